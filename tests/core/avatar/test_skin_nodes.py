"""Avatars of other programs' files: turned, lifted and scaled, without indices or bind matrices, damaged."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from mirror_scan.core.avatar.avatar_file import Avatar, read_avatar, write_avatar
from mirror_scan.core.avatar.clip import Clip
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.gltf import VERTICES, read_gltf, write_gltf
from mirror_scan.core.mesh import Mesh
from scipy.spatial.transform import Rotation
from standing_body import skeleton_of


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    """Triangles about a standing skeleton, weights and a motion."""
    rng = np.random.default_rng(8)
    skeleton = skeleton_of(40.0, 9.0)
    count = 90
    bones = np.array([rng.choice(len(BONES), 4, replace=False) for _ in range(count)])
    vertices = skeleton.joints[bones[:, 0]] + rng.normal(0, 0.05, (count, 3))
    mesh = Mesh(vertices, np.array([rng.choice(count, 3, replace=False) for _ in range(50)], np.int32))
    weight = -np.sort(-rng.dirichlet(np.ones(4), count), axis=1).astype(np.float32)
    turns = Rotation.from_rotvec(rng.normal(0, 0.5, (5 * len(BONES), 3))).as_matrix().reshape(5, len(BONES), 3, 3)
    clip = Clip("wave", 25.0, turns, rng.normal(0, 0.2, (5, 3)))
    return Avatar(mesh, skeleton, SkinWeights(bones.astype(np.uint8), weight), [clip])


@pytest.fixture
def gltf(avatar, tmp_path):
    write_avatar(tmp_path / "a.glb", avatar)
    return read_gltf(tmp_path / "a.glb")


def read_again(gltf, tmp_path) -> Avatar:
    write_gltf(tmp_path / "b.glb", gltf)
    return read_avatar(tmp_path / "b.glb")


def armature_node(gltf) -> dict:
    return next(node for node in gltf.content["nodes"] if node.get("name") == "Armature")


def primitive(gltf) -> dict:
    return gltf.content["meshes"][0]["primitives"][0]


def placed(gltf, scale: float) -> np.ndarray:
    """Turn, lift and scale what carries the bones; returns the matrix (4, 4)."""
    turn = Rotation.from_euler("yx", (130, 20), degrees=True)
    armature_node(gltf).update(translation=[1.0, 0.7, -2.0], rotation=turn.as_quat().tolist(), scale=[scale] * 3)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = scale * turn.as_matrix(), (1.0, 0.7, -2.0)
    return matrix


@pytest.mark.parametrize("scale", [1.0, 1.15])
@pytest.mark.parametrize("in_world", [False, True], ids=["bound as before", "bound in the world"])
def test_an_object_that_was_turned_and_lifted_stands_again(avatar, gltf, tmp_path, scale, in_world):
    """Its scale stays; Blender writes vertices and bind matrices in the world's axes, others do not."""
    matrix = placed(gltf, scale)
    if in_world:
        attributes, skin = primitive(gltf)["attributes"], gltf.content["skins"][0]
        points = gltf.array(attributes["POSITION"]) @ matrix[:3, :3].T + matrix[:3, 3]
        attributes["POSITION"] = gltf.add(points.astype(np.float32), VERTICES, bounds=True)
        inverse = gltf.array(skin["inverseBindMatrices"]) @ np.linalg.inv(matrix)
        skin["inverseBindMatrices"] = gltf.add(inverse.astype(np.float32))
        del skin["extras"]
    found = read_again(gltf, tmp_path)
    np.testing.assert_allclose(found.mesh.vertices, scale * avatar.mesh.vertices, atol=3e-6)
    np.testing.assert_allclose(found.skeleton.joints, scale * avatar.skeleton.joints, atol=3e-6)
    if not in_world:
        np.testing.assert_allclose(found.skeleton.ends, scale * avatar.skeleton.ends, atol=3e-6)
    (clip,), (true,) = found.clips, avatar.clips
    np.testing.assert_allclose(clip.rotations, true.rotations, atol=5e-6)
    np.testing.assert_allclose(clip.translations, scale * true.translations, atol=5e-6)


