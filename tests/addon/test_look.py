"""An avatar's texture and measurements in Blender, from a capture to the files they go to."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture
def built(bpy, scan, compiled):
    """The avatar of a virtual scan, selected; and its height [m]."""
    assert bpy.ops.mirror_scan.build_avatar(filepath=str(scan[0])) == {"FINISHED"}
    return bpy.context.object, scan[1]


def texture_of(bpy, avatar):
    from mirror_scan.mirror_scan_addon.scene import avatar_texture

    return avatar_texture.read_texture(avatar)


def colors_of(avatar, texture):
    """What the texture shows at the middle of each triangle, and what the vertices' colours say there (T, 3)."""
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    data = avatar.data
    rgba = np.empty((len(data.vertices), 4), np.float32)
    data.color_attributes[avatar_objects.COLOR].data.foreach_get("color_srgb", rgba.ravel())
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    by_vertex = 255 * rgba[corners.reshape(-1, 3), :3].mean(axis=1)
    size = len(texture.image)
    middle = texture.uv.mean(axis=1)
    column = np.clip((middle[:, 0] * size).astype(int), 0, size - 1)
    row = np.clip(((1 - middle[:, 1]) * size).astype(int), 0, size - 1)
    return texture.image[row, column].astype(float), by_vertex


def test_a_texture_is_laid_on_the_avatar_and_goes_to_every_file(bpy, built, tmp_path):
    from mirror_scan.mirror_scan_addon.scene import report_text

    avatar, _ = built
    assert bpy.ops.mirror_scan.texture(size="1024") == {"FINISHED"}
    texture = texture_of(bpy, avatar)
    assert texture.image.shape == (1024, 1024, 3) and 0 <= texture.uv.min() and texture.uv.max() <= 1
    shown, by_vertex = colors_of(avatar, texture)
    seen = np.empty(len(avatar.data.polygons), np.int32)
    avatar.data.attributes["kind"].data.foreach_get("value", seen)
    assert np.median(np.abs(shown - by_vertex)[seen == 0]) < 12
    report = report_text.avatar_report(avatar)["texture"]
    assert report["size"] == 1024 and 0 < report["islands"] <= 40 and report["used"] > 0.5
    material = avatar.active_material
    image = next(node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    assert image.packed_file is not None
    assert bpy.ops.mirror_scan.color_by(mode="VIEW") == {"FINISHED"}
    assert avatar.active_material != material
    assert bpy.ops.mirror_scan.color_by(mode="CAPTURE") == {"FINISHED"}
    assert avatar.active_material == material
    paths = {kind: tmp_path / kind / f"my avatar.{kind.lower()}" for kind in ("GLB", "FBX", "OBJ", "USDC")}
    for kind, path in paths.items():
        path.parent.mkdir()
        assert bpy.ops.mirror_scan.export_avatar(filepath=str(path), format=kind) == {"FINISHED"}
    for path in paths.values():
        comes_back_textured(bpy, path, texture)


def comes_back_textured(bpy, path, texture):
    """Blender's own importer finds the image, and the UV map puts the same pixels to the same places."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    importer = {
        ".glb": bpy.ops.import_scene.gltf, ".fbx": bpy.ops.import_scene.fbx, ".obj": bpy.ops.wm.obj_import,
        ".usdc": bpy.ops.wm.usd_import,
    }[path.suffix]  # fmt: skip
    assert importer(filepath=str(path)) == {"FINISHED"}
    avatar = next(item for item in bpy.data.objects if item.type == "MESH" and len(item.data.polygons) > 1000)
    nodes = [node for node in avatar.active_material.node_tree.nodes if node.type == "TEX_IMAGE"]
    image = nodes[0].image
    assert tuple(image.size) == (1024, 1024), path
    uv = np.empty((len(avatar.data.loops), 2), np.float32)
    avatar.data.uv_layers.active.uv.foreach_get("vector", uv.ravel())
    ours = np.unique(np.round(texture.uv.reshape(-1, 2), 4), axis=0)
    theirs = np.unique(np.round(uv, 4), axis=0)
    assert abs(len(ours) - len(theirs)) < 0.02 * len(ours)
    pixels = np.empty(4 * 1024 * 1024, np.float32)
    image.pixels.foreach_get(pixels)
    read = pixels.reshape(1024, 1024, 4)[::-1, :, :3] * 255
    assert np.abs(read - texture.image).max() < 1.5, path


def test_measurements_are_kept_drawn_and_saved(bpy, built, tmp_path):
    from mirror_scan.mirror_scan_addon.scene import report_text, tape_curves

    avatar, height = built
    assert not bpy.ops.mirror_scan.save_measurements.poll()
    assert bpy.ops.mirror_scan.measure() == {"FINISHED"}
    found = report_text.avatar_report(avatar)["measurements"]
    assert len(found) == 12 and abs(found["height"]["mm"] - 1000 * height) < 15
    assert all(one["error_mm"] > 0 and one["iso_name"] for one in found.values())
    curves = tape_curves.tapes_of(avatar).objects
    assert {curve.name for curve in curves} == set(found)
    waist = next(curve for curve in curves if curve.name == "waist")
    points = np.array([point.co[:3] for point in waist.data.splines[0].points])
    around = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum()
    assert 1000 * around == pytest.approx(found["waist"]["mm"], rel=0.02)
    assert bpy.ops.mirror_scan.measure() == {"FINISHED"}  # again: the first curves go
    assert len([item for item in bpy.data.objects if item.type == "CURVE"]) == 12
    path = tmp_path / "sizes.csv"
    assert bpy.ops.mirror_scan.save_measurements(filepath=str(path)) == {"FINISHED"}
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
    assert [row["name"] for row in rows] == list(found)
    assert float(rows[0]["mm"]) == found["height"]["mm"]


def test_what_stands_in_the_way_of_a_texture_is_said(bpy, built, capsule):
    from mirror_scan.mirror_scan_addon.scene import avatar_objects, capture_source, scan_records

    avatar, _ = built
    kept = json.loads(avatar[scan_records.SOURCE])
    avatar[scan_records.SOURCE] = json.dumps(kept | {"path": "/nowhere/capture"})
    with pytest.raises(RuntimeError, match="no longer exists"):
        bpy.ops.mirror_scan.texture()
    avatar[scan_records.SOURCE] = json.dumps(kept)
    assert capture_source.source_of(avatar, bpy.context.scene).path == kept["path"]
    avatar[scan_records.RESTS_OTHERWISE] = True
    assert not bpy.ops.mirror_scan.texture.poll()
    other = avatar_objects.create_avatar(capsule, collection=bpy.context.scene.collection)
    avatar_objects.select_only(bpy.context, other)
    assert not bpy.ops.mirror_scan.texture.poll()
