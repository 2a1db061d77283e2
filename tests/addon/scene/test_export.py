"""Files that open elsewhere as what they were here, and an open file that notices nothing."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bpy")

WRITERS = {"blend": "write_blend", "glb": "write_glb", "fbx": "write_fbx"}


def write(suffix, folder, reconstruction, **options):
    from mirror_scan.mirror_scan_addon.scene import export

    path = folder / f"avatar.{suffix}"
    getattr(export, WRITERS[suffix])(path, reconstruction, **options)
    assert [entry.name for entry in folder.iterdir()] == [path.name]
    return path


@pytest.fixture
def users_file(bpy):
    """A file somebody works in: an Avatar of their own, other units, something selected; returns what it looks like."""
    scene = bpy.context.scene
    scene.unit_settings.scale_length = 0.01
    mine = bpy.data.objects.new("Avatar", bpy.data.meshes.new("Avatar"))
    scene.collection.objects.link(mine)
    mine.select_set(True)
    bpy.context.view_layer.objects.active = mine

    def look():
        kinds = ("objects", "meshes", "materials", "scenes", "cameras", "lights", "collections", "images", "actions")
        return (
            {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in kinds},
            bpy.context.scene.name,
            bpy.context.view_layer.objects.active.name,
            [selected.name for selected in bpy.context.selected_objects],
            bpy.data.filepath,
            sorted(addon.module for addon in bpy.context.preferences.addons),
        )

    return look


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_open_file_is_left_alone(users_file, tmp_path, reconstruction, suffix):
    before = users_file()
    write(suffix, tmp_path, reconstruction)
    assert users_file() == before


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_failure_keeps_the_old_file_and_the_open_one(users_file, tmp_path, reconstruction, suffix):
    from mirror_scan.core.errors import OutputError

    (tmp_path / f"avatar.{suffix}").write_bytes(b"old")
    before = users_file()
    bad = replace(reconstruction, mesh=replace(reconstruction.mesh, triangles=np.zeros((0, 3), np.int32), kind=None))
    with pytest.raises(OutputError, match="no triangles"):
        write(suffix, tmp_path, bad)
    assert (tmp_path / f"avatar.{suffix}").read_bytes() == b"old"
    assert users_file() == before
    with pytest.raises(OutputError, match="does not exist"):
        write(suffix, tmp_path / "nowhere", reconstruction)


@pytest.mark.parametrize("own_process", [True, False])
def test_blend_opens_with_the_avatar(bpy, tmp_path, reconstruction, own_process):
    path = write("blend", tmp_path, reconstruction, own_process=own_process)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    assert [item.type for item in scene.collection.objects] == ["MESH"]
    studio = scene.collection.children["Studio"].objects
    assert sorted(item.type for item in studio) == ["CAMERA", "LIGHT", "LIGHT", "LIGHT", "MESH"]
    avatar = bpy.context.view_layer.objects.active
    assert avatar.name == "Avatar" and avatar.select_get() and avatar.visible_get()
    assert len(avatar.data.vertices) == len(reconstruction.mesh.vertices)
    assert json.loads(avatar["mirror_scan_report"]) == reconstruction.report
    assert scene.unit_settings.system == "METRIC" and scene.unit_settings.scale_length == 1
    assert scene.camera.name == "Studio Camera"
    assert camera_sees(scene, avatar)
    if own_process:
        spaces = [a.spaces.active for s in bpy.data.screens for a in s.areas if a.type == "VIEW_3D"]
        assert spaces and all(space.shading.color_type == "VERTEX" for space in spaces)
        for space in spaces:
            np.testing.assert_allclose(space.region_3d.view_location, (0, 0, 0.85), atol=1e-5)
            assert 1.7 < space.region_3d.view_distance < 5


def camera_sees(scene, avatar) -> bool:
    """Whether the render shows all of the avatar, from its front, filling most of the height."""
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    scene.view_layers[0].update()
    corners = np.array([world_to_camera_view(scene, scene.camera, Vector(corner)) for corner in avatar.bound_box])
    inside = ((corners[:, :2] > 0) & (corners[:, :2] < 1)).all() and (corners[:, 2] > 0).all()
    return inside and scene.camera.location.y < -1 and np.ptp(corners[:, 1]) > 0.6


def read_glb(path):
    """JSON and accessor arrays of a .glb, read by the specification (two chunks, tight or strided views)."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    content = json.loads(data[20 : 20 + size])
    body = data[28 + size :]
    kinds = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
    widths = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

    def accessor(index):
        entry = content["accessors"][index]
        view = content["bufferViews"][entry["bufferView"]]
        kind, width = np.dtype(kinds[entry["componentType"]]), widths[entry["type"]]
        assert view.get("byteStride", kind.itemsize * width) == kind.itemsize * width
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        values = np.frombuffer(body, kind, entry["count"] * width, start).reshape(-1, width)
        return values / np.iinfo(kind).max if entry.get("normalized") else values

    return content, accessor


