"""Avatars as glTF: what is written comes back, stands as glTF's own rules say, and moves as our skinning does."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.avatar.avatar_file import (
    PREFIX,
    Avatar,
    bone_named,
    read_avatar,
    write_avatar,
)
from mirror_scan.core.avatar.clip import Clip
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, PARENTS
from mirror_scan.core.errors import CaptureError, OutputError
from mirror_scan.core.io.gltf import read_gltf, write_gltf
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.numeric.rotations import from_quaternions, quaternions
from scipy.spatial.transform import Rotation
from standing_body import skeleton_of
from textured import colors_at, textured_ball

FRAMES = 7


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    """Some triangles beside a skeleton, with everything a file can hold."""
    rng = np.random.default_rng(5)
    count, faces = 60, 40
    mesh = Mesh(
        rng.normal(0, 0.3, (count, 3)) + (0, 0, 1),
        np.array([rng.choice(count, 3, replace=False) for _ in range(faces)], np.int32),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
        rng.integers(-1, 3, count).astype(np.int8),
        rng.integers(0, 3, faces).astype(np.int8),
    )
    weight = -np.sort(-rng.dirichlet(np.ones(4), count), axis=1).astype(np.float32)
    weight[::3, 2:] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    index = np.array([rng.choice(len(BONES), 4, replace=False) for _ in range(count)])
    weights = SkinWeights(np.where(weight > 0, index, 0).astype(np.uint8), weight)
    skeleton = replace(skeleton_of(40.0, 9.0), confidence=rng.uniform(0, 1, len(BONES)).round(3))
    turns = Rotation.from_rotvec(rng.normal(0, 0.8, (FRAMES * len(BONES), 3))).as_matrix()
    motion = Clip("wave", 25.0, turns.reshape(FRAMES, len(BONES), 3, 3), rng.normal(0, 0.2, (FRAMES, 3)))
    return Avatar(mesh, skeleton, weights, [motion])


def content_of(path) -> dict:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def test_everything_comes_back(avatar, tmp_path):
    write_avatar(tmp_path / "a.glb", avatar)
    found = read_avatar(tmp_path / "a.glb")
    mesh = avatar.mesh
    order = np.argsort(mesh.kind, kind="stable")
    np.testing.assert_allclose(found.mesh.vertices, mesh.vertices, atol=2e-7)
    np.testing.assert_array_equal(found.mesh.triangles, mesh.triangles[order])
    np.testing.assert_array_equal(found.mesh.kind, mesh.kind[order])
    np.testing.assert_array_equal(found.mesh.colors, mesh.colors)
    np.testing.assert_array_equal(found.mesh.view, mesh.view)
    np.testing.assert_allclose(found.skeleton.joints, avatar.skeleton.joints, atol=2e-6)
    np.testing.assert_allclose(found.skeleton.ends, avatar.skeleton.ends, atol=1e-12)
    np.testing.assert_array_equal(found.skeleton.confidence, avatar.skeleton.confidence)
    np.testing.assert_array_equal(found.weights.index, avatar.weights.index)
    np.testing.assert_allclose(found.weights.weight, avatar.weights.weight, atol=1e-6)
    (motion,), (true,) = found.clips, avatar.clips
    assert (motion.name, motion.rate) == (true.name, true.rate)
    np.testing.assert_allclose(motion.rotations, true.rotations, atol=2e-6)
    np.testing.assert_allclose(motion.translations, true.translations, atol=2e-6)


def test_glTFs_own_skinning_moves_the_skin_as_ours(avatar, tmp_path):  # noqa: N802
    """Nodes, inverse bind matrices and animation put together as the specification says, without our reader."""
    write_avatar(tmp_path / "a.glb", avatar)
    content, binary = content_of(tmp_path / "a.glb"), (tmp_path / "a.glb").read_bytes()
    binary = binary[28 + struct.unpack_from("<I", binary, 12)[0] :]

    def rows(number, width):
        accessor = content["accessors"][number]
        view = content["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        return np.frombuffer(binary, "<f4", accessor["count"] * width, view["byteOffset"]).reshape(-1, width)

    skin, animation = content["skins"][0], content["animations"][0]
    bind = rows(skin["inverseBindMatrices"], 16).reshape(-1, 4, 4).swapaxes(1, 2)
    parent = {child: node for node, item in enumerate(content["nodes"]) for child in item.get("children", [])}
    to_file = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    (motion,) = avatar.clips
    for frame in (0, FRAMES - 1):
        local = {}
        for node, item in enumerate(content["nodes"]):
            local[node] = [np.array(item.get("translation", (0, 0, 0))), np.array(item.get("rotation", (0, 0, 0, 1)))]
        for channel in animation["channels"]:
            path = channel["target"]["path"]
            values = rows(animation["samplers"][channel["sampler"]]["output"], 3 if path == "translation" else 4)
            local[channel["target"]["node"]][path == "rotation"] = values[frame]

        def placed(node, local=local):
            matrix = np.eye(4)
            matrix[:3, 3], matrix[:3, :3] = local[node][0], Rotation.from_quat(local[node][1]).as_matrix()
            return placed(parent[node]) @ matrix if node in parent else matrix

        matrices = np.array([placed(node) for node in skin["joints"]]) @ bind
        moved = skinned(avatar.mesh.vertices @ to_file.T, avatar.weights, matrices) @ to_file
        pose = Pose(motion.rotations[frame], motion.translations[frame])
        true = skinned(avatar.mesh.vertices, avatar.weights, bone_matrices(avatar.skeleton, pose))
        np.testing.assert_allclose(moved, true, atol=5e-6)


def test_an_independent_reader_finds_mesh_and_bones(avatar, tmp_path):
    write_avatar(tmp_path / "a.glb", avatar)
    scene = trimesh.load(tmp_path / "a.glb", process=False)
    (body,) = scene.geometry.values()
    np.testing.assert_allclose(body.vertices[:, 1], avatar.mesh.vertices[:, 2], atol=1e-6)  # Y up
    np.testing.assert_allclose(body.vertices[:, 2], -avatar.mesh.vertices[:, 1], atol=1e-6)  # facing +Z
    content = content_of(tmp_path / "a.glb")
    names = [content["nodes"][node]["name"] for node in content["skins"][0]["joints"]]
    assert names == [PREFIX + name for name in BONES]
    for bone, node in enumerate(content["skins"][0]["joints"]):
        children = content["nodes"][node].get("children", [])
        assert children == [content["skins"][0]["joints"][c] for c, above in enumerate(PARENTS) if above == bone]


def test_ends_that_a_file_does_not_say_are_as_usual(avatar, tmp_path):
    """Another program keeps no extras: crown, fingers and toes are then where people have them."""
    write_avatar(tmp_path / "a.glb", avatar)
    gltf = read_gltf(tmp_path / "a.glb")
    del gltf.content["skins"][0]["extras"]
    write_gltf(tmp_path / "b.glb", gltf)
    found = read_avatar(tmp_path / "b.glb").skeleton
    assert np.linalg.norm(found.ends - avatar.skeleton.ends, axis=1).max() < 0.05
    assert (found.confidence == 1).all()


def test_vrm_names_its_humanoid(avatar, tmp_path):
    write_avatar(tmp_path / "a.glb", avatar, vrm=True)
    content = content_of(tmp_path / "a.glb")
    assert content["extensionsUsed"] == ["VRMC_vrm"]
    bones = content["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]
    named = {name: content["nodes"][item["node"]]["name"].removeprefix(PREFIX) for name, item in bones.items()}
    assert len(named) == len(BONES)
    # what VRM 1.0 requires, by its specification
    required = {"hips": "Hips", "spine": "Spine", "head": "Head", "leftUpperLeg": "LeftUpLeg",
                "rightLowerLeg": "RightLeg", "leftFoot": "LeftFoot", "rightUpperArm": "RightArm",
                "leftLowerArm": "LeftForeArm", "rightHand": "RightHand", "leftToes": "LeftToeBase",
                "upperChest": "Spine2", "leftShoulder": "LeftShoulder"}  # fmt: skip
    assert {name: named[name] for name in required} == required
    with pytest.raises(OutputError, match="skeleton"):
        write_avatar(tmp_path / "b.glb", Avatar(avatar.mesh), vrm=True)


def test_a_mesh_without_skeleton_or_colours_is_one_too(avatar, tmp_path):
    write_avatar(tmp_path / "a.glb", Avatar(Mesh(avatar.mesh.vertices, avatar.mesh.triangles)))
    found = read_avatar(tmp_path / "a.glb")
    assert found.skeleton is None and found.mesh.colors is None and found.mesh.kind is None
    np.testing.assert_array_equal(found.mesh.triangles, avatar.mesh.triangles)


def test_what_cannot_be_written_or_read_is_told(avatar, tmp_path):
    far = replace(avatar.mesh, vertices=np.full_like(avatar.mesh.vertices, np.nan))
    for mesh in (far, Mesh(np.zeros((3, 3)), np.empty((0, 3), np.int32))):
        with pytest.raises(OutputError):
            write_avatar(tmp_path / "a.glb", Avatar(mesh))
    assert not list(tmp_path.iterdir())
    write_avatar(tmp_path / "a.glb", avatar)
    data = (tmp_path / "a.glb").read_bytes()
    for case, old, new in (
        ("bone", b"mixamorig:LeftFoot", b"mixamorig:LeftFaat"),
        ("mesh", b'"primitives":', b'"primatives":'),
        ("accessor", b'"POSITION":0', b'"POSITION":99'[:12]),
    ):
        path = tmp_path / f"{case}.glb"
        path.write_bytes(data.replace(old, new))
        with pytest.raises(CaptureError, match=f"{case}.glb") as error:
            read_avatar(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "bone"),
    [("mixamorig:LeftArm", "LeftArm"), ("mixamorig_Hips", "Hips"), ("Spine1", "Spine1"), ("Tail", None),
     ("mixamorigHead", "Head"), ("mixamorig:LeftHandThumb1", None), ("rig:mixamorig:RightLeg", "RightLeg")],
)  # fmt: skip
def test_bones_are_known_by_name(name, bone):
    known = bone_named(name)
    assert (None if known is None else BONES[known]) == bone


def test_quaternions_are_scipys():
    turns = Rotation.random(500, random_state=1)
    halves = Rotation.from_rotvec(np.pi * np.vstack((np.eye(3), [[0.6, 0.8, 0.0]])))
    for rotation in (turns, halves):
        ours, theirs = quaternions(rotation.as_matrix()), rotation.as_quat()
        np.testing.assert_allclose(np.abs((ours * theirs).sum(axis=1)), 1.0, atol=1e-9)
        np.testing.assert_allclose(from_quaternions(3.0 * ours), rotation.as_matrix(), atol=1e-9)


def test_a_texture_lies_where_other_programs_look_for_it(tmp_path):
    mesh, texture, colors = textured_ball()
    write_avatar(tmp_path / "ball.glb", Avatar(mesh, texture=texture))
    (shown,) = trimesh.load(tmp_path / "ball.glb", process=False).geometry.values()
    image = np.asarray(shown.visual.material.baseColorTexture)
    at = shown.visual.uv[shown.faces].mean(axis=1)  # trimesh turns v upwards
    middles = (mesh.vertices[mesh.triangles].mean(axis=1) @ np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0))).T).round(5)
    place = {tuple(middle): k for k, middle in enumerate(middles)}
    ours = [place[tuple(middle)] for middle in shown.vertices[shown.faces].mean(axis=1).round(5)]
    np.testing.assert_array_equal(colors_at(at, image), colors[ours])
    attributes = read_gltf(tmp_path / "ball.glb").content["meshes"][0]["primitives"][0]["attributes"]
    assert "COLOR_0" not in attributes, "viewers would multiply the texture with it"


def test_a_textured_avatar_comes_back_welded(avatar, tmp_path):
    mesh, texture, colors = textured_ball()
    rng = np.random.default_rng(2)
    weight = np.tile(np.float32((0.75, 0.25, 0, 0)), (len(mesh.vertices), 1))
    index = np.zeros((len(mesh.vertices), 4), np.uint8)
    index[:, 0], index[:, 1] = rng.integers(0, 11, len(index)), rng.integers(11, 22, len(index))
    written = Avatar(mesh, avatar.skeleton, SkinWeights(index, weight), (), texture)
    write_avatar(tmp_path / "ball.glb", written)
    back = read_avatar(tmp_path / "ball.glb")
    np.testing.assert_allclose(back.mesh.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(back.mesh.colors, mesh.colors)
    np.testing.assert_array_equal(back.weights.index, index)
    order = np.argsort(mesh.kind, kind="stable")
    np.testing.assert_array_equal(back.mesh.triangles, mesh.triangles[order])
    np.testing.assert_array_equal(back.mesh.kind, mesh.kind[order])
    np.testing.assert_allclose(back.texture.uv, texture.uv[order], atol=1e-6)
    np.testing.assert_array_equal(back.texture.image, texture.image)
    np.testing.assert_array_equal(colors_at(back.texture.uv.mean(axis=1), back.texture.image), colors[order])
    # another program may drop what glTF does not know: vertices in one place are one then
    gltf = read_gltf(tmp_path / "ball.glb")
    attributes = gltf.content["meshes"][0]["primitives"][0]["attributes"]
    del attributes["_VERTEX"], attributes["_COLOR_0"]
    write_gltf(tmp_path / "other.glb", gltf)
    other = read_avatar(tmp_path / "other.glb")
    assert len(other.mesh.vertices) == len(mesh.vertices) and other.mesh.colors is None
    moved = other.mesh.vertices[other.mesh.triangles]
    np.testing.assert_allclose(moved, mesh.vertices[mesh.triangles[order]], atol=1e-6)


@pytest.mark.parametrize("damage", ["image", "view", "png"])
def test_a_damaged_texture_is_reported(damage, tmp_path):
    mesh, texture, _ = textured_ball()
    write_avatar(tmp_path / "ball.glb", Avatar(mesh, texture=texture))
    gltf = read_gltf(tmp_path / "ball.glb")
    view = gltf.content["images"][0]["bufferView"]
    if damage == "image":
        gltf.content["textures"][0]["source"] = 9
    elif damage == "view":
        gltf.content["bufferViews"][view]["byteLength"] = 10**9
    else:
        start = gltf.content["bufferViews"][view]["byteOffset"]
        gltf.binary[start + 60 : start + 90] = bytes(30)
    write_gltf(tmp_path / "bad.glb", gltf)
    with pytest.raises(CaptureError, match="bad.glb"):
        read_avatar(tmp_path / "bad.glb")
