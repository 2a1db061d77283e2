"""Garments in an avatar's file: what is written comes back, and other readers see meshes on the same skin."""

from __future__ import annotations

import numpy as np
import trimesh
from mirror_scan.core.avatar.avatar_file import Avatar, read_avatar, write_avatar
from mirror_scan.core.avatar.garment import Garment
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.io.gltf import read_gltf
from mirror_scan.core.mesh import Mesh
from standing_body import skeleton_of


def some_mesh(rng, count, faces):
    triangles = np.array([rng.choice(count, 3, replace=False) for _ in range(faces)], np.int32)
    triangles[: count // 3] = np.arange(count // 3 * 3).reshape(-1, 3)  # every vertex is used
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    return Mesh(rng.normal(0, 0.3, (count, 3)) + (0, 0, 1), triangles, colors)


def some_weights(rng, count):
    index = np.array([np.sort(rng.choice(len(BONES), 4, replace=False)) for _ in range(count)], np.uint8)
    weight = -np.sort(-rng.dirichlet(np.ones(4), count).astype(np.float32), axis=1)
    return SkinWeights(index, weight)


def dressed(rng):
    body = some_mesh(rng, 60, 40)
    garments = []
    for name, tight, has_uv in (("Skirt", False, True), ("T-Shirt", True, False)):
        mesh = some_mesh(rng, 30, 50)
        uv = rng.random((50, 3, 2)).astype(np.float32) if has_uv else None
        garments.append(
            Garment(name, mesh, some_weights(rng, 30), rng.random(30).astype(np.float32), tight, uv)
        )  # fmt: skip
    return Avatar(body, skeleton_of(45.0, 9.0), some_weights(rng, 60), garments=garments)


def test_garments_come_back(tmp_path):
    avatar = dressed(np.random.default_rng(8))
    write_avatar(tmp_path / "a.glb", avatar)
    found = read_avatar(tmp_path / "a.glb")
    np.testing.assert_allclose(found.mesh.vertices, avatar.mesh.vertices, atol=1e-6)
    assert len(found.garments) == 2
    for one, truth in zip(found.garments, avatar.garments, strict=True):
        assert (one.name, one.tight) == (truth.name, truth.tight)
        np.testing.assert_allclose(one.mesh.vertices, truth.mesh.vertices, atol=1e-6)
        np.testing.assert_array_equal(one.mesh.triangles, truth.mesh.triangles)
        np.testing.assert_array_equal(one.mesh.colors, truth.mesh.colors)
        np.testing.assert_allclose(one.pinned, truth.pinned, atol=1e-6)
        np.testing.assert_array_equal(one.weights.index, truth.weights.index)
        np.testing.assert_allclose(one.weights.weight, truth.weights.weight, atol=1e-6)
        if truth.uv is None:
            assert one.uv is None
        else:
            np.testing.assert_allclose(one.uv, truth.uv, atol=1e-6)


def test_other_readers_see_each_garment(tmp_path):
    avatar = dressed(np.random.default_rng(9))
    write_avatar(tmp_path / "a.glb", avatar)
    scene = trimesh.load(tmp_path / "a.glb", process=False)
    counts = sorted(len(shape.faces) for shape in scene.geometry.values())
    assert counts == sorted([40, 50, 50])
    content = read_gltf(tmp_path / "a.glb").content
    assert [node["skin"] for node in content["nodes"] if "mesh" in node] == [0, 0, 0]
