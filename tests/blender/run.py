"""Install the zip in a real Blender with a window and go the whole way in it, with simulated mouse and keyboard.

    BLENDER=/path/to/blender python tests/blender/run.py OUT         an installed Blender; needs a display or Xvfb
    MIRROR_SCAN_CHROOT=/folder python tests/blender/run.py OUT       the one of make_blender_chroot.sh, as root

Screenshots and ``result.json`` are written into OUT. The Python of this script needs the packages of the project.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ADDON = "bl_ext.user_default.mirror_scan"
ABOVE = 500  # rows of our own screen above Blender's main window, where the windows it opens and larger ones reach to
SCREEN = f"1600x{800 + ABOVE}x24"
PLATFORM = {"linux": "linux-x64", "win32": "windows-x64", "darwin": "macos-arm64"}[sys.platform]

PICTURES = (
    "0_install_menu", "1_panel", "2_capture", "3_mirrors", "4_picking", "5_subject", "6_building", "7_avatar",
    "7_walk", "8_error", "8_problem", "9_rig",
)  # fmt: skip
"""Screenshots that the documentation shows."""

STEPS = (
    "1_panel", "1_first_avatar", "2_capture", "3_mirrors", "4_picking", "5_subject", "6_building", "7_avatar", "7_walk",
    "7_look", "8_check", "8_error", "8_problem", "9_rig", "9_two_people",
)  # fmt: skip
"""Those that it shows in both sizes of the window, dark and light."""

START = f"""
import time, json, bpy, addon_utils
started = time.perf_counter()
addon_utils.enable({ADDON!r})
print("FIGURE", json.dumps(1000 * (time.perf_counter() - started)))
"""


class Impossible(Exception):
    """Why there is no such run on this machine."""


@dataclass(frozen=True)
class Place:
    """Where Blender is: on this machine, or in a chroot that sees ``share`` as /share."""

    blender: str
    share: Path
    chroot: Path | None = None

    def run(self, command: Sequence[str], timeout: float, **settings: str) -> subprocess.CompletedProcess:
        """A command beside Blender, in a home of its own; output is kept."""
        home = self.share / "home"
        home.mkdir(exist_ok=True)
        settings |= {"HOME": self.seen(home), "XDG_RUNTIME_DIR": self.seen(home), "LIBGL_ALWAYS_SOFTWARE": "1"}
        environment = dict(os.environ)
        if self.chroot is not None:
            words = [f"{name}={value}" for name, value in settings.items()]
            command = [str(HERE / "in_chroot.sh"), str(self.chroot), "env", *words, *command]
            environment["SHARE"] = str(self.share)
        else:
            environment = {k: v for k, v in environment.items() if k != "NUMBA_CACHE_DIR"} | settings
            environment["BLENDER_USER_RESOURCES"] = str(home)
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", env=environment,
            start_new_session=True,
        )  # fmt: skip
        try:
            said, _ = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            said += f"\nstopped: not done after {timeout:g} s"
        finally:
            if process.poll() is None:  # not the shell alone: Xvfb, Blender and what it started
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return subprocess.CompletedProcess(command, process.returncode, said)

    def seen(self, path: Path) -> str:
        """A path under ``share`` or the checkout, as Blender sees it."""
        if self.chroot is None:
            return str(path)
        if path.is_relative_to(self.share):
            return str(Path("/share") / path.relative_to(self.share))
        return str(Path("/checkout") / path.relative_to(ROOT))


def find_place(share: Path) -> Place:
    """From the environment; raises :class:`Impossible` with what is missing."""
    if blender := os.environ.get("BLENDER"):
        if shutil.which(blender) is None:
            raise Impossible(f"BLENDER={blender} is no program")
        if sys.platform == "linux" and not os.environ.get("DISPLAY") and shutil.which("Xvfb") is None:
            raise Impossible("there is neither a display nor Xvfb")
        return Place(shutil.which(blender), share)
    if chroot := os.environ.get("MIRROR_SCAN_CHROOT"):
        if not (Path(chroot) / "usr" / "bin" / "blender").exists():
            raise Impossible(f"MIRROR_SCAN_CHROOT={chroot} holds no Blender; make it by make_blender_chroot.sh")
        if os.geteuid() != 0:
            raise Impossible("a chroot needs root")
        return Place("blender", share, Path(chroot))
    raise Impossible("neither BLENDER (an installed one) nor MIRROR_SCAN_CHROOT (from make_blender_chroot.sh) is set")


def versions_of(place: Place) -> tuple[str, tuple[int, ...]]:
    """Version of Blender's Python, as 3.13, and its own."""
    code = "import bpy, sys; print('PYTHON', *sys.version_info[:2], *bpy.app.version)"
    done = place.run([place.blender, "--background", "--factory-startup", "--python-expr", code], 120)
    for line in done.stdout.splitlines():
        if line.startswith("PYTHON "):
            major, minor, *own = line.split()[1:]
            return f"{major}.{minor}", tuple(map(int, own))
    raise Impossible(f"{place.blender} does not start:\n{done.stdout[-1000:]}")


