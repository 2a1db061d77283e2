"""What pictures of an avatar that can move show: its skeleton in it, and the avatar in three poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from ..avatar.skeleton import BONES, Skeleton
from ..mesh import Mesh
from ..motion import make_clip, t_pose

POSES = {"skeleton": (0, -1, 0), "arms out": (0, -1, 0), "arms up": (0, -1, 0), "squat": (1, -1, 0)}
"""Captions, and where the viewer stands."""

_LEFT, _RIGHT, _MIDDLE = (46, 134, 222), (224, 96, 40), (90, 92, 100)  # sRGB of bones
_THICK = 0.11  # of its length: half a bone's width
_JOINT = 0.18  # of its length: where a bone is thickest


def posed_meshes(mesh: Mesh, skeleton: Skeleton, weights: SkinWeights) -> list[Mesh]:
    """What each of ``POSES`` shows.

    Parameters
    ----------
    mesh : Mesh
        Avatar frame, in the rest pose.
    skeleton, weights
        Of the mesh.
    """
    arms_up, squat = make_clip("arms_up", skeleton), make_clip("squat", skeleton)
    poses = (t_pose(skeleton), highest(arms_up), lowest(squat))
    moved = [skinned(mesh.vertices, weights, bone_matrices(skeleton, pose)) for pose in poses]
    return [_with_bones(mesh, skeleton), *(replace(mesh, vertices=vertices) for vertices in moved)]


def highest(clip) -> Pose:
    """The pose of a clip in which the left arm is turned furthest from rest."""
    turned = clip.rotations[:, BONES.index("LeftArm")]
    return clip.pose(int(np.einsum("fii->f", turned).argmin()))


def lowest(clip) -> Pose:
    """The pose of a clip in which the hips are lowest."""
    return clip.pose(int(clip.translations[:, 2].argmin()))


def _with_bones(mesh: Mesh, skeleton: Skeleton) -> Mesh:
    """The mesh in grey behind its bones."""
    plain = np.full((len(mesh.vertices), 3), 214, np.uint8)
    bones = bones_mesh(skeleton)
    assert bones.colors is not None
    before = np.array([0.0, mesh.vertices[:, 1].min() - bones.vertices[:, 1].max() - 0.1, 0.0])
    return Mesh(
        np.concatenate((mesh.vertices, bones.vertices + before)),
        np.concatenate((mesh.triangles, bones.triangles + np.int32(len(mesh.vertices)))),
        np.concatenate((plain, bones.colors)),
    )


def bones_mesh(skeleton: Skeleton) -> Mesh:
    """Each bone as an octahedron from its joint to the next, as Blender draws them; blue are the left ones."""
    ends = skeleton.tails()
    along = ends - skeleton.joints
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(length > 1e-6, along / np.maximum(length, 1e-6), (0.0, 0.0, 1.0))
    side = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(along, side)
    ring = [skeleton.joints + _JOINT * length * along + _THICK * length * d for d in (side, up, -side, -up)]
    vertices = np.stack([skeleton.joints, *ring, ends], axis=1)
    faces = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 1, 4), (5, 1, 2), (5, 2, 3), (5, 3, 4), (5, 4, 1)]
    triangles = np.array(faces)[None] + 6 * np.arange(len(BONES))[:, None, None]
    color = [_LEFT if name.startswith("Left") else _RIGHT if name.startswith("Right") else _MIDDLE for name in BONES]
    return Mesh(
        vertices.reshape(-1, 3), triangles.reshape(-1, 3).astype(np.int32), np.repeat(np.array(color, np.uint8), 6, 0)
    )
