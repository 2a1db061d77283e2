"""The last error of a scene, kept for the panel with what cures it, until its cause is gone or it is dismissed.

It belongs to the session: undo, which an operator that failed makes no step of, must not bring it back. Errors are
known by their codes (:data:`.errors.ErrorCode`); :data:`KINDS` says what is offered for each.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import NamedTuple

import bpy

from ...core import errors
from ...core.errors import MirrorScanError, Notice
from ..language.texts import as_sentence, say, tell


class Kind(NamedTuple):
    """Errors with the same cure.

    Parameters
    ----------
    name : str
        Their :data:`.errors.ErrorCode`, or what stands for an error of an operator that has none of its own.
    topic : str
        The step of the work that it belongs to: when that has succeeded, the error is gone.
    cures : tuple of str
        What is offered, by the names that :mod:`..interface.panel_errors` draws.
    """

    name: str
    topic: str
    cures: tuple[str, ...]


KINDS: dict[str, Kind] = {kind.name: kind for kind in (
    Kind("unsaved", "capture", ("save", "choose")),
    Kind("not_loaded", "capture", ("choose",)),
    Kind("not_a_capture", "capture", ("choose",)),
    Kind("gone", "capture", ("choose", "again")),
    Kind("damaged", "capture", ("choose", "again")),
    Kind("empty", "capture", ("choose", "again")),
    Kind("frames", "capture", ("frames", "again")),
    Kind("memory", "program", ("frames", "again")),
    Kind("lens_missing", "capture", ("lens", "again")),
    Kind("lens_wrong", "capture", ("lens", "again")),
    Kind("rotation", "capture", ("turn", "again")),
    Kind("unit", "capture", ("unit", "again")),
    Kind("color", "capture", ("no color", "again")),
    Kind("camera", "capture", ("again", "choose")),
    Kind("no_mirror", "mirrors", ("pick", "find")),
    Kind("mirror", "mirrors", ("pick", "find", "remove")),
    Kind("mirror_file", "mirrors", ("no mirror file", "choose", "again")),
    Kind("rig_file", "mirrors", ("choose rig", "find", "pick")),
    Kind("nobody", "subject", ("find", "click person", "subject")),
    Kind("size", "build", ("unit", "subject", "find")),
    Kind("noise", "build", ("frames", "again")),
    Kind("avatar", "avatar", ("again", "build")),
    Kind("scaled", "avatar", ("apply scale", "again")),
    Kind("no_skeleton", "avatar", ("skeleton",)),
    Kind("no_person", "avatar", ("build", "again")),
    Kind("no_data", "avatar", ("build",)),
    Kind("motion", "motion", ("other file",)),
    Kind("stream", "motion", ("again",)),
    Kind("writing", "output", ("other file", "again")),
    Kind("program", "program", ()),
    Kind("wheels", "capture", ("no color", "again")),
    Kind("worker", "program", ("frames", "again")),
)}  # fmt: skip
"""By code; a message whose code is "other" is shown with what its operator offers, or *Try Again*."""

WORDS: dict[str, Callable[[], str]] = {
    "lens_missing": lambda: say(
        "No file of this capture describes the camera's lens; choose your camera, or a file with its lens"
    ),
    "not_a_capture": lambda: say(
        "This is no capture of a depth camera. Choose its recording, or the folder with its depth images"
    ),
    "no_mirror": lambda: say(
        "No mirror was found. Click the frame of each mirror; a frame is found automatically if it is at least 3 cm "
        "wide and 10 cm in front of the wall"
    ),
}
"""What is said in place of the message, by kind: where the message speaks of files that nobody has to write here."""

OTHER = Kind("other", "", ("again",))

_SCAN = {"capture", "mirrors", "subject", "build", "program"}, Kind("file", "capture", ("choose", "again"))
_AVATAR = {"avatar", "output", "program"}, Kind("avatar", "avatar", ("build", "again"))
_MIRROR = {"mirrors", "output", "program"}, Kind("mirrors", "mirrors", ("pick", "find"))
_MOTION = {"motion", "avatar", "program"}, Kind("file", "motion", ("other file",))
_MAY_FAIL_BY: dict[str, tuple[set[str] | None, Kind]] = {
    "load_capture": _SCAN, "scan_to_avatar": _SCAN, "build_avatar": _SCAN, "find_subject": _SCAN, "texture": _SCAN,
    "record": (_SCAN[0] | {"output"}, _SCAN[1]), "live_view": (_SCAN[0] | {"output"}, _SCAN[1]),
    "simulate": (_SCAN[0] | {"output"}, OTHER),
    "find_mirrors": _MIRROR, "set_mirror": _MIRROR, "save_mirrors": _MIRROR, "use_rig": _MIRROR,
    "calibrate_rig": _MIRROR,
    "apply_motion": _MOTION, "follow_stream": _MOTION,
}  # fmt: skip
"""By operator: the topics of what it may fail by, and the kind of what is not recognised. Others work on an avatar."""

_CAPTURE = {"load_capture", "scan_to_avatar", "record", "live_view", "simulate"}
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
        return as_sentence(tell(self.notice))

    @property
    def mirror(self) -> str:
        """The mirror that the message names in front; "" when it names none."""
        known = self.notice.mirrors
        return known[0] if known else str(self.notice).partition(":")[0]


def kind_of(code: str, operator: str = "") -> Kind:
    """The kind of an error by its code, if the operator may fail by such; else what the operator offers."""
    topics, otherwise = _MAY_FAIL_BY.get(operator.partition(".")[2], _AVATAR if operator else (None, OTHER))
    kind = KINDS.get(code)
    return kind if kind is not None and (topics is None or kind.topic in topics) else otherwise


def code_of(error: Exception) -> str:
    """The code of what an operator may fail by (:data:`..background.job_operators.REPORTED`)."""
    if isinstance(error, MirrorScanError):
        return error.code
    return "memory" if isinstance(error, MemoryError) else errors.code_of(error)


def keep(context: bpy.types.Context, operator: bpy.types.Operator, error: Exception) -> str:
    """Keep what an operator of this add-on failed by, for the scene it was started in; what is to be reported."""
    from ..background.job_operators import in_words

    shown = getattr(context.window_manager, "mirror_scan", None)
    if shown is None or context.scene is None:
        return in_words(error)
    notice = error.notice if isinstance(error, MirrorScanError) else Notice.of(in_words(error))
    shown.error = json.dumps({
        "operator": type(operator).bl_idname, "options": _options(operator), "scene": context.scene.session_uid,
        "session": os.getpid(), "notice": notice.parts(), "code": code_of(error),
    })  # fmt: skip
    words = WORDS.get(kind_of(code_of(error), type(operator).bl_idname).name)
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
    code = known.get("code", "other")  # one that an older version kept has none
    return Kept(notice, kind_of(code, known["operator"]), known["operator"], known["options"])


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