def prepare(place: Place) -> None:
    """Build the zip for this Blender, write a capture."""
    zips = place.share / "zips"
    zips.mkdir(exist_ok=True)
    builder = ROOT / "tools" / "extension.py"
    python, version = versions_of(place)
    newer = runpy.run_path(str(ROOT / "tests" / "tried_blenders.py"))["newer_than_tried"](version)
    if newer:
        print(newer, file=sys.stderr)
    limit = ["--any-blender"] if newer else []
    done = subprocess.run(
        [sys.executable, str(builder), "--platform", PLATFORM, "--python", python, *limit,
         "--output", str(zips), "--wheels", os.environ.get("MIRROR_SCAN_WHEELS", str(ROOT / "wheels"))],
        capture_output=True, text=True, env={k: v for k, v in os.environ.items() if k != "BLENDER"},
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stderr)
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))  # makes the checkout the package
    if not (place.share / "capture").exists():
        write_capture(place.share / "capture")
    if not (place.share / "Zoë 2").exists():
        write_capture(place.share / "Zoë 2", height=1.5, seed=2)
    shutil.rmtree(place.share / "wrong", ignore_errors=True)
    wrong = runpy.run_path(str(ROOT / "tests" / "wrong_inputs.py"))
    made = wrong["make_dropped"](place.share / "wrong", place.share / "capture")
    (place.share / "wrong" / "wrong.json").write_text(json.dumps(made), encoding="utf-8")
    wrong["half_size"](place.share / "capture", place.share / "wrong" / "half")


def write_capture(folder: Path, height: float = 1.7, seed: int | None = None) -> None:
    """A virtual capture of a mannequin, nearly 300 000 points in a frame."""
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate, write_simulation

    rig = default_rig(sensor="azure_kinect", mirrors=2, frames=6, seed=3)
    write_simulation(simulate(mannequin(height, seed=seed), rig), folder)


