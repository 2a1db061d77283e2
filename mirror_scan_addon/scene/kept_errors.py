"""The last error of a scene, kept for the panel with what cures it, until its cause is gone or it is dismissed.

It belongs to the session: undo, which an operator that failed makes no step of, must not bring it back. Core's messages
are recognised by their English words; :data:`KINDS` says what is offered for each.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from typing import NamedTuple

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy

from ...core.errors import MirrorScanError, Notice
from ..language.texts import say, tell, without_options


class Kind(NamedTuple):
    """Errors with the same cure.

    Parameters
    ----------
    name : str
    topic : str
        The step of the work that it belongs to: when that has succeeded, the error is gone.
    pattern : str
        Regular expression found in their English text.
    cures : tuple of str
        What is offered, by the names that :mod:`..interface.panel_errors` draws.
    """

    name: str
    topic: str
    pattern: str
    cures: tuple[str, ...]


KINDS = (
    Kind("unsaved", "capture", r"is relative to the \.blend file", ("save", "choose")),
    Kind("program", "program", r"numba cannot be imported|There is no second Python", ()),
    Kind("memory", "program", r"emory|may be read at once", ("frames", "again")),
    Kind("wheels", "capture", r"OpenImageIO, which cannot be imported|needs PyAV", ("no color", "again")),
    Kind("camera", "capture", r"pyrealsense2|RealSense camera (?:is|cannot)|the camera stopped after|depth stream of",
         ("again", "choose")),
    Kind("nobody", "subject", r"nobody stands|nothing stands|no connected figure|stands on the floor is seen|"
         r"depth image shows the subject|[Tt]he click|smaller than a person", ("find", "click person", "subject")),
    Kind("size", "build", r"too tall|too small|would (?:be|have)|has no inside|nearer than a person",
         ("unit", "subject", "find")),
    Kind("noise", "build", r"too noisy", ("frames", "again")),
    Kind("rig file", "mirrors", r"rig file|rig was calibrated|calibrate (?:it )?again|moved since it was calibrated",
         ("choose rig", "find", "pick")),
    Kind("no mirror", "mirrors", r"[Nn]o mirror was found|[Nn]o mirrors? yet|There are no mirrors",
         ("pick", "find")),
    Kind("mirror file", "mirrors", r"frame_pixels|\"mirrors\"|plane must be|two mirrors are named|mirrors; at most|"
         r"name of mirror|mirror \d+ must be|mirrors\.json", ("choose", "again")),
    Kind("lens missing", "capture",
         r"intrinsics?(?:\w*)\.json: is missing|intrinsics of these .* are unknown|has no calibration attached|"
         r"no camera_info beside|with its intrinsics is missing|width, height and intrinsic_matrix|"
         r"no section <depth>", ("lens", "again")),
    Kind("rotation", "capture", r"width and height are exchanged|the picture was rotated|can be rotated by",
         ("turn", "again")),
    Kind("lens wrong", "capture",
         r"intrinsics do not fit|intrinsics of this resolution|intrinsics are|is for \d+×\d+ pixels|"
         r"cannot be the image centre|ocal lengths? |principal point|distortion|intrinsic_matrix|nine numbers|"
         r"positive whole number of pixels|fisheye|\d+° ?\)|missing; write the values|in parts of the image's size|"
         r"lies at the edge or outside|look exchanged", ("lens", "again")),
    Kind("unit", "capture", r"depth unit|depth_scale|no depth reading between|readings lie beyond|too far|"
         r"holds no distance", ("unit", "again")),
    Kind("colour", "capture", r"(?:colou?r|color_intrinsic\.json|color folder)\b.*(?:align|depth_to_color|not known|"
         r"channels|has no|lossy)|depth_to_color|has no colour|no colour;", ("no color", "again")),
    Kind("empty", "capture", r"no (?:pixel|reading|depth frame|depth reading|frame|PNG|depth images|depth track|image|"
         r"whole frame|vertices)\b.*|sees nothing", ("choose", "again")),
    Kind("frames", "capture", r"chooses none|at least one frame|frames? (?:are|is) chosen|choose fewer frames|"
         r"more than memory|more than \S+ frames", ("frames", "again")),
    Kind("gone", "capture", r"there is no such file|no longer exists; put|cannot be read \(|cannot be listed|"
         r"No such file|ermission denied.*|Is a directory", ("choose", "again")),
    Kind("not a capture", "capture", r"is not a capture|is not depth|not depth; open|depth must (?:be|have)|"
         r"points in no grid|grid of pixels|one camera sees|OpenNI recording of version|unknown mesh format",
         ("choose",)),
    Kind("damaged", "capture", r"truncated|damaged|cut off|cut short|is empty|ends too early|cannot be decoded|"
         r"not (?:valid )?JSON|not a readable image|far too large|(?:copy|record|export) (?:it )?again",
         ("choose", "again")),
    Kind("not loaded", "capture", r"[Nn]o capture is (?:chosen|loaded)|points of the capture are gone|Load a capture",
         ("choose",)),
    Kind("mirror lies", "mirrors", r"lies? (?:flat )?on the (?:floor|ground)|not upright|rows and columns",
         ("find", "pick", "remove")),
    Kind("mirror", "mirrors", r"its frame|the mirror|frame point|is not placed|on the frame|a plane needs|picks?\b|"
         r"lie on one line|in one plane|edge-on|[Mm]irror", ("pick", "find", "remove")),
    Kind("scaled", "avatar", r"scaled unevenly|no longer as large", ("apply scale", "again")),
    Kind("no skeleton", "avatar", r"Add a skeleton|its skeleton lacks|has no skeleton", ("skeleton",)),
    Kind("no person", "avatar", r"skeleton:|whole person|measurements:|clothes:|there is no chest", ("build", "again")),
    Kind("motion", "motion", r"this skeleton's names|MOTION|holds no frame|BVH|caption|glTF|joints|animation|motion",
         ("other file",)),
    Kind("stream", "motion", r"UDP port|datagram|stream", ("again",)),
    Kind("writing", "output", r"cannot (?:be written|write|be kept)|written|Enter the name|exists already|"
         r"choose another (?:folder|name)|create it first|make room|empty folder|nothing was written",
         ("other file", "again")),
    Kind("no data", "avatar", r"has no such data|no colours from|where its camera stood|build the avatar again|"
         r"no longer exists|Select an avatar|has no faces|not finite", ("build",)),
    Kind("worker", "program", r"process that does the work|second process", ("frames", "again")),
)  # fmt: skip
"""The first whose pattern is found says what is offered; a message of none is shown with *Try Again*."""

WORDS: dict[str, Callable[[], str]] = {
    "lens missing": lambda: say("The camera's lens is missing: no file of this capture gives it"),
    "not a capture": lambda: say(
        "This is no capture of a depth camera. Choose its recording, or the folder with its depth images"
    ),
    "no mirror": lambda: say(
        "No mirror was found. Click the frame of each mirror; a frame is found automatically if it is at least 3 cm "
        "wide and 10 cm in front of the wall"
    ),
}
"""What is said in place of the message, by kind: where the message speaks of files that nobody has to write here."""

OTHER = Kind("other", "", "", ("again",))

_SCAN = {"capture", "mirrors", "subject", "build", "program"}, Kind("file", "capture", "", ("choose", "again"))
_AVATAR = {"avatar", "output", "program"}, Kind("avatar", "avatar", "", ("build", "again"))
_MIRROR = {"mirrors", "output", "program"}, Kind("mirrors", "mirrors", "", ("pick", "find"))
_MOTION = {"motion", "avatar", "program"}, Kind("file", "motion", "", ("other file",))
_MAY_FAIL_BY: dict[str, tuple[set[str] | None, Kind]] = {
    "load_capture": _SCAN, "scan_to_avatar": _SCAN, "build_avatar": _SCAN, "find_subject": _SCAN, "texture": _SCAN,
    "record": (_SCAN[0] | {"output"}, _SCAN[1]), "simulate": (_SCAN[0] | {"output"}, OTHER),
    "find_mirrors": _MIRROR, "set_mirror": _MIRROR, "use_rig": _MIRROR, "calibrate_rig": _MIRROR,
    "apply_motion": _MOTION, "follow_stream": _MOTION,
}  # fmt: skip
"""By operator: the topics of what it may fail by, and the kind of what is not recognised. Others work on an avatar."""

_CAPTURE = {"load_capture", "scan_to_avatar", "record", "simulate"}
_MIRRORS = {
    "find_mirrors",
    "set_mirror",
    "remove_mirror",
    "clear_mirrors",
    "pick_mirror_points",
    "use_rig",
    "calibrate_rig",
}
_SETTLED = {"find_subject": {"subject"}, "build_avatar": {"capture", "mirrors", "subject", "build"},
            "check": {"avatar"}} | {name: {"mirrors"} for name in _MIRRORS}  # fmt: skip
"""By operator, the topics that its success settles, besides its own errors; a loaded capture settles all."""


class Kept(NamedTuple):
    """What the panel shows: the message, its kind, and what failed."""

    notice: Notice
    kind: Kind
    operator: str
    options: dict

    @property
    def text(self) -> str:
        """In the user's language."""
        words = WORDS.get(self.kind.name)
        if words is not None:
            return words()
        text = without_options(tell(self.notice))
        return text[:1].upper() + text[1:] if text.partition(" ")[0].isalpha() else text  # not a file's name

    @property
    def mirror(self) -> str:
        """The mirror that the message names in front; "" when it names none."""
        known = self.notice.mirrors
        return known[0] if known else str(self.notice).partition(":")[0]


