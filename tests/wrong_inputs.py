"""Wrong files and wrong states: how each comes about, what is pressed, what is said and what cures it.

``addon/test_wrong_inputs.py`` tries all of them in the bpy module, ``blender/window.py`` in a window. Nothing here
needs Blender before a case is tried.
"""

from __future__ import annotations

import importlib
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np


class Bench:
    """What a case works with: Blender, a folder of its own, and the mannequin's capture to copy from."""

    def __init__(self, bpy, folder: Path, capture: Path, capsule, package: str = "mirror_scan"):
        self.bpy, self.folder, self.capture, self.capsule, self.package = bpy, folder, capture, capsule, package
        self.ops, self.scene = bpy.ops.mirror_scan, bpy.context.scene.mirror_scan
        self.copy = folder / "capture"  # of the capture, once it is there

    def module(self, name: str):
        """A module of the add-on, whatever the package is called here."""
        return importlib.import_module(f"{self.package}.{name}")

    def copied(self, *without: str) -> Path:
        """A copy of the capture, without some of its files."""
        return Path(shutil.copytree(self.capture, self.copy, ignore=shutil.ignore_patterns(*without)))

    def file(self, name: str, content: bytes | str = b"") -> str:
        path = self.folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return str(path)

    def load(self, path: object = "", **options: object):
        return self.ops.load_capture(filepath=str(path or self.copy), frames=1, **options)

    def loaded(self) -> None:
        assert self.load(self.capture) == {"FINISHED"}

    def lens(self, **values: object) -> Path:
        """A copy whose intrinsic.json says something else."""
        self.copied()
        path = self.copy / "intrinsic.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | values))
        return self.copy

    def mirrors(self, change: Callable[[dict], object]) -> Path:
        """A copy whose mirrors.json was changed in place, or holds what ``change`` returns."""
        self.copied()
        path = self.copy / "mirrors.json"
        content = json.loads(path.read_text())
        changed = change(content)
        path.write_text(json.dumps(content if changed is None else changed))
        return self.copy

    def depth(self, change: Callable[[np.ndarray], np.ndarray]) -> Path:
        """A copy with other depth images."""
        images = self.module("core.io.images")
        self.copied()
        for path in self.copy.glob("depth/*.png"):
            images.write_png(path, np.ascontiguousarray(change(images.read_image(path))))
        return self.copy

    def avatar(self, **report: object):
        """A body of the right size that says it was built by us."""
        objects = self.module("mirror_scan_addon.scene.avatar_objects")
        body = objects.create_avatar(self.capsule, name="Body", collection=self.bpy.context.collection, report=report)
        self.bpy.context.view_layer.objects.active = body
        body.select_set(True)
        return body

    def cube(self):
        self.bpy.ops.mesh.primitive_cube_add()
        return self.bpy.context.object

    def linked(self) -> None:
        """The avatar, from a library."""
        data, body = self.bpy.data, self.avatar()
        library, name = str(self.folder / "library.blend"), body.name
        data.libraries.write(library, {body}, fake_user=True)
        mesh = body.data
        data.objects.remove(body)
        data.meshes.remove(mesh)
        with data.libraries.load(library, link=True) as (_, here):
            here.objects = [name]
        body = here.objects[0]
        self.bpy.context.collection.objects.link(body)
        self.bpy.context.view_layer.objects.active = body
        body.select_set(True)

    def set(self, owner: object, **values: object) -> None:
        for name, value in values.items():
            setattr(owner, name, value)


@dataclass(frozen=True)
class Wrong:
    """A wrong input: how it comes about, what is pressed then, what is said, and what cures it."""

    name: str
    make: Callable[[Bench], object]
    press: Callable[[Bench], object]
    words: str
    cure: Callable[[Bench], object] | None = None
    again: Callable[[Bench], object] | None = None
    """What is pressed after the cure, if not ``press`` again."""


def nothing(b: Bench) -> None:
    pass


def load(b: Bench):
    return b.load()


def use(b: Bench):
    return b.load(b.capture)


def instead(press: Callable[[Bench], object] = use) -> dict:
    """The cure is to press something else."""
    return {"cure": nothing, "again": press}


def first_depth(b: Bench, content: Callable[[bytes], bytes]) -> None:
    path = sorted(b.copied().glob("depth/*.png"))[0]
    path.write_bytes(content(path.read_bytes()))


def small_depth(b: Bench) -> None:
    """A capture whose first depth image is smaller than the others."""
    path = min(b.copied().glob("depth/*.png"))
    b.module("core.io.images").write_png(path, np.full((8, 8), 1000, np.uint16))


def given_lens(b: Bench) -> None:
    b.scene.reading.intrinsics = str(b.capture / "intrinsic.json")


GOOD_MIRRORS = instead(lambda b: b.load(mirrors_filepath=str(b.capture / "mirrors.json")))


