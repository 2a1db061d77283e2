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
from ..mesh.normals import vertex_normals
from ..mirrors import Mirror
from ..mirrors.curved_glass import behind_front, bow_moves, flattened, thickness_moves
from ..mirrors.mirror import moved, person_before, reflect, reflection_moves, with_reason
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
    each : float
        By how much the glass of one mirror is thicker or thinner than usual, one standard deviation [m].
    sag : float
        How bowed mirrors are as they are sold, one standard deviation [m].
    """

    use: bool = True
    usual: float = 0.005
    spread: float = 0.0009
    least: float = 0.0025
    most: float = 0.009
    gain: float = 0.0
    unlit_deviations: float = 3.0
    min_pieces: int = 12
    each: float = 0.0012
    sag: float = 0.0012


_NOISE, _PER_GAP = 0.003, 0.1  # of a piece's offset: of itself [m], and as a share of its gap
_CORRELATED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_PLACED = {"reflections", "views", "seams"}  # what moved a mirror by surface that two views show
_LIKELY = 0.5  # from so likely on glass may be thick though what is seen twice does not show it
_BIAS = 0.0015  # what all offsets between two views have in common [m]
_TOUCHING, _PER_NOISE = 0.0005, 0.4  # how well an outline tells the thickness: by itself [m], and of readings' noise
_STEP = 0.001  # by which the thickness is changed to see how it moves what touches the outline [m]
_NEAR, _FEWEST_TOUCHING = 6.0, 40  # px from the outline within which a piece may be of it, and how many must be
_BEST_SAG = 1e-4  # no sag is known better [m]
_BEST_FRAME = 5e-5  # nor a frame's slopes [rad], shift and sag [m], one standard deviation
_ENDS_NOISE, _ENDS_ALIKE = 0.7, 20.0  # px of one row's end; so many rows, of a limb or the trunk, err alike
_ENDS_BIAS, _ENDS_SPREAD = 0.1, 0.35  # px by which all ends stay inside of the outline, and how well that is known
_SIDEWAYS, _EDGE_ON = 0.7, 0.3  # cosines of a surface's normal with the rows, and with the line of sight, at an end
_CROSSINGS = 12  # most rows that an edge of a patch crosses
_TINY = 1e-9
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


@dataclass(frozen=True)
class _Ends:
    """Where the silhouette (K,) of what a mirror shows ends in the picture, beside the body's outline.

    ``gaps`` how far inside of that [px], ``jacobian`` (K, 5) how they would shrink with the mirror's two slopes [rad],
    its shift, sag and thickness [m].
    """

    gaps: np.ndarray
    jacobian: np.ndarray


@dataclass(frozen=True)
class _Touched:
    """What a body's outline and the frame say together of the glass that shows its sides.

    ``step`` (5,) of :class:`_Ends` from glass of the usual thickness, its ``covariance`` (5, 5), and the ``cost`` that
    is left: twice the log of the likelihood, but for its sign and a constant.
    """

    step: np.ndarray
    covariance: np.ndarray
    cost: float


def glass_by_seams(
    mirrors: Sequence[Mirror],
    maps: ViewMaps,
    mesh: Mesh,
    settings: SeamGlassSettings | None = None,
    lit_twice: bool = True,
    outline: Outline | None = None,
    intrinsics: Intrinsics | None = None,
    patches: Sequence[Mesh] | None = None,
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors of glass as thick and as bowed as the seams show; as they were where these do not show it.

    Seams say of all mirrors together whether they are thick. How thick, how bowed and how turned each of them is, the
    outline then tells, where there is one, together with the frame.

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
    patches : sequence of Mesh, optional
        Of all views, as thin and flat glass shows them; with an outline.

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
    touched: list[tuple[_Touched | None, _Touched | None]] = [(None, None)] * len(asked)
    if outline is not None and intrinsics is not None and patches is not None:
        touched = [_touched(mirrors[k], patches[behind[k]], outline, intrinsics, settings) for k in asked]
    bent = _likely_bows(seams, settings, [tuple(0.0 if t is None else t.cost for t in both) for both in touched])
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
    for k, is_bent, both in zip(asked, bent, touched, strict=True):
        bowed, fit = _with_bow(mirrors[k]) if is_bent else None, both[is_bent]
        at = mirrors[k] if bowed is None else with_reason(bowed, mirrors[k], "bow")
        if thick and fit is not None:
            at = _as_touched(mirrors[k], fit, settings)
            at = at if bowed is None else with_reason(at, mirrors[k], "bow")
        else:
            at = _less_certain(behind_front(at, thickness) if thick else at, doubt)
        out[k] = at
        if bowed is not None:
            notes.append(
                Notice(
                    "{name}: its glass is bowed by {sag:.1f} mm, as its frame and the seams show; what it shows is "
                    "reflected accordingly",
                    name=at.name, sag=1000.0 * abs(at.sag), mirrors=[at.name],
                )
            )  # fmt: skip
    if thick:
        notes.append(
            Notice(
                "{names}: the glass is taken to be {thickness:.0f} mm thick, as the seams between what is seen "
                "directly and in it show; the delay and the place where it reflects are heeded. Give glass_thickness "
                "where it is known",
                names=" and ".join(f"“{mirrors[k].name}”" for k in asked),
                thickness=1000.0 * float(np.mean([out[k].glass_thickness for k in asked])),
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


def _as_touched(mirror: Mirror, fit: _Touched, settings: SeamGlassSettings) -> Mirror:
    """The mirror of glass as its frame and the outline say, and as certain."""
    thickness = float(np.clip(settings.usual + fit.step[4], settings.least, settings.most))
    deviations = np.sqrt(np.diag(fit.covariance))
    at = replace(
        behind_front(moved(mirror, fit.step[:3]), thickness), covariance=fit.covariance[:3, :3],
        frame_bow=None, bow_by_frame=None,
    )  # fmt: skip
    if mirror.rectangle is not None:
        at = replace(at, sag=mirror.sag + float(fit.step[3]), sag_error=float(deviations[3]))
    return _less_certain(at, float(deviations[4]))


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
    return replace(bowed, sag=mirror.frame_bow[3], sag_error=0.0, frame_bow=None, bow_by_frame=None)


def _placed(shown: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Where readings (N, 3) that lie where thin and flat glass shows them really are [m]."""
    return reflect(flattened(shown, mirror, time_of_flight=True), mirror)


