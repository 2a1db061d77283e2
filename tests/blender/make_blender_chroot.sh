#!/bin/sh
# A real Blender to test in, on Debian or its kin, from Debian's packages alone; as root, 1.6 GB, a few minutes.
#
#   tests/blender/make_blender_chroot.sh FOLDER
#   tests/blender/in_chroot.sh FOLDER blender --version
#
# Elsewhere install Blender from blender.org and set BLENDER to its executable.
set -eu

if [ $# -ne 1 ]; then
    echo "usage: $0 FOLDER" >&2
    exit 2
fi
if [ "$(id -u)" -ne 0 ]; then
    echo "error: needs root, for debootstrap and chroot" >&2
    exit 1
fi
root=$1
suite=${SUITE:-sid}
run() {
    chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"
}

command -v debootstrap >/dev/null || apt-get install -y debootstrap
[ -e "$root/etc/debian_version" ] || debootstrap --variant=minbase "$suite" "$root"
# Debian's package does not ask for numpy, nor for what Blender's own extension manager imports.
run apt-get install -y --no-install-recommends blender xvfb libgl1-mesa-dri libegl1 imagemagick \
    python3-numpy python3-requests python3-zstandard python3-attr python3-typing-extensions

# What blender.org's builds have and Debian's lacks comes as wheels: cattrs for the extension manager, OpenImageIO for us.
python=$(run python3 -c 'import sys; print(f"{sys.version_info[0]}.{sys.version_info[1]}")')
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
python3 -m pip download -q --no-deps --only-binary=:all: --python-version "$python" --implementation cp \
    --platform manylinux_2_28_x86_64 --platform manylinux_2_27_x86_64 --platform any \
    -d "$wheels" cattrs OpenImageIO
packages=$root/usr/local/lib/python$python/dist-packages
mkdir -p "$packages"
for wheel in "$wheels"/*.whl; do
    python3 -m zipfile -e "$wheel" "$packages"
done

ln -sf /proc/self/mounts "$root/etc/mtab"
mkdir -p -m 1777 "$root/tmp/.X11-unix"
run blender --version | head -n 1
