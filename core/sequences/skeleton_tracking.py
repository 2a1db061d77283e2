"""One avatar skinned once, its joints followed through the frames of a sequence.

The frame whose body shows its joints best becomes the avatar. From there the skeleton goes forward and backward from
frame to frame: bones turn until points of the skin lie on the frame's surface (point to plane, Gauss-Newton over all
bones at once, as articulated ICP of Pellegrini et al. 2008 does it), starting where the last two frames lead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..avatar.clip import Clip
from ..avatar.joints.skeleton_search import find_skeleton
from ..avatar.pose import Pose, SkinWeights, bone_matrices, posed_joints, skinned
from ..avatar.skeleton import BONES, PARENTS, Skeleton
from ..avatar.skin_weights import skinned_mesh
from ..errors import MirrorScanError, ReconstructionError
from ..mesh import SURFACE, Mesh
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.normals import triangle_normals, vertex_normals
from ..numeric.rotations import between, from_vectors

_CANDIDATES = 6  # frames in which a skeleton is looked for
_POINTS = 1500  # of the skin that are fitted
_FACING = 0.4  # cosine between normals of the skin and the surface: less is another side
_FAR, _NEAR, _ROUNDS = 0.25, 0.05, 12  # reach of a point at first and at last [m], and Gauss-Newton rounds
_ROBUST = 0.015  # m: from where a distance weighs less
_STIFF = 2e-4  # m² a rad²: how much a bone's turn against its parent costs
_HANDS = 25.0  # times as stiff are bones whose skin says little of their turn
_SETTLED = 1e-4  # rad, m
_SMOOTH = np.array((0.25, 0.5, 0.25))  # of successive poses
_LOOSE = {"LeftHand", "RightHand", "LeftToeBase", "RightToeBase", "LeftShoulder", "RightShoulder", "Head", "Neck"}


@dataclass(frozen=True)
class RiggedFrame:
    """The avatar of a sequence: the body of one of its frames.

    Parameters
    ----------
    place : int
        Of the frame.
    mesh : Mesh
        Avatar frame, between its feet x = y = 0.
    skeleton : Skeleton
    weights : SkinWeights
    shift : np.ndarray [shape=(3,)]
        From the frame of the sequence's meshes to the avatar's [m].
    """

    place: int
    mesh: Mesh
    skeleton: Skeleton
    weights: SkinWeights
    shift: np.ndarray


def best_frame(places: Sequence[int], mesh_at: Callable[[int], Mesh]) -> RiggedFrame:
    """The avatar of a sequence: of some frames, evenly over it, the one whose skeleton is the most certain.

    Parameters
    ----------
    places : sequence of int
        Frames that were made.
    mesh_at : callable(place) -> Mesh
        Closed, Z up, floor at z = 0.

    Raises
    ------
    ReconstructionError
        No frame shows a whole person who stands and faces the camera.
    """
    found: list[tuple[float, int, Mesh, Skeleton, np.ndarray]] = []
    fault: MirrorScanError | None = None
    count = min(_CANDIDATES, len(places))
    for place in (places[(2 * k + 1) * len(places) // (2 * count)] for k in range(count)):
        mesh = mesh_at(place)
        shift = -0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
        shift[2] = 0.0
        mesh = _shifted(mesh, shift)
        try:
            skeleton = find_skeleton(mesh)
        except MirrorScanError as error:
            fault = fault or error
            continue
        found.append((float(skeleton.confidence.mean()), place, mesh, skeleton, shift))
    if not found:
        raise ReconstructionError(
            "no skeleton was found in any of {count} frames; let the person stand in front of the camera, arms off the "
            "body, for a moment of the recording: {reason}",
            count=count, reason=fault,
        )  # fmt: skip
    _, place, mesh, skeleton, shift = max(found, key=lambda one: one[0])
    fine, weights = skinned_mesh(mesh, skeleton)
    return RiggedFrame(place, fine, skeleton, weights, shift)


def track(
    rigged: RiggedFrame,
    places: Sequence[int],
    mesh_at: Callable[[int], Mesh],
    rate: float,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[Clip, np.ndarray]:
    """The avatar's clip through a sequence.

    Parameters
    ----------
    rigged : RiggedFrame
        Of :func:`best_frame`.
    places : sequence of int
        Frames to follow, in order; one of them is ``rigged.place``. What lies between two that follow each other here,
        frames that were lost, is interpolated.
    mesh_at : callable(place) -> Mesh
    rate : float
        Frames a second.
    progress : callable(fraction, message), optional

    Returns
    -------
    clip : Clip
        Of all frames from ``places[0]`` to ``places[-1]``.
    residual : np.ndarray [shape=(F,)]
        Of each of ``places``: median distance of the skin from the frame's surface [m].
    """
    tracker = SkeletonTracker(rigged)
    start = list(places).index(rigged.place)
    poses: dict[int, Pose] = {start: Pose.rest()}
    residual = np.zeros(len(places))
    done = 0
    for way in (range(start, len(places)), range(start, -1, -1)):
        tracker.restart()
        for k in way:
            poses[k], residual[k] = tracker.follow(_shifted(mesh_at(places[k]), rigged.shift))
            done += 1
            if progress is not None:
                progress(done / (len(places) + 1), f"Following the joints: frame {places[k]}")
    rotations = np.stack([poses[k].rotations for k in range(len(places))])
    translations = np.stack([poses[k].translation for k in range(len(places))])
    rotations, translations = smoothed(rotations, translations)
    return _filled(places, rotations, translations, rate), residual


class SkeletonTracker:
    """Follows a body: ``follow(mesh)`` a frame gives the pose of its skeleton.

    Parameters
    ----------
    rigged : RiggedFrame
    """

    def __init__(self, rigged: RiggedFrame) -> None:
        self._skeleton = rigged.skeleton
        mesh, weights = rigged.mesh, rigged.weights
        seen = np.arange(len(mesh.vertices))
        if mesh.kind is not None:  # fills are guesses
            seen = np.unique(mesh.triangles[mesh.kind == SURFACE])
        chosen = seen[np.random.default_rng(0).permutation(len(seen))[:_POINTS]]
        self._points = mesh.vertices[chosen]
        self._normals = vertex_normals(mesh.vertices, mesh.triangles)[chosen]
        self._weights = SkinWeights(weights.index[chosen], weights.weight[chosen])
        self._below = _moved_by(self._weights)
        self._stiff = np.array([_STIFF * (_HANDS if bone in _LOOSE else 1.0) for bone in BONES]).repeat(3)
        self.restart()

    def restart(self) -> None:
        """Begin at the rest pose."""
        self._pose = Pose.rest()
        self._before: Pose | None = None

    def follow(self, mesh: Mesh) -> tuple[Pose, float]:
        """The pose in which the skin lies on ``mesh``, and the median distance that is left [m]."""
        vertices, triangles = mesh.vertices.astype(np.float64), mesh.triangles
        surface, normals = build_bvh(vertices, triangles), triangle_normals(vertices, triangles)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        start = self._led_on()
        pose, left = start, np.inf
        for step in range(_ROUNDS):
            reach = _NEAR + (_FAR - _NEAR) * max(0.0, 1.0 - step / (0.6 * _ROUNDS))
            change, left = self._correction(pose, start, surface, normals, reach)
            pose = _turned(pose, change, self._skeleton)
            if reach == _NEAR and np.abs(change).max() < _SETTLED:
                break
        self._before, self._pose = self._pose, pose
        return pose, left

    def _led_on(self) -> Pose:
        """Where the last two poses lead."""
        if self._before is None:
            return self._pose
        last, before = self._pose, self._before
        rotations = np.stack(
            [r @ b.T @ r for r, b in zip(last.rotations, before.rotations, strict=True)]
        )  # fmt: skip
        rotations = between(last.rotations, rotations, 0.5)  # half of the way: people stop and turn round
        return Pose(rotations, last.translation + 0.5 * (last.translation - before.translation))

    def _correction(
        self, pose: Pose, start: Pose, surface, normals: np.ndarray, reach: float
    ) -> tuple[np.ndarray, float]:
        """Turns of all bones (22 · 3) [rad] and the shift (3,) [m] that bring the skin nearer to the surface."""
        matrices = bone_matrices(self._skeleton, pose)
        points = skinned(self._points, self._weights, matrices)
        facing = np.einsum("vk,vkij,vj->vi", self._weights.weight, pose.rotations[self._weights.index], self._normals)
        distance, triangle, nearest = closest_point(surface, points, reach)
        near = np.flatnonzero(triangle >= 0)
        toward = normals[triangle[near]]
        near, toward = (part[np.einsum("vi,vi->v", facing[near], toward) > _FACING] for part in (near, toward))
        if not len(near):
            return np.zeros(3 * len(BONES) + 3), float("inf")
        off = np.einsum("vi,vi->v", nearest[near] - points[near], toward)
        weight = 1.0 / (1.0 + (distance[near] / _ROBUST) ** 2)
        joints = posed_joints(self._skeleton, pose)
        arms = np.cross(points[near][:, None] - joints, toward[:, None]) * self._below[near][:, :, None]
        rows = np.concatenate((arms.reshape(len(near), -1), toward), axis=1)
        normal = (rows * weight[:, None]).T @ rows / weight.sum()
        right = (rows * weight[:, None]).T @ off / weight.sum()
        held = np.append(self._stiff, np.full(3, 1e-6))
        return np.linalg.solve(normal + np.diag(held * (reach / _NEAR) ** 0.5), right), float(np.median(distance[near]))


def _moved_by(weights: SkinWeights) -> np.ndarray:
    """How much of each point (V, 22) hangs on each bone, those further down its chain included."""
    share = np.zeros((len(weights.index), len(BONES)))
    for k in range(weights.index.shape[1]):
        np.add.at(share, (np.arange(len(share)), weights.index[:, k]), weights.weight[:, k])
    for bone in range(len(BONES) - 1, 0, -1):
        share[:, PARENTS[bone]] += share[:, bone]
    return share


def _turned(pose: Pose, change: np.ndarray, skeleton: Skeleton) -> Pose:
    """The pose after a correction: each bone's turn carries those that hang on it."""
    turns = from_vectors(change[:-3].reshape(-1, 3))
    total = turns.copy()
    for bone in range(1, len(BONES)):
        total[bone] = total[PARENTS[bone]] @ turns[bone]
    return Pose(total @ pose.rotations, pose.translation + change[-3:])


