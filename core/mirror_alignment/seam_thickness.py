"""How thick the glass is, as the seams between what is seen directly and in mirrors show.

Where light comes two ways nothing that is seen twice can be trusted: it is lit twice, too. What remains is the surface
on either side of a seam. Thick glass sets all that a mirror shows to a camera that measures time farther away, by two
to three times its thickness, so that it does not meet what is seen directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import Notice
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.curved_glass import behind_front, thickness_moves
from ..mirrors.mirror import person_before, reflect
from ..views.view_maps import ViewMaps
from .seam_alignment import mirrored_views
from .seam_offsets import seam_pieces


@dataclass(frozen=True)
class SeamThicknessSettings:
    """When seams say that glass is thick.

    Parameters
    ----------
    use : bool
    usual, spread : float
        Thickness of mirrors as they are sold, and one standard deviation [m].
    least, most : float
        Thinner glass is taken for thin; none is thicker [m].
    deviations : float
        By so many of its standard deviations the thickness must differ from 0.
    min_pieces : int
        Of seams between the direct view and a mirror's.
    """

    use: bool = True
    usual: float = 0.005
    spread: float = 0.0012
    least: float = 0.002
    most: float = 0.009
    deviations: float = 2.5
    min_pieces: int = 12


_NOISE, _PER_GAP = 0.003, 0.1  # of a piece's offset: of itself [m], and as a share of its gap
_CORRELATED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_BIAS = 0.0015  # what all offsets between two views have in common [m]
_ROUNDS = 8  # in which outliers are weighed anew
_OUTLIER = 2.0  # deviations from which an offset weighs less


def thickness_by_seams(
    mirrors: Sequence[Mirror], maps: ViewMaps, mesh: Mesh, settings: SeamThicknessSettings | None = None
) -> tuple[list[Mirror], list[np.ndarray], tuple[str, ...]]:
    """Mirrors of glass as thick as the seams show, all alike; as they were when these do not show it.

    Parameters
    ----------
    mirrors : sequence of Mirror
        In the order of the views that ``maps`` says are reflected; camera frame.
    maps : ViewMaps
        Of one camera that measures time.
    mesh : Mesh
        As :func:`.zipper.zip_patches` leaves it.

    Returns
    -------
    mirrors : list of Mirror
    motions : list of np.ndarray [shape=(4, 4)]
        How what each mirror shows moves with it: a shift, as a person is small beside the way to it.
    notes : tuple of str
        What was found, for the user; empty when nothing was.
    """
    settings = settings or SeamThicknessSettings()
    behind, still = mirrored_views(maps), [np.eye(4) for _ in mirrors]
    asked = [k for k, m in enumerate(mirrors) if m.source in ("picked", "found") and m.glass_thickness == 0.0]
    if not settings.use or not asked or len(maps.to_view) - len(behind) != 1:
        return list(mirrors), still, ()
    pieces = seam_pieces(mesh, maps)
    offsets, slopes, noise = [], [], []
    for k in asked:
        of = (pieces.views[:, 0] == 0) & (pieces.views[:, 1] == behind[k])
        moves = thickness_moves(mirrors[k], reflect(pieces.high[of], mirrors[k]), True)
        offsets.append(pieces.offset[of])
        slopes.append(np.einsum("nc,nc->n", moves, pieces.along[of]))
        noise.append(np.hypot(_NOISE, _PER_GAP * pieces.gap[of]))
    offset, slope, deviation = (np.concatenate(rows) for rows in (offsets, slopes, noise))
    if len(offset) < settings.min_pieces:
        return list(mirrors), still, ()
    thickness, error = _fitted(offset, slope, deviation)
    if not thickness > max(settings.least, settings.deviations * error):
        return list(mirrors), still, ()
    # how thick mirrors are is known beforehand, once these are known to be thick
    share = settings.spread**2 / (settings.spread**2 + error**2)
    thickness = float(np.clip(settings.usual + share * (thickness - settings.usual), settings.least, settings.most))
    placed, motions = list(mirrors), still
    for k in asked:
        person = reflect(person_before(mirrors[k]), mirrors[k])
        moved = thickness * thickness_moves(mirrors[k], person, True).mean(axis=0)
        placed[k] = behind_front(mirrors[k], thickness)
        motions[k] = np.eye(4)
        motions[k][:3, 3] = moved
    names = " and ".join(f"“{mirrors[k].name}”" for k in asked)
    note = Notice(
        "{names}: the glass is taken to be {thickness:.0f} mm thick, as the seams between what is seen directly and in "
        "it show; the delay and the place where it reflects are heeded. Give glass_thickness where it is known",
        names=names, thickness=1000.0 * thickness, mirrors=[mirrors[k].name for k in asked],
    )  # fmt: skip
    return placed, motions, (note,)


def _fitted(offset: np.ndarray, slope: np.ndarray, noise: np.ndarray) -> tuple[float, float]:
    """The thickness that makes offsets vanish, and one standard deviation of it [m]; robust."""
    weights, thickness = noise**-2.0, 0.0
    for _ in range(_ROUNDS):
        thickness = -float((weights * slope) @ offset / ((weights * slope) @ slope))
        rest = (offset + slope * thickness) / noise
        weights = noise**-2.0 / (1.0 + (rest / _OUTLIER) ** 2)
    information = float((weights * slope) @ slope) / _CORRELATED
    bias = _BIAS * abs(float(weights @ slope)) / float((weights * slope) @ slope)
    return thickness, float(np.hypot(information**-0.5, bias))
