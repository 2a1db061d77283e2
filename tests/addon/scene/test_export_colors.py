"""Every format carries the capture's colours, whatever is shown, with a material that shows them."""

from __future__ import annotations

import json
import struct
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exported_colors import (
    BY_IMAGE,
    IMPORTERS,
    MODES,
    check_colors,
    colors_in_3mf,
    corners_of,
    image_shown,
    import_mesh,
    stored_colors,
    texels_shown,
    truth_at,
)

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def mesh():
    """A capsule of random colours, the extremes among them."""
    from mirror_scan.core.mesh import Mesh

    rng = np.random.default_rng(8)
    around, along = 16, 9
    turn, up = np.meshgrid(2 * np.pi * np.arange(around) / around, np.arange(along))
    radius = 0.3 * np.sin(np.pi * (up + 1) / (along + 1)) + 0.02
    vertices = np.stack((radius * np.cos(turn), radius * np.sin(turn), 0.2 * up), axis=-1).reshape(-1, 3)
    here = np.arange(around)
    there = (here + 1) % around
    triangles = []
    for ring in range(along - 1):
        low, high = ring * around, (ring + 1) * around
        triangles += [np.stack((low + here, low + there, high + there), axis=1)]
        triangles += [np.stack((low + here, high + there, high + here), axis=1)]
    triangles = np.concatenate(triangles).astype(np.int32)
    colors = rng.integers(0, 256, (len(vertices), 3)).astype(np.uint8)
    colors[:6] = np.repeat([[0], [1], [2], [128], [254], [255]], 3, axis=1)
    view, kind = rng.integers(-1, 3, len(vertices)), rng.integers(0, 3, len(triangles))
    return Mesh(vertices, triangles, colors, view.astype(np.int8), kind.astype(np.int8))


@pytest.fixture
def avatar(bpy, mesh):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    made = create_avatar(mesh, collection=bpy.context.scene.collection)
    select_only(bpy.context, made)
    return made


@pytest.fixture
def texture(mesh):
    """Places of the triangles in an image of random colours."""
    from mirror_scan.core.mesh import Texture

    rng = np.random.default_rng(3)
    return Texture(
        ((rng.integers(0, 64, (len(mesh.triangles), 3, 2)) + 0.5) / 64).astype(np.float32),
        rng.integers(0, 256, (64, 64, 3)).astype(np.uint8), np.arange(len(mesh.triangles), dtype=np.int32),
    )  # fmt: skip


def exported(bpy, path, **options):
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(path), **options) == {"FINISHED"}
    return path


def imported(bpy, path):
    """The one mesh in a file, in an empty scene."""
    emptied(bpy)
    return import_mesh(bpy, path)


def emptied(bpy):
    import addon_utils

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for module in ("io_scene_gltf2", "io_scene_fbx"):
        addon_utils.enable(module)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("ending", [*IMPORTERS, "blend"])
def test_the_colours_of_the_capture_come_back_bit_for_bit(bpy, avatar, mesh, tmp_path, ending, mode):
    bpy.ops.mirror_scan.color_by(mode=mode)
    names = [attribute.name for attribute in avatar.data.color_attributes]
    slots = [slot.material for slot in avatar.material_slots]
    path = exported(bpy, tmp_path / f"a.{ending}")
    assert [attribute.name for attribute in avatar.data.color_attributes] == names
    assert [slot.material for slot in avatar.material_slots] == slots and avatar.data.name == "Avatar"
    emptied(bpy)
    check_colors(bpy, path, mesh)
    if ending in BY_IMAGE:
        assert bpy.data.materials[0].name == ("Avatar Texture" if ending == "fbx" else "Avatar_Texture")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("ending", [*IMPORTERS, "blend"])
def test_a_texture_goes_along_whatever_is_shown(bpy, avatar, texture, tmp_path, ending, mode):
    from mirror_scan.mirror_scan_addon.scene.avatar_texture import set_texture

    set_texture(avatar, texture)
    bpy.ops.mirror_scan.color_by(mode=mode)
    item = imported(bpy, exported(bpy, tmp_path / f"a.{ending}"))
    names = [attribute.name for attribute in item.data.color_attributes]
    assert len(names) == (0 if ending.startswith("gl") else 1)  # viewers multiply a texture by COLOR_0
    uv = np.empty((len(item.data.loops), 2), np.float32)
    if ending not in ("ply",):  # which has a place for every vertex, not for every corner
        item.data.uv_layers.active.uv.foreach_get("vector", uv.ravel())
        ours, theirs = (np.unique(np.rint(64 * one.reshape(-1, 2) - 0.5), axis=0) for one in (texture.uv, uv))
        np.testing.assert_array_equal(ours, theirs)
    if ending not in ("ply", "abc"):
        np.testing.assert_array_equal(image_shown(item), texture.image)


