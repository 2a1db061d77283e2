"""A mirror's plane, and its covariance, from what is seen both directly and in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage, project
from ..errors import Notice
from ..mirrors import Mirror
from ..mirrors.curved_glass import REFRACTION, behind_front, flattened, thickness_moves
from ..mirrors.glass_kernels import (
    NEAREST,
    before_plane,
    glass_of,
    nearest_pixel,
    reflected,
    reflected_direction,
    share_at_glass,
)
from ..mirrors.mirror import moved, reflect, reflection_moves, with_reason
from ..numeric.kernels import njit
from ..numeric.threads import each
from .pose_solver import (
    ALL,
    NormalEquations,
    PoseFit,
    confirmed_fit,
    frames_prior,
    judged,
    scaled_cauchy_weights,
    solve_pose,
    weighted_equations,
)

_GATES = (1.0, 1.0, 1.0, 1.0, 0.4, 0.4, 0.4, 0.4)  # times the gate, each round: the first bring the surfaces near
_SETTLED = 2e-5  # of slopes [rad] and shifts [m]
_LEAST_NOISE = 0.002  # of the distances [m]
_LEAST_GAIN = 0.003  # by which the median distance must fall: less is within what cameras misread [m]
_UNLIKE = 0.35  # of the shift: by more the shifts that the halves ask for must not differ
_CORRELATED = 10.0  # neighbouring pixels share so much of their errors that this many count as one
_THINNEST, _THICKEST = 0.0015, 0.009  # of a mirror's glass [m]
_LIKE_OTHERS = 0.001  # by which the thickness of a rig's mirrors differs, one standard deviation [m]
_MOST_READINGS = 6000  # in a glass that are used; of as many neighbours share no less


@dataclass(frozen=True)
class JointSettings:
    """When what is seen both directly and in a mirror may move the mirror.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    gate : float
        Surfaces at a larger distance from each other than this are not paired [m].
    offset : float
        How far the glass may well lie off the frame's plane, one standard deviation [m].
    max_shift, max_slope : float
        Bounds of the whole correction [m], [rad].
    gain : float
        The correction is made only when it brings the distance of surfaces it was not fitted to down to this share.
    min_pairs : int
        Of surface points seen both ways.
    two_sided : bool
        The two sides of a thin board count as one surface.
    """

    use: bool = True
    gate: float = 0.06
    offset: float = 0.01
    max_shift: float = 0.03
    max_slope: float = 0.01
    gain: float = 0.5
    min_pairs: int = 24
    two_sided: bool = False


def align_reflections(
    image: RgbdImage, mirrors: list[Mirror], settings: JointSettings | None = None, thickness: float | None = None
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors moved until what they show coincides with what is seen directly, where that is shown to help.

    A frame may project in front of its glass, which displaces the reflection by twice as much and which no fit of the
    frame can show. Readings in the glass are reflected, compared with the direct readings in the same line of sight,
    and the distances along these surfaces' normals minimised over two slopes and a shift, with the frame's covariance
    (and ``offset``) as prior. The pairs are split into two sets of image blocks; both must ask for the same correction,
    and what one asks for must bring the other's pairs together.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].
    thickness : float, optional
        The mirrors are about as thick, see :func:`.glass_alignment.thick_glass` [m]: what displaces the reflection is
        taken for the thickness of the glass, which a camera that measures the time of light reads along the ray as
        well, and not for a frame that projects in front of it. A mirror of which too little is seen twice is taken to
        be as thick as the others.

    Returns
    -------
    mirrors : list of Mirror
    notes : tuple of str
        What was moved, for the user.
    """
    settings = settings or JointSettings()
    if not settings.use:
        return list(mirrors), ()

    thick = thickness is not None

    def aligned(mirror: Mirror) -> Mirror | None:
        movable = mirror.covariance is not None and mirror.source in ("picked", "found")
        usable = movable and mirror.rectangle is not None
        return _aligned(image, mirror, settings, thick) if usable else None

    out, notes = [], []
    found = each(aligned, mirrors)
    if thick:
        assert thickness is not None  # else it is not
        found = _as_thick_as_others(mirrors, found, thickness)
    for mirror, better in zip(mirrors, found, strict=True):
        if better is not None:
            notes.append(_note(mirror, better))
        out.append(mirror if better is None else with_reason(better, mirror, "reflections"))
    return out, tuple(notes)


