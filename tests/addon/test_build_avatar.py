"""The operator and its panel, as scripts and as Blender's interface call them."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")


@pytest.fixture
def steps(addon, monkeypatch, reconstruction):
    """A stand-in for the work, so that these tests are about Blender: what it was asked and what it shall answer."""
    from mirror_scan.mirror_scan_addon import tasks

    calls = []

    def build_steps(*arguments):
        calls.append(arguments)
        yield 0.0, "Reading"
        yield 0.5, "Zippering"
        if isinstance(calls[0], Exception):
            raise calls.pop(0)
        return tasks.Built(reconstruction.mesh, reconstruction.report, (), [])

    monkeypatch.setattr(tasks, "build_steps", build_steps)
    return calls


def test_it_builds_selects_and_remembers(bpy, steps, reconstruction, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = str(tmp_path)
    bpy.context.scene.mirror_scan.frames = 7
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    ((path, frames, mirrors, mirrors_path, settings, cloud, reading),) = steps
    assert (path, frames, mirrors, mirrors_path, cloud) == (str(tmp_path), 7, None, "", None)
    assert reading["turn_degrees"] is None and reading["color"]
    assert settings["depth"]["smoothing"] == 1 and settings["views"]["max_height"] == pytest.approx(2.4)
    avatar = bpy.context.object
    assert avatar.name == avatar.data.name == tmp_path.name and bpy.context.selected_objects == [avatar]
    assert len(avatar.data.vertices) == len(reconstruction.mesh.vertices)
    assert bpy.ops.mirror_scan.build_avatar("INVOKE_DEFAULT") == {"FINISHED"}  # background: runs to its end
    assert bpy.context.selected_objects == list(bpy.data.objects) == [avatar]  # built again: in place of the first
    assert len(bpy.data.materials) == len(bpy.data.meshes) == 1


def test_arguments_win_over_the_scene(bpy, steps, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = "/elsewhere"
    bpy.context.scene.mirror_scan.frames = 7
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path), mirrors_filepath="/m.json", frames=0)
    assert steps[0][:4] == (str(tmp_path), 0, None, "/m.json")


def test_undo_takes_it_back(bpy, steps, tmp_path):
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.ed.undo_push(message="built")
    bpy.ops.ed.undo()
    assert len(bpy.data.objects) == len(bpy.data.meshes) == len(bpy.data.materials) == 0
    bpy.ops.ed.redo()
    assert [item.name for item in bpy.data.objects] == [tmp_path.name]


def test_an_error_is_one_line_and_changes_nothing(bpy, steps, tmp_path):
    from mirror_scan.core.errors import ReconstructionError

    steps.append(ReconstructionError("nobody stands between camera and mirrors"))
    with pytest.raises(RuntimeError, match=r"^Error: nobody stands between camera and mirrors\s*$"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    assert len(bpy.data.objects) == len(bpy.data.meshes) == 0


def test_real_reading_errors_are_reports_too(bpy, tmp_path):
    with pytest.raises(RuntimeError, match=r"^Error: .*there is no such file"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path / "missing"))
    with pytest.raises(RuntimeError, match=r"^Error: .*is not a capture"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))


def test_without_a_capture_it_says_where_to_choose_one(bpy):
    with pytest.raises(RuntimeError, match="Error: No capture is loaded"):
        bpy.ops.mirror_scan.build_avatar()


def test_wrong_states_are_refused_with_a_reason(bpy, steps, tmp_path):
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(bpy.data.objects) == 1


def test_a_linked_scene_is_refused(bpy, steps, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.context.scene.name = "Linked"
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (there, here):
        here.scenes = there.scenes
    bpy.context.window.scene = bpy.data.scenes["Linked"]
    with pytest.raises(RuntimeError, match="linked from another file"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))


def test_an_excluded_collection_does_not_hide_the_avatar(bpy, steps, tmp_path):
    inner = bpy.data.collections.new("Inner")
    bpy.context.scene.collection.children.link(inner)
    layer = bpy.context.view_layer.layer_collection.children["Inner"]
    bpy.context.view_layer.active_layer_collection = layer
    layer.exclude = True
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    assert bpy.context.object.name == tmp_path.name and bpy.context.object.visible_get()


def test_state_survives_saving(bpy, steps, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = "//capture"
    with pytest.raises(RuntimeError, match="save it first"):
        bpy.ops.mirror_scan.build_avatar()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.mirror_scan.build_avatar()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    assert bpy.context.scene.mirror_scan.capture_path == "//capture"
    steps.clear()
    bpy.ops.mirror_scan.build_avatar()
    assert steps[0][0] == str(tmp_path / "capture")  # "//" is the .blend's folder
