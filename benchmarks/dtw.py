"""Dynamic time warping with path: two random walks in 3-D, ours and four libraries."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mirror_scan.core.zippering.dtw import dtw

from .machine import installed, medians, say
from .results import Finding, Result, Table, number, yes

LENGTHS = (1500, 900)
RUNS = 15
MIN_RATIO = 4.0
OURS = "Mirror Scan"
EUCLIDEAN = "distances"
SQUARED = "squared distances"


@dataclass(frozen=True)
class Contender:
    """``call`` () -> (length of the path, accumulated cost); ``cost``: what is accumulated."""

    name: str
    library: str
    cost: str
    call: Callable[[], tuple[int, float]]


def contenders(x: np.ndarray, y: np.ndarray) -> list[Contender]:
    """Each with the call of its library that returns a path and is fastest; tslearn also with our definition."""
    across_x, across_y = np.ascontiguousarray(x.T), np.ascontiguousarray(y.T)

    def ours():
        found = dtw(x, y)
        return len(found.path), found.distance

    def librosa():
        from librosa.sequence import dtw

        cost, path = dtw(across_x, across_y, metric="euclidean")
        return len(path), cost[-1, -1]

    def dtaidistance():
        from dtaidistance.dtw_ndim import warping_path

        path, distance = warping_path(x, y, use_c=True, include_distance=True)
        return len(path), distance**2

    def tslearn():
        from tslearn.metrics import dtw_path

        path, distance = dtw_path(x, y)
        return len(path), distance**2

    def tslearn_euclidean():
        from tslearn.metrics import dtw_path_from_metric

        path, distance = dtw_path_from_metric(x, y, metric="euclidean")
        return len(path), distance

    def aeon():
        from aeon.distances import dtw_alignment_path

        path, distance = dtw_alignment_path(across_x, across_y)
        return len(path), distance

    return [
        Contender(OURS, "mirror_scan", EUCLIDEAN, ours),
        Contender("librosa sequence.dtw", "librosa", EUCLIDEAN, librosa),
        Contender("dtaidistance warping_path, C", "dtaidistance", SQUARED, dtaidistance),
        Contender("tslearn dtw_path", "tslearn", SQUARED, tslearn),
        Contender("tslearn dtw_path_from_metric", "tslearn", EUCLIDEAN, tslearn_euclidean),
        Contender("aeon dtw_alignment_path", "aeon", SQUARED, aeon),
    ]


def run() -> Result:
    say("dtw")
    rng = np.random.default_rng(0)
    x, y = (0.01 * np.cumsum(rng.standard_normal((n, 3)), axis=0) for n in LENGTHS)
    field = contenders(x, y)
    there = [c for c in field if installed(c.library)]
    times, values = medians({c.name: c.call for c in there}, RUNS)
    reference: dict[str, tuple[str, float]] = {}  # for each definition, who gave its cost first
    for c in there:
        reference.setdefault(c.cost, (c.name, values[c.name][1]))
    table = Table(
        f"DTW with path, {LENGTHS[0]} x {LENGTHS[1]} points in 3-D",
        ("library", "accumulates", "ms", "x ours", "path", "cost", "agrees"),
        left=2,
    )
    agree = True
    for c in field:
        if c not in there:
            table.rows.append((c.name, c.cost, "not installed", *["–"] * 4))
            continue
        length, cost = values[c.name]
        same = math.isclose(cost, reference[c.cost][1], rel_tol=1e-9)
        agree &= same
        verdict = "reference" if reference[c.cost][0] == c.name else yes(same)
        spent, ratio = number(times[c.name], 2), number(times[c.name] / times[OURS], 1)
        table.rows.append((c.name, c.cost, spent, ratio, str(length), number(cost, 6), verdict))
    table.notes = [
        f"Medians of {RUNS} runs in turn; random walks, float64.",
        "Agrees: same cost, to 1e-9, as the first row of the same definition.",
        "Squared distances have another best path (and spare the roots); a cost returned as a root is squared here.",
    ]
    return Result([table], _findings(field, times, agree))


def _findings(field: list[Contender], times: dict[str, float], agree: bool) -> list[Finding]:
    found = []
    for c in field[1:]:
        least = MIN_RATIO if c.library == "librosa" else 1.0
        limit = f"DTW >= {least:g} x librosa" if c.library == "librosa" else f"DTW faster than {c.name}"
        if c.name not in times:
            found.append(Finding(limit, "not installed", None))
            continue
        ratio = times[c.name] / times[OURS]
        passed = ratio >= least if c.library == "librosa" else ratio > least
        found.append(Finding(limit, f"{ratio:.1f} x", passed))
    text = "equal to 1e-9" if agree else "differs"
    found.append(Finding("DTW: same cost as those of the same definition", text, agree))
    return found
