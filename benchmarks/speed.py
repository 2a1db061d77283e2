"""Depth frames in memory to closed mesh: time by stage, against Open3D's Poisson on the same points; peak memory."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.pipeline import reconstruct

from .machine import installed, say
from .peers import OPEN3D, open3d_poisson
from .quality import oriented_points
from .results import Finding, Result, Table, number
from .scenes import Scene, scenes

RUNS = 7
PEER_EVERY = 3
"""The peer is slower; it takes its turn in every third round only."""
STAGES = ("depth", "mirrors", "views", "smoothing", "triangulation", "overlap", "zippering", "seams", "closing")
MAX_MS, MAX_SURFACE_MS, MIN_RATIO, MAX_MB = 300.0, 80.0, 5.0, 500.0
SMALL = (480, 640)
ROOT = Path(__file__).resolve().parents[1]


def run() -> Result:
    table = Table(
        "Speed: depth frames in memory to closed mesh [ms]",
        ("capture", "pixels", "frames", *STAGES, "total", OPEN3D, "ratio", "surface step's"),
    )
    table.notes = [
        f"Medians of {RUNS} runs, {-(-RUNS // PEER_EVERY)} of {OPEN3D}, in turn. Total: all but the final check.",
        f"Ratio: {OPEN3D}, its call alone on our oriented points, over our total; then over zippering + closing alone.",
    ]
    totals: dict[str, float | None] = {}
    surfaces: dict[str, float] = {}
    ratios: dict[str, float] = {}
    for scene in scenes():
        say(f"speed: {scene.name}")
        height, width = scene.capture.depth.shape[1:]
        label = (scene.name, f"{width}x{height}", str(len(scene.capture.depth)))
        try:
            stages, total, peer = _time(scene)
        except MirrorScanError as error:
            totals[scene.name] = None
            table.rows.append((*label, *["–"] * (len(table.columns) - len(label))))
            table.notes.append(f"{scene.name} failed: {error}")
            continue
        totals[scene.name] = total
        surfaces[scene.name] = stages["zippering"] + stages["closing"]
        cells = [number(stages[name], 0) for name in STAGES] + [number(total, 0)]
        if peer is None:
            cells += ["not installed", "–", "–"]
        else:
            ratios[scene.name] = peer / total
            cells += [number(peer, 0), number(peer / total, 1), number(peer / surfaces[scene.name], 1)]
        table.rows.append((*label, *cells))
    memory, worst = _memory()
    return Result([table, memory], _findings(totals, surfaces, ratios) + [worst])


def _time(scene: Scene) -> tuple[dict[str, float], float, float | None]:
    points, normals = oriented_points(reconstruct(scene.capture))
    with_peer = installed("open3d")
    ours, theirs = [], []
    for k in range(RUNS):
        laps = reconstruct(scene.capture).report["timings_ms"]
        if set(laps) - {"checking"} != set(STAGES):
            raise RuntimeError(f"the pipeline's stages are {', '.join(laps)}; bring benchmarks/speed.py up to date")
        ours.append({name: laps[name] for name in STAGES})
        if with_peer and k % PEER_EVERY == 0:
            theirs.append(open3d_poisson(points, normals)[0][1])
    stages = {name: median(laps[name] for laps in ours) for name in STAGES}
    return stages, median(sum(laps.values()) for laps in ours), median(theirs) if theirs else None


def _memory() -> tuple[Table, Finding]:
    """Peak memory in a fresh process each, for one Kinect v1 and one Azure Kinect capture of each origin."""
    table = Table("Speed: memory [MB]", ("capture", "frames as held", "first run", "warm run", "process at its peak"))
    table.notes = [
        "Peak of the resident memory during reconstruct() above what was resident before, in a fresh process.",
        "The first run also loads the compiled kernels from numba's cache.",
    ]
    limit = f"peak extra memory < {MAX_MB:g} MB"
    peaks: dict[str, float] = {}
    for scene in scenes():
        if "kinect" not in scene.name and "azure" not in scene.name:
            continue
        say(f"memory: {scene.name}")
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "capture.pickle"
            file.write_bytes(pickle.dumps(scene.capture))
            command = [sys.executable, "-m", "benchmarks.memory", str(file)]
            done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        said = json.loads(done.stdout)
        if "missing" in said:
            table.notes.append(said["missing"])
            return table, Finding(limit, said["missing"], None)
        if "failed" in said:
            table.notes.append(f"{scene.name} failed: {said['failed']}")
            peaks[scene.name] = float("inf")
            continue
        peaks[scene.name] = max(said["first"], said["warm"])
        columns = (said["held"], said["first"], said["warm"], said["peak"])
        table.rows.append((scene.name, *(number(v, 0) for v in columns)))
    worst = max(peaks, key=peaks.get)
    failed = peaks[worst] == float("inf")
    text = f"{worst} failed" if failed else f"worst {peaks[worst]:.0f} MB, {worst}"
    return table, Finding(limit, text, peaks[worst] < MAX_MB)


def _findings(totals: dict[str, float | None], surfaces: dict[str, float], ratios: dict[str, float]) -> list[Finding]:
    small = [s.name for s in scenes() if s.capture.depth.shape[1:] == SMALL]
    slow = [name for name in small if totals[name] is None or totals[name] >= MAX_MS]
    text = ", ".join(f"{name} {number(totals[name], 0)}" for name in small) + " ms"
    found = [Finding(f"640x480: depth frames to closed mesh < {MAX_MS:g} ms", text, not slow)]
    slow = [name for name in small if surfaces.get(name, float("inf")) >= MAX_SURFACE_MS]
    text = ", ".join(f"{name} {number(surfaces.get(name), 0)}" for name in small) + " ms"
    found.append(Finding(f"640x480: zippering + closing < {MAX_SURFACE_MS:g} ms", text, not slow))
    limit = f"whole job >= {MIN_RATIO:g} x faster than {OPEN3D}"
    if not ratios:
        return found + [Finding(limit, "Open3D is not installed" if not installed("open3d") else "nothing", None)]
    worst = min(ratios, key=ratios.get)
    text = f"{sum(r >= MIN_RATIO for r in ratios.values())} of {len(totals)}; worst {ratios[worst]:.1f} x, {worst}"
    return found + [Finding(limit, text, len(ratios) == len(totals) and ratios[worst] >= MIN_RATIO)]