def _likely_bows(seams: list[_Offsets], settings: SeamGlassSettings, costs: Sequence[tuple[float, ...]]) -> list[bool]:
    """Which frames' bows make the offsets so much smaller that they are the glass's, too.

    ``costs``: of each mirror by the outline, without the bow and with it.
    """
    choices = [(False, True) if s.bow.any() else (False,) for s in seams]
    best, least = [False] * len(seams), np.inf
    for bent in product(*choices):
        thickness, _ = _thickness(seams, bent)
        cost = sum(bent) * settings.gain
        for s, is_bent, by_outline in zip(seams, bent, costs, strict=True):
            cost += by_outline[is_bent]
            rest = (s.offset + is_bent * s.bow + thickness * s.thickness) / s.noise
            cost += float(np.sum(_OUTLIER**2 * np.log1p((rest / _OUTLIER) ** 2))) / _CORRELATED
        if cost < least:
            best, least = list(bent), cost
    return best


def _touched(
    mirror: Mirror, patch: Mesh, outline: Outline, intrinsics: Intrinsics, settings: SeamGlassSettings
) -> tuple[_Touched | None, _Touched | None]:
    """What the outline says of a mirror whose thin and flat glass shows ``patch``: without its frame's bow and with it.

    Both are the same where the frame shows no bow clearly: then its readings say by themselves how much is likely.
    Nothing of a mirror of which it is not known how certain it is.
    """
    if mirror.covariance is None:
        return None, None
    usual = behind_front(mirror, settings.usual)
    ends = _ends(usual, _placed(reflect(patch.vertices, mirror), usual), patch.triangles, outline, intrinsics)
    flat = _fitted(ends, *_known(mirror, False, settings))
    return flat, flat if mirror.frame_bow is None else _fitted(ends, *_known(mirror, True, settings))


def _known(mirror: Mirror, is_bent: bool, settings: SeamGlassSettings) -> tuple[np.ndarray, np.ndarray]:
    """What is known beforehand of slopes, shift, sag and thickness: information (5, 5) and that times the best (5,)."""
    information, right = np.zeros((5, 5)), np.zeros(5)
    by_frame = mirror.bow_by_frame
    if by_frame is not None and (is_bent or (mirror.frame_bow is None and not mirror.moved_by)):
        step, covariance = by_frame
        information[:4, :4] = np.linalg.inv(covariance + _BEST_FRAME**2 * np.eye(4))
        right[:4] = information[:4, :4] @ step
        information[3, 3] += settings.sag**-2
    else:
        assert mirror.covariance is not None  # it was looked at
        information[:3, :3] = np.linalg.inv(mirror.covariance)
        # glass that is not bowed as its frame is, may be bowed otherwise
        information[3, 3] = (settings.sag if mirror.sag == 0.0 else max(mirror.sag_error, _BEST_SAG)) ** -2
    information[4, 4] = settings.each**-2
    return information, right