def smoothed(rotations: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (F, 22, 3, 3), (F, 3), each averaged with its neighbours; the first and the last stay."""
    if len(rotations) < 3:
        return rotations, translations
    mean = sum(
        share * rotations[k : len(rotations) - 2 + k] for k, share in enumerate(_SMOOTH)
    )  # fmt: skip
    u, _, vt = np.linalg.svd(mean)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    out = rotations.copy()
    out[1:-1] = u @ vt
    moved = translations.copy()
    moved[1:-1] = sum(share * translations[k : len(translations) - 2 + k] for k, share in enumerate(_SMOOTH))
    return out, moved


def _filled(places: Sequence[int], rotations: np.ndarray, translations: np.ndarray, rate: float) -> Clip:
    """A clip of every frame from the first to the last: those that are missing lie between their neighbours."""
    known = np.asarray(places, dtype=np.float64)
    every = np.arange(places[0], places[-1] + 1)
    at = np.interp(every, known, np.arange(len(known)))
    first = np.minimum(np.floor(at).astype(int), len(known) - 1)
    second = np.minimum(first + 1, len(known) - 1)
    share = at - first
    turned = between(rotations[first], rotations[second], share[:, None])
    moved = translations[first] + share[:, None] * (translations[second] - translations[first])
    return Clip("Sequence", float(rate), turned, moved)


def _shifted(mesh: Mesh, shift: np.ndarray) -> Mesh:
    matrix = np.eye(4)
    matrix[:3, 3] = shift
    return mesh.transformed(matrix)
