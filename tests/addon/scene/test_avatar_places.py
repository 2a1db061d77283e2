"""Each scan has its collections and its names; an avatar built again replaces the one before, the next person stands
beside it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture
def build(bpy, monkeypatch, reconstruction, tmp_path):
    """Builds the avatar of a capture of that name, as tall as is said, without the work of a reconstruction."""
    from mirror_scan.mirror_scan_addon import tasks

    mesh = reconstruction.mesh
    tall = {}

    def build_steps(path, *arguments):
        yield 0.0, "Reading"
        vertices = mesh.vertices * (1, 1, tall[path] / 1.7)
        report = reconstruction.report | {"camera_to_avatar": np.eye(4).tolist()}
        return tasks.Built(replace(mesh, vertices=vertices), report, (), [])

    monkeypatch.setattr(tasks, "build_steps", build_steps)

    def built(name, height=1.7, folder=tmp_path, **options):
        path = folder / name
        path.mkdir(exist_ok=True, parents=True)
        tall[str(path)] = height
        assert bpy.ops.mirror_scan.build_avatar(filepath=str(path), **options) == {"FINISHED"}
        bpy.context.view_layer.update()
        return bpy.context.object

    return built


def tree(bpy):
    """The scene's collections as nested dicts, objects as lists of names."""

    def inside(collection):
        names = sorted(item.name for item in collection.objects)
        return {child.name: inside(child) for child in collection.children} | ({"": names} if names else {})

    return inside(bpy.context.scene.collection)


def bounds(item):
    points = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])
    return points.min(axis=0), points.max(axis=0)


def test_two_people_rebuilt_twice_named_apart_undone_reloaded(bpy, build, tmp_path):
    wanted = {
        "Mirror Scan": {
            "anna": {"anna Avatar": {"": ["anna"]}}, "ben": {"ben Avatar": {"": ["ben"]}},
        }
    }  # fmt: skip
    bpy.ops.ed.undo_push(message="start")
    for height in (1.6, 1.65, 1.7):  # built, and rebuilt twice
        for name in ("anna", "ben"):
            avatar = build(name, height)
            assert avatar.name == avatar.data.name == avatar.active_material.name == name
            assert avatar.dimensions.z == pytest.approx(height, abs=1e-4)
            bpy.ops.ed.undo_push(message="built")
    assert tree(bpy) == wanted
    assert len(bpy.data.meshes) == len(bpy.data.materials) == 2
    anna, ben = bpy.data.objects["anna"], bpy.data.objects["ben"]
    assert tuple(anna.location) == (0, 0, 0)
    assert bounds(ben)[0][0] - bounds(anna)[1][0] == pytest.approx(0.3, abs=1e-3)
    assert bounds(ben)[0][2] == pytest.approx(0, abs=1e-6) and ben.location.y == 0
    bpy.ops.ed.undo()
    assert tree(bpy) == wanted and bpy.data.objects["ben"].dimensions.z == pytest.approx(1.65, abs=1e-4)
    bpy.ops.ed.undo()
    assert bpy.data.objects["anna"].dimensions.z == pytest.approx(1.65, abs=1e-4)
    for _ in range(4):
        bpy.ops.ed.undo()
    assert tree(bpy) == {} and not bpy.data.objects
    for _ in range(6):
        bpy.ops.ed.redo()
    assert tree(bpy) == wanted
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "two.blend"))
    assert tree(bpy) == wanted
    place = bpy.data.objects["ben"].location.copy()
    avatar = build("ben", 1.8)
    assert tree(bpy) == wanted and avatar.name == "ben" and avatar.location == place
    assert build("carla").location.x > avatar.location.x + 0.3


def test_what_a_user_named_moved_and_made_stays(bpy, build, tmp_path):
    avatar = build("anna")
    avatar.name, avatar.location, avatar.rotation_euler.z = "Doctor", (1, 2, 0), 0.5
    avatar.active_material.name, avatar.active_material.roughness = "Skin", 0.123
    hat = bpy.data.objects.new("Hat", None)
    bpy.context.scene.collection.objects.link(hat)
    hat.parent = avatar
    collection = bpy.data.collections["anna"]
    collection.name = "Patients"
    avatar.modifiers.new("More", "SUBSURF")
    bpy.ops.mirror_scan.color_by(mode="VIEW")
    again = build("anna", 1.5)
    assert again == avatar and again.name == "Doctor" and tuple(again.location) == (1, 2, 0)
    assert again.active_material.name == "Skin" and hat.parent == again and again.modifiers.keys() == ["More"]
    assert again.data.color_attributes.keys() == ["Color"]
    other = build("anna", folder=tmp_path / "elsewhere")  # another capture of the same name
    assert other not in (avatar, None) and {"Patients", "anna"} <= set(tree(bpy)["Mirror Scan"])
    assert other.active_material != again.active_material