def first_colors_of(glb):
    """COLOR_0 (N, 3) of the one mesh of a .glb, 0 to 1, which has no others; by the specification of glTF 2.0."""
    (size,) = struct.unpack_from("<I", glb, 12)
    content, body = json.loads(glb[20 : 20 + size]), glb[28 + size :]
    (primitive,) = content["meshes"][0]["primitives"]
    assert [name for name in primitive["attributes"] if name.startswith("COLOR")] == ["COLOR_0"]
    accessor = content["accessors"][primitive["attributes"]["COLOR_0"]]
    kind = {5121: np.uint8, 5123: np.uint16, 5126: np.float32}[accessor["componentType"]]
    width = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
    start = content["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(body, kind, width * accessor["count"], start).reshape(-1, width)[:, :3]
    return values.astype(np.float64) / (1 if kind == np.float32 else np.iinfo(kind).max)


@pytest.mark.parametrize("textured", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_3mf_has_the_colours_or_the_texture(bpy, avatar, mesh, texture, tmp_path, mode, textured):
    from mirror_scan.core.io.images import image_of_bytes
    from mirror_scan.mirror_scan_addon.scene.avatar_texture import set_texture

    if textured:
        set_texture(avatar, texture)
    bpy.ops.mirror_scan.color_by(mode=mode)
    avatar.location.x = 1.0
    exported(bpy, tmp_path / "a.3mf")
    if textured:
        with zipfile.ZipFile(tmp_path / "a.3mf") as archive:
            np.testing.assert_array_equal(image_of_bytes(archive.read("3D/Textures/texture.png")), texture.image)
        return
    places, colors = colors_in_3mf(tmp_path / "a.3mf")
    np.testing.assert_allclose(places, 1000 * (mesh.vertices + (1, 0, 0))[mesh.triangles], atol=1e-2)
    np.testing.assert_array_equal(colors, mesh.colors[mesh.triangles])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("ending", ["glb", "ply", "obj"])
def test_trimesh_reads_the_colours_of_the_capture(bpy, avatar, mesh, tmp_path, ending, mode):
    trimesh = pytest.importorskip("trimesh")
    from mirror_scan.core.numeric.srgb import from_linear

    bpy.ops.mirror_scan.color_by(mode=mode)
    path = exported(bpy, tmp_path / f"a.{ending}")
    if ending == "glb":
        (found,) = trimesh.load(path, process=False).geometry.values()
        points = np.array(found.vertices)[:, (0, 2, 1)] * (1, -1, 1)
        linear = first_colors_of(path.read_bytes())
        np.testing.assert_array_equal(np.rint(255 * from_linear(linear)), truth_at(mesh, points))
        return
    if ending == "obj":  # trimesh shows the image of a material instead; the colours stand in the lines of vertices
        rows = np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float)
        points, colors = rows[:, :3], np.rint(255 * rows[:, 3:6])
        assert len(trimesh.load(path, process=False).visual.uv) and (tmp_path / "a.png").is_file()
        assert "map_Kd a.png" in (tmp_path / "a.mtl").read_text().splitlines()
    else:
        found = trimesh.load(path, process=False)
        points, colors = np.array(found.vertices), found.visual.vertex_colors[:, :3]
    places = points[:, (0, 2, 1)] * (1, -1, 1) if ending == "obj" else points
    np.testing.assert_array_equal(colors, truth_at(mesh, places))


@pytest.mark.parametrize("ending", IMPORTERS)
def test_what_is_shown_goes_into_a_file_when_it_is_asked_for(bpy, avatar, mesh, tmp_path, ending):
    from mirror_scan.core.preview.palette import view_colors

    bpy.ops.mirror_scan.color_by(mode="VIEW")
    item = imported(bpy, exported(bpy, tmp_path / f"a.{ending}", colors="SHOWN"))
    places, _ = corners_of(item)
    wanted = truth_at(SimpleNamespace(vertices=mesh.vertices, colors=view_colors(mesh.view)), places)
    np.testing.assert_array_equal(stored_colors(item), wanted)
    if ending in BY_IMAGE:
        np.testing.assert_array_equal(texels_shown(item), wanted)


@pytest.mark.parametrize("ending", ["fbx", "usdc"])
def test_scripts_and_the_command_line_write_them_too(bpy, mesh, tmp_path, ending):
    from mirror_scan.core.pipeline import Reconstruction
    from mirror_scan.mirror_scan_addon.scene import export

    path = tmp_path / f"a.{ending}"
    getattr(export, {"fbx": "write_fbx", "usdc": "write_usd"}[ending])(
        path, Reconstruction(mesh, "avatar", np.eye(4), {})
    )
    item = imported(bpy, path)
    np.testing.assert_array_equal(texels_shown(item), truth_at(mesh, corners_of(item)[0]))


@pytest.mark.parametrize("ending", ["glb", "ply", "fbx", "blend"])
def test_what_a_virtual_scan_showed_on_it_stays_here(bpy, avatar, mesh, tmp_path, ending):
    from mirror_scan.mirror_scan_addon.scene import avatar_objects, virtual_rig

    avatar_objects.set_colors(avatar.data, virtual_rig.COVERAGE, 255 - mesh.colors, "POINT")
    avatar_objects.show_colors(avatar, virtual_rig.COVERAGE)
    item = imported(bpy, exported(bpy, tmp_path / f"a.{ending}"))
    np.testing.assert_array_equal(stored_colors(item), truth_at(mesh, corners_of(item)[0]))


def test_what_a_user_made_is_left_alone(bpy, avatar, mesh, tmp_path):
    """A UV map and a material of his own; and a mesh of one colour needs no image."""
    material = bpy.data.materials.new("Mine")
    avatar.data.materials[0] = material
    item = imported(bpy, exported(bpy, tmp_path / "a.fbx"))
    assert item.active_material.name == "Mine" and not item.data.uv_layers
    from dataclasses import replace

    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    plain = replace(mesh, colors=np.full((len(mesh.vertices), 3), (10, 200, 90), np.uint8))
    select_only(bpy.context, create_avatar(plain, collection=bpy.context.scene.collection))
    item = imported(bpy, exported(bpy, tmp_path / "b.fbx"))
    shader = next(node for node in item.active_material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    from mirror_scan.core.numeric.srgb import from_linear

    color = from_linear(np.array(shader.inputs["Base Color"].default_value[:3]))
    np.testing.assert_allclose(255 * color, (10, 200, 90), atol=0.6)
    assert not Path(tmp_path / "b.fbm").exists()
