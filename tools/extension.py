"""Build the Blender extension: zips for each platform, with the wheels that Blender's Python lacks.

    python tools/extension.py [--platform linux-x64 …] [--python 3.13 …] [--output dist] [--bare]

One zip a platform holds the wheels for the Pythons of blender.org's Blenders, another those for Python 3.14, which
distributions such as Debian build Blender with. If wheels for another one do not exist, it is left out and the reason
printed.
Wheels are those pinned in ``wheels.txt``; pip fetches them once into ``wheels/`` and checks their hashes each time.
Zips are built and validated by Blender's own tool: that of the program $BLENDER (or ``--blender``), or the one inside
the bpy module of this Python. Where there is neither, the zip is written here and only :func:`check` has seen it.
"""

from __future__ import annotations

import argparse
import functools
import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PINS = Path(__file__).with_name("wheels.txt")
MANIFEST = "blender_manifest.toml"
SHIPPED_FILES = ("__init__.py", "LICENSE")
SHIPPED_FOLDERS = ("core", "mirror_scan_addon")
# What in them is no Python.
SHIPPED_DATA = (
    "core/avatar/joints/body_template.npz",
    "core/avatar/weight_fields.npz",
    "core/batches/small_capture.npz",
    "mirror_scan_addon/signatures.json",
    "mirror_scan_addon/messages.json",
)
LEFT_OUT = ("__pycache__", "*.py[co]", "*.nb[ci]", ".*")
HELP = "mirror_scan_addon/help"
"""Folder of the help pages in a zip; ``pages.py`` makes them."""

ZIPS = {"": ("3.11", "3.13"), "-python3.14": ("3.14",)}
"""End of a zip's name → the Pythons it has wheels for: Blender 4.5, 5.0 and 5.1 onwards; Debian's Blender. The add-on
names the zip that fits (``mirror_scan_addon/background/numba_setup.py``)."""


@dataclass(frozen=True)
class Platform:
    """``pip`` names it for downloads, ``wheel`` is what names of its wheels end in."""

    pip: tuple[str, ...]
    wheel: re.Pattern


PLATFORMS = {
    "windows-x64": Platform(("win_amd64",), re.compile(r"-win_amd64\.whl$")),
    "linux-x64": Platform(
        ("manylinux_2_27_x86_64", "manylinux_2_28_x86_64"), re.compile(r"-manylinux_[\w.]+_x86_64\.whl$")
    ),
    "macos-arm64": Platform(("macosx_12_0_arm64",), re.compile(r"-macosx_\d+_\d+_arm64\.whl$")),
}


class BuildError(Exception):
    """What went wrong and what to do, for people."""


class NoWheelError(BuildError):
    """The package index has no such wheel."""


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--platform", nargs="+", choices=tuple(PLATFORMS), default=list(PLATFORMS))
    parser.add_argument(
        "--python", nargs="+", metavar="3.x", help="only zips with wheels for these Pythons, and only those wheels"
    )
    parser.add_argument("--output", type=Path, default=ROOT / "dist", metavar="FOLDER")
    parser.add_argument("--wheels", type=Path, default=ROOT / "wheels", metavar="FOLDER", help="where wheels are kept")
    parser.add_argument("--blender", default=os.environ.get("BLENDER"), help="this program's own builder")
    parser.add_argument(
        "--any-blender", action="store_true", help=f"without blender_version_max of {MANIFEST}: to try a newer Blender"
    )
    parser.add_argument("--bare", action="store_true", help="one zip for all, without wheels: for a Blender with numba")
    options = parser.parse_args(argv)
    try:
        tool = find_tool(options.blender)
        if options.bare:
            _print_sizes(build([], [], options.output, tool, any_blender=options.any_blender))
        for ending, pythons in () if options.bare else _zips(options.python).items():
            wheels, platforms = [], []
            for platform in options.platform:
                try:
                    wheels += fetch([platform], pythons, options.wheels)
                    platforms.append(platform)
                except NoWheelError as error:
                    if not ending:  # that one has to be there
                        raise
                    print(f"left out: the zip for {platform}, Python {', '.join(pythons)}: {error}", file=sys.stderr)
            if platforms:
                _print_sizes(build(wheels, platforms, options.output, tool, ending, options.any_blender))
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if tool is None:
        print("no Blender and no bpy module here: Blender's own builder and validation were left out", file=sys.stderr)
    return 0