def opened(title: str, name: str, content: bytes | str, words: str) -> Wrong:
    """A single file that is no capture; another one is chosen instead."""
    return Wrong(title, lambda b: b.file(name, content), lambda b: b.load(b.folder / name), words, **instead())


def mirrored(title: str, change: Callable[[dict], object], words: str) -> Wrong:
    """A capture whose mirrors.json is wrong; another file of mirrors is given instead."""
    return Wrong(title, lambda b: b.mirrors(change), load, words, **GOOD_MIRRORS)


def set_reading(name: str, value: object, title: str, words: str) -> Wrong:
    """A load option that is wrong; it is unset."""
    return Wrong(title, lambda b: b.set(b.scene.reading, **{name: value}), use, words,
                 lambda b: b.scene.reading.property_unset(name))  # fmt: skip


MKV = b"\x1a\x45\xdf\xa3\x01\x00\x00\x00\x00\x00\x00\x23B\x86\x81"
PLY = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {axis}\n" for axis in "xyz")
PLY += "end_header\n0 0 1\n"

FILES = (
    Wrong("no such path", nothing, lambda b: b.load(b.folder / "nowhere"), "no such file", **instead()),
    Wrong("nothing chosen", nothing, lambda b: b.ops.load_capture(), "choose its folder or file", **instead()),
    Wrong("an empty folder", lambda b: b.copy.mkdir(), load, "is not a capture", **instead()),
    Wrong("a folder of letters", lambda b: (b.copy.mkdir(), b.file("capture/a.txt", "x")), load, "is not a capture",
          **instead()),
    opened("an empty recording", "a.mkv", b"", "is not a capture"),
    opened("a letter called .mkv", "a.mkv", "Dear Sir", "is not a capture"),
    Wrong("a folder called .mkv", lambda b: (b.folder / "a.mkv").mkdir(), lambda b: b.load(b.folder / "a.mkv"),
          "is not a capture", **instead()),
    opened("a letter", "a.docx", b"PK\3\4", "is not a capture"),
    opened("a cut-off recording", "a.mkv", MKV, "no depth track"),
    opened("a bag that ends too early", "a.bag", b"#ROSBAG V2.0\n\x45\0\0\0op", "no depth images"),
    opened("a database that is none", "a.db3", b"SQLite format 3\0" + b"\0" * 84, "damaged"),
    opened("a recording of an unknown version", "a.oni", b"NI10" + b"\0" * 20, "not known"),
    opened("a frame cut off", "a.pclzf", b"PCLZF" + b"\1" * 9, "damaged"),
    opened("points without a grid", "a.ply", PLY, "no grid"),
    opened("points in words", "a.pcd", "# .PCD v.7\nVERSION .7\nFIELDS x\n", "damaged"),
    opened("a zip cut off", "a.npz", b"PK\3\4" + b"\0" * 60, "damaged"),
    Wrong("arrays of something else", lambda b: np.savez(b.folder / "a.npz", x=np.zeros(3)),
          lambda b: b.load(b.folder / "a.npz"), "is not a capture", **instead()),
    Wrong("a photograph", lambda b: shutil.copy(sorted(b.capture.glob("color/*"))[0], b.folder / "a.png"),
          lambda b: b.load(b.folder / "a.png"), "is not a capture", **instead()),
    Wrong("no depth images", lambda b: shutil.rmtree(b.copied() / "depth"), load, "depth", **instead()),
    Wrong("an empty depth image", lambda b: first_depth(b, lambda old: b""), load, "is not a PNG", **instead()),
    Wrong("a depth image cut off", lambda b: first_depth(b, lambda old: old[:300]), load, "truncated", **instead()),
    Wrong("black depth images", lambda b: b.depth(lambda d: 0 * d), load, "no pixel", **instead()),
    Wrong("depth images of two sizes", small_depth, load, "8×8", **instead()),
    Wrong("no lens", lambda b: b.copied("intrinsic.json"), load, "is missing", given_lens),
    Wrong("a lens that is no JSON", lambda b: (b.copied() / "intrinsic.json").write_text("{"), load, "not valid JSON",
          given_lens),
    Wrong("the lens of another camera", lambda b: b.lens(width=1280, height=720), load, "1280×720", given_lens),
    Wrong("a lens of zeros", lambda b: b.lens(intrinsic_matrix=[0.0] * 9), load, "focal", given_lens),
    set_reading("intrinsics", "/nowhere/lens.json", "a lens file that is gone", "another file"),
    set_reading("depth_unit_mm", 1000.0, "metres taken for millimetres", "no depth reading"),
    set_reading("depth_unit_mm", 0.00001, "a unit too small", "give millimetres"),
    Wrong("relative to a file that is not saved", nothing, lambda b: b.ops.load_capture(filepath="//capture"),
          "save it first", lambda b: b.bpy.ops.wm.save_as_mainfile(filepath=str(b.copied() / "a.blend")),
          lambda b: b.ops.load_capture(filepath="//", frames=1)),
    Wrong("mirrors that are no JSON", lambda b: (b.copied() / "mirrors.json").write_text("[1, 2"), load, "JSON",
          **GOOD_MIRRORS),
    mirrored("mirrors that are a number", lambda c: {"mirrors": 3}, "pick the mirrors again"),
    mirrored("a mirror of two points", lambda c: c["mirrors"][0].update(frame_pixels=[[1, 2], [3, 4]]), "at least 3"),
    mirrored("a mirror outside the picture",
             lambda c: c["mirrors"][0].update(frame_pixels=[[9e3, 1], [3, 9e3], [5, 6]]), "outside"),
    mirrored("two mirrors of one name", lambda c: [m.update(name="left") for m in c["mirrors"]] and None, "own name"),
    Wrong("a file of mirrors that is gone", nothing, lambda b: b.load(b.capture, mirrors_filepath="/nowhere/m.json"),
          "another file", **instead()),
)  # fmt: skip