def _as_thick_as_others(mirrors: list[Mirror], found: list[Mirror | None], about: float) -> list[Mirror | None]:
    """``found``, with mirrors of which nothing was shown as thick as those of which it was, or else ``about`` so."""
    known = [m.glass_thickness for m in found if m is not None]
    usual, spread = float(np.median(known)) if known else about, _LIKE_OTHERS
    out: list[Mirror | None] = []
    for mirror, better in zip(mirrors, found, strict=True):
        if better is None and mirror.covariance is not None and mirror.source in ("picked", "found"):
            extra = np.diag((0.0, 0.0, (REFRACTION * spread) ** 2))
            better = replace(behind_front(mirror, usual), covariance=mirror.covariance + extra)
        out.append(better)
    return out


def _note(mirror: Mirror, better: Mirror) -> Notice:
    """What is reported of a mirror that was moved, or whose glass is thick."""
    if better.glass_thickness > mirror.glass_thickness:
        return Notice(
            "{name}: its glass is {thickness:.0f} mm thick, as surfaces seen both directly and in it show; the delay "
            "and refraction in it are taken back",
            name=mirror.name, thickness=1000.0 * better.glass_thickness, mirrors=[mirror.name],
        )  # fmt: skip
    shift = 1000.0 * float((better.point - mirror.point) @ mirror.normal)
    if shift < 0.0:
        return Notice(
            "{name}: its glass lies {depth:.0f} mm behind the front of its frame, as surfaces seen both directly and "
            "in it show; the mirror's plane was moved there",
            name=mirror.name, depth=-shift, mirrors=[mirror.name],
        )  # fmt: skip
    return Notice(
        "{name}: its glass lies {depth:.0f} mm in front of its frame, as surfaces seen both directly and in it show; "
        "the mirror's plane was moved there",
        name=mirror.name, depth=shift, mirrors=[mirror.name],
    )  # fmt: skip


def _aligned(image: RgbdImage, mirror: Mirror, settings: JointSettings, thick: bool) -> Mirror | None:
    """The mirror shifted, or its glass taken for ``thick``, until what is seen twice coincides."""
    depth, intrinsics = image.depth, image.intrinsics
    points, facing, blocks = _shown(mirror, depth, intrinsics, settings)
    if len(points) < settings.min_pairs:
        return None
    parts = {which: (points[mine], facing[mine]) for which, mine in ((0, blocks == 0), (1, blocks == 1))}
    parts[ALL] = points, facing
    prior = frames_prior([mirror], [settings.offset])
    gates = [settings.gate * share for share in _GATES]

    def corrected_by(correction: np.ndarray) -> Mirror:
        if not thick:
            return moved(mirror, correction)
        return behind_front(moved(mirror, correction * (1.0, 1.0, 0.0)), float(correction[2]))

    def pairs(correction: np.ndarray, gate: float, which: int) -> tuple[Mirror, np.ndarray, np.ndarray, np.ndarray]:
        at = corrected_by(correction)
        points, facing = parts[which]
        return at, *_pairs(at, flattened(points, at, True), facing, depth, intrinsics, settings, gate)

    def fit(which: int, _: PoseFit | None) -> PoseFit | None:
        def observe(correction: np.ndarray, gate: float) -> list[NormalEquations] | None:
            at, q, normals, distances = pairs(correction, gate, which)
            if len(distances) < settings.min_pairs // 3:
                return None
            shown = reflect(q, at)
            moves = np.einsum("nci,nc->ni", reflection_moves(at, shown), normals)
            if thick:
                moves[:, 2] = np.einsum("nc,nc->n", thickness_moves(at, shown, True), normals)
            weights = scaled_cauchy_weights(distances, _LEAST_NOISE, _CORRELATED)
            return [weighted_equations(moves, distances, weights)]

        return solve_pose(observe, prior, gates, _SETTLED)

    def distances(correction: np.ndarray, half: int) -> np.ndarray:
        return np.abs(pairs(correction, settings.gate, half)[3])

    def promises(before: list[np.ndarray], after: list[np.ndarray]) -> bool:
        """Also false where there are no pairs any more."""
        return _median(after) <= settings.gain * _median(before)

    def confirms(before: list[np.ndarray], after: list[np.ndarray]) -> bool:
        enough = min(len(part) for part in before + after) >= settings.min_pairs // 3
        return enough and promises(before, after) and _median(before) - _median(after) >= _LEAST_GAIN

    before = judged(distances, np.zeros(3))
    if sum(map(len, before)) < settings.min_pairs or _median(before) < _LEAST_GAIN:
        return None
    found = confirmed_fit(fit, distances, confirms, promises, before)
    if found is None:
        return None
    whole, halves = found
    slopes, shift = whole.correction[:2], whole.correction[2]  # or thickness
    if abs(halves[0].correction[2] - halves[1].correction[2]) > _UNLIKE * abs(shift):
        return None
    if abs(shift) > settings.max_shift or np.abs(slopes).max() > settings.max_slope:
        return None
    if thick and not _THINNEST < shift < _THICKEST:
        return None
    return replace(corrected_by(whole.correction), covariance=_of_plane(whole.covariance, thick))


