"""Wrong files and wrong load options: how each comes about, what is pressed, what is said and what cures it.

``test_wrong_inputs.py`` tries all of them in the bpy module; ``tests/blender`` drops some of the files into a window.
Nothing here needs Blender.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np


class Bench:
    """What a case works with: Blender, a folder of its own, and the mannequin's capture to copy from."""

    def __init__(self, bpy, folder: Path, capture: Path, capsule):
        self.bpy, self.folder, self.capture, self.capsule = bpy, folder, capture, capsule
        self.ops, self.scene = bpy.ops.mirror_scan, bpy.context.scene.mirror_scan
        self.copy = folder / "capture"  # of the capture, once it is there

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
        from mirror_scan.core.io.images import read_image, write_png

        self.copied()
        for path in self.copy.glob("depth/*.png"):
            write_png(path, np.ascontiguousarray(change(read_image(path))))
        return self.copy

    def avatar(self, **report: object):
        """A body of the right size that says it was built by us."""
        from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

        body = create_avatar(self.capsule, name="Body", collection=self.bpy.context.collection, report=report)
        self.bpy.context.view_layer.objects.active = body
        body.select_set(True)
        return body

    def cube(self):
        self.bpy.ops.mesh.primitive_cube_add()
        return self.bpy.context.object

    def linked(self) -> None:
        """The avatar, from a library."""
        self.avatar()
        library = str(self.folder / "library.blend")
        self.bpy.ops.wm.save_as_mainfile(filepath=library)
        self.bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        with self.bpy.data.libraries.load(library, link=True) as (_, here):
            here.objects = ["Body"]
        body = self.bpy.data.objects["Body"]
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
    Wrong("depth images of two sizes", lambda b: first_depth(b, lambda old: small_png()), load, "8×8", **instead()),
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


def small_png() -> bytes:
    import tempfile

    from mirror_scan.core.io.images import write_png

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        write_png(path, np.full((8, 8), 1000, np.uint16))
        return path.read_bytes()


# --- some of them for a window ---------------------------------------------------------------------------------------

DROPPED = (
    "a letter called .mkv", "a database that is none", "a recording of an unknown version", "a frame cut off",
    "black depth images", "a depth image cut off", "the lens of another camera", "mirrors that are a number",
)  # fmt: skip
"""Of :data:`FILES`, a handful of kinds, by name; the last ones are capture folders."""


class Maker(Bench):
    """Makes wrong files where there is no Blender, and keeps which one is to be opened."""

    def __init__(self, folder: Path, capture: Path):
        self.folder, self.capture, self.copy = folder, capture, folder / "capture"
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
