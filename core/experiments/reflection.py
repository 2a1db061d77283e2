"""What a mirror costs (paper 5.1): the same back seen via a mirror and directly, over the same path.

With ideal optics the virtual mirror is flat and dims the light; that costs the edges of the figure, which are seen at a
slant. With real ones the glass is thick and bowed, noise grows with what is lost, and dark cloth and thin parts go
first. A real mirror also scatters and doubles the image, which is not simulated: the paper's loss of a fifth of the
vertices is larger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.surface_distance import SurfaceDistance, surface_distance
from ..simulation.optics import IDEAL, Optics
from ..simulation.scene import FramedMirror, Rig, with_real_optics
from ..simulation.sensors import find_sensor
from ..simulation.simulate import Simulation, simulate
from .results import distance_cells, distance_headings, keep
from .snapshot import WAYS, distance_picture, patch


class _Paper(TypedDict):
    """What the paper measured: distances [m], and vertices and triangles of both meshes."""

    mean: float
    max: float
    mirrored: tuple[int, int]
    direct: tuple[int, int]


class _Common(TypedDict):
    """What both rigs share; see :class:`.scene.Rig`."""

    frames: int
    sensor: str
    interference: bool
    tilt_deg: float


PATH = 3.0
"""Camera to mirror to back [m]: there a Kinect v1 gives about as many vertices as the paper had."""
REFLECTANCE = 0.85
"""Share of the light that comes back from a household mirror; the reading's own light passes it twice."""
PAPER: _Paper = {"mean": 2.083e-3, "max": 12.897e-3, "mirrored": (18097, 34985), "direct": (22755, 44303)}

_BEHIND, _TURN = (
    1.2,
    np.radians(25.0),
)  # the mirror stands 1.2 m behind the figure, rotated so that the camera is beside
_HEIGHT = 0.9


@dataclass(frozen=True)
class Comparison:
    """One row.

    ``way`` the depth was treated, the two meshes (avatar frame), the distance from the mirrored to the direct one, and
    of each to the body.
    """

    way: str
    mirrored: Mesh
    direct: Mesh
    apart: SurfaceDistance
    mirrored_truth: SurfaceDistance
    direct_truth: SurfaceDistance

    def loss(self, what: str) -> float:
        """Share of the ``vertices`` or ``triangles`` that the mirrored mesh has fewer."""
        return 1.0 - len(getattr(self.mirrored, what)) / len(getattr(self.direct, what))


def rigs(sensor: str, frames: int, seed: int, path: float = PATH) -> tuple[Rig, Rig]:
    """The two set-ups of the paper's figure 10.

    Beside the figure, looking at its back in a mirror; and behind it, where the mirror shows the camera to be.
    """
    if not path > _BEHIND + 0.5:
        raise MirrorScanError(f"reflection experiment: a path of {path:g} m does not reach past the mirror")
    normal = np.array((np.sin(_TURN), -np.cos(_TURN)))
    virtual = np.array((0.0, path))
    middle = np.array((0.0, _BEHIND))
    camera = virtual - 2 * ((virtual - middle) @ normal) * normal
    looking = middle - camera
    intrinsics = find_sensor(sensor).intrinsics
    mirror = FramedMirror("mirror", (0.0, _BEHIND, 1.0), (*normal, 0.0), width=1.4, height=1.9)
    common: _Common = {"frames": frames, "sensor": sensor, "interference": False, "tilt_deg": 1.0}
    room = (-4.0, 4.0, -4.0, path + 2.0, 2.8)
    beside = Rig(intrinsics, (*camera, _HEIGHT), (mirror,), pan_deg=float(np.degrees(np.arctan2(*looking))), room=room,
                 seed=seed, **common)  # fmt: skip
    behind = Rig(intrinsics, (*virtual, _HEIGHT), (), pan_deg=180.0, room=room, seed=seed + 1, **common)
    return beside, behind


def run(
    body: Mesh,
    sensor: str = "kinect_v1",
    frames: int = 10,
    seed: int = 0,
    path: float = PATH,
    reflectance: float = REFLECTANCE,
    samples: int = 100_000,
    optics: Optics = IDEAL,
    progress: Callable[[float, str], None] | None = None,
) -> list[Comparison]:
    """Take both captures and compare their meshes.

    Parameters
    ----------
    body : Mesh
        Avatar frame.
    sensor, frames, seed
        See :class:`.scene.Rig`; the two captures have noise of their own.
    path : float
        Camera to mirror to the figure's axis [m].
    reflectance : float
        Of the mirror, 0..1. With ideal optics a reading is lost where what returns is less than what the sensor's
        steepest surface returns directly.
    samples : int
        Points on each surface for the distances.
    optics : Optics
        Of both captures. If they are not ideal the mirror has glass like that of :func:`.scene.with_real_optics`.

    Returns
    -------
    list of Comparison
        One for each of ``WAYS``.
    """
    beside, behind = rigs(sensor, frames, seed, path)
    if optics != IDEAL:
        glass = replace(with_real_optics(beside).mirrors[0], reflectivity=reflectance)
        beside, behind = replace(beside, mirrors=(glass,), optics=optics), replace(behind, optics=optics)
    if progress:
        progress(0.0, "scanning via the mirror")
    reflected = simulate(body, beside)
    if progress:
        progress(0.3, "scanning directly")
    straight = simulate(body, behind)
    bright = None if optics.weakens else _bright(reflected, find_sensor(sensor).max_incidence_deg, reflectance)
    rows = []
    for number, way in enumerate(WAYS):
        if progress:
            progress(0.6 + 0.2 * number, f"comparing, {way}")
        mirrored, direct = patch(reflected, 1, way, bright), patch(straight, 0, way)
        rows.append(
            Comparison(
                way, mirrored, direct, surface_distance(mirrored, direct, samples),
                surface_distance(mirrored, body, samples), surface_distance(direct, body, samples),
            )
        )  # fmt: skip
    return rows