def kind_of(text: str, operator: str = "") -> Kind:
    """The kind of an error by its English text, among those that the operator may fail by."""
    topics, otherwise = _MAY_FAIL_BY.get(operator.partition(".")[2], _AVATAR if operator else (None, OTHER))
    fitting = (kind for kind in KINDS if topics is None or kind.topic in topics)
    where, colon, what = text.partition(": ")
    parts = re.split(r"[/\\]", where)
    if colon and len(parts) > 1:  # a folder's name says nothing of what is wrong
        text = f"{parts[-1]}: {what}"
    return next((kind for kind in fitting if re.search(kind.pattern, text)), otherwise)


def keep(context: bpy.types.Context, operator: bpy.types.Operator, error: Exception) -> str:
    """Keep what an operator of this add-on failed by, for the scene it was started in; what is to be reported."""
    from ..background.job_operators import in_words

    shown = getattr(context.window_manager, "mirror_scan", None)
    if shown is None or context.scene is None:
        return in_words(error)
    notice = error.notice if isinstance(error, MirrorScanError) else Notice.of(in_words(error))
    shown.error = json.dumps({
        "operator": type(operator).bl_idname, "options": _options(operator), "scene": context.scene.session_uid,
        "session": os.getpid(), "notice": notice.parts(),
    })  # fmt: skip
    words = WORDS.get(kind_of(str(notice), type(operator).bl_idname).name)
    return in_words(error) if words is None or bpy.app.background else words()  # scripts are told the file


