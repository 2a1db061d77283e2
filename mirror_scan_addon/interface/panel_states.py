"""What each step of the work says of itself on one line, folded: its state and its figures.

Drawn with every redraw of the sidebar, so nothing here costs more than looking at a few properties: reports are parsed
when they change.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeVar

import bpy

from ..language.texts import say
from ..scene import live_subject, report_text, scan_records
from ..scene.scan_records import REPORT, armature_of
from .panel_parts import on_one_line

DONE, OPEN, WRONG = "CHECKMARK", "DOT", "ERROR"
"""Icons in front of a step."""

Answer = TypeVar("Answer")
State = tuple[str, str]
"""What a step says, and its icon."""

_reports: dict[int, tuple[str, dict | None]] = {}  # by the object's session_uid: the text, and what it says


def report_of(avatar: bpy.types.Object | None) -> dict | None:
    """:func:`.report_text.avatar_report`, parsed once."""
    text = avatar.get(REPORT) if avatar is not None else None
    if not isinstance(text, str):
        return None
    uid = avatar.session_uid
    if uid not in _reports or _reports[uid][0] != text:
        if len(_reports) > 8:
            _reports.clear()
        _reports[uid] = text, report_text.avatar_report(avatar)
    return _reports[uid][1]


FEW, LOOK_S = 100, 1.0
"""Objects of a scene that are looked through at every redraw; the seconds for which an answer of more is taken."""

_answers: dict[str, tuple[tuple, float, object]] = {}  # what was found out about a large scene, and when


def looked_up(name: str, context: bpy.types.Context, find: Callable[[], Answer]) -> Answer:
    """What ``find`` finds out by looking through all objects of the scene: at once in a scene of a few, else not more
    often than :data:`LOOK_S`. The answer must be no object: that may be gone a moment later."""
    scene = context.scene
    if len(scene.objects) <= FEW:
        return find()
    key = scene.session_uid, len(scene.objects)
    if name not in _answers or _answers[name][0] != key or time.monotonic() - _answers[name][1] > LOOK_S:
        _answers[name] = key, time.monotonic(), find()
    return _answers[name][2]


def shown_avatar(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active avatar, else the newest of the scene; None when there is none."""
    active = context.object
    if active is not None and REPORT in active:
        return active

    def newest() -> str:
        person = scan_records.person_of(context)
        return person.name if person is not None and REPORT in person else ""

    found = context.scene.objects.get(looked_up("avatar", context, newest))
    return found if found is not None and REPORT in found else None


def cloud_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object with the capture's points, if it is in the scene."""
    target = context.scene.mirror_scan.cloud
    return target if target is not None and target.name in context.scene.objects else None


def capture(context: bpy.types.Context) -> State:
    cloud = cloud_of(context)
    if cloud is None:
        return say("none yet"), OPEN
    name = cloud.name.removesuffix(" Points")  # as it is named when it is loaded
    count = len(cloud.data.vertices)
    editing = cloud.mode == "EDIT"  # a mesh tells of its edits only afterwards
    return say("{name}, {points:,} points").format(name=name, points=count), DONE if count or editing else WRONG


def mirrors(context: bpy.types.Context) -> State:
    items = context.scene.mirror_scan.mirrors
    # while frames are clicked, there is one more for the next click
    found = [scan_records.quality_of(item) for item in items if item.plane or item.message or len(item.picks)]
    if not found:
        return say("none yet"), OPEN
    words = {
        "GOOD": say("{count} good"), "USABLE": say("{count} usable"), "BAD": say("{count} wrong"),
        "NONE": say("{count} not placed"),
    }  # fmt: skip
    text = ", ".join(word.format(count=found.count(quality)) for quality, word in words.items() if quality in found)
    return text, DONE if {"GOOD", "USABLE"}.issuperset(found) else WRONG


def subject(context: bpy.types.Context) -> State:
    settings = context.scene.mirror_scan
    if live_subject.searching(context.scene):
        return say("searching"), OPEN
    if settings.subject.problem:
        return say("not found"), WRONG
    if settings.subject.stale:
        return say("settings have changed"), OPEN
    return (say("found"), DONE) if settings.subject.message else (say("automatic"), OPEN)


def build(context: bpy.types.Context) -> State:
    report = report_of(shown_avatar(context))
    mesh = {} if report is None else report.get("mesh", {})
    if report is None:
        return say("nothing yet"), OPEN
    closed = mesh.get("watertight")
    words = [] if closed is None else [say("closed") if closed else say("has holes")]
    if mesh.get("triangles"):
        words.append(say("{count:,} triangles").format(count=mesh["triangles"]))
    return ", ".join(words), WRONG if closed is False else DONE


def avatar(context: bpy.types.Context) -> State:
    shown = shown_avatar(context)
    if shown is None:
        return say("nothing yet"), OPEN
    report = report_of(shown) or {}
    bones = armature_of(shown)
    words = []
    if bones is not None:
        moves = bones.animation_data is not None and bones.animation_data.action is not None
        words.append(say("moves") if moves else say("skeleton"))
    if "texture" in report:
        words.append(say("texture"))
    if report_text.measurements_of(report):
        words.append(say("measured"))
    return ", ".join(words) or say("no skeleton yet"), DONE if words else OPEN


def check(context: bpy.types.Context) -> State:
    report = report_of(shown_avatar(context)) or {}
    if "problems" not in report:
        return say("not checked"), OPEN
    count = len(report_text.problems_of(report))
    return (say("problems: {count}").format(count=count), WRONG) if count else (say("no problems"), DONE)


def export(context: bpy.types.Context) -> State:
    folder = context.scene.mirror_scan.export_folder
    if not folder:
        return say("asks each time"), OPEN
    return say("to {folder}").format(folder=os.path.basename(folder.rstrip("/\\")) or folder), DONE


class Step:
    """Mixin of a panel that is folded at first: its header says :attr:`state` of the step on one line."""

    bl_options = {"DEFAULT_CLOSED"}
    state: Callable[[bpy.types.Context], State]

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.label(text="", icon=self.state(context)[1])

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        on_one_line(self.layout, self.state(context)[0])