def test_an_armature_in_centimetres_and_other_axes_stands_too(avatar, gltf, tmp_path):
    """As Mixamo's: the node turns Z up into Y up and shrinks by 100; what is in it lies on its back."""
    inner = np.diag([100.0, 100.0, 100.0, 1.0])
    inner[:3, :3] = inner[:3, :3] @ Rotation.from_euler("x", 90, degrees=True).as_matrix()
    node = armature_node(gltf)
    node["matrix"] = np.linalg.inv(inner).T.ravel().tolist()
    skin = gltf.content["skins"][0]
    hips = gltf.content["nodes"][skin["joints"][0]]
    turn = Rotation.from_matrix(inner[:3, :3] / 100) * Rotation.from_quat(hips["rotation"])
    hips["translation"] = (inner[:3, :3] @ hips["translation"]).tolist()
    hips |= {"rotation": turn.as_quat().tolist(), "scale": [100.0] * 3}
    gltf.content.pop("animations")
    found = read_again(gltf, tmp_path)
    np.testing.assert_allclose(found.skeleton.joints, avatar.skeleton.joints, atol=3e-6)
    np.testing.assert_allclose(found.mesh.vertices, avatar.mesh.vertices, atol=3e-6)


def test_a_mesh_without_indices_is_a_set_of_triangles(avatar, gltf, tmp_path):
    part = primitive(gltf)
    corners = gltf.array(part.pop("indices"))
    for name, number in part["attributes"].items():
        part["attributes"][name] = gltf.add(gltf.array(number)[corners], VERTICES, bounds=name == "POSITION")
    found = read_again(gltf, tmp_path)
    np.testing.assert_allclose(
        found.mesh.vertices[found.mesh.triangles], avatar.mesh.vertices[avatar.mesh.triangles], atol=1e-6
    )
    part["attributes"] = {
        name: gltf.add(gltf.array(number)[:-1], VERTICES) for name, number in part["attributes"].items()
    }
    with pytest.raises(CaptureError, match=r"b\.glb"):
        read_again(gltf, tmp_path)


def test_a_skin_without_bind_matrices_has_them_applied(avatar, gltf, tmp_path):
    """What glTF leaves out is the identity: the vertices are put together by the nodes as they stand."""
    skin, attributes = gltf.content["skins"][0], primitive(gltf)["attributes"]
    nodes = np.linalg.inv(gltf.array(skin.pop("inverseBindMatrices")).astype(np.float64))
    weight, index = gltf.array(attributes["WEIGHTS_0"]), gltf.array(attributes["JOINTS_0"])
    blend = np.einsum("vk,vkij->vij", weight, nodes[index])
    points = np.einsum("vij,vj->vi", np.linalg.inv(blend), np.c_[gltf.array(attributes["POSITION"]), np.ones(90)])
    attributes["POSITION"] = gltf.add(points[:, :3].astype(np.float32), VERTICES, bounds=True)
    found = read_again(gltf, tmp_path)
    near = np.linalg.cond(blend) < 1e3  # shares that cancel out lose float32's digits
    assert near.mean() > 0.9
    np.testing.assert_allclose(found.mesh.vertices[near], avatar.mesh.vertices[near], atol=2e-4)
    np.testing.assert_allclose(found.skeleton.joints, avatar.skeleton.joints, atol=3e-6)
    np.testing.assert_allclose(found.clips[0].rotations, avatar.clips[0].rotations, atol=5e-6)


def test_what_fingers_hold_is_held_by_the_hand(avatar, gltf, tmp_path):
    nodes, skin = gltf.content["nodes"], gltf.content["skins"][0]
    hand = BONES.index("LeftHand")
    finger = len(nodes)
    nodes.append({"name": "mixamorig:LeftHandIndex1", "translation": [0.0, 0.08, 0.0]})
    nodes[skin["joints"][hand]]["children"] = [finger]
    skin["joints"].append(finger)
    inverse = gltf.array(skin["inverseBindMatrices"])
    skin["inverseBindMatrices"] = gltf.add(np.concatenate((inverse, inverse[hand : hand + 1])))
    attributes = primitive(gltf)["attributes"]
    index = gltf.array(attributes["JOINTS_0"])
    attributes["JOINTS_0"] = gltf.add(np.where(index == hand, len(BONES), index).astype(np.uint8), VERTICES)
    found = read_again(gltf, tmp_path)
    np.testing.assert_array_equal(found.weights.index, avatar.weights.index)
    np.testing.assert_allclose(found.weights.weight, avatar.weights.weight, atol=1e-6)