def _ends(
    mirror: Mirror, vertices: np.ndarray, triangles: np.ndarray, outline: Outline, intrinsics: Intrinsics
) -> _Ends:
    """Where the silhouette of a mesh (V, 3), (T, 3) that ``mirror`` shows ends beside the outline.

    One end for each row and side of each part of the body. The ends are where the mesh's edges cross the rows, the
    outermost of those where it is seen edge-on.
    """
    lines = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lines = np.unique(np.sort(lines, axis=1), axis=0)
    z = np.maximum(vertices[:, 2], _TINY)
    v = vertices[:, 1] / z * intrinsics.fy + intrinsics.cy
    normals = vertex_normals(vertices, triangles)
    slant = np.einsum("nc,nc->n", normals, vertices) / np.maximum(np.linalg.norm(vertices, axis=1), _TINY)
    sideways = np.abs(normals) @ np.array((1.0, 0.0, 0.0))
    lines = lines[((np.abs(slant) < _EDGE_ON) & (sideways > _SIDEWAYS))[lines].any(axis=1)]
    first = np.ceil(v[lines].min(axis=1)).astype(np.int64)
    count = np.clip(np.floor(v[lines].max(axis=1)).astype(np.int64) - first + 1, 0, _CROSSINGS)
    line = np.repeat(np.arange(len(lines)), count)
    row = first[line] + np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    one, two = lines[line].T
    share = ((row - v[one]) / np.where(v[two] == v[one], 1.0, v[two] - v[one]))[:, None]
    at, normal = (a[one] + share * (a[two] - a[one]) for a in (vertices, normals))
    column = at[:, 0] / at[:, 2] * intrinsics.fx + intrinsics.cx
    x, y = np.rint(column).astype(np.int64) - outline.corner[0], row - outline.corner[1]
    inside = (x >= 0) & (y >= 0) & (x < outline.right.shape[1]) & (y < outline.right.shape[0])
    at, normal, column, x, y = at[inside], normal[inside], column[inside], x[inside], y[inside]
    rightward = normal[:, 0] > 0.0
    line_there = np.where(rightward, outline.right[y, x], outline.left[y, x])
    gaps = np.where(rightward, line_there - column, column - line_there)
    order = np.lexsort((gaps, line_there, rightward, y))
    key = np.column_stack((y, rightward, line_there))[order]
    outermost = order[(np.diff(key, axis=0, prepend=np.nan) != 0.0).any(axis=1)]
    kept = outermost[np.abs(gaps[outermost]) < _NEAR]
    at, outward, scale = at[kept], np.where(rightward[kept], 1.0, -1.0), intrinsics.fx / at[kept, 2]
    across = np.column_stack((outward, np.zeros(len(kept)), -outward * at[:, 0] / at[:, 2])) * scale[:, None]
    shown = reflect(at, mirror)
    bow = np.zeros_like(at) if mirror.rectangle is None else bow_moves(mirror, shown)
    others = np.stack((bow, thickness_moves(mirror, shown, True)), axis=2)
    moves = np.concatenate((reflection_moves(mirror, shown), others), axis=2)
    return _Ends(gaps[kept] - _ENDS_BIAS, np.einsum("nci,nc->ni", moves, across))


def _fitted(ends: _Ends, information: np.ndarray, right: np.ndarray) -> _Touched:
    """The step that closes the ends' gaps, by what is known beforehand; robust.

    By how much all ends stay inside of the outline is found along with it.
    """
    known, wanted = np.zeros((6, 6)), np.append(right, 0.0)
    known[:5, :5], known[5, 5] = information, _ENDS_SPREAD**-2
    rows = np.column_stack((ends.jacobian, np.ones(len(ends.gaps))))
    mean: np.ndarray = np.linalg.solve(known, wanted)
    x = mean
    weight = 1.0 / (_ENDS_ALIKE * _ENDS_NOISE**2)
    for _ in range(_ROUNDS):
        weights = weight / (1.0 + ((ends.gaps - rows @ x) / (_OUTLIER * _ENDS_NOISE)) ** 2)
        normal = known + (rows * weights[:, None]).T @ rows
        x = np.linalg.solve(normal, wanted + (rows * weights[:, None]).T @ ends.gaps)
    left = np.log1p(((ends.gaps - rows @ x) / (_OUTLIER * _ENDS_NOISE)) ** 2).sum() * _OUTLIER**2 / _ENDS_ALIKE
    cost = float(left + (x - mean) @ known @ (x - mean))
    return _Touched(x[:5], np.linalg.inv(normal)[:5, :5], cost)


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
