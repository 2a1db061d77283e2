"""One press from a capture to the avatar; and what goes wrong on the way, which stays in the panel with its cure."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

pytest.importorskip("bpy")


OPERATORS = {
    "capture": "mirror_scan.scan_to_avatar", "mirrors": "mirror_scan.use_rig", "motion": "mirror_scan.apply_motion",
    "avatar": "mirror_scan.add_skeleton", "output": "mirror_scan.export_avatar",
}  # fmt: skip


def test_every_kind_of_error_has_cures_that_can_be_drawn(addon):
    from mirror_scan.core.errors import CODES
    from mirror_scan.mirror_scan_addon.interface.panel_errors import CURES
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    assert set(kept_errors.KINDS) == CODES - {"other"} and set(kept_errors.WORDS) <= CODES
    assert {kind.name for kind in kept_errors.KINDS.values() if not kind.cures} == {"program"}
    for kind in kept_errors.KINDS.values():
        assert set(kind.cures) <= set(CURES)
        fitting = [operator for operator in OPERATORS.values() if kept_errors.kind_of(kind.name, operator) == kind]
        assert fitting, kind.name  # some operator may fail by it


def test_the_code_of_an_error_comes_through_the_second_process_and_an_older_version_had_none(bpy):
    """It is known by neither its words nor its language."""
    from mirror_scan.core.errors import CaptureError
    from mirror_scan.mirror_scan_addon.background import second_process
    from mirror_scan.mirror_scan_addon.background.worker import _tell_error
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    told = []
    _tell_error(lambda **message: told.append(message), CaptureError("{name}: quod erat", name="a/unit", code="unit"))
    errand = second_process.Errand(print, ())
    errand._worker = type("Worker", (), {"ready": False, "close": lambda self: None})()
    errand._hear(json.loads(json.dumps(told[0])))
    assert type(errand.error) is CaptureError and errand.error.code == "unit"
    operator = type("Operator", (), {"bl_idname": OPERATORS["capture"]})()
    kept_errors.keep(bpy.context, operator, errand.error)
    assert kept_errors.kept(bpy.context).kind.name == "unit"
    shown = bpy.context.window_manager.mirror_scan
    old = json.loads(shown.error)
    del old["code"]
    shown.error = json.dumps(old)
    assert kept_errors.kept(bpy.context).kind.cures == ("choose", "again")
    kept_errors.keep(bpy.context, operator, MemoryError())
    assert kept_errors.kept(bpy.context).kind.name == "memory"
    kept_errors.keep(bpy.context, operator, FileNotFoundError(2, "No such file", "/a"))
    assert kept_errors.kept(bpy.context).kind.name == "gone"
    kept_errors.forget(bpy.context)


def test_no_error_is_without_a_kind_and_names_no_option_of_the_command_line(addon):
    from mirror_scan.mirror_scan_addon.language.texts import without_options
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    for text in ("a (--depth-unit) b", "a (option “mirrors”) b", "a (--object; in Blender “Any Object”) b"):
        assert without_options(text) == "a b"
    assert without_options("a recording (.mkv, .bag; see docs/formats.md)") == "a recording (.mkv, .bag)"
    for operator in OPERATORS.values():  # what nobody thought of has a way on as well
        assert kept_errors.kind_of("other", operator).cures


@pytest.fixture
def bare(scan, tmp_path):
    """The capture without a word about its mirrors."""
    folder = tmp_path / "bare"
    shutil.copytree(scan[0], folder)
    (folder / "mirrors.json").unlink()
    return folder


def test_one_press_makes_the_avatar_of_a_capture(bpy, bare, scan):
    assert bpy.ops.mirror_scan.scan_to_avatar(filepath=str(bare / "intrinsic.json")) == {"FINISHED"}
    settings = bpy.context.scene.mirror_scan
    assert settings.capture_path == str(bare) and len(settings.cloud.data.vertices) > 10_000
    assert len(settings.mirrors) == 2 and all(mirror.source == "found" for mirror in settings.mirrors)
    avatar = bpy.context.object
    report = json.loads(avatar["mirror_scan_report"])
    assert report["mesh"]["watertight"] and abs(report["mesh"]["height_m"] - scan[1]) < 0.03
    assert not settings.show_cloud and bpy.context.window_manager.mirror_scan.error == ""
    # the points lie on the avatar
    matrix = np.array(settings.cloud.matrix_world)
    assert np.allclose(matrix, np.array(report["camera_to_avatar"]) @ np.eye(4), atol=1e-5)


def test_it_is_the_avatar_that_loading_and_building_make(bpy, scan):
    assert bpy.ops.mirror_scan.scan_to_avatar(filepath=str(scan[0])) == {"FINISHED"}
    one = np.array([v.co for v in bpy.context.object.data.vertices])
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
    bpy.ops.mirror_scan.build_avatar()
    assert np.array_equal(one, np.array([v.co for v in bpy.context.object.data.vertices]))


def test_without_mirrors_the_points_stay_and_the_panel_offers_to_click(bpy, bare, scan):
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    depth = sorted((bare / "depth").iterdir())
    from mirror_scan.core.io.images import read_image, write_png

    for path in depth:  # nothing but the person's surroundings at one distance: no frame anywhere
        image = read_image(path)
        write_png(path, np.full_like(image, 3000))
    with pytest.raises(RuntimeError, match="o mirror was found"):
        bpy.ops.mirror_scan.scan_to_avatar(filepath=str(bare))
    settings = bpy.context.scene.mirror_scan
    assert settings.cloud is not None and not settings.mirrors
    found = kept_errors.kept(bpy.context)
    assert found.kind.name == "no_mirror" and "Click the frame of each mirror" in found.text
    assert found.kind.cures[0] == "pick" and found.operator == "mirror_scan.scan_to_avatar"
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
    assert kept_errors.kept(bpy.context) is None


def fails(bpy, name: str, **options) -> str:
    """The kind of the error that an operator fails by, as the panel keeps it; its cures are drawn."""
    from mirror_scan.mirror_scan_addon.interface import panel_errors
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    with pytest.raises(RuntimeError):
        getattr(bpy.ops.mirror_scan, name)(**options)
    found = kept_errors.kept(bpy.context)
    assert found.operator == f"mirror_scan.{name}" and found.text and "--" not in found.text
    drawn = Recorder(bpy)
    panel_errors.error_box(drawn, bpy.context)
    assert "mirror_scan.dismiss_error" in drawn.said and " ".join(drawn.labels) == found.text
    return found.kind.name


class Recorder:
    """A layout that keeps the operators and settings that are drawn into it, and sets their options as Blender does."""

    def __init__(self, bpy, said=None, labels=None):
        self.__dict__.update(bpy=bpy, said=[] if said is None else said, labels=[] if labels is None else labels)

    def __getattr__(self, name):
        return lambda *arguments, **options: Recorder(self.bpy, self.said, self.labels)

    def __setattr__(self, name, value):
        pass

    def label(self, text="", **options):
        self.labels.append(text)

    def prop(self, owner, name, **options):
        self.said.append(name)

    def operator(self, name, **options):
        self.said.append(name)
        submodule, _, operator = name.partition(".")
        known = getattr(getattr(self.bpy.ops, submodule), operator).get_rna_type().properties

        class Options:
            def __setattr__(self, key, value):
                assert key in known, f"{name} has no {key}"

        return Options()


def again(bpy) -> None:
    """*Try Again* works, and the error is gone."""
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    found = kept_errors.kept(bpy.context)
    operator = getattr(bpy.ops.mirror_scan, found.operator.partition(".")[2])
    assert operator(**found.options) == {"FINISHED"}
    assert kept_errors.kept(bpy.context) is None


def test_a_missing_lens_is_chosen(bpy, bare):
    (bare / "intrinsic.json").unlink()
    assert fails(bpy, "load_capture", filepath=str(bare)) == "lens_missing"
    bpy.context.scene.mirror_scan.reading.lens = "azure_kinect"
    again(bpy)
    assert bpy.context.scene.mirror_scan.cloud is not None


def test_a_lens_of_another_size_is_replaced(bpy, bare):
    lens = json.loads((bare / "intrinsic.json").read_text())
    (bare / "intrinsic.json").write_text(json.dumps(lens | {"width": 320, "height": 288}))
    assert fails(bpy, "load_capture", filepath=str(bare)) == "lens_wrong"
    bpy.context.scene.mirror_scan.reading.lens = "azure_kinect"
    again(bpy)


def test_a_wrong_unit_is_set_right(bpy, scan):
    reading = bpy.context.scene.mirror_scan.reading
    reading.depth_unit_mm = 0.01
    assert fails(bpy, "scan_to_avatar", filepath=str(scan[0])) in ("unit", "size", "nobody")
    reading.depth_unit_mm = 1.0
    again(bpy)


def test_files_that_are_none_ask_for_another(bpy, bare, tmp_path, scan):
    assert fails(bpy, "load_capture", filepath=str(tmp_path / "nowhere")) == "gone"
    (tmp_path / "empty").mkdir()
    assert fails(bpy, "load_capture", filepath=str(tmp_path / "empty")) == "not_a_capture"
    depth = sorted((bare / "depth").iterdir())[0]
    depth.write_bytes(depth.read_bytes()[:500])
    assert fails(bpy, "load_capture", filepath=str(bare)) == "damaged"
    (bare / "mirrors.json").write_text("{")
    depth.unlink()
    assert fails(bpy, "load_capture", filepath=str(bare)) == "mirror_file"
    bpy.context.scene.mirror_scan.reading.own_mirrors = False
    again(bpy)
    assert fails(bpy, "load_capture", filepath="//capture") == "unsaved"
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
    assert bpy.context.window_manager.mirror_scan.error == ""


def test_a_mirror_that_is_not_placed_is_removed_or_found(bpy, loaded):
    mirror = bpy.context.scene.mirror_scan.mirrors[0]
    mirror.plane, mirror.message = "", f"{mirror.name}: the 3 frame points lie on one line; pick more"
    assert fails(bpy, "build_avatar") == "mirror"
    before = bpy.context.window_manager.mirror_scan.error
    assert bpy.ops.mirror_scan.remove_mirror(index=0) == {"FINISHED"}
    assert bpy.context.window_manager.mirror_scan.error == "" and len(bpy.context.scene.mirror_scan.mirrors) == 1
    bpy.context.window_manager.mirror_scan.error = before
    assert bpy.ops.mirror_scan.find_mirrors() == {"FINISHED"}
    assert bpy.context.window_manager.mirror_scan.error == ""  # its cause is gone
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}


def test_a_person_out_of_reach_is_looked_for_again(bpy, loaded):
    subject = bpy.context.scene.mirror_scan.subject
    subject.depth_limit_m = 1.0
    assert fails(bpy, "build_avatar") == "nobody"
    subject.depth_limit_m = 0.0
    again(bpy)


def test_colour_that_does_not_fit_is_left_out(bpy, bare):
    from mirror_scan.core.io.images import write_png

    for path in (bare / "color").iterdir():
        path.unlink()
    write_png(bare / "color" / "000000.png", np.zeros((50, 90, 3), np.uint8))
    assert fails(bpy, "load_capture", filepath=str(bare)) == "color"
    bpy.context.scene.mirror_scan.reading.color = False
    again(bpy)


def test_other_files_and_folders_are_asked_for(bpy, loaded, tmp_path):
    (tmp_path / "rig.json").write_text("{}")
    assert fails(bpy, "use_rig", filepath=str(tmp_path / "rig.json")) == "rig_file"
    assert bpy.ops.mirror_scan.dismiss_error() == {"FINISHED"}
    assert bpy.context.window_manager.mirror_scan.error == ""


def test_an_error_belongs_to_its_scene_and_session(bpy, tmp_path):
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    fails(bpy, "load_capture", filepath=str(tmp_path / "nowhere"))
    here = bpy.context.window.scene
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    assert kept_errors.kept(bpy.context) is None
    bpy.context.window.scene = here
    assert kept_errors.kept(bpy.context) is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert kept_errors.kept(bpy.context) is None


def test_what_stands_where_the_person_stands_is_hidden_and_shown_again(bpy, loaded, monkeypatch):
    from mirror_scan.mirror_scan_addon.operators import build_avatar
    from mirror_scan.mirror_scan_addon.scene import room

    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=8)
    floor = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(location=(5, 5, 5))
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    avatar, scene, layer = bpy.context.object, bpy.context.scene, bpy.context.view_layer
    layer.update()
    assert room.in_the_way(scene, layer, avatar) == [cube]
    assert bpy.ops.mirror_scan.make_room() == {"FINISHED"}
    assert cube.hide_get() and not floor.hide_get() and not room.in_the_way(scene, layer, avatar)
    assert room.hidden(scene) == [cube]
    assert bpy.ops.mirror_scan.make_room(show=True) == {"FINISHED"}
    assert not cube.hide_get() and not room.hidden(scene)
    settings = scene.mirror_scan
    assert bpy.ops.mirror_scan.show_setup(show=False) == {"FINISHED"} and not room.setup_shown(scene)
    assert bpy.ops.mirror_scan.show_setup() == {"FINISHED"} and settings.show_cloud and settings.show_mirrors
    told = []
    build_avatar._make_room(type("Operator", (), {"report": lambda self, kind, text: told.append(text)})(),
                            bpy.context, avatar)  # fmt: skip
    assert cube.hide_get() and not room.setup_shown(scene) and told[0].endswith(": 1")


def test_a_click_belongs_to_the_mirror_on_whose_frame_it_is(bpy, loaded):
    from mirror_scan.mirror_scan_addon.operators.pick_mirror_points import on_frame
    from mirror_scan.mirror_scan_addon.scene.point_cloud import read_cloud

    settings, arrays = bpy.context.scene.mirror_scan, read_cloud(bpy.context.scene.mirror_scan.cloud)
    width = arrays.intrinsics.width
    for mirror in settings.mirrors:
        for pick in mirror.picks:
            here = np.hypot(arrays.pixel % width - pick.pixel[0], arrays.pixel // width - pick.pixel[1])
            point = arrays.points[np.argmin(here)]
            assert [other == mirror for other in settings.mirrors] == [on_frame(m, point) for m in settings.mirrors]
    middle = np.median(arrays.points, axis=0)
    assert not any(on_frame(mirror, middle) for mirror in settings.mirrors)
