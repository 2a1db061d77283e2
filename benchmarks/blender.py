"""The add-on in a real Blender's window: what its start, its clicks and its jobs cost the user in time.

Run where BLENDER names an installed Blender, or MIRROR_SCAN_CHROOT the folder of
``tests/blender/make_blender_chroot.sh``; elsewhere only what the bpy module can measure is measured.
"""

from __future__ import annotations

import gc
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from types import ModuleType

from .isolated import PeerFailed, Worker
from .machine import installed, medians, say
from .results import Finding, Result, Table, number, yes

ROOT = Path(__file__).resolve().parents[1]
LIMITS = {  # name of the figure: (what, unit, limit; None: reported only, to put the others in context)
    "enable_ms": ("enabling the add-on, fresh Blender", "ms", 50.0),
    "points_shown_s": ("drop a capture, show its 300 k points", "s", 1.0),
    "points_shown_first_s": ("the same while kernels compile, after installing", "s", None),
    "picking_ms": ("a click when picking, longest", "ms", 30.0),
    "build_own_ms": ("building: longest call into the add-on", "ms", 150.0),
    "build_working_blocks_ms": ("building: longest block of the window until the avatar is there", "ms", 150.0),
    "second_build_blocks_ms": ("the same with the redraw that shows the avatar", "ms", None),
    "live_search_own_ms": ("a setting of the subject moves: longest call into the add-on", "ms", 150.0),
    "redraw_empty_ms": ("one redraw of the window, new file", "ms", None),
    "redraw_points_ms": ("one redraw of the window with the points", "ms", None),
    "redraw_ms": ("one redraw of the window with the avatar", "ms", None),
    "redraw_with_ms": ("one redraw with a rig and points, the add-on at work", "ms", None),
    "redraw_without_ms": ("the same right after, the add-on disabled", "ms", None),
    "mesh_ms": ("mesh of 60 k vertices with attributes", "ms", 80.0),
    "first_load_s": ("first capture after installing, kernels compiling", "s", None),
    "first_build_s": ("the same to the avatar", "s", None),
    "second_build_s": ("the next build", "s", None),
    "one_press_s": ("from a dropped capture to the avatar in one press, kernels ready", "s", 4.0),
}
MESH_RUNS = 7
TURNS = 50  # registrations, and builds that are undone
SETTLED = 10  # turns after which memory has to stand still
AMONG = 7  # turns whose median is taken
GROWTH_MB = 30.0  # that is taken for standing still; were they kept, that many builds would take 200 MB


def run() -> Result:
    table = Table("In Blender", ("what", "where", "measured", "limit", "holds"), left=2)
    findings = []
    figures, where, why_not = in_window()
    if why_not:
        table.notes.append(f"No run in a real Blender: {why_not}.")
        if installed("bpy"):
            figures, where = {"mesh_ms": mesh_in_module()}, "bpy module"
    for name, (what, unit, limit) in LIMITS.items():
        text = f"{what} < {limit:g} {unit}" if limit else what
        asked = f"{limit:g} {unit}" if limit else "–"
        if name not in figures:
            table.rows.append((what, "–", "–", asked, "–"))
            if limit:
                findings.append(Finding(text, why_not or "the run ended before it", None))
            continue
        value = median(figures[name]) if isinstance(figures[name], list) else figures[name]
        shown = f"{number(value, 2 if unit == 's' else 0)} {unit}"
        table.rows.append((what, where, shown, asked, yes(value < limit) if limit else "–"))
        if limit:
            findings.append(Finding(text, shown, value < limit))
    if "redraw_ms" in figures:
        table.notes.append(
            "Without a graphics card most of a block is Blender drawing its window, with or without the add-on."
        )
    if "points_shown" in figures:
        table.notes.append(f"The cloud has {figures['points_shown']:,} points, the mesh {figures['mesh_vertices']:,}.")
    if installed("bpy"):
        table.notes.append(leaks(findings))
    return Result([table], findings)


