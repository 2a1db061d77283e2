"""How zippering and closing grow with the boundary's length, and the memory for matching two very long boundaries.

The memory is measured in a fresh process: ``python -m benchmarks.growth N`` prints it [MB] and the time [s] as JSON.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh.half_edges import open_edges
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.zippering.dtw import dtw

from .machine import say
from .memory import CLEAR, extra_peak
from .results import Finding, Result, Table, number

SCALES = (0.5, 0.71, 1.0, 1.41, 2.0)
"""Of 640 × 480."""
RUNS = 5
MAX_EXPONENT = 2.0
LONG, MAX_MB = 20_000, 256.0
ROOT = Path(__file__).resolve().parents[1]
STEPS = ("zippering", "closing")


def run() -> Result:
    table = Table(
        "Growth with resolution: the same scene, ideal sensor [ms]",
        ("pixels", "boundary vertices", *STEPS, "together", "per 1000 vertices"),
    )
    body = mannequin()
    lengths, times = [], []
    for scale in SCALES:
        rig = default_rig("ideal", frames=1)
        intrinsics = _scaled(rig.intrinsics, scale)
        say(f"growth: {intrinsics.width} x {intrinsics.height}")
        capture = simulate(body, replace(rig, intrinsics=intrinsics)).capture
        try:
            reconstruct(capture, frame="camera")
            scans = [reconstruct(capture, frame="camera") for _ in range(RUNS)]
        except MirrorScanError as error:
            table.notes.append(f"{intrinsics.width} x {intrinsics.height} failed: {error}")
            continue
        boundary = sum(len(open_edges(patch.triangles, len(patch.vertices))) for patch in scans[0].patches)
        laps = [median(scan.report["timings_ms"][step] for scan in scans) for step in STEPS]
        lengths.append(boundary)
        times.append(laps)
        cells = [number(value, 1) for value in (*laps, sum(laps), 1000 * sum(laps) / boundary)]
        table.rows.append((f"{intrinsics.width}x{intrinsics.height}", str(boundary), *cells))
    failed = len(lengths) < len(SCALES)
    fitted = [_exponent(lengths, [lap[k] for lap in times]) for k in range(len(STEPS))]
    together = _exponent(lengths, [sum(lap) for lap in times])
    table.notes += [
        f"Medians of {RUNS} warm runs. Time ~ boundary vertices ^ exponent, fitted to the logarithms: "
        + ", ".join(f"{step} {value:.2f}" for step, value in zip(STEPS, fitted, strict=True))
        + f", together {together:.2f}.",
        "Closing also works on the surface around the seams, whose vertices grow with the boundary's square.",
    ]
    limit = f"zippering + closing grow at most with the boundary's power {MAX_EXPONENT:g}"
    findings = [Finding(limit, f"power {together:.2f}", together <= MAX_EXPONENT and not failed), _long_match()]
    return Result([table], findings)


def _scaled(intrinsics: Intrinsics, scale: float) -> Intrinsics:
    width, height = round(intrinsics.width * scale), round(intrinsics.height * scale)
    return replace(
        intrinsics, width=width, height=height, fx=intrinsics.fx * scale, fy=intrinsics.fy * scale,
        cx=(intrinsics.cx + 0.5) * width / intrinsics.width - 0.5,
        cy=(intrinsics.cy + 0.5) * height / intrinsics.height - 0.5,
    )  # fmt: skip


def _exponent(lengths: list[int], times: list[float]) -> float:
    if len(lengths) < 2:
        return float("nan")
    return float(np.polyfit(np.log(lengths), np.log(times), 1)[0])


def _long_match() -> Finding:
    limit = f"DTW of {LONG} x {LONG} vertices: extra memory < {MAX_MB:g} MB"
    if not CLEAR.exists():
        return Finding(limit, "memory is measured on Linux only", None)
    say(f"growth: DTW {LONG} x {LONG}")
    command = [sys.executable, "-m", "benchmarks.growth", str(LONG)]
    said = json.loads(subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout)
    matrix = 8 * LONG**2 / 1e6
    text = f"{said['megabytes']:.0f} MB in {said['seconds']:.1f} s; a float64 matrix would be {matrix:.0f} MB"
    return Finding(limit, text, said["megabytes"] < MAX_MB)


def _measure_match(count: int) -> dict[str, float]:
    """Two random walks as positions, directions and normals, the nine columns the zipper compares."""
    rng = np.random.default_rng(0)
    x, y = (0.01 * np.cumsum(rng.standard_normal((count, 9)), axis=0) for _ in range(2))
    dtw(x[:500], y[:500])
    spent: list[float] = []

    def match() -> None:
        start = time.perf_counter()
        dtw(x, y)
        spent.append(time.perf_counter() - start)

    return {"megabytes": extra_peak(match), "seconds": spent[0]}


if __name__ == "__main__":
    print(json.dumps(_measure_match(int(sys.argv[1]))))