def _zips(wanted: list[str] | None) -> dict[str, list[str]]:
    """Of :data:`ZIPS` those with a Python that is ``wanted``, and only these Pythons; all when nothing is asked for."""
    known = [python for pythons in ZIPS.values() for python in pythons]
    if strange := sorted(set(wanted or ()) - set(known)):
        raise BuildError(f"there is no zip for Python {', '.join(strange)}; there are for {', '.join(known)}")
    chosen = {ending: [p for p in pythons if p in (wanted or known)] for ending, pythons in ZIPS.items()}
    return {ending: pythons for ending, pythons in chosen.items() if pythons}


def _print_sizes(paths: list[Path]) -> None:
    for path in paths:
        print(f"{path}  {path.stat().st_size / 1e6:.1f} MB")


def pins() -> dict[str, str]:
    """Package → version, as ``wheels.txt`` pins them."""
    return dict(re.findall(r"^([\w-]+)==([\w.]+)", PINS.read_text(encoding="utf-8"), re.MULTILINE))


def fetch(platforms: list[str], pythons: list[str], folder: Path) -> list[Path]:
    """The pinned wheels, from ``folder`` or else the package index; returns those asked for.

    Raises
    ------
    NoWheelError
        When there is no such wheel.
    BuildError
        When pip fails otherwise: a hash is not in ``wheels.txt``, the index cannot be reached.
    """
    found = []
    for platform in platforms:
        for python in pythons:
            with tempfile.TemporaryDirectory() as fresh:
                command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:"]
                command += ["--require-hashes", "-r", str(PINS), "--implementation", "cp", "--python-version", python]
                command += [word for name in PLATFORMS[platform].pip for word in ("--platform", name)]
                here = _wheels_of(platform, python, folder)
                offline = ["--no-index", "--find-links", str(folder)] if len(here) == len(pins()) else []
                done = subprocess.run([*command, *offline, "-d", fresh], capture_output=True, text=True)
                if done.returncode:
                    said = "\n".join(line for line in done.stderr.splitlines() if line.startswith("ERROR"))
                    none = "No matching distribution found" in said and "Retrying" not in done.stderr
                    raise (NoWheelError if none else BuildError)(
                        f"pip cannot get the wheels for {platform}, Python {python}:\n{said or done.stderr}\n"
                        f"If a file in {folder} is damaged, delete it; versions and hashes are in {PINS.name}"
                    )
                folder.mkdir(parents=True, exist_ok=True)
                for wheel in Path(fresh).glob("*.whl"):
                    if not (folder / wheel.name).exists():
                        shutil.move(wheel, folder / wheel.name)
            here = _wheels_of(platform, python, folder)
            if len(here) != len(pins()):
                raise BuildError(f"{folder}: wheels for {platform}, Python {python} are {[w.name for w in here]}")
            found += here
    return found


def _wheels_of(platform: str, python: str, folder: Path) -> list[Path]:
    tag = "-cp" + python.replace(".", "") + "-"
    return [
        wheel
        for package, version in sorted(pins().items())
        for wheel in sorted(folder.glob(f"{package}-{version}-*.whl"))
        if tag in wheel.name and PLATFORMS[platform].wheel.search(wheel.name)
    ]


def find_tool(blender: str | None) -> list[str] | None:
    """The command that takes ``build …`` and ``validate …``: of a Blender, of the bpy module, or None."""
    if blender:
        found = shutil.which(blender)
        if found is None:
            raise BuildError(f"{blender}: there is no such program; BLENDER must name Blender's executable")
        return [found, "--factory-startup", "--command", "extension"]
    bpy = importlib.util.find_spec("bpy")
    for folder in (bpy.submodule_search_locations or ()) if bpy else ():
        for script in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return [sys.executable, "-S", str(script)]
    return None


