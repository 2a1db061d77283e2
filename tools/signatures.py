"""List the kernels that the add-on compiles beforehand, with their types: mirror_scan_addon/signatures.json.

    python tools/signatures.py

Goes the whole way with virtual captures of two cameras, then compiles what was called into an empty cache, to know how
long each takes; some minutes. To be run again when kernels came or went, as
``tests/addon/background/test_kernel_compilation.py`` says.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import pickle
import runpy
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    if sys.argv[1:] == ["measure"]:
        return measure(kernel_compilation)
    walks = {"way": walk, kernel_compilation.RIG: walk_rig, kernel_compilation.AVATAR: walk_avatar}
    if len(sys.argv) == 2:
        found = walks[sys.argv[1]](kernel_compilation)
        print(json.dumps([list(entry) for entry in found]))
        return 0
    if sys.argv[1:2] == ["built"]:
        return build(sys.argv[2])
    if len(sys.argv) == 3:
        return simulate(Path(sys.argv[2]), sys.argv[1])
    listed = called("way")
    # Each in a process of its own: what it calls of the stages that it does not stand on has to be in its list too.
    for way, stages in kernel_compilation.SIDE_WAYS.items():
        before = {json.dumps(entry[1:4]) for entry in listed if entry[0] in stages}
        listed += [entry for entry in called(way) if json.dumps(entry[1:4]) not in before]
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, __file__, "measure"], input=json.dumps(listed), text=True, stdout=subprocess.PIPE,
            env=os.environ | {"NUMBA_CACHE_DIR": cache}, check=True,
        )  # fmt: skip
    listed = json.loads(done.stdout)
    # within a stage the longest first: processes that share the list end together then
    stages = (*kernel_compilation.STAGES, *kernel_compilation.SIDE_WAYS)
    listed.sort(key=lambda entry: (stages.index(entry[0]), -entry[4]))
    lines = ",\n".join(json.dumps(entry) for entry in listed)
    kernel_compilation.SIGNATURES.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    print(f"{len(listed)} kernels, {sum(entry[4] for entry in listed):.0f} s one after the other")
    return 0


def called(which: str) -> list:
    """Entries of one way, gone twice: a kernel that only others call shows where it is compiled with them, but not
    where they come from the cache."""
    for _ in range(2):
        done = subprocess.run([sys.executable, __file__, which], text=True, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def walk(compiling) -> list:
    """An entry for each kernel that is called on the way, under the stage that calls it first."""
    from mirror_scan.core.pipeline import finish
    from mirror_scan.mirror_scan_addon import tasks

    found: dict[tuple, compiling.Entry] = {}
    with tempfile.TemporaryDirectory() as folder:
        captures = []
        for sensor in ("azure_kinect", "kinect_v1"):
            captures.append(Path(folder) / sensor)
            # in a process of its own, so that what it calls is not listed
            simulated = [sys.executable, __file__, sensor, str(captures[-1])]
            subprocess.run(simulated, stdout=subprocess.DEVNULL, check=True)

        def look(stage: str) -> None:
            gather(compiling, stage, found)

        loaded = [finish(tasks.load_steps(str(capture), 0)) for capture in captures]
        look("load")
        for one in loaded:
            finish(tasks.find_mirrors_steps(one.depth, one.color, one.intrinsics, 0.0))
            finish(tasks.fit_steps(one.depth, one.intrinsics, one.mirrors, 0.0))
        look("mirrors")
        one = loaded[0]
        placed = finish(tasks.find_mirrors_steps(one.depth, one.color, one.intrinsics, 0.0))
        finish(tasks.find_subject_steps(one.depth, one.intrinsics, placed.mirrors, {}))
        look("subject")
        for capture in captures:
            built = finish(tasks.build_steps(str(capture), 0))
            finish(tasks.check_steps(built.mesh))
        look("build")
    return list(found.values())


def walk_rig(compiling) -> list:
    """Entries for what a virtual scan calls, of the mannequin and of a body that is given."""
    from mirror_scan.core.pipeline import finish
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.sensors import SENSORS
    from mirror_scan.mirror_scan_addon import tasks

    usual = {"sensor": "azure_kinect", "frames": 2, "seed": 0}
    finish(tasks.simulate_steps(None, usual, None))
    body = mannequin()
    mirrors = [dataclasses.asdict(mirror) for mirror in default_rig().mirrors]
    placed = {"camera": (0.0, -2.5, 1.0), "pan_deg": 0.0, "tilt_deg": 0.0, "roll_deg": 0.0, "room": None}
    for sensor in SENSORS:
        finish(tasks.simulate_steps(body, usual | placed | {"sensor": sensor}, mirrors))
    found: dict[tuple, compiling.Entry] = {}
    gather(compiling, compiling.RIG, found)
    return list(found.values())


def walk_avatar(compiling) -> list:
    """Entries for what skeleton and texture call, on an avatar that another process has built."""
    from mirror_scan.core.pipeline import finish
    from mirror_scan.mirror_scan_addon import tasks

    found: dict[tuple, compiling.Entry] = {}
    with tempfile.TemporaryDirectory() as folder:
        simulated = [sys.executable, __file__, "azure_kinect", folder]
        subprocess.run(simulated, stdout=subprocess.DEVNULL, check=True)
        built = subprocess.run([sys.executable, __file__, "built", folder], stdout=subprocess.PIPE, check=True)
        mesh, source = pickle.loads(built.stdout)
        rigged = finish(tasks.skeleton_steps(mesh))
        finish(tasks.texture_steps(rigged.mesh, rigged.weights, source, {"size": 1024}))
        finish(tasks.texture_steps(mesh, None, source, {"size": 1024, "remove_light": True}))
        gather(compiling, compiling.AVATAR, found)
    return list(found.values())


def gather(compiling, stage: str, found: dict) -> None:
    """Put down what was called and is not there yet, under a stage."""
    for module, kernel, signature in compiling.called("mirror_scan"):
        key = (module, kernel, str(signature))
        if key in found:
            continue
        try:
            types = [compiling.describe(kind) for kind in signature]
        except TypeError:  # such as other kernels call it with, and compile with themselves
            continue
        found[key] = compiling.Entry(stage, module, kernel, types, 0.0)


def simulate(folder: Path, sensor: str) -> int:
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate, write_simulation

    write_simulation(simulate(mannequin(), default_rig(sensor=sensor, mirrors=2, frames=4)), folder)
    return 0


def build(capture: str) -> int:
    """The avatar of a capture and what it came from, pickled to standard output."""
    from mirror_scan.core.pipeline import finish
    from mirror_scan.mirror_scan_addon import tasks

    with contextlib.redirect_stdout(sys.stderr):
        built = finish(tasks.build_steps(capture, 0))
    source = tasks.Source(capture, 0, {}, built.mirrors, built.report["camera_to_avatar"], None)
    sys.stdout.buffer.write(pickle.dumps((built.mesh, source)))
    return 0


def measure(compiling) -> int:
    """Entries from standard input, with the seconds that each takes to compile."""
    measured = []
    for entry in (compiling.Entry(*item) for item in json.load(sys.stdin)):
        start = time.perf_counter()
        compiling._compile(entry)
        measured.append([*entry[:4], round(time.perf_counter() - start, 2)])
    print(json.dumps(measured))
    return 0


if __name__ == "__main__":
    sys.exit(main())
