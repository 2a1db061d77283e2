"""Every operator in every state it was not made for: a line for the user, never a traceback, and nothing changed."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("bpy")

OPERATORS = {
    "load_capture": {},
    "import_sequence": {"filepath": "/proc/sequence"},
    "scan_to_avatar": {},
    "drop_avatar": {},
    "drop_look": {},
    "make_room": {},
    "show_setup": {},
    "finish_picking": {},
    "stop_getting_ready": {},
    "cancel_job": {},
    "dismiss_error": {},
    "set_depth_unit": {},
    "record": {"filepath": "/proc/recording"},
    "find_mirrors": {},
    "select_mirror": {},
    "set_mirror": {"points": "[[100, 100], [200, 100], [100, 200]]"},
    "pick_mirror_points": {},
    "save_mirrors": {"filepath": "/proc/mirrors.json"},
    "calibrate_rig": {"filepath": "/proc/rig.json"},
    "use_rig": {"filepath": "/proc/rig.json"},
    "find_subject": {},
    "pick_subject": {"pixel": (-3, 7)},
    "build_avatar": {},
    "check": {},
    "jump_to_problem": {},
    "color_by": {"mode": "KIND"},
    "add_skeleton": {},
    "apply_motion": {"clip": "idle"},
    "follow_stream": {"seconds": 0.01},
    "use_controls": {},
    "rest_in_t_pose": {},
    "texture": {"size": "1024"},
    "measure": {},
    "save_measurements": {"filepath": "/proc/sizes.csv"},
    "reduce": {"triangles": 200},
    "dress": {"kind": "skirt"},
    "prepare_for_cloth": {},
    "mark_as_asset": {},
    "export_avatar": {"filepath": "/proc/avatar.glb"},
    "simulate": {"frames": 1, "filepath": "/proc/scan"},
    "live_view": {"source": "playback", "filepath": "/nowhere/recording"},
    "check_rig": {},
    "save_plan": {"filepath": "/proc/plan.svg"},
    "find_rig": {"preset": "CUSTOM", "room_width": 1.0, "room_depth": 1.0},
    "report_problem": {},
    "clear_compiled_code": {},
    # last, since these may well be possible
    "remove_mirror": {},
    "clear_mirrors": {},
    "add_rig": {},
    "add_studio": {},
    "remove_studio": {},
}


def empty(bpy, capsule, tmp_path):
    """Nothing at all: no capture, no object."""


def edit_mode(bpy, capsule, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")


def not_a_mesh(bpy, capsule, tmp_path):
    bpy.ops.object.empty_add()


def no_faces(bpy, capsule, tmp_path):
    item = bpy.data.objects.new("Points", bpy.data.meshes.new("Points"))
    bpy.context.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item


def foreign_mesh(bpy, capsule, tmp_path):
    bpy.ops.mesh.primitive_cube_add()


def linked_object(bpy, capsule, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    create_avatar(capsule, name="Far", collection=bpy.context.collection, report={"problems": []})
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.objects = ["Far"]
    bpy.context.collection.objects.link(bpy.data.objects["Far"])
    bpy.context.view_layer.objects.active = bpy.data.objects["Far"]


def linked_scene(bpy, capsule, tmp_path):
    bpy.context.scene.name = "Linked"
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.scenes = ["Linked"]
    bpy.context.window.scene = bpy.data.scenes["Linked"]


def gone_capture(bpy, capsule, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = str(tmp_path / "gone")


def unsaved_relative(bpy, capsule, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = "//capture"


def spoiled_cloud(bpy, capsule, tmp_path):
    """An object that says it is a cloud, but whose data somebody spoiled."""
    mesh = bpy.data.meshes.new("Spoiled")
    mesh.from_pydata([(0, 0, 1), (0, 0, 2)], [], [])
    item = bpy.data.objects.new("Spoiled", mesh)
    item["mirror_scan_capture"] = '{"name": "x", "format": "y"}'
    bpy.context.collection.objects.link(item)
    bpy.context.scene.mirror_scan.cloud = item
    bpy.context.scene.mirror_scan.mirrors.add()


def removed_cloud(bpy, capsule, tmp_path):
    spoiled_cloud(bpy, capsule, tmp_path)
    bpy.context.collection.objects.unlink(bpy.data.objects["Spoiled"])


def spoiled_mirror(bpy, capsule, tmp_path):
    spoiled_cloud(bpy, capsule, tmp_path)
    item = bpy.context.scene.mirror_scan.mirrors[0]
    item.plane = '{"point": 1, "normal": "x", "basis": []}'


def points_nowhere(bpy, capsule, tmp_path):
    """A cloud whose points somebody moved behind the camera, or to no number."""
    spoiled_cloud(bpy, capsule, tmp_path)
    item = bpy.data.objects["Spoiled"]
    intrinsics = {"width": 4, "height": 4, "fx": 4.0, "fy": 4.0, "cx": 2.0, "cy": 2.0}
    item["mirror_scan_capture"] = json.dumps({"name": "x", "format": "y", "intrinsics": intrinsics})
    item.data.attributes.new("pixel", "INT", "POINT").data.foreach_set("value", [3, 5])
    item.data.vertices.foreach_set("co", [0, 0, -1, 0, 0, float("nan")])


def other_kinds(bpy, capsule, tmp_path):
    """A cloud whose attributes somebody replaced by others of the same names."""
    points_nowhere(bpy, capsule, tmp_path)
    data = bpy.data.objects["Spoiled"].data
    data.vertices.foreach_set("co", [0, 0, 1, 0, 0, 2])
    data.attributes.remove(data.attributes["pixel"])
    for name, kind in (("pixel", "BYTE_COLOR"), ("Color", "STRING"), ("seen", "FLOAT_COLOR"), ("height", "INT")):
        data.attributes.new(name, kind, "POINT")
    bpy.context.view_layer.objects.active = bpy.data.objects["Spoiled"]


def no_cloud_at_all(bpy, capsule, tmp_path):
    """A script set what is none: it is not to be removed by the next capture either."""
    curve = bpy.data.objects.new("Curve", bpy.data.curves.new("Curve", "CURVE"))
    bpy.context.collection.objects.link(curve)
    bpy.context.scene.mirror_scan.cloud = curve


def nowhere(bpy, capsule, tmp_path):
    """A mesh with a vertex at no place."""
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.vertices[0].co = (float("nan"), 0, 0)
    bpy.ops.mirror_scan.add_rig()


def spoiled_report(bpy, capsule, tmp_path):
    """An avatar whose report somebody edited."""
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    place = {"kind": "hole", "point": 1, "normal": "x", "size": [], "area": 0, "count": 0}
    report = {"mesh": 1, "mirrors": [2, {"residual_mm": "x"}], "seams": 3, "timings_ms": {"total": "x"}, "warnings": 4,
              "problems": [5, place]}  # fmt: skip
    avatar = create_avatar(capsule, name="Spoiled", collection=bpy.context.collection, report=report)
    bpy.context.view_layer.objects.active = avatar
    from mirror_scan.mirror_scan_addon.scene import report_text

    kept = report_text.avatar_report(avatar)
    scene = bpy.context.scene
    assert (
        not report_text.summary(kept, scene) and not report_text.distances(kept) and not report_text.problems_of(kept)
    )


def camera_of_no_size(bpy, capsule, tmp_path):
    bpy.ops.mirror_scan.add_rig()
    bpy.context.scene.camera.scale = (0, 0, 0)
    bpy.context.view_layer.update()


STATES = (empty, edit_mode, not_a_mesh, no_faces, foreign_mesh, linked_object, linked_scene, gone_capture,
          unsaved_relative, spoiled_cloud, removed_cloud, spoiled_mirror, points_nowhere, spoiled_report,
          camera_of_no_size, other_kinds, no_cloud_at_all, nowhere)  # fmt: skip


@pytest.mark.parametrize("state", STATES, ids=lambda state: state.__name__)
def test_a_wrong_state_is_answered_in_words(bpy, capsule, tmp_path, capfd, state):
    state(bpy, capsule, tmp_path)
    for name, options in OPERATORS.items():
        before = {kind: len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "images", "materials")}
        try:
            done = getattr(bpy.ops.mirror_scan, name)(**options)
        except RuntimeError as error:
            text = str(error)
            assert "Traceback" not in text and "Error: Python" not in text, (name, text)
            assert "poll() failed" not in text, f"{name}: poll says no without a reason"
            after = {kind: len(getattr(bpy.data, kind)) for kind in before}
            assert after == before, (name, before, after)
        else:
            assert done in ({"FINISHED"}, {"CANCELLED"}), name
        said = capfd.readouterr()
        assert "Traceback" not in said.out + said.err, name


def test_every_poll_answers_with_a_bool(bpy):
    for name in OPERATORS:
        assert getattr(bpy.ops.mirror_scan, name).poll() in (True, False)


def test_every_operator_is_listed_here(bpy):
    elsewhere = {"add_quality_preset", "help", "sample_capture"}  # Blender's; opens a browser; takes its time
    assert set(dir(bpy.ops.mirror_scan)) - elsewhere == set(OPERATORS)


def test_what_is_no_cloud_survives_the_next_capture(bpy, capsule, tmp_path):
    no_cloud_at_all(bpy, capsule, tmp_path)
    bpy.ops.mirror_scan.simulate(frames=1, sensor="ideal")
    assert bpy.data.objects["Curve"].data and bpy.context.scene.mirror_scan.cloud.name != "Curve"


def test_names_of_mirrors_are_their_own(bpy):
    mirrors = bpy.context.scene.mirror_scan.mirrors
    for name in ("left", "left", "  ", "", "ü" * 100, "ü" * 100, "{0}"):
        mirrors.add().name = name
    assert [item.name for item in mirrors] == [
        "left", "left 2", "mirror", "mirror 2", "ü" * 100, "ü" * 100 + " 2", "{0}"
    ]  # fmt: skip
