"""The paper's first rival (3.2.1): a person on a turntable, scanned again and again, swaying in between.

Scans from one camera without mirrors, registered in pairs by ICP and then jointly, joined by our own zipper; beside it
the single snapshot with mirrors: the same person, sensor and optics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.surface_distance import evaluate, rigid_alignment
from ..numeric.rotations import about_axis
from ..pipeline import reconstruct
from ..pipeline.multi_camera import reconstruct_registered
from ..preview.mesh_views import draw_text, render_views
from ..registration.pairwise import IcpSettings, find_backend
from ..simulation.optics import IDEAL, Optics
from ..simulation.scene import Rig, default_rig, with_real_optics
from ..simulation.simulate import simulate
from .results import distance_colors, keep
from .sway import swayed

SWAYS = (0.0, 0.0025, 0.005, 0.01, 0.015, 0.02)
"""Root mean square shifts of the crown from scan to scan [m]."""

SCANS = 8
SNAPSHOT, TURNTABLE = "snapshot", "turntable"
DISTANCE = 2.5
"""Camera to person, of both [m]."""

_FULL = 0.02  # m: the picture's red
_SIDES = ((0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0))


@dataclass(frozen=True)
class Row:
    """One scan of the table.

    ``way`` is :data:`SNAPSHOT` or :data:`TURNTABLE`; ``sway`` [m]; the mesh laid on the body (avatar frame), None
    where there is none, and then ``fault``: why. ``distances`` as of :func:`.surface_distance.evaluate`; ``residual``
    and ``corrected`` [m] of ICP and of the joint registration, NaN for the snapshot. ``warned``: whether the result
    came with warnings. ``poses`` (N, 4, 4): each camera's frame → that of the first, where registration found them.
    """

    way: str
    sway: float
    mesh: Mesh | None
    distances: dict
    residual: float = np.nan
    corrected: float = np.nan
    warned: bool = False
    fault: str = ""
    poses: np.ndarray | None = None

    @property
    def error(self) -> float:
        """Mean distance [mm] of the mesh to the body and of the body to the mesh; NaN without a mesh."""
        if self.mesh is None:
            return np.nan
        return 0.5 * (self.distances["accuracy_mean"] + self.distances["complete_mean"])


def run(
    body: Mesh,
    sensor: str = "kinect_v1",
    frames: int = 10,
    seed: int = 0,
    sways: Sequence[float] = SWAYS,
    scans: int = SCANS,
    optics: Optics = IDEAL,
    progress: Callable[[float, str], None] | None = None,
    icp: IcpSettings = IcpSettings(),
) -> list[Row]:
    """The snapshot, and a turn of the plate for each sway.

    Parameters
    ----------
    body : Mesh
        Avatar frame.
    sensor, frames, seed
        See :class:`.scene.Rig`.
    sways : sequence of float
        See :func:`.sway.swayed` [m]. The snapshot is taken within a third of a second, in which nobody sways.
    scans : int
        A turn, 3 or more.
    optics : Optics
        Of all captures; the mirrors are then as they are sold.
    icp : IcpSettings

    Returns
    -------
    list of Row
        The snapshot first.

    Raises
    ------
    MirrorScanError
        When fewer scans are asked for, or no package is installed that registers them.
    """
    if scans < 3:
        raise MirrorScanError(
            f"turntable experiment: {scans} scans do not show a person from all sides; give 3 or more"
        )
    find_backend(icp.backend)
    if progress:
        progress(0.0, "taking the snapshot")
    rows = [snapshot(body, sensor, frames, seed, optics)]
    for number, sway in enumerate(sways):
        if progress:
            progress((1 + number) / (1 + len(sways)), f"turning the plate, {1e3 * sway:g} mm of sway")
        rows.append(turned(body, sensor, frames, seed, sway, scans, optics, icp))
    return rows


def snapshot(body: Mesh, sensor: str, frames: int, seed: int, optics: Optics) -> Row:
    """One snapshot with two mirrors, as we take it."""
    rig = default_rig(sensor, subject_distance=DISTANCE, frames=frames, seed=seed)
    made = simulate(body, as_lit(rig, optics))
    return judged(SNAPSHOT, 0.0, body, lambda: reconstruct(made.capture))


def as_lit(rig: Rig, optics: Optics) -> Rig:
    """The rig with these optics, and with its mirrors as they are sold if the optics are not ideal."""
    return rig if optics == IDEAL else replace(with_real_optics(rig), optics=optics)


def turned(
    body: Mesh, sensor: str, frames: int, seed: int, sway: float, scans: int, optics: Optics, icp: IcpSettings
) -> Row:
    """A turn of the plate."""
    rig = default_rig(sensor, subject_distance=DISTANCE, mirrors=0, frames=frames, seed=seed)
    rng = np.random.default_rng([seed, 7])
    captures = []
    for number in range(scans):
        place = np.eye(4)
        place[:3, :3] = about_axis(2, np.array(2.0 * np.pi * number / scans))
        there = swayed(body, sway, rng).transformed(place)
        made = simulate(there, replace(as_lit(rig, optics), seed=seed + number))
        captures.append(replace(made.capture, name=f"scan {number + 1}"))
    return judged(TURNTABLE, sway, body, lambda: reconstruct_registered(captures, 360.0 / scans, icp=icp))


def judged(way: str, sway: float, body: Mesh, make: Callable) -> Row:
    """What was made, laid on the body and measured; or why there is nothing."""
    try:
        made = make()
    except MirrorScanError as error:
        return Row(way, sway, None, {}, fault=str(error))
    distances = evaluate(made.mesh, body)
    found = made.report.get("registration")
    residual, corrected, poses = np.nan, np.nan, None
    if found is not None:
        poses = np.array(found["camera_to_first"])
        residual = 1e-3 * found["residual_mm"]
        corrected = 1e-3 * float(np.sqrt(np.mean([pair["corrected_mm"] ** 2 for pair in found["pairs"]])))
    laid = made.mesh.transformed(rigid_alignment(made.mesh, body))
    return Row(way, sway, laid, distances, residual, corrected, bool(made.warnings), poses=poses)


# --- telling ---------------------------------------------------------------------------------------------------------


def table(rows: Sequence[Row]) -> list[str]:
    """The scans as lines of text, and in a sentence where the snapshot wins and loses."""
    lines = [
        "              sway     to the body, mm     of the body, mm      volume     ICP  corrected",
        "                mm     mean     95 %       mean     95 %             %      mm         mm",
    ]
    for row in rows:
        sway = "–" if row.way == SNAPSHOT else f"{1e3 * row.sway:.1f}"
        if row.mesh is None:
            lines.append(f"{row.way:<11}{sway:>7}   no avatar: {row.fault}")
            continue
        d = row.distances
        icp = (
            "       –          –" if np.isnan(row.residual) else f"{1e3 * row.residual:8.2f}{1e3 * row.corrected:11.2f}"
        )
        lines.append(
            f"{row.way:<11}{sway:>7}{d['accuracy_mean']:9.2f}{d['accuracy_p95']:9.2f}{d['complete_mean']:11.2f}"
            f"{d['complete_p95']:9.2f}{d['volume_error_pct']:+14.2f}{icp}{'   warned' if row.warned else ''}"
        )
    return [*lines, *verdict(rows)]


def verdict(rows: Sequence[Row]) -> list[str]:
    """Where the snapshot wins and loses, by the mean error."""
    ours = next((row.error for row in rows if row.way == SNAPSHOT), np.nan)
    theirs = sorted((row for row in rows if row.way != SNAPSHOT), key=lambda row: row.sway)
    if np.isnan(ours) or not theirs:
        return ["nothing to compare: there is no snapshot or no turntable"]
    better = [row.sway for row in theirs if row.error < ours]
    worse = [row.sway for row in theirs if not row.error < ours]
    lines = [f"mean error of the snapshot {ours:.2f} mm"]
    if better:
        lines.append(f"the turntable is better at a sway of {_millimetres(better)}")
    if worse:
        lines.append(f"the snapshot is better at a sway of {_millimetres(worse)}")
    return lines


def _millimetres(values: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * value:g}" for value in values) + " mm"


def write_results(rows: Sequence[Row], body: Mesh, folder: Path) -> tuple[list[Path], str]:
    """Write table.csv, result.png and, when matplotlib is there, plot.png into a folder that exists.

    Returns and raises as :func:`.results.keep`.
    """
    theirs = [row for row in rows if row.way == TURNTABLE]
    ours = [row for row in rows if row.way == SNAPSHOT and row.mesh is not None]

    def draw(axes) -> None:
        made = [row for row in theirs if row.mesh is not None]
        axes.plot([1e3 * r.sway for r in made], [r.error for r in made], "o-", color="tab:red", label="turntable")
        failed = [1e3 * row.sway for row in theirs if row.mesh is None]
        if failed:
            axes.plot(failed, np.zeros(len(failed)), "kx", label="turntable, no avatar")
        for row in ours:
            axes.axhline(row.error, color="tab:blue", label="single snapshot")
        axes.set(xlabel="sway of the crown from scan to scan [mm]", ylabel="mean error [mm]", ylim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend()

    return keep(folder, cells(rows), picture(rows, body), draw, 1, (6.0, 4.0))


def cells(rows: Sequence[Row]) -> list[list]:
    """The table's cells, headings first."""
    names = ("accuracy_mean", "accuracy_p95", "accuracy_max", "complete_mean", "complete_p95", "complete_max")
    found: list[list] = [
        ["way", "sway_mm", *(f"{name}_mm" for name in names), "volume_error_pct", "icp_residual_mm", "corrected_mm",
         "warned", "fault"]
    ]  # fmt: skip
    for row in rows:
        figures = [f"{row.distances[name]:.4f}" if row.mesh is not None else "" for name in names]
        volume = row.distances.get("volume_error_pct")
        registered = ["" if np.isnan(value) else f"{1e3 * value:.4f}" for value in (row.residual, row.corrected)]
        found.append(
            [row.way, f"{1e3 * row.sway:g}", *figures, "" if volume is None else f"{volume:.3f}", *registered,
             int(row.warned), row.fault]
        )  # fmt: skip
    return found


def picture(rows: Sequence[Row], body: Mesh) -> np.ndarray:
    """Each mesh from four sides, coloured by its distance to the body: blue on it, red 20 mm off or more.

    From top to bottom in the order of the table, which rows without a mesh are left out of.
    """
    strips = []
    for row in rows:
        if row.mesh is None:
            continue
        colors = distance_colors(row.mesh, body, _FULL)
        strip = render_views(row.mesh, colors, _SIDES, 220, 400).copy()
        draw_text(strip, row.way, 12, 24, size=16, color=(60, 62, 68))
        strips.append(strip)
    if not strips:
        return np.full((64, 880, 3), 255, np.uint8)
    return np.concatenate(strips)
