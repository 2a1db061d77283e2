"""Reduce: fewer triangles or quads, and everything that lay on the avatar."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def person():
    """A mannequin, its skeleton and skin weights."""
    from mirror_scan.core.avatar.skin_weights import skin_weights
    from mirror_scan.core.mesh import Mesh
    from mirror_scan.core.simulation.mannequin import rigged_mannequin

    mesh, skeleton = rigged_mannequin(resolution=0.02)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    colors = (255 * (mesh.vertices - low) / (high - low)).astype(np.uint8)
    view = (mesh.vertices[:, 1] > 0).astype(np.int8)
    mesh = Mesh(mesh.vertices, mesh.triangles, colors, view, np.zeros(len(mesh.triangles), np.int8))
    return mesh, skeleton, skin_weights(mesh, skeleton)


@pytest.fixture
def avatar(bpy, person):
    """The mannequin in the scene: a skeleton, a UV map cut at x = 0, a second material and a group of the user's."""
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects

    mesh, skeleton, weights = person
    made = avatar_objects.create_avatar(
        mesh, collection=bpy.context.scene.collection, report={"mesh": {"triangles": 1}}
    )
    armature.add_armature(made, skeleton, weights, bpy.context.scene.collection)
    data = made.data
    left = mesh.vertices[mesh.triangles].mean(axis=1)[:, 0] > 0
    uv = mesh.vertices[mesh.triangles][:, :, [1, 2]] / 4 + 0.25
    uv[left, :, 0] += 0.5
    layer = data.uv_layers.new(name="Skin", do_init=False)
    layer.uv.foreach_set("vector", uv.astype(np.float32).ravel())
    data.materials.append(bpy.data.materials.new("Left"))
    data.polygons.foreach_set("material_index", left.astype(np.int32))
    data["mine"] = "kept"
    own = made.vertex_groups.new(name="Upper")
    own.add(np.flatnonzero(mesh.vertices[:, 2] > 1.0).tolist(), 0.5, "REPLACE")
    bpy.context.view_layer.update()
    avatar_objects.select_only(bpy.context, made)
    return made


def positions(avatar):
    found = np.empty((len(avatar.data.vertices), 3), np.float32)
    avatar.data.attributes["position"].data.foreach_get("vector", found.ravel())
    return found


def open_edges(data):
    edges = np.sort(np.array([key for polygon in data.polygons for key in polygon.edge_keys]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return int((count != 2).sum())


def check_colors_and_weights(avatar, person, tolerance):
    from mirror_scan.core.mesh.bvh import build_bvh, closest_point
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects

    mesh, _, weights = person
    at = positions(avatar).astype(float)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    distance, _, _ = closest_point(build_bvh(mesh.vertices, mesh.triangles), at)
    assert distance.mean() < tolerance
    colors = avatar_objects.active_colors(avatar.data).astype(float)
    assert np.abs(colors - 255 * (at - low) / (high - low)).mean() < 3
    got = armature.read_weights(avatar)
    full, mine = np.zeros((len(weights.index), 22)), np.zeros((len(at), 22))
    np.add.at(full, (np.arange(len(full))[:, None], weights.index), weights.weight)
    np.add.at(mine, (np.arange(len(mine))[:, None], got.index), got.weight)
    nearest = ((mesh.vertices[None] - at[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    assert np.abs(mine - full[nearest]).sum(axis=1).mean() < 0.06
    upper = avatar.vertex_groups["Upper"].index
    held = np.array([sum(m.weight for m in v.groups if m.group == upper) for v in avatar.data.vertices])
    np.testing.assert_allclose(held[at[:, 2] > 1.05], 0.5, atol=0.03)
    assert (held[at[:, 2] < 0.95] < 0.02).all()
    assert avatar.data["mine"] == "kept"
    assert [material.name for material in avatar.data.materials] == ["Avatar", "Left"]
    assert avatar.modifiers["Armature"].object is avatar.parent


def test_everything_stays_with_fewer_triangles(bpy, avatar, person):
    from mirror_scan.mirror_scan_addon.scene.report_text import avatar_report

    before = len(avatar.data.polygons)
    assert bpy.ops.mirror_scan.reduce(triangles=1500) == {"FINISHED"}
    assert before > 3000 and len(avatar.data.polygons) in (1499, 1500)
    assert open_edges(avatar.data) == 0
    check_colors_and_weights(avatar, person, 0.002)
    data = avatar.data
    uv = np.empty((len(data.loops), 2), np.float32)
    data.uv_layers["Skin"].uv.foreach_get("vector", uv.ravel())
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    left = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("material_index", left)
    said = (uv - 0.25 - np.repeat(left, 3)[:, None] * (0.5, 0)) * 4
    away = np.linalg.norm(said - positions(avatar)[corners][:, [1, 2]], axis=1)
    assert away.mean() < 0.002 and np.percentile(away, 99) < 0.02
    assert avatar_report(avatar)["mesh"]["triangles"] == len(data.polygons)
    assert {"view", "kind"} <= set(data.attributes.keys())


def test_quads_cover_the_same_body(bpy, avatar, person):
    assert bpy.ops.mirror_scan.reduce(triangles=3000, quads=True) == {"FINISHED"}
    data = avatar.data
    sides = [len(polygon.vertices) for polygon in data.polygons]
    assert sides.count(4) > 0.98 * len(sides) and 700 < len(sides) < 3000
    assert open_edges(data) == 0
    check_colors_and_weights(avatar, person, 0.004)
    assert [item.name for item in bpy.data.objects if item.type == "MESH"] == [avatar.name]
    assert len(bpy.data.meshes) == 1


@pytest.mark.parametrize("quads", [False, True])
def test_one_undo_brings_everything_back(bpy, avatar, quads):
    before = len(avatar.data.polygons), len(avatar.vertex_groups), len(bpy.data.objects)
    bpy.ops.ed.undo_push(message="start")
    assert bpy.ops.mirror_scan.reduce(triangles=3000, quads=quads) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="reduced")
    bpy.ops.ed.undo()
    back = bpy.data.objects["Avatar"]
    assert (len(back.data.polygons), len(back.vertex_groups), len(bpy.data.objects)) == before
    assert sum(len(vertex.groups) for vertex in back.data.vertices) > len(back.data.vertices)
    assert back.data.uv_layers.active.name == "Skin"


def test_a_scaled_avatar_in_another_unit_keeps_its_size(bpy, avatar):
    bpy.context.scene.unit_settings.scale_length = 0.01
    avatar.scale = (2, 2, 2)
    bpy.context.view_layer.update()
    before = positions(avatar)
    assert bpy.ops.mirror_scan.reduce(triangles=1500) == {"FINISHED"}
    np.testing.assert_allclose(np.ptp(positions(avatar), axis=0), np.ptp(before, axis=0), rtol=0.02)


def test_shape_keys_and_too_few_triangles_are_refused(bpy, avatar):
    with pytest.raises(RuntimeError, match="has only"):
        bpy.ops.mirror_scan.reduce(triangles=1_000_000)
    avatar.shape_key_add()
    assert not bpy.ops.mirror_scan.reduce.poll()