def build(
    wheels: list[Path],
    platforms: list[str],
    output: Path,
    tool: list[str] | None,
    ending: str = "",
    any_blender: bool = False,
) -> list[Path]:
    """Zips in ``output``, one a platform, or one in all when ``platforms`` is empty; all of them checked.

    ``ending`` is a key of :data:`ZIPS`, and comes at the end of their names. ``any_blender`` leaves out the manifest's
    limit to Blenders that somebody has tried.
    """
    with tempfile.TemporaryDirectory(prefix="mirror_scan_") as temporary:
        source, made = Path(temporary) / "source", Path(temporary) / "made"
        made.mkdir()
        stage(source, wheels, platforms, any_blender)
        if tool is not None:
            split = ["--split-platforms"] if platforms else []
            _run([*tool, "build", "--source-dir", str(source), "--output-dir", str(made), *split])
        else:
            _write_zips(source, made, platforms)
        zips = sorted(made.glob("*.zip"))
        if len(zips) != max(1, len(platforms)):
            raise BuildError(f"made {[path.name for path in zips]} for {platforms}")
        for path in zips:
            check(path)
            if path_tags := _pythons_in(path):
                unasked = path_tags - {"cp" + python.replace(".", "") for python in ZIPS[ending]}
                if unasked:
                    raise BuildError(f"{path.name}: holds wheels for {sorted(unasked)}, not for this zip")
            if tool is not None:
                _run([*tool, "validate", str(path)])
        output.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(path, output / f"{path.stem}{ending}.zip")) for path in zips]


def _pythons_in(path: Path) -> set[str]:
    """Tags of the Pythons that a zip has wheels for, such as cp313."""
    with zipfile.ZipFile(path) as archive:
        return {name.split("-")[2] for name in archive.namelist() if name.startswith("wheels/") and "-" in name}


def stage(target: Path, wheels: list[Path], platforms: list[str], any_blender: bool = False) -> None:
    """Copy what is shipped, and name wheels and platforms in the copy's manifest."""
    target.mkdir(parents=True)
    for name in SHIPPED_FILES:
        shutil.copy2(ROOT / name, target / name)
    for name in SHIPPED_FOLDERS:
        shutil.copytree(ROOT / name, target / name, ignore=shutil.ignore_patterns(*LEFT_OUT))
    pages = _tool("pages.py")
    try:
        pages["write_pages"](target / HELP)
    except pages["PageError"] as error:
        raise BuildError(f"help: {error}") from error
    tool = _tool("messages.py")
    tool["write_list"](target / tool["LIST"].relative_to(ROOT))  # the one in the checkout may lag behind
    text = (ROOT / MANIFEST).read_text(encoding="utf-8")
    if wheels:
        (target / "wheels").mkdir()
        for wheel in wheels:
            (target / "wheels" / wheel.name).symlink_to(wheel.resolve())
        listed = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
        text = _replace_list(text, "platforms", f"platforms = {_toml_list(platforms)}\nwheels = [\n{listed}]")
    if any_blender:
        text = re.sub(r"^blender_version_max = .*\n", "", text, flags=re.MULTILINE)
    (target / MANIFEST).write_text(text, encoding="utf-8")


def _toml_list(items: list[str]) -> str:
    return "[" + ", ".join(f'"{item}"' for item in items) + "]"


@functools.cache
def _tool(name: str) -> dict:
    """What another of these tools defines; it may remember between two zips what it has read."""
    return runpy.run_path(str(Path(__file__).with_name(name)))


def _replace_list(text: str, key: str, line: str) -> str:
    changed, count = re.subn(rf"^{key} = \[[^\]]*\]", lambda _: line, text, flags=re.MULTILINE)
    if count != 1:
        raise BuildError(f"{MANIFEST}: must have one line “{key} = […]”, has {count}")
    return changed


def _run(command: list[str]) -> None:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    # An error of Blender's tool does not always reach its exit code.
    if done.returncode or re.search(r"^(ERROR|FATAL_ERROR|Error)\b", done.stdout, re.MULTILINE):
        raise BuildError(f"{' '.join(command)} failed:\n{done.stdout}")


