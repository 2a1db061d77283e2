"""Which share of a body's area a rig sees, in all and of head, hands and feet: quick enough to follow a hand.

The body is a few thousand points, evenly spread over its area. From each of them it is looked back at the camera,
directly and by way of each mirror. Nothing depends on pixels or on how finely the mesh is divided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import project
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.bvh import Bvh, build_bvh
from ..patches.grid_triangulation import TriangulationSettings
from ..simulation.rays import BODY, Sight, lit
from ..simulation.scene import FramedMirror, Rig
from ..simulation.sensors import find_sensor
from ..simulation.simulate import INTERFERENCE_RATIO

PARTS = ("rest", "head", "hands", "feet")
"""What the numbers in :attr:`BodySamples.part` stand for."""
SAMPLES = 2048
"""Points on a body; each share is then certain to about a hundredth."""

_HEAD, _FEET, _HAND = 0.865, 0.06, 0.105  # of the height: chin, above the ankle, tip of the fingers to the wrist
_ARMS = (0.35, 0.95)  # heights between which hands are looked for, of the height
_ROWS = 32  # points are shared out to threads in so many rows
_GOLDEN = ((np.sqrt(5.0) - 1.0) / 2.0, 0.7548776662466927)  # R1 and the first of R2 (Roberts 2018): evenly spread


@dataclass(frozen=True)
class BodySamples:
    """Points that stand for equal areas of a body, avatar frame.

    Parameters
    ----------
    points, normals : np.ndarray [shape=(N, 3)]
        Places [m] and unit normals outwards. N is a multiple of the rows that threads share.
    part : np.ndarray [shape=(N,), dtype=int8]
        Index into :data:`PARTS`.
    bvh : Bvh
        Of the whole body, which hides parts of itself.
    height : float
        From its lowest to its highest point [m].
    """

    points: np.ndarray
    normals: np.ndarray
    part: np.ndarray
    bvh: Bvh
    height: float


@dataclass(frozen=True)
class AreaCoverage:
    """What a rig sees of a body; N samples, V = 1 + mirrors views, the direct one first.

    Parameters
    ----------
    names : tuple of str
        ``"direct"`` and the mirrors' names (V,).
    seen : np.ndarray [shape=(N, V), dtype=bool]
        The view has a reading of it that can be used.
    cosine : np.ndarray [shape=(N, V)]
        Of the incidence; 0 where light does not go that way.
    light : np.ndarray [shape=(N, V)]
        How strongly the camera's own light arrives by each way: cos / r² [1/m²].
    length : np.ndarray [shape=(N, V)]
        Of the ways, folded [m].
    z : np.ndarray [shape=(N, V)]
        Depth that the camera would read [m].
    part : np.ndarray [shape=(N,), dtype=int8]
    """

    names: tuple[str, ...]
    seen: np.ndarray
    cosine: np.ndarray
    light: np.ndarray
    length: np.ndarray
    z: np.ndarray
    part: np.ndarray

    @property
    def share(self) -> float:
        """Of the area, that at least one view sees."""
        return float(self.seen.any(axis=1).mean())

    @property
    def by_view(self) -> dict[str, float]:
        """Of the area, that each view sees; where views overlap it counts for each of them."""
        return dict(zip(self.names, self.seen.mean(axis=0).tolist(), strict=True))

    @property
    def by_part(self) -> dict[str, float]:
        """Of the area of head, hands and feet, that at least one view sees; NaN for what a body does not have."""
        any_view = self.seen.any(axis=1)
        return {name: _mean(any_view[self.part == k]) for k, name in enumerate(PARTS) if k}


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def body_samples(body: Mesh, count: int = SAMPLES) -> BodySamples:
    """Points that stand for equal areas of a body; always the same for the same mesh. O(T log T + N) time.

    The area is cut into N equal pieces along the order of the triangles, and one point taken of each. Head, hands
    and feet go by the shape alone: the head above the chin of an eight-heads figure, the feet below the ankles, and
    hands within a hand's length of what reaches farthest out to either side between thigh and head.

    Raises
    ------
    MirrorScanError
        When the body has no area.
    """
    vertices = np.ascontiguousarray(body.vertices, np.float64)
    triangles = np.ascontiguousarray(body.triangles, np.int32)
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    up_to = np.cumsum(doubled)
    if not len(up_to) or not 0.0 < up_to[-1] < np.inf:
        raise MirrorScanError("the body has no surface; choose a mesh with faces")
    count = max(_ROWS, -(-count // _ROWS) * _ROWS)
    at = np.arange(count)
    chosen = np.searchsorted(up_to, (at + 0.5) / count * up_to[-1], side="right").clip(0, len(triangles) - 1)
    root, second = np.sqrt(at * _GOLDEN[0] % 1.0), at * _GOLDEN[1] % 1.0  # Osada et al. 2002: even in a triangle
    shares = np.stack((1.0 - root, root * (1.0 - second), root * second), axis=1)
    points = np.einsum("nk,nkc->nc", shares, corners[chosen])
    normals = cross[chosen] / np.maximum(doubled[chosen], 1e-300)[:, None]
    used = vertices[np.unique(triangles)]
    low, high = float(used[:, 2].min()), float(used[:, 2].max())
    return BodySamples(
        points, normals, _parts(points, used, low, high - low), build_bvh(vertices, triangles), high - low
    )


def _parts(points: np.ndarray, used: np.ndarray, low: float, height: float) -> np.ndarray:
    """Index into :data:`PARTS` of each point (N,), by the body's shape."""
    level = (points[:, 2] - low) / max(height, 1e-9)
    part = np.zeros(len(points), np.int8)
    part[level > _HEAD], part[level < _FEET] = PARTS.index("head"), PARTS.index("feet")
    middle = points[:, :2].mean(axis=0)
    arms = (used[:, 2] - low > _ARMS[0] * height) & (used[:, 2] - low < _ARMS[1] * height)
    if not arms.any():
        return part
    flat = points[:, :2] - middle
    across = np.linalg.eigh(flat.T @ flat)[1][:, 1]  # a person is broader than deep
    reach = (used[arms, :2] - middle) @ across
    for tip in (used[arms][np.argmax(reach)], used[arms][np.argmin(reach)]):
        near = np.linalg.norm(points - tip, axis=1) < _HAND * height
        part[near & (part == 0)] = PARTS.index("hands")
    return part


