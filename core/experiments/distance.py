"""What distance costs (paper 5.2): the same figure from 3 to 5 m, each capture compared with the nearest.

The virtual sensor is calibrated: its error is noise and quantisation, which a burst averages. The paper's grows faster
with distance than either; common formulas for a Kinect's disparity part by 100 mm and more beyond 4 m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.surface_distance import SurfaceDistance, surface_distance
from ..simulation.optics import IDEAL, Optics
from ..simulation.scene import default_rig
from ..simulation.simulate import simulate
from .results import distance_cells, distance_headings, keep
from .snapshot import WAYS, distance_picture, patch

DISTANCES = (3.0, 3.5, 4.0, 4.5, 5.0)
PAPER = {3.0: 0.0, 3.5: 3.517e-3, 4.0: 9.170e-3, 4.5: 17.277e-3, 5.0: 33.804e-3}
"""Mean distance [m] of the capture at that distance [m] to the one at 3 m."""


@dataclass(frozen=True)
class Capture:
    """One row.

    ``way`` the depth was treated, camera to figure [m], the mesh (avatar frame), its distance to the mesh of the
    nearest capture and to the body.
    """

    way: str
    distance: float
    mesh: Mesh
    apart: SurfaceDistance
    truth: SurfaceDistance


@dataclass(frozen=True)
class Fit:
    """N(d) = a · exp(-b d), as in the paper, and N(d) = c / d², as geometry predicts; each with its R²."""

    a: float
    b: float
    exponential_r2: float
    c: float
    square_r2: float


def fit_counts(distances: Sequence[float], counts: Sequence[int]) -> Fit:
    """Least squares of counts over distance; the exponential by Gauss and Newton from its logarithm.

    Raises
    ------
    MirrorScanError
        When there are fewer than three distances, or a count is not positive.
    """
    d, n = np.asarray(distances, float), np.asarray(counts, float)
    if len(d) < 3 or (n <= 0).any() or len(np.unique(d)) < 3:
        raise MirrorScanError("distance experiment: a fit needs three distances with a count above zero at each")
    slope, level = np.polyfit(d, np.log(n), 1)
    a, b = float(np.exp(level)), float(-slope)
    for _ in range(20):
        decay = np.exp(-b * d)
        step = np.linalg.lstsq(np.column_stack((decay, -a * d * decay)), n - a * decay, rcond=None)[0]
        a, b = a + step[0], b + step[1]
    c = float((n / d**2).sum() / (1 / d**4).sum())
    spread = ((n - n.mean()) ** 2).sum()
    r2 = [1.0 - float(((n - model) ** 2).sum() / spread) if spread else 1.0 for model in (a * np.exp(-b * d), c / d**2)]
    return Fit(float(a), float(b), r2[0], c, r2[1])


def run(
    body: Mesh,
    sensor: str = "kinect_v1",
    frames: int = 10,
    seed: int = 0,
    distances: Sequence[float] = DISTANCES,
    samples: int = 100_000,
    optics: Optics = IDEAL,
    progress: Callable[[float, str], None] | None = None,
) -> list[Capture]:
    """Take the captures and compare each with the nearest.

    Parameters
    ----------
    body : Mesh
        Avatar frame; its front is taken.
    sensor, frames, seed
        See :class:`.scene.Rig`; each capture has noise of its own.
    distances : sequence of float
        Camera to figure [m], the nearest first.
    samples : int
        Points on each surface for the distances.
    optics : Optics
        Of all captures.

    Returns
    -------
    list of Capture
        For each of ``WAYS`` all distances in order.

    Raises
    ------
    MirrorScanError
        When the distances do not grow.
    """
    if len(distances) < 3 or any(b <= a for a, b in zip(distances, distances[1:], strict=False)):
        raise MirrorScanError("distance experiment: give three distances or more, the nearest first")
    made = []
    for number, distance in enumerate(distances):
        if progress:
            progress(0.6 * number / len(distances), f"scanning from {distance:g} m")
        rig = default_rig(
            sensor, subject_distance=distance, mirrors=0, frames=frames, seed=seed + number, tilt_deg=1.0,
            optics=optics,
        )  # fmt: skip
        made.append(simulate(body, rig))
    rows = []
    for number, way in enumerate(WAYS):
        if progress:
            progress(0.6 + 0.2 * number, f"comparing, {way}")
        meshes = [patch(one, 0, way) for one in made]
        for distance, mesh in zip(distances, meshes, strict=True):
            apart = surface_distance(mesh, meshes[0], samples)
            rows.append(Capture(way, float(distance), mesh, apart, surface_distance(mesh, body, samples)))
    return rows


# --- telling ---------------------------------------------------------------------------------------------------------


def _ways(rows: Sequence[Capture]) -> dict[str, list[Capture]]:
    return {way: [r for r in rows if r.way == way] for way in WAYS}


def _fits(rows: Sequence[Capture]) -> dict[tuple[str, str], Fit]:
    return {
        (way, what): fit_counts([r.distance for r in mine], [len(getattr(r.mesh, what)) for r in mine])
        for way, mine in _ways(rows).items()
        for what in ("vertices", "triangles")
    }


def table(rows: Sequence[Capture]) -> list[str]:
    """The captures as lines of text, the paper's figures beside, and the fits of the counts below."""
    lines = [
        "                 vertices  triangles       to the nearest, mm        to the body, mm  paper, mm",
        "                                         mean    95 %     max         mean    95 %       mean",
    ]
    for r in rows:
        known = PAPER.get(round(r.distance, 3))
        paper = "–" if known is None else f"{1e3 * known:.1f}"
        lines.append(
            f"{r.way:<9}{r.distance:5.2f} m{len(r.mesh.vertices):9}{len(r.mesh.triangles):11}{1e3 * r.apart.mean:12.2f}"
            f"{1e3 * r.apart.p95:8.2f}{1e3 * r.apart.max:8.1f}{1e3 * r.truth.mean:13.2f}{1e3 * r.truth.p95:8.2f}"
            f"{paper:>11}"
        )
    for (way, what), fit in _fits(rows).items():
        lines.append(
            f"{way}, {what}: {fit.a:.0f} exp(-{fit.b:.3f} d), R² {fit.exponential_r2:.4f} (the paper's law); "
            f"{fit.c:.0f} / d², R² {fit.square_r2:.4f}"
        )
    return lines