def _unaligned(gltf):
    gltf.content["bufferViews"][0]["byteOffset"] = 1


def _far_end(gltf):
    gltf.content["skins"][0]["extras"]["ends"]["LeftHand_End"] = [1e300, 0, 0]


def _far_vertex(gltf):
    points = gltf.array(primitive(gltf)["attributes"]["POSITION"]).copy()
    points[7] = np.inf
    gltf.content["bufferViews"][gltf.content["accessors"][gltf.add(points)]["bufferView"]]
    primitive(gltf)["attributes"]["POSITION"] = len(gltf.content["accessors"]) - 1


def _circle(gltf):
    nodes, skin = gltf.content["nodes"], gltf.content["skins"][0]
    nodes[skin["joints"][-1]]["children"] = [nodes.index(armature_node(gltf))]


def _lost_joint(gltf):
    attributes = primitive(gltf)["attributes"]
    index = gltf.array(attributes["JOINTS_0"]).copy()
    index[3] = 99
    attributes["JOINTS_0"] = gltf.add(index, VERTICES)


def _short_track(gltf):
    sampler = gltf.content["animations"][0]["samplers"][2]
    sampler["output"] = gltf.add(gltf.array(sampler["output"])[:-1])


def _no_turn(gltf):
    gltf.content["nodes"][gltf.content["skins"][0]["joints"][4]]["rotation"] = [0, 0, 0, 0]


def _flat_bind(gltf):
    skin = gltf.content["skins"][0]
    skin["inverseBindMatrices"] = gltf.add(0 * gltf.array(skin["inverseBindMatrices"]))


def _lies(gltf):
    points = primitive(gltf)["attributes"]
    points["POSITION"] = gltf.add(gltf.array(points["POSITION"]), VERTICES)
    skin = gltf.content["skins"][0]
    turn = np.eye(4, dtype=np.float32)
    turn[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    skin["inverseBindMatrices"] = gltf.add(gltf.array(skin["inverseBindMatrices"]) @ turn)
    hips = gltf.content["nodes"][skin["joints"][0]]
    lies = Rotation.from_euler("z", -90, degrees=True)
    hips["translation"] = lies.apply(hips["translation"]).tolist()
    hips["rotation"] = (lies * Rotation.from_quat(hips["rotation"])).as_quat().tolist()


@pytest.mark.parametrize(
    "damage",
    [_unaligned, _far_end, _far_vertex, _circle, _lost_joint, _short_track, _no_turn, _flat_bind, _lies],
)
def test_what_is_damaged_is_one_clear_error(gltf, tmp_path, damage):
    damage(gltf)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CaptureError, match=r"b\.glb: [^\n]+$"):
            read_again(gltf, tmp_path)


def test_numbers_that_no_file_should_hold_give_no_warning(avatar, tmp_path):
    """Any number of the binary part may be anything; what is read is finite or refused."""
    rng = np.random.default_rng(2)
    write_avatar(tmp_path / "a.glb", avatar)
    gltf = read_gltf(tmp_path / "a.glb")
    for _ in range(60):
        binary = bytearray(gltf.binary)
        at = 4 * int(rng.integers(len(binary) // 4))
        binary[at : at + 4] = rng.choice((b"\x00\x00\x80\x7f", b"\x00\x00\xc0\x7f", b"\xff\xff\x7f\x7f", bytes(4)))
        other = read_gltf(tmp_path / "a.glb")
        other.binary = binary
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                found = read_again(other, tmp_path)
            except CaptureError:
                continue
        assert np.isfinite(found.mesh.vertices).all() and np.isfinite(found.weights.weight).all()
        assert all(np.isfinite(clip.rotations).all() for clip in found.clips)
