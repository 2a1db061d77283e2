"""The paper's experiment 5.3, zippering alone: ours, and Blender's bridge on the same split."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.experiments.zippering import Closed
from mirror_scan.core.experiments.zippering import run as zippering
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import mannequin

from .bridge import BLENDER, blender_bridge
from .isolated import PeerFailed
from .machine import say
from .quality import OURS
from .results import Finding, Result, Table, number, yes

STEP, MAX_PCT, MIN_R2 = 40.0, 0.1, 0.95


def run() -> Result:
    table = Table(
        "Experiment 5.3: a mannequin cut in three, its back thinned, and closed again",
        ("thinned", "closed by", "closed", "manifold", "components", "self-intersecting faces", "mean [mm]", "RMS",
         "max", "mean, % of height", "max, %"), left=2,
    )  # fmt: skip
    body = mannequin()
    tall = float(np.ptp(body.vertices[:, 2]))
    failed: list[str] = []

    def bridge(parts: Mesh) -> Mesh | None:
        try:
            made = blender_bridge(parts)
        except PeerFailed as error:
            failed.append(str(error))
            return None
        return None if made is None else made[0]

    say("experiment 5.3")
    steps = zippering(body, bridge=bridge)
    for step in steps:
        table.rows.append((f"{step.decimation:g} %", OURS, *_cells(step, tall)))
        if step.bridged:
            table.rows.append(("", BLENDER, *_cells(step.bridged, tall)))
    slope, fit = straight([s.decimation for s in steps], [s.mean for s in steps])
    table.notes = [
        "Distances of both directions the larger, 100 000 samples. The paper's figure 16 has the mean over thinning.",
        f"Each per cent of thinning adds {1e6 * slope:.2f} µm to our mean distance; a straight line explains "
        f"{100 * fit:.1f} % of its variance.",
        *(f"Blender: {message}" for message in failed),
    ]
    if not any(step.bridged for step in steps):
        table.notes.append("bpy is not installed or cannot be imported: without Blender's bridge.")
    at = next(s for s in steps if s.decimation == STEP)
    share = 100.0 * at.mean / tall
    open_steps = [f"{s.decimation:g} %" for s in steps if not (s.report["watertight"] and s.report["manifold"])]
    findings = [
        Finding(f"experiment 5.3: mean at {STEP:g} % < {MAX_PCT:g} % of the height", f"{share:.4f} %", share < MAX_PCT),
        Finding(f"experiment 5.3: linear in the thinning, R² >= {MIN_R2:g}", f"{fit:.3f}", fit >= MIN_R2),
        Finding("experiment 5.3: closed at every step", f"not {', '.join(open_steps)}" if open_steps else "all",
                not open_steps),
    ]  # fmt: skip
    pairs = [(s.mean, s.bridged.mean) for s in steps if s.bridged]
    text = ", ".join(f"{1e3 * a:.2f} / {1e3 * b:.2f}" for a, b in pairs) + " mm"
    limit = f"experiment 5.3: mean below that of {BLENDER} at every step"
    findings.append(Finding(limit, text if pairs else "not run", all(a < b for a, b in pairs) if pairs else None))
    return Result([table], findings)


def straight(percent: list[float], mean: list[float]) -> tuple[float, float]:
    """Slope of the straight line through the means, and its coefficient of determination R²."""
    slope, _ = np.polyfit(percent, mean, 1)
    return float(slope), float(np.corrcoef(percent, mean)[0, 1] ** 2)


def _cells(made: Closed, tall: float) -> tuple[str, ...]:
    report = made.report
    return (
        yes(report["watertight"]), yes(report["manifold"]), str(report["components"]),
        str(report["self_intersections"]), *(number(1e3 * v, 3) for v in (made.mean, made.rms, made.max)),
        number(100 * made.mean / tall, 4), number(100 * made.max / tall, 3),
    )  # fmt: skip
