"""Where a glTF skin's joints rest, in the avatar frame: nodes, inverse bind matrices, and what the person stands in.

A file may hold its avatar turned, lifted or scaled (an object that was moved in Blender), lying in other axes (an
armature in centimetres, Z up), or without inverse bind matrices, which means that they are applied to the mesh already.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import CaptureError
from ..io.gltf import Gltf
from ..mesh import Mesh
from ..numeric.point_products import transform
from ..numeric.rotations import from_quaternions
from .pose import SkinWeights, skinned
from .skeleton import BONES

TO_FILE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Avatar frame (Z up, facing -Y) → glTF's (Y up, facing +Z)."""
_FROM_UPRIGHT = np.eye(4)
_FROM_UPRIGHT[:3, :3] = TO_FILE
FARTHEST = 1e6
"""No point of an avatar lies as far from its origin [m]."""
_SAME = 1e-3  # matrices that differ by less are the same, next to the size of the skeleton
_UPRIGHT, _AHEAD = 0.8, 0.5  # cosines: so near do trunk and shoulders come to where they should point


@dataclass(frozen=True)
class SkinRest:
    """The rest pose of a skin's 22 bones, in the avatar frame.

    Parameters
    ----------
    joints : np.ndarray [shape=(22, 3)]
        [m].
    axes : np.ndarray [shape=(22, 3, 3)]
        Each bone's own axes, as columns.
    armature : np.ndarray [shape=(4, 4)]
        From the file's frame of the node that the hips hang on to the avatar frame; a similarity.
    place : np.ndarray [shape=(4, 4)] or None
        From the file's frame of the mesh, and of ``ends``, to the avatar frame.
    poses : np.ndarray [shape=(J, 4, 4)] or None
        Where the mesh has to be put together first: what moves it by each of the skin's joints into the avatar frame.
    """

    joints: np.ndarray
    axes: np.ndarray
    armature: np.ndarray
    place: np.ndarray
    poses: np.ndarray | None


def moved_mesh(mesh: Mesh, rest: SkinRest, index: np.ndarray, weight: np.ndarray) -> Mesh:
    """The mesh of a file, whose axes are made upright, as it rests in the avatar frame.

    ``index`` and ``weight`` (V, 4) are of the skin's own joints.
    """
    if rest.poses is None:
        if np.array_equal(rest.place[:3, :3], TO_FILE.T) and not rest.place[:3, 3].any():
            return mesh  # bit for bit
        return mesh.transformed(rest.place @ _FROM_UPRIGHT)
    total = weight.sum(axis=1, keepdims=True)
    shares = SkinWeights(index, weight / np.where(total > 0, total, 1))
    return replace(mesh, vertices=skinned(mesh.vertices, shares, rest.poses @ _FROM_UPRIGHT))


def bones_above(nodes: list[dict], joints: list[int], bones: dict[int, int]) -> np.ndarray:
    """The bone (J,) of each of a skin's ``joints``: its own, else that of the nearest node above; -1 without one.

    ``bones`` has the node of each bone.
    """
    parents = _parents(nodes)
    bone_of = {node: bone for bone, node in bones.items()}
    found = np.full(len(joints), -1)
    for place, joint in enumerate(joints):
        node = joint
        while node not in bone_of and node in parents:
            node = parents[node]
        found[place] = bone_of.get(node, -1)
    return found