def write_results(rows: Sequence[Capture], folder: Path) -> tuple[list[Path], str]:
    """Write table.csv, result.png and, when matplotlib is there, plot.png into a folder that exists.

    Returns and raises as :func:`.results.keep`.
    """
    ways, fits = _ways(rows), _fits(rows)

    def draw(distances, counts) -> None:
        known = sorted(set(PAPER) & {round(r.distance, 3) for r in rows})
        if known:
            distances.plot(known, [1e3 * PAPER[d] for d in known], "k^:", label="paper, to the nearest")
        for way, color in zip(WAYS, ("tab:red", "tab:blue"), strict=True):
            x = [r.distance for r in ways[way]]
            distances.plot(
                x, [1e3 * r.apart.mean for r in ways[way]], "o-", color=color, label=f"{way}, to the nearest"
            )
            distances.plot(x, [1e3 * r.truth.mean for r in ways[way]], "s--", color=color, label=f"{way}, to the body")
        distances.set(xlabel="camera to figure [m]", ylabel="mean distance [mm]", ylim=(0, None))
        way = WAYS[-1]
        smooth = np.linspace(ways[way][0].distance, ways[way][-1].distance, 50)
        for what, color in (("vertices", "tab:green"), ("triangles", "tab:purple")):
            fit = fits[way, what]
            counts.plot(
                [r.distance for r in ways[way]], [len(getattr(r.mesh, what)) for r in ways[way]], "o", color=color
            )
            counts.plot(smooth, fit.a * np.exp(-fit.b * smooth), "-", color=color, label=f"{what}, exponential")
            counts.plot(smooth, fit.c / smooth**2, ":", color=color, label=f"{what}, 1 / d²")
        counts.set(xlabel="camera to figure [m]", ylabel=f"number, {way}", ylim=(0, None))
        for axes in (distances, counts):
            axes.grid(alpha=0.3)
            axes.legend()

    return keep(folder, _rows(rows), _picture(rows), draw, 2, (10.4, 4.0))


def _rows(rows: Sequence[Capture]) -> list[list]:
    """The table's cells, headings first."""
    cells: list[list] = [
        ["way", "distance_m", "vertices", "triangles", "paper_mean_mm", *distance_headings("to_nearest", "to_body")]
    ]
    for r in rows:
        paper = PAPER.get(round(r.distance, 3))
        shown = "" if paper is None else f"{1e3 * paper:.3f}"
        sizes = [len(r.mesh.vertices), len(r.mesh.triangles)]
        cells.append([r.way, f"{r.distance:g}", *sizes, shown, *distance_cells(r.apart, r.truth)])
    return cells


def _picture(rows: Sequence[Capture]) -> np.ndarray:
    ways = _ways(rows)
    references = [ways[r.way][0].mesh for r in rows]
    heading = "from near to far   blue on the nearest   red as far off as the farthest of the paper"
    titles = [r.way for r in rows]
    columns = len(next(iter(ways.values())))
    return distance_picture([r.mesh for r in rows], references, titles, (0, -1, 0), 0.035, heading, columns)