def test_glb_has_metres_y_up_and_linear_colours(bpy, tmp_path, reconstruction):
    content, accessor = read_glb(write("glb", tmp_path, reconstruction))
    assert [node["name"] for node in content["nodes"]] == ["Avatar"]
    assert not {"scale", "rotation", "translation", "matrix"} & content["nodes"][0].keys()
    (primitive,) = content["meshes"][0]["primitives"]
    mesh = reconstruction.mesh
    position = accessor(primitive["attributes"]["POSITION"])
    # The exporter is free in the order of vertices: pair them by position.
    expected = mesh.vertices[:, (0, 2, 1)] * (1, 1, -1)
    order, found = np.lexsort(np.round(expected, 5).T), np.lexsort(np.round(position, 5).T)
    np.testing.assert_allclose(position[found], expected[order], atol=1e-5)
    assert len(accessor(primitive["indices"])) == 3 * len(mesh.triangles)
    value = mesh.colors / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(accessor(primitive["attributes"]["COLOR_0"])[found][:, :3], linear[order], atol=3e-4)
    normal = accessor(primitive["attributes"]["NORMAL"])
    assert (np.einsum("ij,ij->i", normal, position - (0, 0.85, 0)) > 0).all()


def test_glb_is_read_by_trimesh(bpy, tmp_path, reconstruction):
    trimesh = pytest.importorskip("trimesh")
    (mesh,) = trimesh.load(write("glb", tmp_path, reconstruction)).geometry.values()
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.extents, (0.4, 1.7, 0.4), atol=2e-3)


def test_fbx_has_the_same_size_without_a_scale(bpy, tmp_path, reconstruction):
    path = write("fbx", tmp_path, reconstruction)
    bpy.ops.import_scene.fbx(filepath=str(path))
    (avatar,) = bpy.data.objects
    bpy.context.view_layer.update()
    np.testing.assert_allclose(avatar.scale, 1, atol=1e-6)
    vertices = np.empty(3 * len(avatar.data.vertices))
    avatar.data.vertices.foreach_get("co", vertices)
    world = vertices.reshape(-1, 3) @ np.array(avatar.matrix_world)[:3, :3].T
    np.testing.assert_allclose(world, reconstruction.mesh.vertices, atol=1e-5)
    layer = avatar.data.color_attributes[0]
    rgba = np.empty(4 * len(layer.data))
    layer.data.foreach_get("color_srgb", rgba)
    index = np.empty(len(avatar.data.loops), dtype=np.int32)
    avatar.data.loops.foreach_get("vertex_index", index)
    index = index if layer.domain == "CORNER" else np.arange(len(vertices) // 3)
    np.testing.assert_allclose(rgba.reshape(-1, 4)[:, :3] * 255, reconstruction.mesh.colors[index], atol=0.51)


def test_fbx_unit_is_the_metre(bpy, tmp_path, reconstruction):
    """FBX counts centimetres: a unit factor of 100 says that the numbers are metres."""
    data = write("fbx", tmp_path, reconstruction).read_bytes()
    at = data.index(b"UnitScaleFactor")
    assert math.isclose(struct.unpack_from("<d", data, data.index(b"D", at + len("UnitScaleFactor") + 20) + 1)[0], 100)


def test_colourless_meshes_are_written_too(bpy, tmp_path, reconstruction):
    grey = replace(reconstruction, mesh=replace(reconstruction.mesh, colors=None))
    content, _ = read_glb(write("glb", tmp_path, grey))
    assert "COLOR_0" not in content["meshes"][0]["primitives"][0]["attributes"]