def skin_rest(gltf: Gltf, skin: dict, bones: dict[int, int]) -> SkinRest:
    """The rest pose of a skin with the node of each bone in ``bones``.

    The node that the hips hang on carries the avatar: what that turns and moves is undone, its scale is kept. Where
    nobody would stand upright and face ahead then, the file's own axes are taken as they are.

    Raises
    ------
    CaptureError
        Nodes are in a circle or not finite, or nobody stands in the file.
    """
    nodes = gltf.content["nodes"]
    world = _world_matrices(nodes)
    order = {node: place for place, node in enumerate(skin["joints"])}
    places = [order[bones[bone]] for bone in range(len(BONES))]
    at = world[skin["joints"]]
    carrier = _parents(nodes).get(bones[0])
    carried = np.eye(4) if carrier is None else world[carrier]
    if np.linalg.det(carried[:3, :3]) == 0:
        raise CaptureError("its skeleton is scaled to nothing")
    bound = "inverseBindMatrices" in skin
    bind, to_world = at[places], np.eye(4)
    if bound:
        inverse = check_finite(gltf.array(skin["inverseBindMatrices"]).astype(np.float64), "an inverse bind matrix")
        moved = at[places] @ inverse[places]
        bind = np.linalg.inv(inverse[places])
        reach = _SAME * np.abs(bind).max()
        if np.abs(moved - moved[0]).max() < reach and np.abs(moved[0] - to_world).max() > 0.01 * reach:
            to_world = moved[0]  # otherwise the nodes rest where the matrices say, or stand in another pose
    upright = np.eye(4)
    upright[:3, :3] = TO_FILE.T
    undone = upright @ _rigid_inverse(carried)
    for to_avatar in (undone @ to_world, upright @ to_world, upright):
        joints = transform(bind[:, :3, 3], to_avatar)
        if _stands(joints):
            break
    else:
        raise CaptureError("nobody stands upright in it and faces +Z; turn the avatar with its skeleton, Y up")
    axes = to_avatar[:3, :3] @ bind[:, :3, :3]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    armature = to_avatar @ np.linalg.inv(to_world) @ carried
    return SkinRest(joints, axes, armature, to_avatar, None if bound else to_avatar @ at)


def check_finite(values: np.ndarray, what: str) -> np.ndarray:
    """The ``values`` themselves, which must be numbers below ``FARTHEST``.

    Raises
    ------
    CaptureError
    """
    if not (np.abs(values) < FARTHEST).all():  # false for NaN too
        raise CaptureError(f"{what} is no usable number; the file is damaged")
    return values


def _parents(nodes: list[dict]) -> dict[int, int]:
    return {int(child): parent for parent, node in enumerate(nodes) for child in node.get("children", [])}


def _world_matrices(nodes: list[dict]) -> np.ndarray:
    """Of each node (N, 4, 4), as the file has them."""
    parents = _parents(nodes)
    world: dict[int, np.ndarray] = {}
    for start in range(len(nodes)):
        chain = [start]
        while chain[-1] not in world and chain[-1] in parents:
            if len(chain) > len(nodes):
                raise CaptureError("its nodes hang in a circle; the file is damaged")
            chain.append(parents[chain[-1]])
        for node in reversed(chain):
            if node not in world:
                local = _local_matrix(nodes[node])
                world[node] = world[parents[node]] @ local if node in parents else local
    matrices = np.array([world[node] for node in range(len(nodes))])
    return check_finite(matrices, "the place of a node")


def _local_matrix(node: dict) -> np.ndarray:
    if "matrix" in node:
        return check_finite(np.array(node["matrix"], np.float64).reshape(4, 4).T, "the place of a node")
    turn = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    matrix = np.eye(4)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    length = np.linalg.norm(check_finite(turn, "the rotation of a node"))
    if not length > 0:
        raise CaptureError("the rotation of a node is no usable number; the file is damaged")
    matrix[:3, :3] = from_quaternions(turn / length) * np.array(node.get("scale", (1, 1, 1)), np.float64)
    return check_finite(matrix, "the place of a node")


def _rigid_inverse(matrix: np.ndarray) -> np.ndarray:
    """Undoes turn and shift of a similarity, and keeps its scale."""
    inverse = np.eye(4)
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    inverse[:3, :3] = (u @ vt).T
    inverse[:3, 3] = -inverse[:3, :3] @ matrix[:3, 3]
    return inverse


def _stands(joints: np.ndarray) -> bool:
    """Whether somebody with these joints stands upright and faces -Y, more or less."""
    at = dict(zip(BONES, joints, strict=True))
    up = at["Neck"] - at["Hips"]
    left = at["LeftUpLeg"] - at["RightUpLeg"] + at["LeftArm"] - at["RightArm"]
    return bool(up[2] > _UPRIGHT * np.linalg.norm(up) > 0 and left[0] > _AHEAD * np.linalg.norm(left))
