"""Views of a subject that turned before the camera, or that cameras stood about: from their order to their poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import MirrorScanError, Notice, ReconstructionError
from ..mesh.bvh import Bvh, build_bvh, closest_point
from ..mesh.half_edges import boundary_vertices
from ..mesh.normals import triangle_normals, vertex_normals
from ..numeric.rotations import about_axis, unit
from .joint import Edge, JointPoses, joint_registration
from .pairwise import IcpSettings, Registration, register

PAIRED_DEG = 125.0
"""Views that look at the subject from directions farther apart than this have too little in common for a pair."""

_BEHIND = np.arange(-0.02, 0.30, 0.02)
"""So far behind the mean of what a view shows the subject's axis is looked for [m]."""

_SAMPLES = 300  # points of a view that are compared for that
_FAR = 0.1  # m: a point that is farther from another view is not shown by it
_SPACINGS = 1.5  # a pair's points may be as far apart as so many points of one view
_REFINED = 3  # times that a pair is registered again by points that have a partner
_SAME_WAY = 0.8  # cosine between the normals of such a pair, at least
_FEWEST = 100  # such points
_NEIGHBOURS = 2  # in the order of the angles: to each side a view is registered with so many
_LEAST_OVERLAP = 0.15  # of a pair that counts, but for a view's best
_MOVED, _TURNED = 0.05, 10.0  # m, degrees: a pair that the other pairs correct by more contradicts them
_NOTED = 0.015  # m: corrections larger than this are warned of


@dataclass(frozen=True)
class SubjectView:
    """What one view shows of the subject, in its camera's frame.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        Of its surface as it is seen, open where nothing more is [m].
    triangles : np.ndarray [shape=(T, 3)]
    up : np.ndarray [shape=(3,)]
        Vertical.
    floor : float or None
        Height of the floor along ``up`` [m].
    """

    vertices: np.ndarray
    triangles: np.ndarray
    up: np.ndarray
    floor: float | None = None


@dataclass(frozen=True)
class RegisteredViews:
    """Poses found for views that had none.

    Parameters
    ----------
    poses : np.ndarray [shape=(N, 4, 4)]
        Rigid: each camera's frame → that of the first.
    angles : np.ndarray [shape=(N,)]
        From which side each view looks, as guessed [degrees], see :func:`guessed_poses`.
    pairs : tuple of (int, int)
        Views, from 0, that were registered with each other.
    registrations : tuple of Registration
        Of the pairs, as ICP left them.
    turned, shifted : np.ndarray [shape=(E,)]
        By how much the joint registration corrected each pair [rad], [m].
    notes : tuple of Notice
    """

    poses: np.ndarray
    angles: np.ndarray
    pairs: tuple[tuple[int, int], ...]
    registrations: tuple[Registration, ...]
    turned: np.ndarray
    shifted: np.ndarray
    notes: tuple[Notice, ...] = ()

    @property
    def residual(self) -> float:
        """Root mean square distance of all pairs' points [m], a pair as much as another."""
        return float(np.sqrt(np.mean([one.residual**2 for one in self.registrations])))


def even_angles(views: int, step: float | None = None) -> np.ndarray:
    """Angles (N,) [degrees] of views that follow each other evenly: ``step`` apart, by default once round."""
    return (360.0 / views if step is None else step) * np.arange(views)


def subject_frame(view: SubjectView) -> np.ndarray:
    """(4, 4): the camera's frame → one that stands on the floor within the subject, z up, y away from the camera.

    Its origin lies in the middle of the subject's outline, as far away as the mean of what is seen of its surface;
    without a floor as high as the lowest of the subject.
    """
    up = unit(np.asarray(view.up, np.float64))
    ahead = np.array([0.0, 0.0, 1.0])
    ahead = unit(ahead - (ahead @ up) * up)
    frame = np.eye(4)
    frame[:3, :3] = np.cross(ahead, up), ahead, up
    across, away, height = frame[:3, :3] @ np.asarray(view.vertices, np.float64).T
    low = float(np.percentile(height, 0.5)) if view.floor is None else view.floor
    frame[:3, 3] = -np.mean(np.percentile(across, (1, 99))), -away.mean(), -low
    return frame


