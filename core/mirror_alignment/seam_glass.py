"""How thick and how bowed the glass is, as the seams between what is seen directly and in mirrors show.

Where light comes two ways nothing that is seen twice can be trusted: it is lit twice, too. What remains is the surface
on either side of a seam, and the outline that what mirrors show of a body's sides touches. Thick glass sets all that a
mirror shows to a camera that measures time farther away, by two to three times its thickness; bowed glass displaces
what its ends show. Then both sides of a seam do not meet, and sides lie within the outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..errors import Notice
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.curved_glass import behind_front, flattened, thickness_moves
from ..mirrors.mirror import moved, person_before, reflect, with_reason
from ..views.silhouette_contact import Outline, contact
from ..views.view_correspondences import noise_of, surfaces
from ..views.view_maps import ViewMaps
from .pose_solver import MAD
from .seam_alignment import mirrored_views, move_views
from .seam_offsets import seam_pieces


@dataclass(frozen=True)
class SeamGlassSettings:
    """When seams say that glass is thick or bowed.

    Parameters
    ----------
    use : bool
    usual, spread : float
        Thickness of mirrors as they are sold, and one standard deviation [m].
    least, most : float
        Glass is thick from here on; none is thicker than the latter [m].
    gain : float
        By so much the offsets must be likelier with a frame's bow than without: twice the log of the ratio.
    unlit_deviations : float
        By so many of its standard deviations the thickness must differ from 0 where light comes one way.
    min_pieces : int
        Of seams between the direct view and the mirrors'.
    """

    use: bool = True
    usual: float = 0.005
    spread: float = 0.0009
    least: float = 0.0025
    most: float = 0.009
    gain: float = 0.0
    unlit_deviations: float = 3.0
    min_pieces: int = 12


_NOISE, _PER_GAP = 0.003, 0.1  # of a piece's offset: of itself [m], and as a share of its gap
_CORRELATED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_PLACED = {"reflections", "views", "seams"}  # what moved a mirror by surface that two views show
_LIKELY = 0.5  # from so likely on glass may be thick though what is seen twice does not show it
_BIAS = 0.0015  # what all offsets between two views have in common [m]
_TOUCHING, _PER_NOISE = 0.0005, 0.4  # how well an outline tells the thickness: by itself [m], and of readings' noise
_STEP = 0.001  # by which the thickness is changed to see how it moves what touches the outline [m]
_NEAR, _FEWEST_TOUCHING = 6.0, 40  # px from the outline within which a piece may be of it, and how many must be
_ROUNDS = 8  # in which outliers are weighed anew
_OUTLIER = 2.0  # deviations from which an offset weighs less


@dataclass(frozen=True)
class _Offsets:
    """Pieces (K,) of the seams between the direct view and one mirror's.

    ``offset`` [m], its ``noise`` [m], ``thickness`` its change a metre of glass, ``bow`` its change by the frame's bow
    [m], all 0 where the frame shows none.
    """

    offset: np.ndarray
    noise: np.ndarray
    thickness: np.ndarray
    bow: np.ndarray


def glass_by_seams(
    mirrors: Sequence[Mirror],
    maps: ViewMaps,
    mesh: Mesh,
    settings: SeamGlassSettings | None = None,
    lit_twice: bool = True,
    outline: Outline | None = None,
    intrinsics: Intrinsics | None = None,
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors of glass as thick, all alike, and as bowed as the seams show; as they were where these do not show it.

    Parameters
    ----------
    mirrors : sequence of Mirror
        In the order of the views that ``maps`` says are reflected; camera frame.
    maps : ViewMaps
        Of one camera that measures time.
    mesh : Mesh
        As :func:`.zipper.zip_patches` leaves it.
    settings : SeamGlassSettings
    lit_twice : bool
        Light comes two ways, so that what is seen twice said nothing; else seams must show thick glass more clearly,
        glass that they do not even make likely to be thick counts as thin, and bows are known already.
    outline : Outline, optional
        Of the body as it is seen directly: what a mirror shows of its sides touches it, through glass of the right
        thickness.
    intrinsics : Intrinsics, optional
        Of the camera; with an outline.

    Returns
    -------
    mirrors : list of Mirror
        Less certain by how well the thickness is known, or by that of glass which may be thick.
    notes : tuple of str
        What was found, for the user; empty when nothing was.
    """
    settings = settings or SeamGlassSettings()
    behind = mirrored_views(maps)
    asked = [
        k for k, m in enumerate(mirrors)
        if m.source in ("picked", "found") and m.glass_thickness == 0.0 and (lit_twice or not _PLACED & {*m.moved_by})
    ]  # fmt: skip
    if not settings.use or not asked or len(maps.to_view) - len(behind) != 1:
        return list(mirrors), ()
    pieces = seam_pieces(mesh, maps)
    seams = []
    for k in asked:
        of = (pieces.views[:, 0] == 0) & (pieces.views[:, 1] == behind[k])
        shown, along = reflect(pieces.high[of], mirrors[k]), pieces.along[of]
        thick = np.einsum("nc,nc->n", thickness_moves(mirrors[k], shown, True), along)
        bow = np.zeros(int(of.sum()))
        if lit_twice and (bowed := _with_bow(mirrors[k])) is not None:
            bow = np.einsum("nc,nc->n", _placed(shown, bowed) - pieces.high[of], along)
        seams.append(_Offsets(pieces.offset[of], np.hypot(_NOISE, _PER_GAP * pieces.gap[of]), thick, bow))
    if sum(len(s.offset) for s in seams) < settings.min_pieces:
        return list(mirrors), ()
    bent = _likely_bows(seams, settings)
    thickness, error = _thickness(seams, bent)
    if outline is not None and intrinsics is not None:
        through = [((b and _with_bow(mirrors[k])) or mirrors[k], behind[k]) for k, b in zip(asked, bent, strict=True)]
        touching, blur = _touching(through, maps, outline, intrinsics, settings)
        share = error**2 / (error**2 + blur**2)
        thickness, error = thickness + share * (touching - thickness), float(np.sqrt(1.0 - share)) * error
    thick = thickness > max(settings.least, (1.0 if lit_twice else settings.unlit_deviations) * error)
    likely = 1.0 if thick else _likely_thick(thickness, error, settings)
    doubt = settings.usual * float(np.sqrt(likely)) if lit_twice or likely > _LIKELY else 0.0
    if thick:  # how thick mirrors are is known beforehand, once these are known to be thick
        share = settings.spread**2 / (settings.spread**2 + error**2)
        thickness = float(np.clip(settings.usual + share * (thickness - settings.usual), settings.least, settings.most))
        doubt = float(np.sqrt(share)) * error
    out, notes = list(mirrors), []
    for k, is_bent in zip(asked, bent, strict=True):
        bowed = _with_bow(mirrors[k])
        if is_bent and bowed is not None:
            out[k] = with_reason(bowed, mirrors[k], "bow")
            notes.append(
                Notice(
                    "{name}: its glass is bowed by {sag:.1f} mm, as its frame and the seams show; what it shows is "
                    "reflected accordingly",
                    name=mirrors[k].name, sag=1000.0 * abs(bowed.sag), mirrors=[mirrors[k].name],
                )
            )  # fmt: skip
        if thick:
            out[k] = behind_front(out[k], thickness)
        out[k] = _less_certain(out[k], doubt)
    if thick:
        notes.append(
            Notice(
                "{names}: the glass is taken to be {thickness:.0f} mm thick, as the seams between what is seen "
                "directly and in it show; the delay and the place where it reflects are heeded. Give glass_thickness "
                "where it is known",
                names=" and ".join(f"“{mirrors[k].name}”" for k in asked), thickness=1000.0 * thickness,
                mirrors=[mirrors[k].name for k in asked],
            )
        )  # fmt: skip
    return out, tuple(notes)