def test_an_earlier_version_is_kept_when_it_is_asked_for(bpy, build):
    first = build("anna", 1.6)
    first.location.y = 3.0
    second = build("anna", 1.7, keep_version=True)
    assert second != first and (first.name, second.name) == ("anna Version 1", "anna")
    assert second.location.y == 3.0 and not first.visible_get() and second.visible_get()
    bpy.context.scene.mirror_scan.keep_versions = True
    third = build("anna", 1.8)
    versions = bpy.data.collections["anna Versions"]
    assert sorted(versions.objects.keys()) == ["anna Version 1", "anna Version 2"] and versions.hide_render
    assert third.dimensions.z == pytest.approx(1.8, abs=1e-4)
    build("anna", 1.9, keep_version=False)
    assert len(versions.objects) == 2 and third.dimensions.z == pytest.approx(1.9, abs=1e-4)


@pytest.fixture(scope="module")
def person():
    """A mannequin with skeleton and weights."""
    from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
    from mirror_scan.core.avatar.skin_weights import skinned_mesh
    from mirror_scan.core.simulation.mannequin import mannequin

    mesh = mannequin()
    skeleton = find_skeleton(mesh)
    return *skinned_mesh(mesh, skeleton), skeleton


def rig(bpy, avatar, person):
    from mirror_scan.mirror_scan_addon.operators.skeleton import _own_collection
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects

    mesh, weights, skeleton = person
    avatar_objects.refine(avatar, mesh, 1.0)
    return armature.add_armature(avatar, skeleton, weights, _own_collection(avatar, bpy.context.scene))


def test_a_skeleton_stands_in_the_collection_of_the_rig_and_goes_with_its_avatar(bpy, build, person):
    from mirror_scan.core.mesh import Texture
    from mirror_scan.mirror_scan_addon.scene.avatar_texture import set_texture

    avatar = build("anna")
    avatar.location = (0, 4, 0)
    bones = rig(bpy, avatar, person)
    assert bones.name == bones.data.name == "anna Skeleton"
    assert tree(bpy)["Mirror Scan"]["anna"] == {"anna Avatar": {"": ["anna"]}, "anna Rig": {"": ["anna Skeleton"]}}
    count = len(avatar.data.polygons)
    set_texture(avatar, Texture(np.zeros((count, 3, 2), np.float32), np.zeros((8, 8, 3), np.uint8),
                                np.zeros(count, np.int32)))  # fmt: skip
    hat = bpy.data.objects.new("Hat", None)
    bpy.context.scene.collection.objects.link(hat)
    hat.parent, hat.parent_type, hat.parent_bone = bones, "BONE", "mixamorig:Head"
    bpy.context.view_layer.update()
    stood = hat.matrix_world.translation.copy()
    again = build("anna", 1.5)
    assert again == avatar and again.parent is None and tuple(again.location) == (0, 4, 0)
    assert not bpy.data.armatures and not again.vertex_groups and not again.modifiers and not bpy.data.images
    assert tree(bpy)["Mirror Scan"]["anna"] == {"anna Avatar": {"": ["anna"]}}
    assert again.active_material.name == "anna" and len(bpy.data.materials) == 1
    assert hat.parent == again and (hat.matrix_world.translation - stood).length < 1e-5


def test_collections_that_are_hidden_or_excluded_show_what_is_made(bpy, build, person):
    def layer_of(collection, layer=None):
        layer = layer or bpy.context.view_layer.layer_collection
        if layer.collection == collection:
            return layer
        return next(filter(None, (layer_of(collection, child) for child in layer.children)), None)

    avatar = build("anna")
    empty = bpy.data.objects.new("Keeps it", None)
    rig(bpy, avatar, person)
    home = bpy.data.collections["anna Rig"]
    home.objects.link(empty)
    avatar = build("anna")
    layer_of(home).exclude = True
    assert rig(bpy, avatar, person).name in bpy.context.view_layer.objects
    build("anna")
    home.hide_viewport = layer_of(home).hide_viewport = True
    assert rig(bpy, avatar, person).visible_get()
    layer_of(bpy.data.collections["Mirror Scan"]).exclude = True
    assert build("ben").visible_get()


def test_a_version_keeps_its_skeleton(bpy, build, person):
    avatar = build("anna")
    bones = rig(bpy, avatar, person)
    second = build("anna", 1.5, keep_version=True)
    assert avatar.parent == bones and (avatar.name, bones.name) == ("anna Version 1", "anna Version 1 Skeleton")
    assert second.parent is None and second.name == "anna"
    assert sorted(bpy.data.collections["anna Versions"].objects.keys()) == ["anna Version 1", "anna Version 1 Skeleton"]


