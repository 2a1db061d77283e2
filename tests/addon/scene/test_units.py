"""A scene whose unit is not the metre: everything has its true size, and shows it as Blender shows sizes."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("bpy")

SCALES = (0.01, 0.3048, 1000.0)  # centimetres, feet, kilometres


def set_units(bpy, scale, system="METRIC"):
    bpy.context.scene.unit_settings.system = system
    bpy.context.scene.unit_settings.scale_length = scale


def in_metres(item, scale):
    """World coordinates (N, 3) [m] of an object's vertices."""
    points = np.empty((len(item.data.vertices), 3), np.float32)
    item.data.vertices.foreach_get("co", points.ravel())
    matrix = np.array(item.matrix_world)
    return scale * (points @ matrix[:3, :3].T + matrix[:3, 3])


@pytest.mark.parametrize("scale", SCALES)
def test_the_points_and_the_avatar_have_their_true_size(bpy, scan, scale):
    folder, height = scan
    bpy.ops.mirror_scan.load_capture(filepath=str(folder))
    settings = bpy.context.scene.mirror_scan
    true = in_metres(settings.cloud, 1.0)
    placed = [(mirror.name, mirror.residual_mm) for mirror in settings.mirrors]
    marks = true[:: len(true) // 5]
    set_units(bpy, scale)
    bpy.ops.mirror_scan.load_capture(filepath=str(folder))
    bpy.context.view_layer.update()
    np.testing.assert_allclose(in_metres(settings.cloud, scale), true, atol=1e-4)
    assert [(mirror.name, mirror.residual_mm) for mirror in settings.mirrors] == placed
    # places in the world are in Blender units for scripts too
    from mirror_scan.mirror_scan_addon.operators.mirrors import _pixels_of
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    arrays = point_cloud.read_cloud(settings.cloud)
    pixels = _pixels_of(marks / scale, point_cloud.camera_to_world(settings.cloud), arrays.intrinsics)
    found = np.rint(pixels).astype(int) @ (1, arrays.intrinsics.width)
    assert (found == arrays.pixel[:: len(true) // 5]).all()
    if scale == SCALES[0]:
        bpy.ops.mirror_scan.build_avatar()
        avatar = bpy.context.object
        assert scale * avatar.dimensions.z == pytest.approx(height, abs=0.03)
        assert tuple(avatar.scale) == (1, 1, 1)
        person = in_metres(avatar, scale)
        seen = in_metres(settings.cloud, scale)
        inside = ((seen > person.min(axis=0)) & (seen < person.max(axis=0))).all(axis=1)
        assert inside.sum() > 5000  # the points that it was made of are where it is


def test_settings_are_kept_in_metres_and_shown_in_the_units_of_the_scene(bpy):
    from mirror_scan.mirror_scan_addon.scene.scan_records import build_settings

    settings = bpy.context.scene.mirror_scan
    before = build_settings(settings)
    set_units(bpy, 0.01)
    assert build_settings(settings) == before
    assert settings.subject.max_height == pytest.approx(240) and settings.subject.reach == pytest.approx(115)
    settings.subject.depth_limit, settings.quality.glass_offset, settings.subject.reach = 300.0, 1.2, 0.0
    settings.quality.glass_thickness = 0.6
    now = build_settings(settings)
    assert now["mirror"]["glass_thickness"] == pytest.approx(0.006)
    assert now["views"]["depth_limit"] == pytest.approx(3) and now["mirror"]["glass_offset"] == pytest.approx(0.012)
    assert now["views"]["reach"] == pytest.approx(0.2)  # the least that makes sense
    set_units(bpy, 0.01, "NONE")  # without a unit system Blender leaves the scale aside
    assert settings.subject.depth_limit == pytest.approx(3)


@pytest.mark.parametrize("scale", SCALES)
def test_a_rig_stands_and_sees_as_one_in_metres_does(bpy, scale):
    from mirror_scan.mirror_scan_addon.scene import virtual_rig

    def arranged(unit):
        bpy.context.view_layer.update()
        scene = bpy.context.scene
        intrinsics = scene.camera.data
        mirrors = [
            {name: value for name, value in mirror.items() if name != "name"}
            for mirror in virtual_rig.mirrors_of(scene)
        ]
        return [virtual_rig.camera_of(scene.camera, unit), *mirrors, {"angle": intrinsics.angle}]

    bpy.ops.mirror_scan.add_rig()
    wanted = arranged(1.0)
    camera = bpy.context.scene.camera.location.copy()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    set_units(bpy, scale)
    bpy.ops.mirror_scan.add_rig()
    for mine, true in zip(arranged(scale), wanted, strict=True):
        assert mine.keys() == true.keys()
        for name, value in true.items():
            np.testing.assert_allclose(mine[name], value, rtol=1e-4, atol=1e-5, err_msg=name)
    np.testing.assert_allclose(scale * np.array(bpy.context.scene.camera.location), camera, rtol=1e-4, atol=1e-5)
    bpy.ops.mirror_scan.add_rig(distance=3.0 / scale)  # a script's lengths are Blender units
    assert math.hypot(*bpy.context.scene.camera.location[:2]) * scale == pytest.approx(3, rel=0.01)
    bpy.ops.mesh.primitive_plane_add(size=1 / scale)
    bpy.context.object.mirror_scan.is_mirror = True
    assert bpy.context.object.mirror_scan.frame_width * scale == pytest.approx(0.035)


def test_a_body_is_scanned_in_its_true_size(bpy, capsule_10k):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    said = []
    for scale in (1.0, 0.01):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        set_units(bpy, scale)
        body = create_avatar(capsule_10k, name="Body", collection=bpy.context.collection, unit=scale)
        assert body.dimensions.z * scale == pytest.approx(1.7, abs=1e-3)
        bpy.ops.mirror_scan.add_rig()
        select_only(bpy.context, body)
        assert bpy.ops.mirror_scan.simulate(frames=1, sensor="ideal") == {"FINISHED"}
        settings = bpy.context.scene.mirror_scan
        bpy.context.view_layer.update()
        seen = in_metres(settings.cloud, scale)
        said.append((settings.rig_message, len(seen), seen.min(axis=0), seen.max(axis=0)))
    assert said[0][0] == said[1][0] and said[1][1] == pytest.approx(said[0][1], rel=1e-3)
    for one, other in zip(said[0][2:], said[1][2:], strict=True):
        np.testing.assert_allclose(other, one, atol=1e-3)


@pytest.mark.parametrize("size", (1.0, 2.0))
def test_a_problem_has_its_true_size_and_place(bpy, capsule_10k, size):
    from dataclasses import replace

    import mathutils
    from mirror_scan.mirror_scan_addon.scene import report_text
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    centre = capsule_10k.vertices[capsule_10k.triangles].mean(axis=1)
    hole = np.linalg.norm(centre - (0, 0, 1.7), axis=1) < 0.06
    torn = replace(
        capsule_10k, triangles=capsule_10k.triangles[~hole], kind=np.zeros(int((~hole).sum()), np.int8), view=None
    )
    set_units(bpy, 0.01)
    avatar = create_avatar(torn, collection=bpy.context.collection, unit=0.01)
    avatar.scale = (size,) * 3
    avatar.location = (50, 0, 0)
    select_only(bpy.context, avatar)
    bpy.ops.mirror_scan.check()
    report = report_text.avatar_report(avatar)
    assert report["mesh"]["height_m"] == pytest.approx(1.7 * size, abs=1e-3)
    place = report_text.problems_of(report)[0]
    assert place["kind"] == "hole" and 0.12 < place["size"] / size < 0.2
    world = 0.01 * np.array(avatar.matrix_world @ mathutils.Vector(place["point"]))
    np.testing.assert_allclose(world, np.array((0, 0, 1.7)) * size + (0.5, 0, 0), atol=0.03 * size)
    bpy.ops.mirror_scan.jump_to_problem()
    scene = bpy.context.scene
    centimetres = report_text.problem_text(place, scene)
    assert "cm across" in centimetres
    scene.unit_settings.system = "IMPERIAL"
    assert '" across' in report_text.problem_text(place, scene)
    lines = dict(line[:2] for line in report_text.summary(report, scene))
    assert lines["Height"] == ("5' 7\"" if size == 1 else "11' 2\"")
    scene.unit_settings.length_unit = "INCHES"
    assert dict(line[:2] for line in report_text.summary(report, scene))["Height"] == f"{1.7 * size / 0.0254:.1f} in"


IMPORTERS = {
    "GLB": "import_scene.gltf", "FBX": "import_scene.fbx", "OBJ": "wm.obj_import", "PLY": "wm.ply_import",
    "STL": "wm.stl_import", "USDC": "wm.usd_import", "ABC": "wm.alembic_import",
}  # fmt: skip


@pytest.mark.parametrize("kind", IMPORTERS)
def test_files_are_in_metres(bpy, capsule, tmp_path, kind):
    import addon_utils
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    set_units(bpy, 0.01)
    avatar = create_avatar(capsule, collection=bpy.context.collection, unit=0.01)
    avatar.location, avatar.rotation_euler = (100, 0, 0), (0, 0, 0.3)
    select_only(bpy.context, avatar)
    bpy.context.view_layer.update()
    before = avatar.matrix_world.copy()
    path = str(tmp_path / f"avatar.{kind.lower()}")
    assert bpy.ops.mirror_scan.export_avatar(filepath=path) == {"FINISHED"}
    assert avatar.matrix_world == before and tuple(avatar.scale) == (1, 1, 1)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    if kind in ("GLB", "FBX"):
        addon_utils.enable({"GLB": "io_scene_gltf2", "FBX": "io_scene_fbx"}[kind])
    module, name = IMPORTERS[kind].split(".")
    options = {} if kind in ("GLB", "FBX", "USDC", "ABC") else {"forward_axis": "Y", "up_axis": "Z"}
    if kind == "OBJ":
        options = {}
    if kind == "STL":
        options["global_scale"] = 0.001  # it is in millimetres, for slicers
    getattr(getattr(bpy.ops, module), name)(filepath=path, **options)
    bpy.context.view_layer.update()
    found = in_metres(next(item for item in bpy.data.objects if item.type == "MESH"), 1.0)
    turn = np.array([[math.cos(0.3), -math.sin(0.3), 0], [math.sin(0.3), math.cos(0.3), 0], [0, 0, 1]])
    wanted = capsule.vertices @ turn.T + (1, 0, 0)
    np.testing.assert_allclose(found.min(axis=0), wanted.min(axis=0), atol=1e-3)
    np.testing.assert_allclose(found.max(axis=0), wanted.max(axis=0), atol=1e-3)


def test_what_constraints_hold_is_written_in_metres_too(bpy, capsule, tmp_path):
    from mirror_scan.core.io import read_mesh
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    set_units(bpy, 0.01)
    avatar = create_avatar(capsule, collection=bpy.context.collection, unit=0.01)
    avatar.constraints.new("LIMIT_SCALE").use_min_z = True
    avatar.constraints[0].min_z = 2.0
    select_only(bpy.context, avatar)
    bpy.context.view_layer.update()
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path / "a.ply")) == {"FINISHED"}
    assert np.ptp(read_mesh(tmp_path / "a.ply").vertices, axis=0).max() == pytest.approx(3.4, abs=1e-3)
    assert tuple(avatar.scale) == (1, 1, 1)


def test_a_linked_avatar_is_written_in_metres_too(bpy, capsule, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    create_avatar(capsule, name="Far", collection=bpy.context.collection, unit=0.01)
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    set_units(bpy, 0.01)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.objects = ["Far"]
    avatar = bpy.data.objects["Far"]
    bpy.context.collection.objects.link(avatar)
    select_only(bpy.context, avatar)
    path = str(tmp_path / "far.ply")
    assert bpy.ops.mirror_scan.export_avatar(filepath=path) == {"FINISHED"} and tuple(avatar.scale) == (1, 1, 1)
    bpy.ops.wm.ply_import(filepath=path, forward_axis="Y", up_axis="Z")
    assert bpy.context.object.dimensions.z == pytest.approx(1.7, abs=1e-3)
