"""An avatar is exported whole, with faces outwards and in metres, in whatever state it stands in the scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("bpy")

IMPORTERS = {
    "glb": "import_scene.gltf", "fbx": "import_scene.fbx", "obj": "wm.obj_import", "ply": "wm.ply_import",
    "stl": "wm.stl_import", "usdc": "wm.usd_import", "abc": "wm.alembic_import",
}  # fmt: skip


@pytest.fixture(scope="module")
def wedge():
    """No symmetry, 192 triangles: sides that were exchanged, or faces that point inwards, show."""
    from mirror_scan.core.mesh import Mesh

    grid = [(a / 4, b / 4) for a in range(4) for b in range(4)]
    quads = []
    for axis in range(3):
        for end in (0.0, 1.0):
            for a, b in grid:
                square = [
                    np.roll((end, c, d), axis) for c, d in ((a, b), (a + 0.25, b), (a + 0.25, b + 0.25), (a, b + 0.25))
                ]
                quads.append(square if end else square[::-1])
    points = np.array(quads).reshape(-1, 3)
    vertices, inverse = np.unique(points.round(9), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1, 4)
    triangles = np.concatenate((inverse[:, [0, 1, 2]], inverse[:, [0, 2, 3]])).astype(np.int32)
    vertices = vertices * (0.5, 0.3, 1.7)
    vertices[:, 0] += 0.2 * vertices[:, 2] * vertices[:, 1]
    return Mesh(vertices, triangles, np.full((len(vertices), 3), 120, np.uint8))


def volume(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def in_world(item):
    """Vertices of a mesh object as they stand in the world, and its triangles."""
    data = item.data
    data.calc_loop_triangles()
    points = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", points.ravel())
    triangles = np.empty((len(data.loop_triangles), 3), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    matrix = np.array(item.matrix_world)
    return points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3], triangles


def imported(bpy, path):
    """The one mesh in a file, in the world."""
    import addon_utils

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    ending = path.suffix[1:]
    if ending in ("glb", "fbx"):
        addon_utils.enable({"glb": "io_scene_gltf2", "fbx": "io_scene_fbx"}[ending])
    module, name = IMPORTERS[ending].split(".")
    options = {"forward_axis": "Y", "up_axis": "Z"} if ending in ("ply", "stl") else {}
    if ending == "stl":
        options["global_scale"] = 0.001  # it is in millimetres, for slicers
    getattr(getattr(bpy.ops, module), name)(filepath=str(path), **options)
    bpy.context.view_layer.update()
    # the glTF importer brings a shape for bones
    (found,) = [item for item in bpy.data.objects if item.type == "MESH" and not item.name.startswith("Icosphere")]
    return in_world(found)


# --- states ----------------------------------------------------------------------------------------------------------


def plain(bpy, avatar, layer):
    """As it was built."""


def unselectable(bpy, avatar, layer):
    avatar.hide_select = True


def disabled(bpy, avatar, layer):
    avatar.hide_viewport = True


def disabled_then_moved(bpy, avatar, layer):
    avatar.hide_viewport = True
    bpy.context.view_layer.update()
    avatar.location.x = 2.0
    avatar.scale.y = -1.0


def eye(bpy, avatar, layer):
    avatar.hide_set(True)


def not_rendered(bpy, avatar, layer):
    avatar.hide_render = True


def all_hidden(bpy, avatar, layer):
    avatar.hide_select = avatar.hide_render = True
    layer.hide_viewport = True
    layer.collection.hide_viewport = layer.collection.hide_render = layer.collection.hide_select = True


def collection_unselectable(bpy, avatar, layer):
    layer.collection.hide_select = True


def collection_disabled(bpy, avatar, layer):
    layer.collection.hide_viewport = True


def collection_eye(bpy, avatar, layer):
    layer.hide_viewport = True


def collection_not_rendered(bpy, avatar, layer):
    layer.collection.hide_render = True


def collection_indirect(bpy, avatar, layer):
    layer.indirect_only = True
    layer.holdout = True


def deselected(bpy, avatar, layer):
    avatar.select_set(False)


def others_selected(bpy, avatar, layer):
    bpy.ops.mesh.primitive_cube_add(location=(9, 9, 9))
    bpy.ops.object.select_all(action="SELECT")


def moved(bpy, avatar, layer):
    avatar.location, avatar.rotation_euler, avatar.scale = (1, 2, 3), (0.3, 0.2, 0.7), (1.0, 2.0, 0.5)


def mirrored_x(bpy, avatar, layer):
    avatar.scale.x = -1


def mirrored_z(bpy, avatar, layer):
    avatar.scale.z = -1
    avatar.rotation_euler = (0.3, 0.2, 0.7)


def mirrored_twice(bpy, avatar, layer):
    avatar.scale = (-1, -2, 1)


def mirrored_thrice(bpy, avatar, layer):
    avatar.scale = (-1, -2, -0.5)
    avatar.location = (0, 3, 1)


def mirrored_parent(bpy, avatar, layer):
    parent = bpy.data.objects.new("Parent", None)
    layer.collection.objects.link(parent)
    parent.scale, parent.rotation_euler, parent.location = (-1, 1, 1), (0, 0, 0.5), (1, 0, 0)
    avatar.parent = parent


def sheared(bpy, avatar, layer):
    parent = bpy.data.objects.new("Parent", None)
    layer.collection.objects.link(parent)
    parent.scale = (1, 3, 1)
    avatar.parent, avatar.rotation_euler = parent, (0, 0, 0.6)


def sheared_and_mirrored(bpy, avatar, layer):
    sheared(bpy, avatar, layer)
    avatar.parent.scale = (1, -3, 1)


def hidden_parent(bpy, avatar, layer):
    mirrored_parent(bpy, avatar, layer)
    avatar.parent.hide_viewport = True


def constrained(bpy, avatar, layer):
    constraint = avatar.constraints.new("LIMIT_SCALE")
    constraint.use_min_x, constraint.min_x = True, 1.5


def animated(bpy, avatar, layer):
    avatar.keyframe_insert("location", frame=1)
    avatar.location.x = 4.0
    avatar.keyframe_insert("location", frame=11)
    bpy.context.scene.frame_set(6)


def subdivided(bpy, avatar, layer):
    modifier = avatar.modifiers.new("More", "SUBSURF")
    modifier.levels = modifier.render_levels = 1
    modifier.subdivision_type = "SIMPLE"


def mirrored_with_modifiers(bpy, avatar, layer):
    subdivided(bpy, avatar, layer)
    array = avatar.modifiers.new("Row", "ARRAY")
    array.count, array.relative_offset_displace[0] = 2, 2.0
    avatar.scale.x = -1


def shared_mesh(bpy, avatar, layer):
    avatar.scale.x = -1
    layer.collection.objects.link(bpy.data.objects.new("Twin", avatar.data))


def shape_keys(bpy, avatar, layer):
    avatar.shape_key_add(name="Basis")
    avatar.shape_key_add(name="Tall")


def odd_name(bpy, avatar, layer):
    avatar.name = ' /a\\b:*?"<>|%s{0}\n.ü.. '


def name_of_many_bytes(bpy, avatar, layer):
    avatar.name = "人" * 20


def centimetres(bpy, avatar, layer):
    bpy.context.scene.unit_settings.scale_length = 0.01
    avatar.scale = (-100, 100, 100)
    avatar.location = (100, 0, 0)


def in_another_collection_too(bpy, avatar, layer):
    bpy.context.scene.collection.objects.link(avatar)
    layer.exclude = True


STATES = (
    plain, unselectable, disabled, disabled_then_moved, eye, not_rendered, all_hidden, collection_unselectable,
    collection_disabled, collection_eye, collection_not_rendered, collection_indirect, deselected, others_selected,
    moved, mirrored_x, mirrored_z, mirrored_twice, mirrored_thrice, mirrored_parent, sheared, sheared_and_mirrored,
    hidden_parent, constrained, animated, subdivided, mirrored_with_modifiers, shared_mesh, shape_keys, odd_name,
    name_of_many_bytes, centimetres, in_another_collection_too,
)  # fmt: skip


def stand(bpy, wedge):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    collection = bpy.data.collections.new("People")
    bpy.context.scene.collection.children.link(collection)
    avatar = create_avatar(wedge, collection=collection)
    view = bpy.context.view_layer
    view.update()
    view.objects.active = avatar
    avatar.select_set(True)
    return avatar, view.layer_collection.children["People"]


def look(bpy):
    """What a user sees of the file."""
    return (
        {item.name: (tuple(map(tuple, item.matrix_basis)), item.hide_select, item.hide_viewport, item.hide_render,
                     item.data and item.data.name, item.select_get(), item.parent and item.parent.name,
                     [m.name for m in item.modifiers], [c.name for c in item.constraints])
         for item in bpy.context.view_layer.objects},
        bpy.context.scene.name, bpy.context.view_layer.objects.active.name,
        {kind: sorted(block.name for block in getattr(bpy.data, kind))
         for kind in ("objects", "meshes", "materials", "scenes", "collections", "actions")},
    )  # fmt: skip


def truth(bpy, avatar):
    """Vertices in metres as the world shows them, as if nothing hid it, and the volume with faces outwards."""
    size = bpy.context.scene.unit_settings.scale_length
    shown = avatar.copy()
    shown.hide_viewport = False
    bpy.context.scene.collection.objects.link(shown)
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    evaluated = shown.evaluated_get(graph)
    points, triangles = in_world(evaluated)
    bpy.data.objects.remove(shown)
    points = size * points
    return points, abs(volume(points, triangles)), len(triangles)


@pytest.mark.parametrize("ending", IMPORTERS)
def test_it_is_written_whole_whatever_its_state(bpy, wedge, tmp_path, ending):
    for state in STATES:
        avatar, layer = stand(bpy, wedge)
        state(bpy, avatar, layer)
        bpy.context.view_layer.objects.active = avatar
        points, inside, count = truth(bpy, avatar)
        bpy.context.view_layer.update()
        before = look(bpy)
        path = tmp_path / f"{state.__name__}.{ending}"
        assert bpy.ops.mirror_scan.export_avatar(filepath=str(path)) == {"FINISHED"}, state.__name__
        assert look(bpy) == before, state.__name__
        found, triangles = imported(bpy, path)
        assert len(triangles) == count, (state.__name__, len(triangles), count)
        np.testing.assert_allclose(found.min(axis=0), points.min(axis=0), atol=2e-3, err_msg=state.__name__)
        np.testing.assert_allclose(found.max(axis=0), points.max(axis=0), atol=2e-3, err_msg=state.__name__)
        assert volume(found, triangles) == pytest.approx(inside, rel=1e-3), state.__name__
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("ending", IMPORTERS)
@pytest.mark.parametrize("inside", [True, False], ids=["it alone", "another alone"])
def test_it_is_written_from_a_viewport_in_local_view(bpy, wedge, tmp_path, ending, inside):
    avatar, _ = stand(bpy, wedge)
    if not inside:
        bpy.ops.mesh.primitive_cube_add()
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        if not inside:
            avatar.select_set(False)
        bpy.ops.view3d.localview()
        assert area.spaces.active.local_view
        bpy.context.view_layer.objects.active = avatar
        path = tmp_path / f"a.{ending}"
        assert bpy.ops.mirror_scan.export_avatar(filepath=str(path)) == {"FINISHED"}
        assert area.spaces.active.local_view
    found, triangles = imported(bpy, path)
    assert len(triangles) == len(wedge.triangles) and volume(found, triangles) > 0


# --- what cannot be written ------------------------------------------------------------------------------------------


def no_faces(bpy, avatar, layer):
    import bmesh

    shape = bmesh.new()
    shape.from_mesh(avatar.data)
    bmesh.ops.delete(shape, geom=shape.faces[:], context="FACES_ONLY")
    shape.to_mesh(avatar.data)
    shape.free()


def no_vertices(bpy, avatar, layer):
    avatar.data.clear_geometry()


def nothing_left_by_modifiers(bpy, avatar, layer):
    avatar.vertex_groups.new(name="Nobody")
    avatar.modifiers.new("Mask", "MASK").vertex_group = "Nobody"


def nothing_left_of_its_mirror_image(bpy, avatar, layer):
    nothing_left_by_modifiers(bpy, avatar, layer)
    avatar.scale.x = -1


def flat(bpy, avatar, layer):
    avatar.scale.z = 0


def excluded(bpy, avatar, layer):
    layer.exclude = True


def edited(bpy, avatar, layer):
    bpy.ops.object.mode_set(mode="EDIT")


def nowhere(bpy, avatar, layer):
    avatar.location.x = math.nan


@pytest.mark.parametrize("ending", IMPORTERS)
@pytest.mark.parametrize(
    "state",
    [no_faces, no_vertices, nothing_left_by_modifiers, nothing_left_of_its_mirror_image, flat, excluded, edited,
     nowhere],
    ids=lambda state: state.__name__,
)  # fmt: skip
def test_what_cannot_be_written_keeps_the_old_file(bpy, wedge, tmp_path, state, ending):
    avatar, layer = stand(bpy, wedge)
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"a good file")
    state(bpy, avatar, layer)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError) as told:
        bpy.ops.mirror_scan.export_avatar(filepath=str(path))
    assert "Traceback" not in str(told.value) and len(str(told.value).strip().splitlines()) == 1
    assert path.read_bytes() == b"a good file" and [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ["glb", "fbx", "ply", "stl", "obj", "usdc", "abc"])
def test_an_exporter_that_writes_nothing_is_noticed(bpy, wedge, tmp_path, monkeypatch, ending):
    """Blender's own exporters say nothing of it."""
    from mirror_scan.mirror_scan_addon.scene import export

    stand(bpy, wedge)
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"a good file")
    kind = ending.upper()
    write = export._EXPORTERS[kind]

    def of_an_empty_scene(file, copy):
        bpy.context.scene.collection.objects.unlink(copy)
        write(file, copy)

    monkeypatch.setitem(export._EXPORTERS, kind, of_an_empty_scene)
    with pytest.raises(RuntimeError):
        bpy.ops.mirror_scan.export_avatar(filepath=str(path))
    assert path.read_bytes() == b"a good file" and [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_blender_built_without_a_format_says_so(bpy, tmp_path, monkeypatch):
    """As Debian's is without USD."""
    from types import SimpleNamespace

    from mirror_scan.mirror_scan_addon.scene import blender_files

    without = SimpleNamespace(app=SimpleNamespace(build_options=SimpleNamespace(usd=False, alembic=True)))
    monkeypatch.setattr(blender_files, "bpy", without)
    with pytest.raises(blender_files.OutputError, match="built without USD; choose another format"):
        blender_files.check_built_with(tmp_path / "a.usdc")
    blender_files.check_built_with(tmp_path / "a.abc")
    blender_files.check_built_with(tmp_path / "a.glb")


@pytest.mark.parametrize("ending", ["blend", "glb", "ply"])
def test_a_linked_avatar_is_written_not_linked_again(bpy, wedge, tmp_path, ending):
    avatar, _ = stand(bpy, wedge)
    avatar.name = "Far"
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.objects = ["Far"]
    bpy.context.collection.objects.link(bpy.data.objects["Far"])
    bpy.context.view_layer.objects.active = bpy.data.objects["Far"]
    bpy.context.view_layer.update()
    before = look(bpy)
    path = tmp_path / f"a.{ending}"
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(path)) == {"FINISHED"}
    assert look(bpy) == before
    if ending == "blend":
        (tmp_path / "library.blend").unlink()
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        with bpy.data.libraries.load(str(path)) as (there, here):
            here.objects = there.objects
        (found,) = here.objects
        assert found.name == "Far" and len(found.data.polygons) == len(wedge.triangles)
    else:
        found, triangles = imported(bpy, path)
        assert len(triangles) == len(wedge.triangles) and volume(found, triangles) > 0