def area_coverage(body: BodySamples, rig: Rig) -> AreaCoverage:
    """What the rig sees of the body. O(N · views · log T) time: 5 to 10 µs a sample and core with two mirrors.

    A view sees a sample when light goes that way undisturbed, the sample is in the image and in the range of the
    sensor, its surface is tilted no more than the sensor reads and the triangulation joins, and the sensor's pattern
    reaches it: a camera that projects patterns loses what they reach by two ways.
    """
    sensor = find_sensor(rig.sensor)
    shape = (_ROWS, len(body.points) // _ROWS)
    grid = as_sight(body, shape)
    views = 1 + len(rig.mirrors)
    light = lit(grid, body.bvh, rig, 0.0).reshape(-1, views).astype(np.float64)
    inside, z, length = _in_image(body.points, rig)
    cosine = np.clip(light * length**2, 0.0, 1.0)
    steepest = np.cos(np.radians(min(TriangulationSettings().max_slope, sensor.max_incidence_deg)))
    seen = (light > 0) & inside & (cosine > steepest) & (z >= sensor.min_range) & (z <= sensor.max_range)
    interference = sensor.interference if rig.interference is None else rig.interference
    if interference or sensor.baseline > 0:
        pattern = light
        if sensor.baseline > 0:
            pattern = lit(grid, body.bvh, rig, sensor.baseline).reshape(-1, views).astype(np.float64)
        seen &= pattern > 0
        if interference:
            seen &= pattern.sum(axis=1, keepdims=True) - pattern <= INTERFERENCE_RATIO * pattern
    names = ("direct", *(mirror.name for mirror in rig.mirrors))
    return AreaCoverage(names, seen, cosine, light, length, z, body.part)


def as_sight(body: BodySamples, shape: tuple[int, int]) -> Sight:
    """The samples as if each were what one pixel of an image sees."""
    rows = np.zeros(shape)
    wide = (*shape, 3)
    return Sight(
        rows, np.full(shape, BODY, np.uint8), np.zeros(shape, np.int32), np.zeros(shape, np.int8),
        np.zeros(shape, np.uint8), np.zeros(shape, np.float32), np.zeros(wide, np.uint8), body.points.reshape(wide),
        body.normals.reshape(wide), rows,
    )  # fmt: skip


def mirrored(points: np.ndarray, mirror: FramedMirror) -> np.ndarray:
    """Points (N, 3) flipped over the plane of a mirror, avatar frame [m]."""
    normal = mirror.axes[2]
    return points - 2.0 * ((points - np.array(mirror.centre)) @ normal)[:, None] * normal


def _in_image(points: np.ndarray, rig: Rig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether each view has the points in its image, their z and their distance [m]; all (N, V)."""
    pose, lens = rig.camera_to_avatar, rig.intrinsics
    images = np.stack([points, *(mirrored(points, mirror) for mirror in rig.mirrors)], axis=1)
    there = (images - pose[:3, 3]) @ pose[:3, :3]
    u, v = np.moveaxis(project(there, lens), -1, 0)
    inside = (u >= 0) & (v >= 0) & (u <= lens.width - 1) & (v <= lens.height - 1)  # NaN behind the camera
    return inside, there[..., 2], np.linalg.norm(there, axis=-1)
