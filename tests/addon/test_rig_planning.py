"""A rig that is planned in Blender: what it brings, what it tells, the search, the plan, and undo."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def small_mannequin():
    """The mannequin of the session, made once and coarsely."""
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.mirror_scan_addon.scene import live_rig

    live_rig.keep_mannequin(mannequin(resolution=0.02))
    yield
    live_rig._mannequin.clear()


def settings_of(bpy):
    return bpy.context.scene.mirror_scan


def tagged(bpy, what: str) -> list:
    return [item for item in bpy.context.scene.objects if item.get("mirror_scan_rig") == what]


def test_a_rig_brings_its_person_and_takes_neither_cube_nor_camera(bpy):
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.object.camera_add(location=(5, 5, 5))
    mine = bpy.context.scene.camera = bpy.context.object
    bpy.context.view_layer.objects.active = cube
    assert bpy.ops.mirror_scan.add_rig() == {"FINISHED"}
    settings = settings_of(bpy)
    assert bpy.context.scene.camera == mine and settings.rig_camera != mine
    assert [settings.rig_person] == tagged(bpy, "person") and len(tagged(bpy, "frame")) == 2
    assert 1.6 < settings.rig_person.dimensions.z < 1.8
    # the cube is active, and it is not a person: the mannequin is scanned, by the rig's camera
    assert bpy.ops.mirror_scan.simulate(frames=1, sensor="ideal") == {"FINISHED"}
    assert not cube.data.color_attributes and settings.rig_person.data.color_attributes.active_color.name == "Coverage"
    assert 80 < float(settings.rig_message.split("sees ")[1].split("%")[0]) < 99


def test_a_person_who_is_there_is_what_the_rig_looks_at(bpy):
    bpy.ops.mesh.primitive_cylinder_add(radius=0.25, depth=1.8, location=(0, 0, 0.9))
    person = bpy.context.object
    bpy.ops.mirror_scan.add_rig()
    assert settings_of(bpy).rig_person == person and not tagged(bpy, "person")


def test_a_rig_stands_round_a_person_wherever_they_stand_and_however_they_were_imported(bpy, tmp_path):
    from mirror_scan.mirror_scan_addon.interface.rig_overlay import rig_lines
    from mirror_scan.mirror_scan_addon.scene import live_rig

    bpy.context.scene.unit_settings.scale_length = 0.01
    bpy.ops.mesh.primitive_cylinder_add(radius=25, depth=180, location=(300, 200, 90), rotation=(np.pi / 2, 0, 0))
    person = bpy.context.object
    bpy.ops.object.transform_apply(location=False, rotation=True, scale=False)
    person.rotation_euler.x = np.pi / 2  # upright again, in axes of its own
    assert bpy.ops.mirror_scan.add_rig() == {"FINISHED"}
    settings, scene = settings_of(bpy), bpy.context.scene
    assert settings.rig_person == person and not tagged(bpy, "person")
    assert tuple(settings.rig_camera.location.xy) == pytest.approx((300, -50), abs=1e-3)
    bpy.ops.mirror_scan.check_rig()
    assert live_rig.checked(scene)["seen"] > 0.8
    bpy.ops.mirror_scan.save_plan(filepath=str(tmp_path / "plan.svg"))
    assert rig_lines(scene)[1][0][1] == "2.50 m" and ">2.50 m<" in (tmp_path / "plan.svg").read_text(encoding="utf-8")
    bpy.data.objects.remove(person)
    bpy.ops.mirror_scan.add_rig()
    assert 160 < settings.rig_person.dimensions.z < 180  # the mannequin has the size of a person in any unit


def test_an_earlier_rig_makes_way_for_the_next_but_nothing_of_the_users(bpy):
    from mirror_scan.mirror_scan_addon.scene import virtual_rig

    bpy.ops.mirror_scan.add_rig()
    scene, camera = bpy.context.scene, settings_of(bpy).rig_camera
    (home,) = camera.users_collection
    bpy.ops.mesh.primitive_plane_add()
    mine = bpy.context.object
    mine.mirror_scan.is_mirror = True
    left = next(item for item in scene.objects if item.name == "Mirror left")
    for item in (camera, left):  # where the user has them
        home.objects.unlink(item)
        mine.users_collection[0].objects.link(item)
    for item in (camera, *home.objects):
        if item.name in ("Depth Camera", "Mirror right"):
            del item["mirror_scan_rig"]  # as a rig of 0.7.0
    home.objects.link(camera)
    virtual_rig.remove_rig(scene)
    assert list(scene.objects) == [mine] and home not in list(bpy.data.collections)


def test_a_virtual_scan_is_made_with_the_sensor_and_the_mirrors_of_the_rig(bpy):
    from mirror_scan.core.simulation.sensors import find_sensor
    from mirror_scan.mirror_scan_addon.scene.point_cloud import read_cloud

    bpy.ops.mirror_scan.add_rig(sensor="realsense_d455", mirrors=0)
    settings = settings_of(bpy)
    assert bpy.ops.mirror_scan.simulate(frames=1) == {"FINISHED"}
    assert len(settings.mirrors) == 0
    assert read_cloud(settings.cloud).intrinsics.width == find_sensor("realsense_d455").intrinsics.width
    wide = settings.rig_camera.data.angle
    settings.rig_sensor = "kinect_v1"
    assert settings.rig_camera.data.angle < wide - 0.05


def test_head_hands_and_feet_are_ticked_and_what_to_move_is_told(bpy):
    from mirror_scan.mirror_scan_addon.interface.rig_overlay import _mirrors, rig_lines
    from mirror_scan.mirror_scan_addon.scene import live_rig

    with pytest.raises(RuntimeError, match="no planned rig"):
        bpy.ops.mirror_scan.check_rig()
    bpy.ops.mirror_scan.add_rig()
    bpy.context.view_layer.update()
    scene = bpy.context.scene
    assert bpy.ops.mirror_scan.check_rig() == {"FINISHED"}
    good = live_rig.checked(scene)
    assert 0.85 < good["seen"] < 1 and all(view[part] for view in good["views"] for part in ("head", "hands", "feet"))
    assert not any(view["advice"] for view in good["views"])
    number, image = live_rig.picture(scene)
    assert image.shape == (144, 160, 3) and image.std() > 20
    left = next(item for item in scene.objects if item.name == "Mirror left")
    left.location.z += 0.7
    bpy.context.view_layer.update()
    bpy.ops.mirror_scan.check_rig()
    bad = live_rig.checked(scene)
    view = next(view for view in bad["views"] if view["name"] == "left")
    assert not view["feet"] and view["head"] and view["advice"].startswith("left mirror: the feet are cut off; move it")
    assert bad["seen"] < good["seen"] and live_rig.picture(scene)[0] == number + 1
    lines, labels = rig_lines(scene)
    assert len(lines) == 5 and len(labels) == 7
    assert labels[0][1] == "2.50 m" and lines[0][0].z == 0
    assert rig_lines(scene, _mirrors(bpy.context))[1] == labels and rig_lines(scene, ("gone",))[1] == labels[:1]
    settings_of(bpy).rig_checked = "spoiled"
    assert live_rig.checked(scene) is None


def test_only_what_concerns_the_rig_has_it_checked_again(bpy):
    from mirror_scan.mirror_scan_addon.scene import live_rig

    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.mirror_scan.add_rig()
    settings, found = settings_of(bpy), []

    def heard(scene, depsgraph):
        found.extend(live_rig._concerns(update, settings) for update in depsgraph.updates)

    def checked_after(change) -> bool:
        bpy.context.view_layer.update()
        found.clear()
        change()
        bpy.context.view_layer.update()
        return any(found)

    left, right = (item for item in bpy.context.scene.objects if item.mirror_scan.is_mirror)
    bpy.app.handlers.depsgraph_update_post.append(heard)
    try:
        assert not checked_after(lambda: setattr(cube, "location", (1, 1, 1)))
        assert not checked_after(lambda: cube.select_set(False))
        for item in (settings.rig_camera, settings.rig_person, left):
            assert checked_after(lambda item=item: setattr(item, "location", item.location * 1.1 + item.location))
        assert checked_after(lambda: setattr(right, "hide_render", True))
        assert checked_after(lambda: bpy.data.objects.remove(left))
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(heard)


def test_what_a_live_check_fails_by_is_told(bpy, monkeypatch):
    from types import SimpleNamespace

    from mirror_scan.core.errors import MirrorScanError
    from mirror_scan.mirror_scan_addon.background import job_operators
    from mirror_scan.mirror_scan_addon.scene import live_rig

    bpy.ops.mirror_scan.add_rig()
    scene, begun = bpy.context.scene, []

    def begin(task, thread=False):
        begun.append((task.name, thread))
        error = MirrorScanError("the disk is full") if thread else job_operators.UNAVAILABLE("no Python")
        return SimpleNamespace(is_alive=lambda: False, error=error, result=None, progress=(0.0, "Starting"))

    monkeypatch.setattr(job_operators, "begin", begin)
    live_rig._wanted.add(scene.session_uid)
    while live_rig._turn() is not None:
        assert len(begun) < 3
    assert begun == [("check_rig_steps", False), ("check_rig_steps", True)] and live_rig.stage(scene) == ""
    assert "the disk is full" in live_rig.checked(scene)["problem"]


def test_mirrors_have_a_frame_that_follows_their_settings(bpy):
    bpy.ops.mirror_scan.add_rig(person=False)
    glass = next(item for item in bpy.context.scene.objects if item.mirror_scan.is_mirror)
    (frame,) = glass.children
    assert frame.hide_select and not frame.mirror_scan.is_mirror
    assert frame.dimensions.x == pytest.approx(0.87, abs=1e-4)
    glass.mirror_scan.frame_width = 0.1
    bpy.context.view_layer.update()
    assert frame.dimensions.x == pytest.approx(1.0, abs=1e-4)
    color = glass.data.materials[0].diffuse_color
    assert color[2] > color[0] + 0.2 and glass.data.materials[0].metallic == 1.0  # bluish where nothing is reflected
    assert frame.data.materials[0].diffuse_color[0] < 0.3


def test_a_rig_is_put_where_the_search_says_and_its_plan_is_written(bpy, tmp_path, monkeypatch):
    from dataclasses import replace

    from mirror_scan.core.rig_planning import placement_search
    from mirror_scan.core.rig_planning.area_coverage import area_coverage, body_samples
    from mirror_scan.core.rig_planning.placement_search import Placement
    from mirror_scan.core.rig_planning.predicted_error import predicted_error
    from mirror_scan.core.simulation.scene import default_rig

    asked = []

    def found(room, sensor, mirrors, body, settings):  # the search itself has its own tests
        yield 0.5, "Trying placements"
        asked.append((room, sensor, mirrors))
        rig = replace(default_rig(sensor, subject_distance=2.3), room=(-1.5, 1.5, -2.6, 1.4, 2.4))
        covered = area_coverage(body_samples(body, 256), rig)
        return Placement(rig, room, False, covered, predicted_error(body_samples(body, 256), covered, rig), False, 1)

    monkeypatch.setattr(placement_search, "placement_steps", found)
    bpy.ops.mirror_scan.add_rig()
    before = {item.name for item in bpy.context.scene.objects}
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    assert bpy.ops.mirror_scan.find_rig(preset="BEDROOM", sensor="realsense_d455", glass="GYM") == {"FINISHED"}
    room, sensor, mirrors = asked[0]
    assert (room.width, room.depth, sensor, mirrors) == (3.2, 4.0, "realsense_d455", [(1.2, 2.0)] * 2)
    settings, scene = settings_of(bpy), bpy.context.scene
    assert cube.name in scene.objects and len(scene.objects) == len(before) + 2  # the cube, and the room
    assert settings.rig_camera.location.y == pytest.approx(-2.3) and settings.rig_sensor == "realsense_d455"
    (walls,) = tagged(bpy, "room")
    assert walls.dimensions.y == pytest.approx(4.0) and walls.hide_select and "predicted" in settings.rig_message
    path = tmp_path / "plan"
    assert bpy.ops.mirror_scan.save_plan(filepath=str(path)) == {"FINISHED"}
    texts = [element.text for element in ET.parse(tmp_path / "plan.svg").getroot().iter() if element.text]
    assert "2.30 m" in texts and any("3 × 4 × 2.4 m" in text for text in texts)


def test_a_room_too_small_is_told_and_changes_nothing(bpy):
    bpy.ops.mirror_scan.add_rig()
    before = {item.name for item in bpy.context.scene.objects}
    with pytest.raises(RuntimeError, match="too small") as raised:
        bpy.ops.mirror_scan.find_rig(preset="CUSTOM", room_width=1.5, room_depth=1.8)
    assert "wider" in str(raised.value) or "deeper" in str(raised.value)
    assert {item.name for item in bpy.context.scene.objects} == before


def test_checks_survive_saving(bpy, tmp_path):
    bpy.ops.mirror_scan.add_rig()
    bpy.context.view_layer.update()
    bpy.ops.mirror_scan.check_rig()
    kept = json.loads(settings_of(bpy).rig_checked)
    path = str(tmp_path / "rig.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    settings = settings_of(bpy)
    assert json.loads(settings.rig_checked) == kept and settings.rig_camera.type == "CAMERA"
    assert np.isclose(settings.rig_person.dimensions.z, 1.7, atol=0.05)


def test_a_rig_is_undone_as_a_whole(bpy):
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.mirror_scan.add_rig()
    bpy.ops.ed.undo_push(message="rig")
    assert len(bpy.context.scene.objects) == 6
    bpy.ops.ed.undo()
    assert not bpy.context.scene.objects and settings_of(bpy).rig_camera is None
    bpy.ops.ed.redo()
    assert len(bpy.context.scene.objects) == 6 and settings_of(bpy).rig_camera.type == "CAMERA"


def test_a_rig_whose_camera_was_deleted_is_none(bpy):
    from mirror_scan.mirror_scan_addon.interface.rig_overlay import rig_lines

    bpy.ops.mirror_scan.add_rig()
    for collection in settings_of(bpy).rig_camera.users_collection:  # as Delete does: the scene's memory keeps it
        collection.objects.unlink(settings_of(bpy).rig_camera)
    assert rig_lines(bpy.context.scene) == ([], []) and not bpy.ops.mirror_scan.check_rig.poll()
