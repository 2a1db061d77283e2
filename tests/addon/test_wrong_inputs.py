"""Wrong files and wrong states, each answered by one line that says what is wrong and what to do; the cure works.

``test_wrong_states.py`` tries every operator in every odd state; here each case has its own operator, its own words,
and where something can be pressed or set against it, that is done and the operator works. Nothing is lost on the way.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from wrong_files import FILES, Bench, Wrong, instead, nothing, use

pytest.importorskip("bpy")


def export(path: str) -> Callable[[Bench], object]:
    return lambda b: b.ops.export_avatar(filepath=path.format(folder=b.folder))


def edit_mode(b: Bench) -> None:
    b.avatar()
    b.bpy.ops.object.mode_set(mode="EDIT")


def object_mode(b: Bench) -> None:
    b.bpy.ops.object.mode_set(mode="OBJECT")


def local(b: Bench) -> None:
    b.bpy.ops.object.make_local(type="SELECT_OBDATA")


def no_person(b: Bench) -> None:
    b.load(b.depth(lambda d: np.full_like(d, 2500)))


def without_mirrors(b: Bench) -> None:
    b.loaded()
    b.ops.clear_mirrors()


def loaded(b: Bench) -> None:
    b.loaded()


def find_mirrors(b: Bench):
    return b.ops.find_mirrors()


def find_subject(b: Bench):
    return b.ops.find_subject()


def unlink_points(b: Bench) -> None:
    b.loaded()
    for collection in b.scene.cloud.users_collection:
        collection.objects.unlink(b.scene.cloud)


def use_rig(b: Bench):
    return b.ops.use_rig(filepath=str(b.folder / "rig.json"))


def built_elsewhere(b: Bench) -> None:
    """An avatar whose capture was moved away, and which no points are kept of."""
    from mirror_scan.mirror_scan_addon.scene.capture_source import keep_source

    body = b.avatar(camera_to_avatar=np.eye(4).tolist())
    keep_source(body, "/nowhere/capture", 0, {}, [])


def camera_removed(b: Bench) -> None:
    b.ops.add_rig()
    b.bpy.data.objects.remove(b.bpy.context.scene.camera)


def camera_added(b: Bench) -> None:
    b.bpy.ops.object.camera_add(location=(0, -2.5, 0.9), rotation=(np.pi / 2, 0, 0))
    b.bpy.context.scene.camera = b.bpy.context.object


def state(make: Callable[[Bench], object], operator: str, words: str, *cure, title: str, **options) -> Wrong:
    """An operator that is pressed in a wrong state, with what cures it."""
    return Wrong(title, make, lambda b: getattr(b.ops, operator)(**options), words, *cure)


def cube(b: Bench) -> None:
    b.cube()


def avatar(b: Bench) -> None:
    b.avatar()


FULL = "belongs to another capture; choose an empty folder"
SHAPE = "not the shape of a whole person"

STATES = (
    Wrong("no capture", nothing, find_mirrors, "Load a capture first", use),
    state(nothing, "build_avatar", "No capture is loaded", title="no capture to build from"),
    Wrong("points deleted", lambda b: (b.loaded(), b.bpy.data.objects.remove(b.scene.cloud)), find_mirrors,
          "Load a capture first", use),
    Wrong("points unlinked", unlink_points, find_mirrors, "Load a capture first", use),
    Wrong("edit mode", edit_mode, use, "Object Mode", object_mode),
    Wrong("sculpt mode", lambda b: (b.avatar(), b.bpy.ops.object.mode_set(mode="SCULPT")), use, "Object Mode",
          object_mode),
    Wrong("no mirrors to save", without_mirrors, lambda b: b.ops.save_mirrors(filepath=str(b.folder / "m.json")),
          "Find the mirrors", find_mirrors),
    Wrong("no mirrors for the search", without_mirrors, find_subject, "Find the mirrors", find_mirrors),
    Wrong("nobody there", no_person, find_subject, "nobody stands", use),
    state(no_person, "build_avatar", "nobody stands", title="nobody to build"),
    state(loaded, "pick_subject", "give a column", title="a click beside the picture", pixel=(-3, 7)),
    state(loaded, "set_mirror", "give a list", title="points that are none", points="left, top"),
    state(loaded, "set_mirror", "on one line; pick", title="points on one line", points="[[0, 0], [1, 0], [2, 0]]"),
    Wrong("a rig file that is none", lambda b: (b.loaded(), b.file("rig.json", "{}")), use_rig, "calibrate the rig",
          lambda b: b.ops.calibrate_rig(filepath=str(b.folder / "rig.json"))),
    Wrong("a rig file that is gone", loaded, use_rig, "choose another file",
          lambda b: b.ops.calibrate_rig(filepath=str(b.folder / "rig.json"))),
    Wrong("a folder for a rig file", loaded, lambda b: b.ops.use_rig(filepath=str(b.folder)), "choose a rig file"),
    state(nothing, "record", "another folder", title="a recording where nothing can be written", filepath="/proc/x"),
    Wrong("no camera connected", nothing, lambda b: b.ops.record(filepath=str(b.folder / "new")), "plug it|install"),
    Wrong("nothing selected", nothing, lambda b: b.ops.check(), "Select an avatar", avatar),
    state(lambda b: b.bpy.ops.object.light_add(), "check", "Select an avatar", avatar, title="a lamp selected"),
    state(loaded, "measure", "Select an avatar", title="points selected"),
    state(cube, "add_skeleton", SHAPE, title="a cube gets no skeleton"),
    state(cube, "texture", "Only avatars built", title="a cube gets no texture"),
    state(cube, "dress", "Add a skeleton first", title="a cube gets no clothes", kind="skirt"),
    state(cube, "measure", SHAPE, title="a cube has no measures"),
    Wrong("no measures to save", avatar, lambda b: b.ops.save_measurements(filepath=str(b.folder / "a.csv")),
          "Measure the avatar first"),
    state(avatar, "apply_motion", "Add a skeleton first", title="no skeleton to move", clip="idle"),
    state(lambda b: b.linked(), "reduce", "make it local", local, title="a linked avatar", triangles=500),
    state(lambda b: b.set(b.avatar(), scale=(1, 2, 1)), "measure", "apply its scale", title="an avatar squeezed"),
    state(lambda b: b.set(b.avatar().data.vertices[0], co=(float("nan"), 0, 0)), "check", "remove or move it",
          title="a vertex at no place"),
    state(built_elsewhere, "texture", "put the capture back", title="an avatar whose capture is gone"),
    Wrong("no problem to go to", avatar, lambda b: b.ops.jump_to_problem(), "Check the avatar first",
          **instead(lambda b: b.ops.check())),
    state(cube, "color_by", "select an avatar", title="no views to colour by", mode="VIEW"),
    Wrong("an unknown ending", avatar, export("{folder}/a.docx"), "not one of the formats", nothing,
          export("{folder}/a.glb")),
    Wrong("a folder that is not there", avatar, export("{folder}/no/a.ply"), "create it first",
          lambda b: (b.folder / "no").mkdir()),
    Wrong("no file name", avatar, export(""), "Enter the name", nothing, export("{folder}/a.stl")),
    Wrong("a device for a file", lambda b: (b.avatar(), (b.folder / "b.ply").symlink_to("/dev/full")),
          export("{folder}/b.ply"), "give the name of a file", nothing, export("{folder}/a.ply")),
    Wrong("a disk that only reads", avatar, export("/proc/a.ply"), "choose another folder", nothing,
          export("{folder}/a.ply")),
    Wrong("export in edit mode", edit_mode, export("{folder}/a.ply"), "Object Mode", object_mode),
    Wrong("export beside a file that is not saved", avatar, export("//a.ply"), "save it first",
          lambda b: b.bpy.ops.wm.save_as_mainfile(filepath=str(b.folder / "a.blend"))),
    state(camera_removed, "simulate", "no camera; add one", camera_added, title="mirrors but no camera", frames=1,
          sensor="ideal"),
    Wrong("a full folder for a virtual scan", lambda b: b.copied(),
          lambda b: b.ops.simulate(frames=1, sensor="ideal", filepath=str(b.copy)), FULL),
    state(nothing, "add_rig", "a path longer", title="a path too short", distance=30.0, path=1.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def half(scan, tmp_path_factory) -> Path:
    """The mannequin's capture at half its size, two frames: what is wrong with files is wrong at any size."""
    from mirror_scan.core.io.images import read_image, write_png

    folder = tmp_path_factory.mktemp("half") / "capture"
    for kind in ("depth", "color"):
        (folder / kind).mkdir(parents=True)
        for path in sorted(scan[0].glob(f"{kind}/*"))[:2]:
            write_png(folder / kind / path.name, np.ascontiguousarray(read_image(path)[::2, ::2]))
    lens = json.loads((scan[0] / "intrinsic.json").read_text())
    matrix = [value / 2 for value in lens["intrinsic_matrix"][:8]] + [1.0]
    lens = {"width": lens["width"] // 2, "height": lens["height"] // 2, "intrinsic_matrix": matrix}
    (folder / "intrinsic.json").write_text(json.dumps(lens))
    mirrors = json.loads((scan[0] / "mirrors.json").read_text())
    for mirror in mirrors["mirrors"]:
        mirror["frame_pixels"] = [[u / 2, v / 2] for u, v in mirror["frame_pixels"]]
    (folder / "mirrors.json").write_text(json.dumps(mirrors))
    return folder


CURES = re.compile(
    r"\b(choose|give|pick|load|save|select|open|use|switch|build|add|make|install|copy|record|enter|apply|move|find|put|"
    r"remove|create|plug|check|correct|needs|stand|measure|create|calibrate|press|no such)\b", re.IGNORECASE
)  # fmt: skip
"""A message says what to do; that a file is not there is enough said."""

INSIDE = re.compile(r"--[a-z]|Traceback|\bNone\b|\bTypeError|\bdtype|\barray\b|kernel|operator|poll\(\)|<[a-z]")


def held(bpy) -> dict[str, list[str]]:
    return {kind: sorted(item.name for item in getattr(bpy.data, kind)) for kind in
            ("objects", "meshes", "images", "materials", "collections", "armatures")}  # fmt: skip


def files(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("wrong", FILES + STATES, ids=lambda wrong: wrong.name)
def test_it_is_said_in_a_line_and_cured(bpy, half, capsule, tmp_path, capfd, wrong):
    bench = Bench(bpy, tmp_path, half, capsule)
    wrong.make(bench)
    before, there = held(bpy), files(tmp_path)
    capfd.readouterr()
    with pytest.raises(RuntimeError) as caught:
        wrong.press(bench)
    lines = [line for line in str(caught.value).splitlines() if line.strip() and not line.startswith("Warning")]
    assert len(lines) == 1
    text = re.sub(r"^(Error:|Operator bpy\.ops\.mirror_scan\.\w+\.poll\(\))", "", lines[0]).replace(str(tmp_path), "")
    assert re.search(wrong.words, text) and CURES.search(text) and not INSIDE.search(text), text
    said = capfd.readouterr()
    assert "Traceback" not in said.out + said.err
    assert held(bpy) == before and files(tmp_path) == there
    if wrong.cure is not None:
        wrong.cure(bench)
        assert (wrong.again or wrong.press)(bench) == {"FINISHED"}
