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

KNOWN = (
    ("capture", "/scans/memory/mirror: there is no such file or folder", "gone", "choose"),
    ("capture", "//x: is relative to the .blend file, which is not saved yet; save it first", "unsaved", "save"),
    ("capture", "The Python package numba cannot be imported (no module)", "program", None),
    ("capture", "Not enough memory; close other programs or use fewer frames", "memory", "frames"),
    ("capture", "/a/scan.mkv: has no calibration attached; give the intrinsics", "lens missing", "lens"),
    ("capture", "/a/d.png: the intrinsics of these 800×600 pixels are unknown; give them", "lens missing", "lens"),
    ("capture", "/a/1.png: is 640×480 pixels, but intrinsic.json says 480×640: width and height are exchanged, or the "
     "picture was rotated; give the intrinsics of the picture as it is", "rotation", "turn"),
    ("capture", "/a/intrinsic.json: focal lengths must be positive, got fx=0, fy=1; enter your camera's", "lens wrong",
     "lens"),
    ("capture", "no depth reading between 0.3 and 8 m in any of 3 frames; check that the depth images are 16-bit "
     "millimetres and the camera was not covered", "unit", "unit"),
    ("capture", "/a: colour is 64×48 pixels, but depth has 640×480; their alignment is unknown; align colour to depth "
     "when recording, or leave colour out", "colour", "no color"),
    ("capture", "/a/scan.bag: holds no depth frame; record with the depth stream on", "empty", "choose"),
    ("capture", "/a/scan.oni: is truncated; copy or record it again", "damaged", "choose"),
    ("capture", "/a/x.txt: is not a capture; give a folder", "not a capture", "choose"),
    ("capture", "/a/1.png: is an 8-bit picture; depth must have 16 bits. Record the depth stream itself",
     "not a capture", "choose"),
    ("capture", "No capture is chosen; choose its folder or file", "not loaded", "choose"),
    ("capture", "/a/mirrors.json: two mirrors are named “left”; give each its own name", "mirror file", "again"),
    ("capture", "scan: no mirror was found: none is given", "no mirror", "pick"),
    ("capture", "left: the 3 frame points lie on one line; pick points on two of its sides", "mirror", "remove"),
    ("capture", "left: lies on the floor", "mirror lies", "find"),
    ("capture", "nobody stands between the camera and the mirrors: no connected figure is seen directly", "nobody",
     "click person"),
    ("capture", "the subject would be 17.0 m tall or more, too tall for a person: check the depth unit (--depth-unit)",
     "size", "unit"),
    ("capture", "the subject's readings are too noisy to connect; use a longer burst", "noise", "frames"),
    ("capture", "The process that does the work was ended (code -9)", "memory", "again"),
    ("mirrors", "/a/rig.json: is not a rig file; make one with “mirror-scan calibrate”", "rig file", "choose rig"),
    ("motion", "/a/walk.bvh: is no BVH file (it does not begin with HIERARCHY)", "motion", "other file"),
    ("motion", "walk: this skeleton's names are not known; not found: Hips", "motion", "other file"),
    ("avatar", "Avatar is scaled unevenly; apply its scale first (Ctrl A)", "scaled", "apply scale"),
    ("avatar", "skeleton: the mesh has not the shape of a whole person", "no person", "build"),
    ("output", "/a: cannot be written: Permission denied; choose another folder", "writing", "other file"),
)  # fmt: skip


@pytest.mark.parametrize("topic, text, name, cure", KNOWN, ids=[case[2] for case in KNOWN])
def test_every_kind_of_error_is_known_and_its_cure_can_be_drawn(addon, topic, text, name, cure):
    from mirror_scan.mirror_scan_addon.interface.panel_errors import CURES
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    kind = kept_errors.kind_of(text, OPERATORS[topic])
    if name == "memory" and "process" in text:
        assert kind.cures == ("frames", "again")
        return
    assert kind.name == name and (cure in kind.cures if cure else not kind.cures)
    assert set(kind.cures) <= set(CURES)


def test_no_error_is_without_a_kind_and_names_no_option_of_the_command_line(addon):
    from mirror_scan.mirror_scan_addon.language.texts import without_options
    from mirror_scan.mirror_scan_addon.scene import kept_errors

    assert len(kept_errors.KINDS) >= 20 and len({kind.name for kind in kept_errors.KINDS}) == len(kept_errors.KINDS)
    for text in ("a (--depth-unit) b", "a (option “mirrors”) b", "a (--object; in Blender “Any Object”) b"):
        assert without_options(text) == "a b"
    assert without_options("a recording (.mkv, .bag; see docs/formats.md)") == "a recording (.mkv, .bag)"
    for operator in OPERATORS.values():  # what nobody thought of has a way on as well
        assert kept_errors.kind_of("something else", operator).cures


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
    assert found.kind.name == "no mirror" and "Click the frame of each mirror" in found.text
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
    assert fails(bpy, "load_capture", filepath=str(bare)) == "lens missing"
    bpy.context.scene.mirror_scan.reading.lens = "azure_kinect"
    again(bpy)
    assert bpy.context.scene.mirror_scan.cloud is not None


def test_a_lens_of_another_size_is_replaced(bpy, bare):
    lens = json.loads((bare / "intrinsic.json").read_text())
    (bare / "intrinsic.json").write_text(json.dumps(lens | {"width": 320, "height": 288}))
    assert fails(bpy, "load_capture", filepath=str(bare)) == "lens wrong"
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
    assert fails(bpy, "load_capture", filepath=str(tmp_path / "empty")) == "not a capture"
    depth = sorted((bare / "depth").iterdir())[0]
    depth.write_bytes(depth.read_bytes()[:500])
    assert fails(bpy, "load_capture", filepath=str(bare)) == "damaged"
    (bare / "mirrors.json").write_text("{")
    assert fails(bpy, "load_capture", filepath=str(bare)) in ("mirror file", "damaged")
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
    assert fails(bpy, "load_capture", filepath=str(bare)) == "colour"
    bpy.context.scene.mirror_scan.reading.color = False
    again(bpy)


def test_other_files_and_folders_are_asked_for(bpy, loaded, tmp_path):
    (tmp_path / "rig.json").write_text("{}")
    assert fails(bpy, "use_rig", filepath=str(tmp_path / "rig.json")) == "rig file"
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
