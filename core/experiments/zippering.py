"""What zippering costs in accuracy (paper 5.3): a closed body is cut in three, its back decimated, and zippered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..closing.mesh_closing import close_mesh
from ..errors import MirrorScanError
from ..mesh import SEAM, SURFACE, Mesh
from ..mesh.bvh import build_bvh, raycast
from ..mesh.half_edges import twins
from ..mesh.soundness import mesh_report
from ..mesh.submesh import drop_small_components, keep_triangles, remove_bowties
from ..mesh.surface_distance import SurfaceDistance, surface_distance
from ..mesh.triangle_mesh import merge
from ..preview.mesh_views import KIND_COLORS, SIDES, draw_text, render_views
from ..views.view_maps import NOTHING_SEEN
from ..zippering.coronal_matching import solidity
from ..zippering.seam_strips import Seam
from ..zippering.zipper import ZipperSettings, zip_patches
from .decimation import decimate
from .results import NEAR_TO_FAR, distance_cells, distance_colors, distance_headings, keep

STEPS = (0, 10, 20, 30, 40, 50)
"""Vertices taken from the two back parts [%] (paper 5.3)."""

MATCHINGS = ("auto", "planes", "facing")
"""``planes`` starts with the paper's matching whatever the figure, ``facing`` never uses it, ``auto`` lets the
silhouette decide as for a capture."""

UP = np.array((0.0, 0.0, 1.0))
_SPECK = 12  # triangles: a piece of fewer is no patch
_HEIGHTS = (0.2, 3.0)  # m: what the widths of gaps in ZipperSettings are made for


@dataclass(frozen=True)
class Closed:
    """A closed split.

    The ``mesh``, its ``report`` of :func:`.soundness.mesh_report`, and the distances ``there``, from it to the
    original, and ``back``, the other way [m].
    """

    mesh: Mesh
    report: dict
    there: SurfaceDistance
    back: SurfaceDistance

    @property
    def mean(self) -> float:
        """Mean distance [m], the larger of the two directions."""
        return max(self.there.mean, self.back.mean)

    @property
    def rms(self) -> float:
        """Root mean square distance [m], the larger of the two directions."""
        return max(self.there.rms, self.back.rms)

    @property
    def max(self) -> float:
        """Largest distance [m], the larger of the two directions."""
        return max(self.there.max, self.back.max)


@dataclass(frozen=True)
class Step(Closed):
    """One row of the table: what was zippered, and how.

    ``decimation`` [%], ``vertices`` of the three parts, ``seams`` with their ``seam_triangles``, ``method`` (how much
    of the seams' length was matched how), ``notes`` of the closing; ``bridged``, what the other tool made of the same
    three parts, or None.
    """

    decimation: float
    vertices: tuple[int, int, int]
    seams: list[Seam]
    seam_triangles: int
    method: str
    notes: list[str]
    bridged: Closed | None = None


def run(
    body: Mesh,
    steps: Sequence[float] = STEPS,
    matching: str = "auto",
    samples: int = 100_000,
    progress: Callable[[float, str], None] | None = None,
    bridge: Callable[[Mesh], Mesh | None] | None = None,
) -> list[Step]:
    """Cut, decimate, zipper and close a body once for each step, and measure how far the result is from it.

    Parameters
    ----------
    body : Mesh
        Closed, outward; Z up, facing along Y [m]. It is not changed.
    steps : sequence of float
        Vertices to remove from the back parts, from 0 to below 100 [%].
    matching : str
        One of ``MATCHINGS``.
    samples : int
        Points on each surface for the distances.
    progress : function(fraction, message) or None
    bridge : function(mesh) or None
        Another tool that closes three parts, distinguished by ``view``, for comparison; it may return None where it
        cannot.

    Returns
    -------
    list of Step
        In the order of ``steps``.

    Raises
    ------
    MirrorScanError
        When the body is not closed or of no human size, cannot be cut in three, or an argument does not fit.
    """
    if matching not in MATCHINGS:
        raise MirrorScanError(f"zippering experiment: no matching “{matching}”; one of {', '.join(MATCHINGS)}")
    if not len(steps) or not all(0 <= step < 100 for step in steps):
        raise MirrorScanError("zippering experiment: steps are percentages from 0 to below 100, and at least one")
    tall = _height(body)
    parts, axis = split(body)
    compactness = {"auto": ZipperSettings().compactness, "planes": 0.0, "facing": 2.0}[matching]
    if matching == "auto" and compactness <= solidity(_silhouette(body, tall)):
        compactness = 0.0  # no view shows a silhouette: what it would have decided is decided here
    settings = replace(ZipperSettings(), compactness=compactness)
    done = []
    for number, percent in enumerate(steps):
        if progress:
            progress(number / len(steps), f"zippering, {percent:g} % less behind")
        thinned = [parts[0]] + [decimate(part, _left(part, percent)) for part in parts[1:]]
        zipped, seams, twin = zip_patches(thinned, NOTHING_SEEN, UP, axis, None, settings)
        sewn = int(np.count_nonzero(zipped.kind == SEAM))
        mesh, notes = close_mesh(zipped, NOTHING_SEEN, UP, None, twin=twin)
        other = bridge(merge(thinned)) if bridge else None
        bridged = _compare(other, body, samples) if other is not None else None
        first, second, third = (len(part.vertices) for part in thinned)
        made = _compare(mesh, body, samples)
        done.append(Step(
            made.mesh, made.report, made.there, made.back, float(percent), (first, second, third), seams, sewn,
            _method(seams), notes, bridged,
        ))  # fmt: skip
    return done


def _compare(mesh: Mesh, body: Mesh, samples: int) -> Closed:
    there, back = surface_distance(mesh, body, samples), surface_distance(body, mesh, samples)
    return Closed(mesh, mesh_report(mesh), there, back)


# --- the cut ---------------------------------------------------------------------------------------------------------


def split(body: Mesh) -> tuple[list[Mesh], np.ndarray]:
    """Cut a body into front, back left and back right by taking points away (paper 5.3).

    The coronal plane runs through the centroid of the surface, the sagittal plane through it as well. Points nearer
    than half a median edge to a plane are taken away, and with them their triangles, and every triangle whose corners
    lie in two parts: the cut is as irregular as the triangulation.

    Returns
    -------
    parts : list of Mesh
        Views 0, 1, 2, kind ``SURFACE``, every vertex with one fan; specks dropped.
    axis : np.ndarray [shape=(3,)]
        Point of the vertical in which the planes meet.

    Raises
    ------
    MirrorScanError
        When the body is not closed or a part is empty.
    """
    if not len(body.triangles) or not np.isfinite(body.vertices).all():
        raise MirrorScanError("zippering experiment: the body needs triangles and finite points")
    twin = twins(body.triangles, len(body.vertices))
    if (twin < 0).any():
        raise MirrorScanError(
            f"zippering experiment: the body must be closed, but {np.count_nonzero(twin < 0)} of its edges have not "
            "exactly two triangles; close it first"
        )
    corners = body.vertices[body.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    axis = np.average(corners.mean(axis=1), axis=0, weights=area)
    half = 0.5 * float(np.median(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)))
    x, y, _ = (body.vertices - axis).T
    part = np.where(y < -half, 0, np.where(y <= half, -1, np.where(x > half, 1, np.where(x < -half, 2, -1))))
    parts = []
    for number, name in enumerate(("front", "back left", "back right")):
        inside = (part[body.triangles] == number).all(axis=1)
        if not inside.any():
            raise MirrorScanError(f"zippering experiment: the {name} part is empty; give a finer mesh, Z up, facing -Y")
        view = np.full(len(body.vertices), number, np.int8)
        kind = np.full(len(body.triangles), SURFACE, np.int8)
        piece = keep_triangles(replace(body, view=view, kind=kind), inside)
        parts.append(drop_small_components(remove_bowties(piece), _SPECK))
        if not len(parts[-1].triangles):
            raise MirrorScanError(f"zippering experiment: the {name} part falls to specks; give a finer mesh")
    return parts, axis


def _left(part: Mesh, percent: float) -> int:
    return round(len(part.vertices) * (1.0 - percent / 100.0))


def _height(body: Mesh) -> float:
    tall = float(np.ptp(body.vertices[:, 2])) if len(body.vertices) else 0.0
    if not _HEIGHTS[0] <= tall <= _HEIGHTS[1]:
        raise MirrorScanError(
            f"zippering experiment: the body is {tall:.3g} m tall; give one of {_HEIGHTS[0]:g} to {_HEIGHTS[1]:g} m, "
            "in metres, Z up, facing -Y"
        )
    return tall


def _silhouette(body: Mesh, tall: float, rows: int = 240) -> np.ndarray:
    """Labels as the direct view would have them: 0 where the body is seen from the front, -1 beside it."""
    tree = build_bvh(np.ascontiguousarray(body.vertices, np.float64), np.ascontiguousarray(body.triangles, np.int32))
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    pixel = tall / rows
    x, z = np.meshgrid(np.arange(low[0] + pixel / 2, high[0], pixel), np.arange(low[2] + pixel / 2, high[2], pixel))
    origins = np.column_stack((x.ravel(), np.full(x.size, low[1] - 1.0), z.ravel()))
    hit = np.isfinite(raycast(tree, origins, np.array((0.0, 1.0, 0.0)))[0])
    return np.where(hit, 0, -1).astype(np.int8).reshape(x.shape)


def _method(seams: list[Seam]) -> str:
    """Shares of the seams' length by how they were matched."""
    lengths: dict[str, float] = {}
    for seam in seams:
        lengths[seam.method] = lengths.get(seam.method, 0.0) + seam.length
    total = sum(lengths.values())
    return ", ".join(f"{name} {100 * length / total:.0f} %" for name, length in sorted(lengths.items())) or "none"


# --- telling ---------------------------------------------------------------------------------------------------------


def table(steps: Sequence[Step], body: Mesh) -> list[str]:
    """The steps as lines of text, distances also in per cent of the body's height."""
    tall = _height(body)
    lines = [
        "thinned   vertices front + left + right   seam tri.  closed  manifold   mean      rms      max mm"
        "    mean %   max %   matched by"
    ]
    for s in steps:
        parts = " + ".join(str(v) for v in s.vertices)
        lines.append(f"{s.decimation:5.4g} %   {parts:>28}{s.seam_triangles:13}{_figures(s, tall)}   {s.method}")
    if any(s.bridged for s in steps):
        lines.append("the same parts by Blender's Bridge Edge Loops and Fill Holes")
    for s in steps:
        if s.bridged:
            pieces, crossing = (s.bridged.report[key] for key in ("components", "self_intersections"))
            flaws = f"{pieces} pieces, {crossing} faces cross" if pieces > 1 else f"{crossing} faces cross"
            lines.append(f"{s.decimation:5.4g} %{'':44}{_figures(s.bridged, tall)}   {flaws}")
    return lines


def _figures(made: Closed, tall: float) -> str:
    yes = ["yes" if made.report[key] else "NO" for key in ("watertight", "manifold")]
    mm = "".join(f"{1000 * value:9.3f}" for value in (made.mean, made.rms, made.max))
    return f"{yes[0]:>8}{yes[1]:>10}{mm}{100 * made.mean / tall:10.4f}{100 * made.max / tall:8.3f}"


def write_results(steps: Sequence[Step], body: Mesh, folder: Path) -> tuple[list[Path], str]:
    """Write table.csv, the picture result.png and, when matplotlib is there, plot.png into a folder that exists.

    The picture shows the step nearest to 40 %: above by distance to the original (red near, blue far, as in the
    paper's figure 15), below by kind of surface.

    Returns and raises as :func:`.results.keep`.
    """
    tall = _height(body)
    shown = min(steps, key=lambda s: abs(s.decimation - 40.0))

    def draw(axes) -> None:
        order = sorted(steps, key=lambda s: s.decimation)
        x = [s.decimation for s in order]
        axes.plot(x, [1000 * s.there.mean for s in order], "o-", label="result to original")
        axes.plot(x, [1000 * s.back.mean for s in order], "s--", label="original to result")
        bridged = [(s.decimation, s.bridged) for s in order if s.bridged]
        if bridged:
            at, means = [percent for percent, _ in bridged], [1000 * other.mean for _, other in bridged]
            axes.plot(at, means, "^:", color="tab:gray", label="Blender's bridge, the larger of both ways")
        axes.set(xlabel="vertices taken from the back parts [%]", ylabel="mean distance [mm]", ylim=(0, None))
        percent = axes.secondary_yaxis("right", functions=(lambda mm: mm / (10 * tall), lambda p: p * 10 * tall))
        percent.set_ylabel("of the height [%]")
        axes.grid(alpha=0.3)
        axes.legend()

    return keep(folder, _rows(steps, tall), _picture(shown, body), draw, 1, (6.4, 4.2))


def _rows(steps: Sequence[Step], tall: float) -> list[list]:
    """The table's cells, headings first."""
    distances = distance_headings("result_to_original", "original_to_result")
    flags = ("watertight", "manifold", "components", "euler_characteristic", "triangles", "self_intersections")
    rows = [
        ["decimation_pct", "vertices_front", "vertices_back_left", "vertices_back_right", "seam_triangles", "method"]
        + [*flags, *distances, "mean_pct_of_height", "rms_pct_of_height", "max_pct_of_height"]
        + [f"blender_{name}" for name in (*flags, *distances)]
    ]

    def cells(made: Closed) -> list:
        return [made.report[flag] for flag in flags] + distance_cells(made.there, made.back)

    for s in steps:
        rows.append(
            [f"{s.decimation:g}", *s.vertices, s.seam_triangles, s.method, *cells(s)]
            + [f"{100 * value / tall:.6f}" for value in (s.mean, s.rms, s.max)]
            + (cells(s.bridged) if s.bridged else [""] * (len(flags) + len(distances)))
        )
    return rows


def _picture(step: Step, body: Mesh) -> np.ndarray:
    full = 0.001 * _height(body)  # blue from a thousandth of the height on
    by_distance = distance_colors(step.mesh, body, full, NEAR_TO_FAR[::-1])
    by_kind = np.array([KIND_COLORS[k] for k in sorted(KIND_COLORS)], np.uint8)[step.mesh.kind]
    rows = [render_views(step.mesh, colors, list(SIDES.values()), 400, 640) for colors in (by_distance, by_kind)]
    band = np.full((50, rows[0].shape[1], 3), 255, np.uint8)
    title = "red on the original   blue a thousandth of the height off or more"
    draw_text(band, title, 20, 34, size=22, color=(60, 62, 68))
    return np.concatenate((band, *rows))
