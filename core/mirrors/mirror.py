"""A mirror's plane and glass, and reflection over the plane (paper eq. 2–4)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MirrorError

PAST_BORDER = 2.0
"""How far glass is taken to go on past the image's border [m]: what is farther off the frame's middle is not seen."""


def expected_error(mirror: Mirror) -> float:
    """Expected error of the reflection of a person 1.5 m in front of the mirror [m]; inf when it is unknown."""
    error = mirror.displacement(person_before(mirror))
    if error is None:
        return 0.0 if mirror.source == "given" else np.inf
    return error


@dataclass(frozen=True)
class Mirror:
    """A mirror's plane and outline, camera frame.

    Parameters
    ----------
    name : str
        For reports.
    point : np.ndarray [shape=(3,)]
        Centroid of the frame points [m] (the paper's c_m).
    normal : np.ndarray [shape=(3,)]
        Unit, towards the camera.
    basis : np.ndarray [shape=(3, 3)]
        Columns a, b, c of eq. 1: the paper's M, mirror → world, right-handed. Seen by the camera a points left, b down;
        c is ``normal``.
    rectangle : np.ndarray [shape=(2, 2)] or None
        Extent of the glass along a and b about ``point`` [m]: ((a_min, a_max), (b_min, b_max)). None = unlimited.
    outline : np.ndarray [shape=(4, 2)] or None
        Corners of ``rectangle`` in pixels.
    residual : float
        RMS distance of the points used from the plane [m]; 0 for a plane that was given.
    points_used : int
        How many.
    refined : bool
        The frame's own pixels were pulled in.
    source : str
        Where it is from: "picked", "given" (its plane was), "found" (without a click) or "rig file".
    covariance : np.ndarray [shape=(3, 3)] or None
        How certain the plane is, about ``point``: of its slope along a and along b [rad], and of its shift along the
        normal [m]. None for a plane that was given.
    polygon : np.ndarray [shape=(K, 2)] or None
        Corners of a glass that is no rectangle, along a and b about ``point`` [m], inside ``rectangle``.
    moved_by : tuple of str
        What moved the plane from where its frame is: "reflections" of what is seen directly too, the "floor" that is
        seen both ways, a "person" or "views" that must agree, "seams" that showed an offset.
    moved : float
        By how much that moves the reflection of somebody 1.5 m in front of it, root mean square [m].
    sag : float
        How far the middle of the apparent surface lies in front of its two ends, along its longer side [m]; 0 = flat.
        ``point`` and ``normal`` are those of its best plane.
    sag_error : float
        How certain that is, one standard deviation [m]; 0 where nothing speaks for a bow.
    glass_thickness : float
        Of the glass before the silver [m]; 0 = thin, or not known. The plane is the apparent one for a ray along its
        normal; see :func:`.curved_glass.flattened`.
    frame_bow : tuple of float or None
        A bow that the frame shows and nothing has confirmed: what it would change of the two slopes [rad], the shift
        [m] and the sag [m].
    bow_by_frame : tuple of np.ndarray or None
        What the readings of the frame, which may be bowed, say of the two slopes [rad], the shift [m] and the sag [m],
        against the flat plane: the best (4,) and their covariance (4, 4). None once the glass is taken to be bowed.
    frame_ahead : float
        Of a rig file's mirror: how far the front of its frame lies in front of the plane [m].
    turn_by_frame : float
        Variance of its slope along a by the frame alone [rad²], where a person that it shows has turned it since; else
        0.
    """

    name: str
    point: np.ndarray
    normal: np.ndarray
    basis: np.ndarray
    rectangle: np.ndarray | None = None
    outline: np.ndarray | None = None
    residual: float = 0.0
    points_used: int = 0
    refined: bool = False
    source: str = "picked"
    covariance: np.ndarray | None = None
    polygon: np.ndarray | None = None
    moved_by: tuple[str, ...] = ()
    moved: float = 0.0
    sag: float = 0.0
    sag_error: float = 0.0
    glass_thickness: float = 0.0
    frame_bow: tuple[float, float, float, float] | None = None
    bow_by_frame: tuple[np.ndarray, np.ndarray] | None = None
    frame_ahead: float = 0.0
    turn_by_frame: float = 0.0

    def displacement(self, points: np.ndarray) -> float | None:
        """Expected error of reflected ``points`` (N, 3), root mean square over them [m]; None without a covariance.

        To first order a slope (α, β) and a shift δ move the image of a point at r from ``point``, s in front of the
        plane, by 2 (α a·r + β b·r + δ) n + 2 s (α a + β b).
        """
        if self.covariance is None:
            return None
        a, b, n = self.basis.T
        moves = reflection_moves(self, points)
        variance = np.einsum("nci,ij,ncj->n", moves, self.covariance, moves).mean()
        return float(np.sqrt(variance + self._bow_variance(np.asarray(points, dtype=np.float64).reshape(-1, 3))))

    def _bow_variance(self, points: np.ndarray) -> float:
        """What the sag's error adds at real ``points`` (N, 3): to first order 2 s q and 2 D times the slope s q'."""
        if self.sag_error == 0.0 or self.rectangle is None:
            return 0.0
        axis, middle, length = long_axis(self)
        offset = points - self.point
        ahead, eye = offset @ self.normal, -(self.point @ self.normal)
        # where on the glass the camera sees them: the line from the camera to their image
        along = self.basis[:, axis]
        place = offset @ along + ahead / (ahead + eye) * (-(self.point @ along) - offset @ along)
        share = np.clip(2.0 * (place - middle) / length, -1.0, 1.0)
        lift, slope = 1.0 / 3.0 - share**2, 4.0 * share / length
        return float(self.sag_error**2 * (4.0 * lift**2 + (2.0 * ahead * slope) ** 2).mean())


def seen_extent(mirror: Mirror) -> np.ndarray:
    """The mirror's rectangle (2, 2) [m], but as far as the image shows it: not :data:`PAST_BORDER` beyond its border.

    What is not seen of a mirror says nothing of how long its sides are, nor of how its glass is bent.
    """
    assert mirror.rectangle is not None  # an unlimited glass has no extent
    past = np.abs(mirror.rectangle) > PAST_BORDER
    return mirror.rectangle - np.where(past, PAST_BORDER * np.sign(mirror.rectangle), 0.0)


def long_axis(mirror: Mirror) -> tuple[int, float, float]:
    """Along which axis the mirror, as it is seen, is longer, 0 = a and 1 = b; its middle there and its length [m]."""
    seen = seen_extent(mirror)
    sizes = np.diff(seen, axis=1)[:, 0]
    axis = int(np.argmax(sizes))
    return axis, float(seen[axis].mean()), float(sizes[axis])


def reflection_moves(mirror: Mirror, points: np.ndarray) -> np.ndarray:
    """How the reflections of ``points`` (N, 3) move with the mirror: derivatives (N, 3, 3).

    The last axis is over its slopes along a and b and its shift along the normal.
    """
    a, b, n = mirror.basis.T
    offset = np.asarray(points, dtype=np.float64).reshape(-1, 3) - mirror.point
    ahead = (offset @ n)[:, None]
    return np.stack(
        (
            2.0 * ((offset @ a)[:, None] * n + ahead * a),
            2.0 * ((offset @ b)[:, None] * n + ahead * b),
            np.broadcast_to(2.0 * n, offset.shape),
        ),
        axis=2,
    )


def oriented(normal: np.ndarray, point: np.ndarray, down=(0.0, 1.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal towards the camera, and the basis (a left, b down, c normal); ``down`` says where b points."""
    normal = normal / np.linalg.norm(normal)
    if normal @ point > 0:
        normal = -normal
    down = np.asarray(down) - (normal @ down) * normal
    if np.linalg.norm(down) < 0.1:  # a mirror on floor or ceiling
        down = np.array((0.0, 0.0, 1.0)) - normal[2] * normal
    down /= np.linalg.norm(down)
    return normal, np.column_stack((np.cross(down, normal), down, normal))


def plane_mirror(name: str, point: np.ndarray | None, normal: np.ndarray | None) -> Mirror:
    """A mirror whose plane is known; its glass is taken as unlimited. Raises MirrorError when something is missing."""
    point = np.asarray(point, dtype=np.float64)
    normal = np.asarray(normal, dtype=np.float64)
    if (
        point.shape != (3,)
        or normal.shape != (3,)
        or not np.isfinite((point, normal)).all()
        or np.linalg.norm(normal) < 1e-9
    ):
        raise MirrorError(f"{name}: a plane needs a point and a non-zero normal of three numbers each")
    return Mirror(name, point, *oriented(normal, point), source="given")


def in_frame(mirror: Mirror, pose: np.ndarray) -> Mirror:
    """The mirror in another frame, to which ``pose`` (4, 4), rigid, leads; its outline stays the camera's."""
    basis = pose[:3, :3] @ mirror.basis
    return replace(mirror, point=pose[:3, :3] @ mirror.point + pose[:3, 3], normal=basis[:, 2], basis=basis)


def reflection_matrix(mirror: Mirror) -> np.ndarray:
    """Reflection over the mirror as one matrix (4, 4): to mirror coordinates, flip z, and back (paper eq. 2–4)."""
    flip = np.diag((1.0, 1.0, -1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = mirror.basis @ flip @ mirror.basis.T
    matrix[:3, 3] = mirror.point - matrix[:3, :3] @ mirror.point
    return matrix


def reflect(points: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Points [shape=(..., 3)] flipped over the mirror's plane (paper eq. 2–4)."""
    matrix = reflection_matrix(mirror)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def behind_glass(
    points: np.ndarray, mirrors: Iterable[Mirror], margin: float = 0.0, nearest: float = 1.0
) -> np.ndarray:
    """Which of some points (N, 3) the camera sees, or would see, in the rectangle of a mirror in front of them.

    ``margin`` [m] widens the rectangles; what is nearer than the plane counts, too, when the plane is less than
    ``nearest`` times as far.
    """
    hidden = np.zeros(len(points), np.bool_)
    for m in mirrors:
        if m.rectangle is None:  # how far it goes is not known
            continue
        share = (m.normal @ m.point) / (points @ m.normal)
        place = (points * share[:, None] - m.point) @ m.basis[:, :2]
        on = ((m.rectangle[:, 0] - margin < place) & (place < m.rectangle[:, 1] + margin)).all(axis=1)
        hidden |= on & (share > 0.0) & (share < nearest)
    return hidden


def moved(mirror: Mirror, step: np.ndarray) -> Mirror:
    """The mirror tilted by two slopes and shifted along its normal."""
    a, b, n = mirror.basis.T
    point = mirror.point + step[2] * n
    normal, basis = oriented(n - step[0] * a - step[1] * b, point, b)
    return replace(mirror, point=point, normal=normal, basis=basis)


def person_before(mirror: Mirror) -> np.ndarray:
    """Points (6, 3) where a person 1.5 m in front of the middle of the mirror would be [m]."""
    middle = mirror.point
    if mirror.rectangle is not None:
        middle = middle + mirror.basis[:, :2] @ np.clip(mirror.rectangle, -1.5, 1.5).mean(axis=1)
    x, y = np.meshgrid((-0.3, 0.3), (-0.8, 0.0, 0.8))
    return middle + 1.5 * mirror.normal + np.column_stack((x.ravel(), y.ravel())) @ mirror.basis[:, :2].T


def reflection_shift(person: np.ndarray, one: Mirror, other: Mirror) -> float:
    """Distance between the reflections of ``person`` (N, 3) in two mirrors, root mean square over the points [m]."""
    return float(np.sqrt(np.mean(np.sum((reflect(person, one) - reflect(person, other)) ** 2, axis=1))))


def with_reason(new: Mirror, old: Mirror, reason: str) -> Mirror:
    """``new``, noting that ``reason`` moved it from ``old``, and by how much at a person."""
    shift = reflection_shift(person_before(old), new, old)
    return replace(new, moved_by=(*old.moved_by, reason), moved=float(np.hypot(old.moved, shift)))