def rig_bounds(cloud):
    """Least and largest coordinates of a capture's points, but for the room's walls."""
    points = np.empty((len(cloud.data.vertices), 3), np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", points.ravel())
    matrix = np.array(cloud.matrix_world)
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    points = points[np.abs(points - np.median(points, axis=0)).max(axis=1) < 2]
    return points.min(axis=0), points.max(axis=0)


def test_points_stand_beside_others_and_on_their_own_avatar_in_the_scan(bpy, scan):
    """The real way: load, find the person, build, and once more, with another avatar at the origin."""
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar
    from mirror_scan.mirror_scan_addon.scene.report_text import avatar_report

    other = create_avatar(_box(), "Other", bpy.context.scene.collection, report={})
    for written in (str(scan[0]), f"{scan[0]}/", str(scan[0] / "intrinsic.json")):  # the same capture each time
        bpy.ops.mirror_scan.load_capture(filepath=written)
        assert tree(bpy)["Mirror Scan"] == {"capture": {"capture Points": {"": ["capture Points"]}}}
    settings = bpy.context.scene.mirror_scan
    assert rig_bounds(settings.cloud)[0][0] > bounds(other)[1][0] + 0.29
    before, avatar = np.array(settings.cloud.matrix_world), None
    assert bpy.ops.mirror_scan.find_subject() == {"FINISHED"}
    assert np.abs(np.array(settings.cloud.matrix_world) - before).max() < 0.3
    for number in range(2):
        if number:  # its points come back where it stands, even if it was moved
            avatar.location, avatar.rotation_euler.z = (1, 5, 0), 0.4
            bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
            stands = np.array(settings.cloud.matrix_world)
            assert bpy.ops.mirror_scan.find_subject() == {"FINISHED"}
            np.testing.assert_array_equal(np.array(settings.cloud.matrix_world), stands)
            expected = np.array(avatar.matrix_world) @ np.array(avatar_report(avatar)["camera_to_avatar"])
            np.testing.assert_allclose(stands, expected, atol=1e-5)
        assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
        bpy.context.view_layer.update()
        avatar = bpy.context.object
        assert tree(bpy)["Mirror Scan"]["capture"] == {
            "capture Points": {"": ["capture Points"]}, "capture Avatar": {"": ["capture"]},
        }  # fmt: skip
        assert number or bounds(avatar)[0][0] > bounds(other)[1][0] + 0.29
        cloud = bpy.context.scene.mirror_scan.cloud
        expected = np.array(avatar.matrix_world) @ np.array(avatar_report(avatar)["camera_to_avatar"])
        np.testing.assert_allclose(np.array(cloud.matrix_world), expected, atol=1e-5)
    material = avatar.active_material
    assert bpy.ops.mirror_scan.texture(size="1024") == {"FINISHED"} and avatar.active_material != material


def _box():
    from mirror_scan.core.mesh import Mesh

    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.3, 0.3) for z in (0, 1.8)], float)
    triangles = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6),
                 (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    return Mesh(corners, np.array(triangles, np.int32))


def test_the_next_person_stands_beside_avatars_of_other_files_too(bpy, build, tmp_path):
    build("anna")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, here):
        here.objects = ["anna"]
    far = bpy.data.objects["anna"]
    bpy.context.scene.collection.objects.link(far)
    for name in ("anna", "ben"):  # the linked one cannot be built again, and stays
        made = build(name)
        assert made != far and bounds(made)[0][0] > bounds(far)[1][0] + 0.29


# --- files of older versions -----------------------------------------------------------------------------------------


def old_avatar(bpy, capsule, path, name="Avatar"):
    """As version 0.5 left one: in the scene's own collection, with what it was built from."""
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only
    from mirror_scan.mirror_scan_addon.scene.scan_records import SOURCE

    avatar = create_avatar(capsule, name, bpy.context.scene.collection, report={"mesh": {"height_m": 1.7}})
    if path is not None:
        avatar[SOURCE] = json.dumps({"path": str(path), "frames": 0, "reading": {}, "mirrors": []})
    select_only(bpy.context, avatar)
    return avatar


def test_a_file_of_version_0_5_is_built_again_and_exported(bpy, build, capsule, tmp_path):
    old_avatar(bpy, capsule, tmp_path / "anna")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path / "a.glb")) == {"FINISHED"}
    again = build("anna", 1.5)
    assert [item.name for item in bpy.data.objects] == ["Avatar"] and again.dimensions.z == pytest.approx(1.5, abs=1e-4)
    assert tree(bpy) == {"": ["Avatar"]}  # where it stood, and no empty collection
    assert build("ben").location.x > 0.5


def test_an_avatar_of_version_0_4_does_not_know_its_capture_and_stays(bpy, build, capsule):
    old = old_avatar(bpy, capsule, None)
    made = build("anna")
    assert made != old and old.name == "Avatar" and bounds(made)[0][0] > bounds(old)[1][0]