def _bright(made: Simulation, steepest_deg: float, reflectance: float) -> np.ndarray:
    """Where enough light returns: it falls with the cosine of incidence and passes the mirror twice."""
    returned = np.cos(made.truth.sight.incidence) * reflectance**2
    return (made.truth.labels != 1) | (returned >= np.cos(np.radians(steepest_deg)))


# --- telling ---------------------------------------------------------------------------------------------------------


def table(rows: Sequence[Comparison]) -> list[str]:
    """The comparison as lines of text beside the paper's figures."""
    lines = [
        "                  vertices             triangles          loss, %   mirrored to direct, mm    to the body, mm",
        "          mirrored  direct    mirrored  direct     vert.   tri.     mean    95 %     max     mirrored  direct",
    ]
    paper = [PAPER["mirrored"], PAPER["direct"]]
    lost = [100 * (1 - paper[0][k] / paper[1][k]) for k in (0, 1)]
    lines.append(
        f"paper   {paper[0][0]:10}{paper[1][0]:8}{paper[0][1]:12}{paper[1][1]:8}{lost[0]:10.1f}{lost[1]:7.1f}"
        f"{1e3 * PAPER['mean']:9.2f}       –{1e3 * PAPER['max']:8.1f}            –       –"
    )
    for r in rows:
        lines.append(
            f"{r.way:<8}{len(r.mirrored.vertices):10}{len(r.direct.vertices):8}{len(r.mirrored.triangles):12}"
            f"{len(r.direct.triangles):8}{100 * r.loss('vertices'):10.1f}{100 * r.loss('triangles'):7.1f}"
            f"{1e3 * r.apart.mean:9.2f}{1e3 * r.apart.p95:8.2f}{1e3 * r.apart.max:8.1f}"
            f"{1e3 * r.mirrored_truth.mean:13.2f}{1e3 * r.direct_truth.mean:8.2f}"
        )
    return lines


def write_results(rows: Sequence[Comparison], folder: Path) -> tuple[list[Path], str]:
    """Write table.csv, result.png and, when matplotlib is there, plot.png into a folder that exists.

    Returns and raises as :func:`.results.keep`.
    """

    def draw(distances, losses) -> None:
        names = ["paper", *(r.way for r in rows)]
        x = np.arange(len(names))
        means = [1e3 * PAPER["mean"], *(1e3 * r.apart.mean for r in rows)]
        largest = [1e3 * PAPER["max"], *(1e3 * r.apart.max for r in rows)]
        distances.bar(x - 0.2, means, 0.4, label="mean")
        distances.bar(x + 0.2, largest, 0.4, label="largest")
        distances.set_yscale("log")
        distances.set(ylabel="mirrored to direct [mm]", xticks=x, xticklabels=names)
        distances.legend()
        lost = [100 * (1 - PAPER["mirrored"][0] / PAPER["direct"][0]), *(100 * r.loss("vertices") for r in rows)]
        losses.bar(x, lost, 0.5)
        losses.set(ylabel="vertices lost in the mirror [%]", xticks=x, xticklabels=names)
        for axes in (distances, losses):
            axes.grid(alpha=0.3, axis="y")

    return keep(folder, _rows(rows), _picture(rows), draw, 2, (10.4, 4.0))


def _rows(rows: Sequence[Comparison]) -> list[list]:
    """The table's cells, headings first."""
    cells: list[list] = [
        ["way", "vertices_mirrored", "vertices_direct", "triangles_mirrored", "triangles_direct", "vertex_loss_pct"]
        + ["triangle_loss_pct", *distance_headings("mirrored_to_direct", "mirrored_to_body", "direct_to_body")]
    ]
    for r in rows:
        sizes = [len(getattr(m, what)) for what in ("vertices", "triangles") for m in (r.mirrored, r.direct)]
        losses = [f"{100 * r.loss(what):.3f}" for what in ("vertices", "triangles")]
        cells.append([r.way, *sizes, *losses, *distance_cells(r.apart, r.mirrored_truth, r.direct_truth)])
    return cells


def _picture(rows: Sequence[Comparison]) -> np.ndarray:
    pictures = []
    for r in rows:
        pictures += [(r.mirrored, r.direct, f"{r.way}   in the mirror"), (r.direct, r.mirrored, f"{r.way}   directly")]
    meshes, references, titles = zip(*pictures, strict=True)
    heading = "distance to the other   blue none   red as much as the largest of the paper"
    return distance_picture(meshes, references, titles, (0, 1, 0), PAPER["max"], heading, 4)