def seen_through(
    patches: list[Mesh], maps: ViewMaps, before: Sequence[Mirror], after: Sequence[Mirror]
) -> tuple[list[Mesh], ViewMaps]:
    """Patches where the glass ``after`` shows them, for a camera that measures time; maps moved with them, rigidly."""
    behind, motions, placed = mirrored_views(maps), [], list(patches)
    for view, old, new in zip(behind, before, after, strict=True):
        real = patches[view].vertices
        if new is old or not len(real):
            motions.append(np.eye(4))
            continue
        moved_to = _placed(reflect(real, old), new)
        motions.append(_rigid(real, moved_to))
        placed[view] = replace(patches[view], vertices=moved_to)
    _, maps = move_views(patches, maps, behind, motions)
    return placed, maps


def _likely_thick(thickness: float, error: float, settings: SeamGlassSettings) -> float:
    """How likely glass is as thick as usual, or else thin, by a thickness that was measured [0..1]."""
    thin = (thickness / error) ** 2
    thick = (thickness - settings.usual) ** 2 / (error**2 + settings.spread**2)
    return float(1.0 / (1.0 + np.exp(np.clip(0.5 * (thick - thin), -50.0, 50.0))))


def _less_certain(mirror: Mirror, thickness: float) -> Mirror:
    """The mirror, whose glass may be thicker or thinner by a ``thickness`` [m], one standard deviation."""
    if mirror.covariance is None or thickness == 0.0:
        return mirror
    moves = thickness_moves(mirror, reflect(person_before(mirror), mirror), True)
    shift = 0.5 * thickness * float(np.sqrt((moves**2).sum(axis=1).mean()))  # which moves reflections by twice itself
    return replace(mirror, covariance=mirror.covariance + np.diag((0.0, 0.0, shift**2)))