def start_figures(place: Place, runs: int = 3) -> list[float]:
    """Milliseconds that enabling takes, each in a fresh Blender."""
    # As in every start after the first: enabled in the saved preferences, its wheels in place, byte code written.
    keep = f"import addon_utils, bpy; addon_utils.enable({ADDON!r}, default_set=True); bpy.ops.wm.save_userpref()"
    done = place.run([place.blender, "--background", "--python-exit-code", "1", "--python-expr", keep], 120)
    if done.returncode:
        raise RuntimeError(done.stdout)
    spent = []
    for _ in range(runs):
        # Factory settings know no extensions until they are told; only then is the add-on's own time taken.
        done = place.run([place.blender, "--background", "--python-exit-code", "1", "--python-expr",
                          f"import addon_utils; addon_utils.disable({ADDON!r})\n{PURGE}{START}"], 120)  # fmt: skip
        spent += [json.loads(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("FIGURE ")]
        if done.returncode or not spent:
            raise RuntimeError(done.stdout)
    return spent


PURGE = f"import sys; [sys.modules.pop(name) for name in list(sys.modules) if name.startswith({ADDON!r})]\n"


def go(place: Place, out: Path, timeout: float = 2400, looks: bool = False) -> dict:
    """The run in the window; returns what it found, pictures are in ``out``; ``looks``: in both sizes, light and
    dark."""
    inner = place.share / "out"
    inner.mkdir(exist_ok=True)
    (package,) = (place.share / "zips").glob("mirror_scan-*.zip")
    settings = {
        "MIRROR_SCAN_OUT": place.seen(inner),
        "MIRROR_SCAN_CAPTURE": place.seen(place.share / "capture"),
        "MIRROR_SCAN_SECOND": place.seen(place.share / "Zoë 2"),
        "MIRROR_SCAN_ZIP": place.seen(package),
        "MIRROR_SCAN_ID": ADDON,
        "MIRROR_SCAN_WRONG": place.seen(place.share / "wrong"),
        "MIRROR_SCAN_LOOKS": "1" if looks else "",
    }
    blender = [place.blender, "--enable-event-simulate", "--no-window-focus", "--window-geometry", "0", "0", "1280",
               "800", "--python-exit-code", "1", "--python", place.seen(HERE / "window.py")]  # fmt: skip
    own_screen = sys.platform == "linux" and (place.chroot is not None or not os.environ.get("DISPLAY"))
    settings["MIRROR_SCAN_ABOVE"] = str(ABOVE if own_screen else 0)
    if own_screen:
        number = place.seen(place.share / "display")
        script = (
            f"rm -f {number}; "
            f"Xvfb -displayfd 3 -screen 0 {SCREEN} +extension GLX -nolisten tcp 3>{number} 2>/dev/null & x=$!; "
            f"for i in $(seq 100); do [ -s {number} ] && break; sleep 0.1; done; "
            f"DISPLAY=:$(cat {number}) {shlex.join(blender)}; code=$?; kill $x; exit $code"
        )
        blender = ["sh", "-c", script]
    done = place.run(blender, timeout, **settings)
    out.mkdir(parents=True, exist_ok=True)
    (out / "blender.log").write_text(done.stdout, encoding="utf-8")
    for path in inner.iterdir():
        shutil.copy(path, out / path.name)
    if not (inner / "result.json").exists():
        raise RuntimeError(f"Blender ended with {done.returncode} before the end:\n{done.stdout[-3000:]}")
    return json.loads((out / "result.json").read_text(encoding="utf-8")) | {"code": done.returncode}


def run_readme(place: Place) -> subprocess.CompletedProcess:
    """The script of the README in this Blender, without a window; the avatar is written into ``share``."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text[text.index("\n## In Blender\n") :], re.DOTALL).group(1)
    capture = place.share / "without_mirrors"
    if not capture.exists():
        shutil.copytree(place.share / "capture", capture)
        (capture / "mirrors.json").unlink()  # they are found
    code = code.replace("/path/to/my_scan", place.seen(capture)).replace("/path/to/", place.seen(place.share) + "/")
    script = place.share / "build.py"
    script.write_text(code, encoding="utf-8")
    return place.run([place.blender, "--background", "--addons", ADDON, "--python-exit-code", "1",
                      "--python", place.seen(script)], 300)  # fmt: skip


def write_images(place: Place, out: Path, folder: Path) -> None:
    """Pictures for the documentation: the viewport of each screenshot, small, in few colours."""
    inner = place.share / "images"
    inner.mkdir(exist_ok=True)
    window, preferences = "1052x774+0+26", f"876x244+104+{ABOVE - 137}"
    for name in PICTURES:
        source, target = place.share / "out" / f"{name}.png", inner / f"blender_{name}.png"
        cut = preferences if name.startswith("0_") else window
        done = place.run(
            ["convert", place.seen(source), "-crop", cut, "+repage", "-resize", "840x",
             "+dither", "-colors", "120", "-strip", f"png8:{place.seen(target)}"], 60)  # fmt: skip
        if done.returncode:
            raise RuntimeError(done.stdout)
        shutil.copy(target, folder / target.name)
    for name in STEPS:
        sources = [place.seen(place.share / "out" / f"{name}{look}.png")
                   for look in ("", "_1280_light", "_1600_dark", "_1600_light")]  # fmt: skip
        target = inner / f"looks_{name}.png"
        done = place.run(
            ["convert", "(", *sources[:2], "-resize", "560x350!", "+append", ")",
             "(", *sources[2:], "-resize", "560x350!", "+append", ")", "-append",
             "+dither", "-colors", "64", "-strip", f"png8:{place.seen(target)}"], 60)  # fmt: skip
        if done.returncode:
            raise RuntimeError(done.stdout)
        shutil.copy(target, folder / target.name)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder for screenshots and result.json")
    parser.add_argument("--share", type=Path, metavar="FOLDER", help="keep Blender's home there, compiled kernels too")
    parser.add_argument("--images", type=Path, metavar="FOLDER", help="write the documentation's pictures there")
    options = parser.parse_args()
    if options.share is not None:
        options.share.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        share = options.share or stack.enter_context(tempfile.TemporaryDirectory(prefix="mirror_scan_window_"))
        try:
            place = find_place(Path(share).resolve())
        except Impossible as error:
            print(f"not run: {error}", file=sys.stderr)
            return 2
        prepare(place)
        found = go(place, options.out, looks=options.images is not None)
        found["figures"]["enable_ms"] = start_figures(place)
        (options.out / "result.json").write_text(json.dumps(found, indent=1))
        if options.images is not None and found["code"] == 0:
            write_images(place, options.out, options.images)
    print(json.dumps({name: value for name, value in found.items() if name != "events"}, indent=1))
    return found["code"]


if __name__ == "__main__":
    sys.exit(main())
