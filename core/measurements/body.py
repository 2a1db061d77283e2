"""What measures are taken of: a closed mesh, its skeleton, and which part of the body each vertex belongs to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..avatar.pose import SkinWeights
from ..avatar.skeleton import BONES, PARENTS, Skeleton
from ..errors import MirrorScanError
from ..mesh import SURFACE, Mesh
from .plane_cuts import PlaneCut, cut_by_plane

SIDES = ("Left", "Right")
UP = np.array([0.0, 0.0, 1.0])
_SHARED = 0.5  # of its weight: from here on a vertex belongs to a part


@dataclass(frozen=True)
class Body:
    """A mesh in the avatar frame and the share (V,) that each part of the body has in its vertices, 0 to 1.

    Parameters
    ----------
    mesh : Mesh
        Closed [m].
    skeleton : Skeleton
        In the same frame.
    arms : tuple of np.ndarray
        Left, right: upper arm, forearm and hand.
    legs : tuple of np.ndarray
        Left, right: from the thigh down.
    head : np.ndarray
        Head, without the neck.
    """

    mesh: Mesh
    skeleton: Skeleton
    arms: tuple[np.ndarray, np.ndarray]
    legs: tuple[np.ndarray, np.ndarray]
    head: np.ndarray

    @property
    def height(self) -> float:
        """From the floor, z = 0, to the top [m]; steps and margins are in proportion to it."""
        return float(self.mesh.vertices[:, 2].max())

    def joint(self, name: str) -> np.ndarray:
        """Where a bone of ``BONES`` begins (3,) [m]."""
        return self.skeleton.joints[BONES.index(name)]

    def cut(self, point: np.ndarray, normal: np.ndarray, triangles: np.ndarray | None = None) -> PlaneCut:
        """The cut by a plane, of all triangles or of those (N,) named; ``triangle`` counts in all."""
        if triangles is None:
            return cut_by_plane(self.mesh.vertices, self.mesh.triangles, point, normal)
        found = cut_by_plane(self.mesh.vertices, self.mesh.triangles[triangles], point, normal)
        return PlaneCut(found.points, found.segments, triangles[found.triangle], found.edge, found.at)

    def restricted(self, kept: np.ndarray) -> Body:
        """The triangles ``kept`` (T,) bool alone, for searches that try many planes; triangles count anew."""
        used = np.zeros(len(self.mesh.vertices), np.bool_)
        used[self.mesh.triangles[kept]] = True
        place = (np.cumsum(used) - 1).astype(np.int32)
        return Body(
            Mesh(self.mesh.vertices[used], place[self.mesh.triangles[kept]]),
            self.skeleton,
            (self.arms[0][used], self.arms[1][used]),
            (self.legs[0][used], self.legs[1][used]),
            self.head[used],
        )

    def between(self, low: float, high: float) -> Body:
        """What lies between two levels, and a little more."""
        level = self.mesh.vertices[:, 2][self.mesh.triangles]
        return self.restricted((level.max(axis=1) >= low) & (level.min(axis=1) <= high))

    def trunk(self, level: float) -> PlaneCut:
        """The level cut without arms."""
        found = self.cut(np.array([0.0, 0.0, level]), UP)
        return found.part(found.values(self.arms[0] + self.arms[1]) <= _SHARED)

    def limb(self, point: np.ndarray, normal: np.ndarray, share: np.ndarray) -> PlaneCut:
        """The loop about ``point``, a point of a bone, as far as it is held by the limb with this ``share``."""
        found = self.cut(point, normal)
        mine = found.values(share) >= _SHARED
        if not mine.any():
            return found.part(mine)
        loop = found.loops()
        near = np.where(mine, np.linalg.norm(found.points - point, axis=1), np.inf).argmin()
        return found.part(mine & (loop == loop[near]))


def body_of(mesh: Mesh, skeleton: Skeleton, weights: SkinWeights) -> Body:
    """Prepare a mesh to be measured.

    Raises
    ------
    MirrorScanError
        When the weights are not of this mesh, or the mesh is not finite.
    """
    if len(weights.index) != len(mesh.vertices):
        raise MirrorScanError(
            f"measurements: the skin weights are of {len(weights.index)} vertices, the mesh has {len(mesh.vertices)}; "
            "give the weights of this mesh",
            code="no_person",
        )
    if not len(mesh.triangles) or not np.isfinite(mesh.vertices).all():
        raise MirrorScanError(
            "measurements: the mesh has no triangles or a vertex that is not finite; repair it first", code="no_person"
        )

    def share(*first: str) -> np.ndarray:
        bones = below([BONES.index(name) for name in first])
        return np.where(np.isin(weights.index, bones), weights.weight, 0.0).sum(axis=1).astype(np.float64)

    return Body(
        mesh,
        skeleton,
        (share("LeftArm"), share("RightArm")),
        (share("LeftUpLeg"), share("RightUpLeg")),
        share("Head"),
    )


def below(first: list[int]) -> list[int]:
    """These bones and all that hang on them."""
    found = set(first)
    for bone, parent in enumerate(PARENTS):
        if parent in found:
            found.add(bone)
    return sorted(found)


def measured(mesh: Mesh) -> np.ndarray:
    """Which triangles (T,) the camera saw; all, where the mesh does not say."""
    if mesh.kind is None:
        return np.ones(len(mesh.triangles), np.bool_)
    return mesh.kind == SURFACE