def _of_plane(covariance: np.ndarray, thick: bool) -> np.ndarray:
    """Covariance (3, 3) of slopes and shift, where the third unknown was the thickness.

    At the person an error of that is one of the apparent plane and of the delay, about twice as much.
    """
    if not thick:
        return covariance
    scale = np.diag((1.0, 1.0, REFRACTION))
    return scale @ covariance @ scale


def _median(parts: list[np.ndarray]) -> float:
    """Median over both halves; not a number of none."""
    both = np.concatenate(parts)
    return float(np.median(both)) if len(both) else np.nan


def _shown(mirror, depth, intrinsics, settings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the glass shows that faces so that the camera might see it directly too.

    Points (N, 3) and normals (N, 3) as read, behind the glass, and halves (N,) by image blocks.
    """
    corners = np.array([(x, y) for x in mirror.rectangle[0] for y in mirror.rectangle[1]])
    box = project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    size = np.array((intrinsics.width, intrinsics.height))
    if not np.isfinite(box).all():
        box = np.array(((0.0, 0.0), size))
    low = np.clip(box.min(axis=0), 3, size - 3).astype(np.int64)
    high = np.clip(box.max(axis=0), 3, size - 3).astype(np.int64)
    room = max(int(np.prod(high - low)), 1)
    points, normals, half = np.empty((room, 3)), np.empty((room, 3)), np.empty(room, np.int8)
    n = _shown_kernel(
        depth, intrinsics.packed, glass_of([mirror]), low, high, settings.two_sided, points, normals, half
    )
    thin = slice(0, n, n // _MOST_READINGS + 1)
    points, normals, half = (np.ascontiguousarray(part[thin]) for part in (points, normals, half))
    return points, normals, half


def _pairs(mirror, points, facing, depth, intrinsics, settings, gate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reflected points (N, 3), normals (N, 3) of the direct surfaces they meet, and distances (N,) along these."""
    q, normals, gap = np.empty_like(points), np.empty_like(points), np.empty(len(points))
    n = _pairs_kernel(
        depth, intrinsics.packed, glass_of([mirror]), points, facing, gate, settings.two_sided, q, normals, gap
    )
    return q[:n], normals[:n], gap[:n]


@njit(cache=True, nogil=True)
def _surface(depth, camera, u, v, p, n):
    """Point and unit normal towards the camera of the reading at a pixel; False at an edge or a gap."""
    fx, fy, cx, cy = camera
    z = depth[v, u]
    if z == 0:
        return False
    step = 2
    left, right, up, down = depth[v, u - step], depth[v, u + step], depth[v - step, u], depth[v + step, u]
    for other in (left, right, up, down):
        if other == 0 or abs(other - z) > 0.05:
            return False
    x, y = (u - cx) / fx, (v - cy) / fy
    p[0], p[1], p[2] = x * z, y * z, z
    ax, ay, az = (x + step / fx) * right - (x - step / fx) * left, y * (right - left), right - left
    bx, by, bz = x * (down - up), (y + step / fy) * down - (y - step / fy) * up, down - up
    n[0], n[1], n[2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    if n[0] * p[0] + n[1] * p[1] + n[2] * p[2] > 0:
        length = -length
    for k in range(3):
        n[k] /= length
    return True


_OFF_FRAME, _BEHIND_GLASS, _BEFORE_GLASS = 0.04, 0.15, 0.1  # nearer to them readings may be the frame's or a wall's [m]
_ACROSS = 0.2  # cosine between normals under which a surface stands across the mirror, and says nothing of its place
_ALIKE, _OTHER_SIDE = 0.8, -0.9  # cosines between normals of one surface, and of the two sides of a board


@njit(cache=True, nogil=True)
def _shown_kernel(depth, intrinsics, glass, low, high, two_sided, out_p, out_n, out_half):
    fx, fy, cx, cy = intrinsics
    p, n = np.empty(3), np.empty(3)
    count = 0
    for v in range(low[1], high[1]):
        y = (v - cy) / fy
        for u in range(low[0], high[0]):
            z = depth[v, u]
            if z == 0:
                continue
            at = share_at_glass(glass, 0, (u - cx) / fx, y, 1.0, _OFF_FRAME)
            if z < at + _BEHIND_GLASS or not _surface(depth, intrinsics, u, v, p, n):
                continue
            # surfaces at right angles to the mirror, like the floor, say nothing of its place
            normal = glass.planes[0]
            if abs(n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]) < _ACROSS:
                continue
            qx, qy, qz = reflected(glass, 0, p[0], p[1], p[2])
            mx, my, mz = reflected_direction(glass, 0, n[0], n[1], n[2])
            if qx * mx + qy * my + qz * mz > 0 and not two_sided:
                continue
            for c in range(3):
                out_p[count, c], out_n[count, c] = p[c], n[c]
            out_half[count] = (u // 12 + v // 12) % 2
            count += 1
    return count


@njit(cache=True, nogil=True)
def _pairs_kernel(depth, intrinsics, glass, points, facing, gate, two_sided, out_q, out_n, out_gap):
    height, width = depth.shape
    q, m, d, e = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for i in range(len(points)):
        q[0], q[1], q[2] = reflected(glass, 0, points[i, 0], points[i, 1], points[i, 2])
        if q[2] < NEAREST:
            continue
        x, y = nearest_pixel(q[0], q[1], q[2], intrinsics)
        if x < 3 or y < 3 or x >= width - 3 or y >= height - 3 or not _surface(depth, intrinsics, x, y, d, e):
            continue
        m[0], m[1], m[2] = reflected_direction(glass, 0, facing[i, 0], facing[i, 1], facing[i, 2])
        alike, gap, far = 0.0, 0.0, 0.0
        for r in range(3):
            alike += m[r] * e[r]
            gap += e[r] * (d[r] - q[r])
            far += (d[r] - q[r]) ** 2
        if alike < _ALIKE and not (two_sided and alike < _OTHER_SIDE):
            continue
        if abs(gap) > gate or far > 9.0 * gate * gate or before_plane(glass, 0, d[0], d[1], d[2]) < _BEFORE_GLASS:
            continue
        for c in range(3):
            out_q[count, c], out_n[count, c] = q[c], e[c]
        out_gap[count] = gap
        count += 1
    return count
