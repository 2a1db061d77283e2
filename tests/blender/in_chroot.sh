#!/bin/sh
# Run a command in the chroot that make_blender_chroot.sh made, with this checkout at /checkout.
#
#   tests/blender/in_chroot.sh FOLDER COMMAND …
#
# SHARE names a folder that is to be seen there as /share; KEEP lists NAME=value settings for the command.
# The mounts belong to a name space of their own and vanish with the command.
set -eu

if [ $# -lt 2 ]; then
    echo "usage: $0 FOLDER COMMAND ..." >&2
    exit 2
fi
root=$(realpath "$1")
shift
ROOT=$root CHECKOUT=$(realpath "$(dirname "$0")/../..") exec unshare --mount sh -eu -c '
    mkdir -p "$ROOT/checkout" "$ROOT/share" "$ROOT/tmp/home"
    mount -t proc proc "$ROOT/proc"
    mount -t sysfs sysfs "$ROOT/sys"
    mount --rbind /dev "$ROOT/dev"
    mount -t tmpfs tmpfs "$ROOT/dev/shm"
    mount --bind "$CHECKOUT" "$ROOT/checkout"
    mount -o remount,bind,ro "$ROOT/checkout"
    [ -z "${SHARE:-}" ] || mount --bind "$SHARE" "$ROOT/share"
    exec chroot "$ROOT" env -i PATH=/usr/local/bin:/usr/bin:/bin HOME=/tmp/home LANG=C.UTF-8 \
        XDG_RUNTIME_DIR=/tmp/home PYTHONDONTWRITEBYTECODE=1 ${KEEP:-} "$@"
' in_chroot "$@"