def kept(context: bpy.types.Context) -> Kept | None:
    """The error of the present scene."""
    text = context.window_manager.mirror_scan.error
    if not text:
        return None
    known = json.loads(text)
    if (known["session"], known["scene"]) != (os.getpid(), context.scene.session_uid):
        return None  # of another scene, or one that came with a file
    notice = Notice.of_parts(known["notice"])
    return Kept(notice, kind_of(str(notice), known["operator"]), known["operator"], known["options"])


def forget(context: bpy.types.Context, operator: bpy.types.Operator | None = None) -> None:
    """Drop the error: of whatever kind, or when the success of ``operator`` shows that its cause is gone."""
    shown = getattr(context.window_manager, "mirror_scan", None)
    if shown is None or not getattr(shown, "error", ""):
        return
    if operator is not None:
        found, done = kept(context), type(operator).bl_idname.partition(".")[2]
        if found is None or not (
            done in _CAPTURE or type(operator).bl_idname == found.operator or found.kind.topic in _SETTLED.get(done, ())
        ):
            return
    shown.error = ""


def _options(operator: bpy.types.Operator) -> dict:
    """What the operator was called with, of what JSON can hold."""
    properties = getattr(operator, "properties", None)
    if properties is None:
        return {}
    given = {}
    for known in properties.bl_rna.properties:
        name = known.identifier
        if name != "rna_type" and properties.is_property_set(name):
            value = getattr(properties, name)
            if isinstance(value, bool | int | float | str):
                given[name] = value
    return given
