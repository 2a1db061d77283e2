"""Bodies whose joints and weights are known: ``../shared/data/rigged``, with arms turned as asked."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, posed_joints, skinned
from mirror_scan.core.avatar.skeleton import BONES, ENDS, Skeleton
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.numeric.rotations import from_vectors

from .scenes import SHARED

FOLDER = SHARED / "data" / "rigged"
LIMBS = [
    BONES.index(side + name)
    for name in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")
    for side in ("Left", "Right")
]
"""The twelve joints of the limbs."""


@dataclass(frozen=True)
class RiggedBody:
    """A body, its true joints and weights. The ends of the hands are not known: the wrists stand for them."""

    name: str
    mesh: Mesh
    skeleton: Skeleton
    weights: SkinWeights
    clothed: bool


@cache
def rigged_bodies() -> tuple[RiggedBody, ...]:
    """All there are beside the checkout, maybe none."""
    return tuple(_read(folder.name) for folder in sorted(FOLDER.glob("*")) if (folder / "joints.json").exists())


def _read(name: str) -> RiggedBody:
    folder = FOLDER / name
    joints = json.loads((folder / "joints.json").read_text())
    what = json.loads((folder / "measures.json").read_text())["what"]
    with np.load(folder / "weights.npz") as stored:
        order = np.array([BONES.index(str(bone)) for bone in stored["bones"]], dtype=np.uint8)
        weights = SkinWeights(order[stored["index"]], stored["weight"])
    ends = np.array([joints[end if end in joints else end.removesuffix("_End")] for end in ENDS])
    skeleton = Skeleton(np.array([joints[bone] for bone in BONES]), ends, np.ones(len(BONES)))
    return RiggedBody(name, read_mesh(folder / "body.ply"), skeleton, weights, "clothed" in what)


def with_arms(body: RiggedBody, down: float) -> tuple[Mesh, np.ndarray]:
    """The body with both upper arms ``down`` degrees below the horizontal, by its own weights, and its joints there."""
    pose = Pose.rest()
    joints = body.skeleton.joints
    for side in ("Left", "Right"):
        arm = BONES.index(f"{side}Arm")
        along = joints[arm + 1] - joints[arm]
        now = np.degrees(np.arctan2(-along[2], np.hypot(along[0], along[1])))
        axis = np.cross((*along[:2], 0.0), (0.0, 0.0, 1.0)) / np.hypot(along[0], along[1])
        pose.rotations[arm : arm + 3] = from_vectors(axis * np.radians(now - down))
    vertices = skinned(body.mesh.vertices, body.weights, bone_matrices(body.skeleton, pose))
    return replace(body.mesh, vertices=vertices), posed_joints(body.skeleton, pose)