def _with_bow(mirror: Mirror) -> Mirror | None:
    """The mirror as bowed as its frame shows and nothing has confirmed yet; None where it shows no bow."""
    if mirror.frame_bow is None or mirror.sag != 0.0:
        return None
    bowed = moved(mirror, np.asarray(mirror.frame_bow[:3]))
    return replace(bowed, sag=mirror.frame_bow[3], sag_error=0.0, frame_bow=None)


def _placed(shown: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Where readings (N, 3) that lie where thin and flat glass shows them really are [m]."""
    return reflect(flattened(shown, mirror, time_of_flight=True), mirror)


def _likely_bows(seams: list[_Offsets], settings: SeamGlassSettings) -> list[bool]:
    """Which frames' bows make the offsets so much smaller that they are the glass's, too."""
    choices = [(False, True) if s.bow.any() else (False,) for s in seams]
    best, least = [False] * len(seams), np.inf
    for bent in product(*choices):
        thickness, _ = _thickness(seams, bent)
        cost = sum(bent) * settings.gain
        for s, is_bent in zip(seams, bent, strict=True):
            rest = (s.offset + is_bent * s.bow + thickness * s.thickness) / s.noise
            cost += float(np.sum(_OUTLIER**2 * np.log1p((rest / _OUTLIER) ** 2))) / _CORRELATED
        if cost < least:
            best, least = list(bent), cost
    return best


def _touching(
    shown: list[tuple[Mirror, int]],
    maps: ViewMaps,
    outline: Outline,
    intrinsics: Intrinsics,
    settings: SeamGlassSettings,
) -> tuple[float, float]:
    """The thickness through which what mirrors show of a body's sides touches its outline.

    And one standard deviation of it [m], infinite where nothing touches. ``shown``: mirrors and their views.
    """
    image, found = RgbdImage(maps.depth, intrinsics), []
    sigma, noise = noise_of(maps.depth, maps.labels), 0.0
    for mirror, view in shown:
        pieces = surfaces(image, maps.labels, view, sigma)
        normals = pieces.normals - 2.0 * (pieces.normals @ mirror.normal)[:, None] * mirror.normal
        gaps = []
        for thickness in (settings.usual, settings.usual + _STEP):
            points = _placed(pieces.points, behind_front(mirror, thickness))
            met = contact(replace(pieces, points=points, normals=normals), np.eye(4), outline, intrinsics)
            gaps.append(met[np.abs(met) < _NEAR])
        inside, then = (float(np.median(g)) if len(g) >= _FEWEST_TOUCHING else np.nan for g in gaps)
        if inside > then:
            found.append(float(np.clip(settings.usual + _STEP * inside / (inside - then), 0.0, settings.most)))
            noise = max(noise, float(maps.noise[view] * np.median(pieces.points[:, 2])))
    if not found:
        return settings.usual, np.inf
    return float(np.mean(found)), float(np.hypot(_TOUCHING, _PER_NOISE * noise))


def _thickness(seams: list[_Offsets], bent: Sequence[bool]) -> tuple[float, float]:
    """The thickness that makes offsets vanish, and one standard deviation of it [m]; robust."""
    offset = np.concatenate([s.offset + is_bent * s.bow for s, is_bent in zip(seams, bent, strict=True)])
    slope, noise = np.concatenate([s.thickness for s in seams]), np.concatenate([s.noise for s in seams])
    weights, thickness = noise**-2.0, 0.0
    for _ in range(_ROUNDS):
        thickness = -float((weights * slope) @ offset / ((weights * slope) @ slope))
        rest = (offset + slope * thickness) / noise
        weights = noise**-2.0 / (1.0 + (rest / _OUTLIER) ** 2)
    information = float((weights * slope) @ slope) / _CORRELATED
    bias = _BIAS * abs(float(weights @ slope)) / float((weights * slope) @ slope)
    scatter = max(MAD * float(np.median(np.abs(offset + slope * thickness) / noise)), 1.0)  # more than expected
    return thickness, float(np.hypot(scatter * information**-0.5, bias))


def _rigid(points: np.ndarray, to: np.ndarray) -> np.ndarray:
    """The rotation and shift (4, 4) that bring points (N, 3) nearest to others (Kabsch 1976)."""
    middle, there = points.mean(axis=0), to.mean(axis=0)
    left, _, right = np.linalg.svd((points - middle).T @ (to - there))
    sign = np.diag((1.0, 1.0, np.sign(np.linalg.det(left @ right))))
    motion = np.eye(4)
    motion[:3, :3] = (left @ sign @ right).T
    motion[:3, 3] = there - motion[:3, :3] @ middle
    return motion