def leaks(findings: list[Finding]) -> str:
    """Whether registering, building and undoing many times leaves anything behind; says what was done."""
    text = f"{TURNS} registrations and {TURNS} builds with undo: {{}}"
    worker = Worker()
    try:
        found = worker.call(_over_and_over, limit=900.0)
    except PeerFailed as error:
        findings.append(Finding(text.format("nothing left"), str(error), False))
        return f"Registering and building over and over failed: {error}."
    finally:
        worker.stop()
    left = ", ".join(found["left"]) or "nothing"
    findings.append(Finding(text.format("data blocks and handlers left"), left, not found["left"]))
    for name in ("registrations", "builds"):
        grown = found[name]
        what = f"memory that {TURNS - SETTLED} {name} add < {GROWTH_MB:g} MB"
        findings.append(Finding(what, f"{number(grown, 1)} MB", grown < GROWTH_MB))
    return f"{TURNS} registrations and {TURNS} builds with undo, in bpy {found['bpy']}."


def _over_and_over() -> dict:
    """Register, then build and undo, :data:`TURNS` times each, in a process of its own; what is left, and MB added."""
    import bpy
    import mirror_scan

    from .memory import resident

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # every build would be reported

    names = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]

    def count() -> dict[str, int]:
        lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
        handlers = {f"handlers.{name}": len(value) for name, value in lists.items() if isinstance(value, list)}
        return {name: len(getattr(bpy.data, name)) for name in names} | handlers

    def grown(turn: Callable[[], object]) -> float:
        memory = []
        for _ in range(TURNS):
            turn()
            gc.collect()
            memory.append(resident("VmRSS"))
        # a single look may be 25 MB off: malloc gives back what it has when it pleases
        return median(memory[-AMONG:]) - median(memory[SETTLED : SETTLED + AMONG])

    def register() -> None:
        mirror_scan.unregister()
        mirror_scan.register()

    def build() -> None:
        if bpy.ops.mirror_scan.build_avatar() != {"FINISHED"}:
            raise RuntimeError("the build was cancelled")
        bpy.ops.ed.undo_push(message="built")
        bpy.ops.ed.undo()

    with tempfile.TemporaryDirectory() as folder:
        capture = Path(folder) / "capture"
        _load_runner().write_capture(capture)
        mirror_scan.register()
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        bpy.ops.mirror_scan.load_capture(filepath=str(capture))
        bpy.ops.ed.undo_push(message="loaded")
        before = count()
        found = {"registrations": grown(register), "builds": grown(build), "bpy": bpy.app.version_string}
        bpy.data.orphans_purge(do_recursive=True)
        after = count()
    found["left"] = [f"{after[name] - before[name]:+d} {name}" for name in before if after[name] != before[name]]
    return found


def in_window() -> tuple[dict, str, str]:
    """Figures of the run in a window, where it was, and why there was none."""
    runner = _load_runner()
    with tempfile.TemporaryDirectory(prefix="mirror_scan_bench_") as folder:
        try:
            place = runner.find_place(Path(folder) / "share")
        except runner.Impossible as error:
            return {}, "", str(error)
        say("real Blender: build, install, go the whole way; some minutes")
        place.share.mkdir()
        runner.prepare(place)
        found = runner.go(place, Path(folder) / "out")
        if found["code"]:
            say(found.get("error", "the run in Blender failed"))
        return found["figures"] | {"enable_ms": runner.start_figures(place)}, found.get("blender", "Blender"), ""


def mesh_in_module() -> float:
    """Milliseconds for a sheet of 60 000 vertices, in the bpy module."""
    say("mesh into bpy")
    import bpy
    import numpy as np
    from mirror_scan.core.mesh import Mesh
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    n = 245
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        (np.stack((corner, corner + 1, corner + n), 1), np.stack((corner + 1, corner + n + 1, corner + n), 1))
    ).astype(np.int32)
    vertices = np.stack((x, y, 0.1 * np.sin(9 * x)), -1).reshape(-1, 3)
    colors = np.zeros((n * n, 3), np.uint8)
    mesh = Mesh(vertices, triangles, colors, np.zeros(n * n, np.int8), np.zeros(len(triangles), np.int8))

    def create() -> None:
        bpy.data.meshes.remove(avatar_objects.create_avatar(mesh).data)

    spent, _ = medians({"mesh": create}, MESH_RUNS)
    return spent["mesh"]


def _load_runner() -> ModuleType:
    spec = importlib.util.spec_from_file_location("run_in_blender", ROOT / "tests" / "blender" / "run.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