# --- states -----------------------------------------------------------------------------------------------------------


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
    body = b.avatar(camera_to_avatar=np.eye(4).tolist())
    b.module("mirror_scan_addon.scene.capture_source").keep_source(body, "/nowhere/capture", 0, {}, [])


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
SHAPE = "shape of a whole person"

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
    Wrong("a rig file that is none", lambda b: (b.loaded(), b.file("rig.json", "{}")), use_rig, "not a rig file",
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


CURES = re.compile(
    r"\b(choose|give|pick|load|save|select|open|use|switch|build|add|make|install|copy|record|enter|apply|move|find|put|"
    r"remove|create|plug|check|correct|needs|stand|measure|create|calibrate|press|no such)\b", re.IGNORECASE
)  # fmt: skip
"""A message says what to do; that a file is not there is enough said."""

INSIDE = re.compile(r"--[a-z]|Traceback|\bNone\b|\bTypeError|\bdtype|\barray\b|kernel|operator|poll\(\)|<[a-z]")


def refusal(error: RuntimeError, folder: Path) -> tuple[str, int]:
    """What an operator said as it refused to work, without Blender's own words and ``folder``; in how many lines."""
    lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Warning")]
    own = re.sub(r"^(Error:|Operator bpy\.ops\.mirror_scan\.\w+\.poll\(\))", "", lines[0])
    return own.replace(str(folder), ""), len(lines)


def half_size(capture: Path, folder: Path) -> Path:
    """A capture at half its size, two frames, in a new folder: what is wrong with files is wrong at any size."""
    from mirror_scan.core.io.images import read_image, write_png

    for kind in ("depth", "color"):
        (folder / kind).mkdir(parents=True)
        for path in sorted(capture.glob(f"{kind}/*"))[:2]:
            write_png(folder / kind / path.name, np.ascontiguousarray(read_image(path)[::2, ::2]))
    lens = json.loads((capture / "intrinsic.json").read_text())
    matrix = [value / 2 for value in lens["intrinsic_matrix"][:8]] + [1.0]
    lens = {"width": lens["width"] // 2, "height": lens["height"] // 2, "intrinsic_matrix": matrix}
    (folder / "intrinsic.json").write_text(json.dumps(lens))
    mirrors = json.loads((capture / "mirrors.json").read_text())
    for mirror in mirrors["mirrors"]:
        mirror["frame_pixels"] = [[u / 2, v / 2] for u, v in mirror["frame_pixels"]]
    (folder / "mirrors.json").write_text(json.dumps(mirrors))
    return folder


# --- some of them for a window ---------------------------------------------------------------------------------------

DROPPED = (
    "a letter called .mkv", "a database that is none", "a recording of an unknown version", "a frame cut off",
    "black depth images", "a depth image cut off", "the lens of another camera", "mirrors that are a number",
)  # fmt: skip
"""Of :data:`FILES`, a handful of kinds, by name; the last ones are capture folders."""


class Maker(Bench):
    """Makes wrong files where there is no Blender, and keeps which one is to be opened."""

    def __init__(self, folder: Path, capture: Path):
        self.folder, self.capture, self.copy, self.package = folder, capture, folder / "capture", "mirror_scan"
        self.opened = folder

    def load(self, path: object = "", **options: object) -> None:
        self.opened = Path(str(path or self.copy))


def make_dropped(folder: Path, capture: Path) -> list[dict]:
    """Make the files of :data:`DROPPED` in folders of their own; which file of each to drop, and what is said then."""
    known, made = {wrong.name: wrong for wrong in FILES}, []
    for number, name in enumerate(DROPPED):
        place = folder / f"wrong{number}"
        place.mkdir(parents=True)
        maker = Maker(place, capture)
        known[name].make(maker)
        known[name].press(maker)
        file = maker.opened / "intrinsic.json" if maker.opened.is_dir() else maker.opened
        entry = {"name": name, "file": str(file.relative_to(folder)), "words": known[name].words}
        made.append(entry)
    return made
