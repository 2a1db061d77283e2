"""The add-on in a real Blender's window: what its start, its clicks and its jobs cost whoever looks at it.

Run where BLENDER names an installed Blender, or MIRROR_SCAN_CHROOT the folder of
``tests/blender/make_blender_chroot.sh``; elsewhere only what the bpy module can tell is measured.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from pathlib import Path
from statistics import median
from types import ModuleType

from .machine import installed, medians, say
from .results import Finding, Result, Table, number, yes

ROOT = Path(__file__).resolve().parents[1]
LIMITS = {  # name of the figure: (what, unit, limit; None: told, for what the others are worth)
    "enable_ms": ("enabling the add-on, fresh Blender", "ms", 50.0),
    "points_shown_s": ("drop a capture, show its 300 k points", "s", 1.0),
    "picking_ms": ("a click when picking, longest", "ms", 30.0),
    "build_own_ms": ("building: longest call into the add-on", "ms", 150.0),
    "second_build_blocks_ms": ("building: longest block of the window, redraws included", "ms", None),
    "redraw_ms": ("one redraw of that window", "ms", None),
    "redraw_without_ms": ("one redraw with the add-on disabled", "ms", None),
    "mesh_ms": ("mesh of 60 k vertices with attributes", "ms", 80.0),
    "first_load_s": ("first capture after installing, kernels compiling", "s", None),
    "first_build_s": ("first build, kernels compiling", "s", None),
    "second_build_s": ("the next build", "s", None),
}
MESH_RUNS = 7


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
        table.notes.append("Without a graphics card most of a block is Blender drawing its window, with or without us.")
    if "points_shown" in figures:
        table.notes.append(f"The cloud has {figures['points_shown']:,} points, the mesh {figures['mesh_vertices']:,}.")
    return Result([table], findings)


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
    from mirror_scan.mirror_scan_addon import scene

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
        bpy.data.meshes.remove(scene.create_avatar(mesh).data)

    spent, _ = medians({"mesh": create}, MESH_RUNS)
    return spent["mesh"]


def _load_runner() -> ModuleType:
    spec = importlib.util.spec_from_file_location("run_in_blender", ROOT / "tests" / "blender" / "run.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