def guessed_poses(views: Sequence[SubjectView], angles: np.ndarray) -> np.ndarray:
    """First poses (N, 4, 4) of views, each camera's frame → that of the first, by the order in which they were taken.

    The axis about which the views turn is the same before each camera, as on a turntable, or goes with what is seen, as
    where cameras stand at other distances; and lies somewhere behind that. What neighbours show is nearest to each
    other where it is right.

    Parameters
    ----------
    views : sequence of SubjectView
    angles : np.ndarray [shape=(N,)]
        By how much the subject had turned to its left, seen from above against the clock, before each view [degrees];
        or how far the camera had gone round it with the clock.
    """
    turns = np.tile(np.eye(4), (len(views), 1, 1))
    turns[:, :3, :3] = about_axis(2, np.radians(angles[0] - np.asarray(angles, np.float64)))
    few = [view.vertices[:: len(view.vertices) // _SAMPLES + 1] for view in views]
    pairs = paired_views(angles)

    own = np.array([subject_frame(view) for view in views])
    common = own.copy()
    common[:, :2, 3] = own[:, :2, 3].mean(axis=0)

    def frames(placed: np.ndarray, behind: float) -> np.ndarray:
        moved = placed.copy()
        moved[:, 1, 3] -= behind
        return moved

    def misfit(placed: np.ndarray) -> float:
        poses = turns @ placed
        moved = [points @ pose[:3, :3].T + pose[:3, 3] for points, pose in zip(few, poses, strict=True)]
        total = 0.0
        for one, other in pairs:
            a, b = moved[one], moved[other]
            square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
            total += float(sum(np.minimum(square.min(axis=axis), _FAR**2).mean() for axis in (0, 1)))
        return total

    best = min((frames(placed, behind) for placed in (common, own) for behind in _BEHIND), key=misfit)
    return np.linalg.inv(best[0]) @ turns @ best


def paired_views(angles: np.ndarray) -> list[tuple[int, int]]:
    """Which views are registered with each other: the next and the next but one on the circle, if they are near."""
    circle = np.mod(angles, 360.0)
    order = np.argsort(circle, kind="stable")
    count = len(order)
    found = set()
    for place, one in enumerate(order):
        for step in range(1, min(_NEIGHBOURS, count - 1) + 1):
            other = order[(place + step) % count]
            apart = abs((circle[one] - circle[other] + 180.0) % 360.0 - 180.0)
            if apart <= PAIRED_DEG:
                found.add((min(int(one), int(other)), max(int(one), int(other))))
    return sorted(found)


def register_views(
    views: Sequence[SubjectView],
    poses: np.ndarray,
    angles: np.ndarray,
    settings: IcpSettings = IcpSettings(),
) -> RegisteredViews:
    """Views registered in pairs from first poses, then jointly.

    Parameters
    ----------
    views : sequence of SubjectView
    poses : np.ndarray [shape=(N, 4, 4)]
        First poses, each camera's frame → that of the first.
    angles : np.ndarray [shape=(N,)]
        From which side each view looks [degrees]; it says which views have something in common.
    settings : IcpSettings

    Raises
    ------
    MirrorScanError
        No package is installed that registers two views.
    ReconstructionError
        The views do not fit together.
    """
    poses, ring = np.array(poses, np.float64), _ring(angles)
    pairs = paired_views(angles)
    first = [pair for pair in pairs if pair in ring]
    surfaces = [_surface(view) for view in views]
    settings = _fitted(settings, views)
    found: dict[tuple[int, int], Registration] = {}
    near = replace(settings, reach=settings.reach[1:] or settings.reach)
    # first poses may be far off, or near enough for a far reach to lead away from them
    for stage, ways in ((first, (settings, near)), ([pair for pair in pairs if pair not in ring], (near,))):
        for one, other in stage:
            initial = np.linalg.inv(poses[one]) @ poses[other]
            tried = [result for way in ways if (result := _pair(surfaces[other], surfaces[one], initial, way))]
            if tried:  # else nothing in common; whether a view is left over, the joint registration says
                found[one, other] = min(tried, key=lambda result: result.misfit(settings.reach[-1]))
        joint = _jointly(views, found)
        poses = joint.poses
    kept = _kept(len(views), found)
    return RegisteredViews(
        poses, np.asarray(angles, np.float64), tuple(kept), tuple(kept.values()), joint.turned, joint.shifted,
        _check(joint, list(kept)),
    )  # fmt: skip


class _Surface(NamedTuple):
    """What is seen of a subject, ready to be asked for its nearest points."""

    points: np.ndarray
    normals: np.ndarray
    tree: Bvh
    facing: np.ndarray  # unit normals of the triangles
    rim: np.ndarray  # triangles at the boundary


def _surface(view: SubjectView) -> _Surface:
    vertices = np.ascontiguousarray(view.vertices, np.float64)
    triangles = np.ascontiguousarray(view.triangles, np.int32)
    at_rim = boundary_vertices(triangles, len(vertices))[triangles].any(axis=1)
    normals = vertex_normals(vertices, triangles)
    return _Surface(
        vertices, normals, build_bvh(vertices, triangles), unit(triangle_normals(vertices, triangles)), at_rim
    )


def _fitted(settings: IcpSettings, views: Sequence[SubjectView]) -> IcpSettings:
    """The settings with no reach shorter than what separates the points of the views."""
    sides = [np.linalg.norm(v.vertices[v.triangles[:, 0]] - v.vertices[v.triangles[:, 1]], axis=1) for v in views]
    shortest = _SPACINGS * float(np.median(np.concatenate(sides)))
    return replace(settings, reach=tuple(max(reach, shortest) for reach in settings.reach))


def _pair(source: _Surface, target: _Surface, initial: np.ndarray, settings: IcpSettings) -> Registration | None:
    """Two views registered; None when they have nothing in common."""
    try:
        return _refined(source, target, register(source.points, target.points, initial, settings), settings)
    except ReconstructionError:
        return None


def _refined(source: _Surface, target: _Surface, found: Registration, settings: IcpSettings) -> Registration:
    """A registration again by the points whose partner lies within the other view, turned the same way.

    A point whose nearest is on the boundary has no partner, and pulls the views into each other (Turk and Levoy,
    "Zippered polygon meshes from range images", 1994, section 3). The overlap is then the share of those that have.
    """
    last = replace(settings, reach=settings.reach[-1:])
    for _ in range(_REFINED):
        pose = found.pose
        moved = source.points @ pose[:3, :3].T + pose[:3, 3]
        distance, nearest, _ = closest_point(target.tree, moved, 2.0 * settings.reach[-1])
        facing = ((source.normals @ pose[:3, :3].T) * target.facing[nearest]).sum(axis=1)
        good = np.isfinite(distance) & ~target.rim[nearest] & (facing > _SAME_WAY)
        if np.count_nonzero(good) < _FEWEST:
            raise ReconstructionError(
                "registration: two views have almost no surface in common; take the captures nearer to each other"
            )
        found = replace(register(source.points[good], target.points, pose, last), overlap=float(good.mean()))
    return found


def _ring(angles: np.ndarray) -> set[tuple[int, int]]:
    """Pairs of views that are next to each other on the circle."""
    order = np.argsort(np.mod(angles, 360.0), kind="stable")
    return {(min(a, b), max(a, b)) for a, b in zip(order.tolist(), np.roll(order, -1).tolist(), strict=True)}


def _kept(views: int, found: dict[tuple[int, int], Registration]) -> dict[tuple[int, int], Registration]:
    """Pairs that overlap well, and the best of each view."""
    best = np.zeros(views)
    for pair, result in found.items():
        best[list(pair)] = np.maximum(best[list(pair)], result.overlap)
    return {pair: result for pair, result in found.items() if result.overlap >= min(_LEAST_OVERLAP, *best[list(pair)])}


def _jointly(views: Sequence[SubjectView], found: dict[tuple[int, int], Registration]) -> JointPoses:
    """Camera poses of all views by the registrations of pairs; a correction counts in the middle of the subject."""
    middles = np.array([view.vertices.mean(axis=0) for view in views])
    edges = [Edge(other, one, _centred(result.pose, middles[other], middles[one]), result.overlap)
             for (one, other), result in _kept(len(views), found).items()]  # fmt: skip
    for view in range(len(views)):
        if not any(view in (edge.source, edge.target) for edge in edges):
            raise ReconstructionError(
                "capture {number} has too little in common with its neighbours; take more captures, so that each shows "
                "much of what the next one does",
                number=view + 1,
            )
    try:
        joint = joint_registration(len(views), edges)
    except MirrorScanError as error:
        raise ReconstructionError("{error}", error=error) from None
    placed = [_centred(pose, -middle, -middles[0]) for pose, middle in zip(joint.poses, middles, strict=True)]
    return JointPoses(np.array(placed), joint.turned, joint.shifted)


def register_turntable(
    views: Sequence[SubjectView],
    step: float | None = None,
    settings: IcpSettings = IcpSettings(),
) -> RegisteredViews:
    """:func:`register_views` of captures that follow each other evenly round a subject.

    Parameters
    ----------
    views : sequence of SubjectView
        In the order in which they were taken.
    step : float, optional
        By how much the subject turned to its left from one to the next [degrees]; negative to its right. Without,
        once round: both ways are tried, and the one that fits better counts.

    Raises
    ------
    MirrorScanError, ReconstructionError
        As of :func:`register_views`; and for fewer than two views, or an angle of none.
    """
    if len(views) < 2:
        raise ReconstructionError("registration: one capture has nothing to be registered with; give several")
    if step is not None and not 1.0 <= abs(step) <= 180.0:
        raise ReconstructionError("registration: captures that are {step:g}° apart; give 1° to 180°", step=step)
    ways = [abs(even_angles(len(views))[1]), -even_angles(len(views))[1]] if step is None else [step]
    tried: list[RegisteredViews] = []
    failed: MirrorScanError | None = None
    for way in ways:
        angles = even_angles(len(views), way)
        try:
            tried.append(register_views(views, guessed_poses(views, angles), angles, settings))
        except ReconstructionError as error:
            failed = error
    if not tried:
        assert failed is not None  # each way gives one of the two
        raise failed
    reach = settings.reach[-1]
    return min(tried, key=lambda one: np.mean([pair.misfit(reach) for pair in one.registrations]))


def _centred(pose: np.ndarray, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """A pose between two frames as one between frames turned alike whose origins are ``source`` and ``target``."""
    moved = pose.copy()
    moved[:3, 3] = pose[:3, :3] @ source + pose[:3, 3] - target
    return moved


def _check(joint: JointPoses, pairs: Sequence[tuple[int, int]]) -> tuple[Notice, ...]:
    """What to say of corrections: refuse pairs that contradict each other, and warn of such as hardly do."""
    turned = np.degrees(joint.turned)
    worst = int(np.argmax(np.maximum(turned / _TURNED, joint.shifted / _MOVED)))
    if turned[worst] > _TURNED or joint.shifted[worst] > _MOVED:
        raise ReconstructionError(
            "the captures {one} and {other} fit each other elsewhere than the other captures have it ({shift:.0f} mm, "
            "{turn:.0f}°); check the captures' order and the angle between them, and that the person kept still",
            one=pairs[worst][0] + 1, other=pairs[worst][1] + 1, shift=1e3 * joint.shifted[worst], turn=turned[worst],
        )  # fmt: skip
    if joint.shifted.max() > _NOTED:
        worst = int(np.argmax(joint.shifted))
        return (
            Notice(
                "the captures {one} and {other} fit each other {shift:.0f} mm from where the other captures have it; "
                "the person moved from one capture to the next",
                one=pairs[worst][0] + 1, other=pairs[worst][1] + 1, shift=1e3 * joint.shifted[worst],
            ),
        )  # fmt: skip
    return ()