def _write_zips(source: Path, made: Path, platforms: list[str]) -> None:
    """What Blender's builder does with a staged folder: the files of one platform, and the manifest made to match."""
    text = (source / MANIFEST).read_text(encoding="utf-8")
    version = tomllib.loads(text)["version"]
    for platform in platforms or [""]:
        wheels = [w for w in sorted(source.glob("wheels/*")) if platform and PLATFORMS[platform].wheel.search(w.name)]
        mine = text
        if platform:
            listed = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
            mine = _replace_list(mine, "platforms", f'platforms = ["{platform}"]')
            mine = _replace_list(mine, "wheels", f"wheels = [\n{listed}]")
        name = "-".join(filter(None, ("mirror_scan", version, platform.replace("-", "_")))) + ".zip"
        with zipfile.ZipFile(made / name, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            archive.writestr(MANIFEST, mine)
            for path in sorted(source.rglob("*")):
                if path.is_file() and path.name != MANIFEST and "wheels" not in path.parts:
                    archive.write(path, path.relative_to(source).as_posix())
            for wheel in wheels:  # zips themselves
                archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)


def check(path: Path) -> dict:
    """Hold a zip against what its manifest says and what extensions may contain; returns the manifest.

    Blender's validation does not look at these: a platform without wheels, files nobody needs, a text too long.

    Raises
    ------
    BuildError
        Names the zip and what is wrong with it.
    """

    def demand(holds: bool, what: str) -> None:
        if not holds:
            raise BuildError(f"{path.name}: {what}")

    with zipfile.ZipFile(path) as archive:
        demand(archive.testzip() is None, "is damaged")
        names = {name for name in archive.namelist() if not name.endswith("/")}
        demand(MANIFEST in names, f"has no {MANIFEST}")
        manifest = tomllib.loads(archive.read(MANIFEST).decode("utf-8"))
        manifest |= manifest.get("build", {}).get("generated", {})  # what splitting by platform leaves of two lists
        sources = {ROOT / folder for folder in SHIPPED_FOLDERS}
        shipped = {file.relative_to(ROOT).as_posix() for folder in sources for file in folder.rglob("*.py")}
        ours = re.compile(rf"(core|mirror_scan_addon)/[\w/]+\.py|wheels/[^/]+\.whl|{HELP}/(images/)?[^/]+")
        strange = [name for name in names if not ours.fullmatch(name)]
        languages = {file.relative_to(ROOT).as_posix() for file in ROOT.glob("mirror_scan_addon/languages/*.po")}
        known = {MANIFEST, *SHIPPED_FILES, *SHIPPED_DATA, *languages}
        demand(set(strange) == known, f"holds {sorted(set(strange) - known)}, lacks {sorted(known - set(strange))}")
        demand(shipped <= names, f"lacks {sorted(shipped - names)}")
        demand(f"{HELP}/blender.html" in names, "has no help pages")
    texts = {"tagline": manifest["tagline"], **manifest.get("permissions", {})}
    for key, text in texts.items():
        demand(len(text) <= 64 and text[-1].isalnum(), f"{key} must have up to 64 characters and no full stop")
    for key in ("version", "blender_version_min"):
        demand(re.fullmatch(r"\d+\.\d+\.\d+", manifest[key]) is not None, f"{key} must be three numbers")
    demand(all(name.startswith("SPDX:") for name in manifest["license"]), "licence is not an SPDX name")
    wheels = {name.removeprefix("./") for name in manifest.get("wheels", ())}
    demand(wheels == {name for name in names if name.startswith("wheels/")}, "lists other wheels than it holds")
    if not wheels:
        return manifest
    (platform,) = manifest["platforms"]
    demand(all(PLATFORMS[platform].wheel.search(name) for name in wheels), f"holds wheels for others than {platform}")
    found = sorted(tuple(name.removeprefix("wheels/").split("-")[:3]) for name in wheels)
    for python in {tag for _, _, tag in found}:
        mine = [(package, version) for package, version, tag in found if tag == python]
        demand(mine == sorted(pins().items()), f"for {python} it holds {mine}")
    return manifest


if __name__ == "__main__":
    sys.exit(main())
