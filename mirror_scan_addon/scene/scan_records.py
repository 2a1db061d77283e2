"""What a scene remembers, as the plain values that jobs take: mirrors as records, settings as dicts, paths."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import bpy

from ...core.errors import CaptureError, MirrorError, OutputError
from ..language.texts import say

CLOUD = "mirror_scan_capture"  # :data:`.point_cloud.INFO`, which numpy would have to be imported for


def no_mesh(context: bpy.types.Context) -> str:
    """Why the active object cannot be looked over; "" when it can."""
    active = context.object
    if active is None or active.type != "MESH" or CLOUD in active:
        return say("Select an avatar first")
    if not active.data.polygons:
        return say("{name} has no faces").format(name=active.name)
    return ""


def no_avatar(context: bpy.types.Context) -> str:
    """Why the active object is no avatar of ours to be looked over; "" when it is one."""
    problem = no_mesh(context)
    if not problem and REPORT not in context.object and "kind" not in context.object.data.attributes:
        return say("Select an avatar first")
    return problem


def not_ours(context: bpy.types.Context) -> str:
    """Why the active object cannot be changed; "" when it can."""
    active = context.object
    if active is not None and (not active.is_editable or active.data is not None and not active.data.is_editable):
        return _linked(active)
    return ""


def _linked(item: bpy.types.Object) -> str:
    text = say("{name} is linked from another file and cannot be changed; make it local first")
    return text.format(name=item.name)


def armature_of(item: bpy.types.Object | None) -> bpy.types.Object | None:
    """The armature with Mixamo's bones that an object is, or that moves it; None when there is none."""
    if item is None:
        return None
    found = [item] if item.type == "ARMATURE" else [
        modifier.object for modifier in item.modifiers if modifier.type == "ARMATURE" and modifier.object is not None
    ]  # fmt: skip
    return next((bones for bones in found if all(name in bones.data.bones for name in _BONES)), None)


def has_controls(bones: bpy.types.Object) -> bool:
    """Whether an armature of ours has control bones."""
    return f"{CONTROL}LeftHand" in bones.data.bones


def no_skeleton(context: bpy.types.Context) -> str:
    """Why the active object cannot be moved; "" when it can."""
    active = context.object
    bones = armature_of(active)
    if bones is None:
        return no_mesh(context) if active is None or active.type != "MESH" else say("Add a skeleton first")
    if not bones.is_editable or not bones.data.is_editable:
        return _linked(bones)
    return ""


def person_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object that shows the person: the active avatar, else the newest one, else the capture's points, else the
    person of a planned rig."""
    active = context.object
    if active is not None and REPORT in active:
        return active
    avatars = [item for item in context.scene.objects if REPORT in item]
    if avatars:
        return max(avatars, key=lambda item: item.session_uid)
    settings = context.scene.mirror_scan
    others = (item for item in (settings.cloud, settings.rig_person) if item is not None)
    return next((item for item in others if item.name in context.scene.objects), None)


def studio_of(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The studio's collection in a scene; None when there is none."""
    return next((found for found in scene.collection.children_recursive if STUDIO in found), None)


def rests_otherwise(context: bpy.types.Context) -> str:
    """Why what belongs to the capture's pose cannot be done with the active object; "" when it can."""
    active = context.object
    if active is None or not active.get(RESTS_OTHERWISE):
        return ""
    text = say("{name} no longer rests in the pose of its capture; undo “T-Pose as Rest”, or build the avatar again")
    return text.format(name=active.name)


def no_source(context: bpy.types.Context) -> str:
    """Why the active object's capture cannot be asked for its colours; "" when it can."""
    active = context.object
    if problem := rests_otherwise(context):
        return problem
    if active is None or REPORT not in active:
        return say("Only avatars built by Mirror Scan from a capture can be textured; select one")
    return ""


SOURCE = "mirror_scan_source"
"""Custom property of an avatar: what it was built from, as JSON."""
RESTS_OTHERWISE = "mirror_scan_rests_otherwise"
"""Custom property of an avatar whose rest pose is not that of its capture any more."""
REPORT = "mirror_scan_report"
"""Custom property of an avatar: report.json as text."""
TEXTURED = "mirror_scan_texture"
"""Custom property of an avatar's mesh: the material with its texture; of such a material: that it is one."""
TAPES = "mirror_scan_tapes"
"""Custom property of a collection of measurements: the avatar that they are of."""
RIG_TAG = "mirror_scan_rig"
"""Custom property of an object that a rig brought: camera, mirror, frame, person or room."""
STUDIO = "mirror_scan_studio"
"""Custom property of the studio's collection: the scene's settings that it changed, as JSON."""
CONTROL = "Control "  # what names of control bones begin with
_BONES = tuple(
    f"mixamorig:{name}" for name in (
        "Hips", "Spine", "Spine1", "Spine2", "Neck", "Head",
        *(f"{side}{part}" for side in ("Left", "Right") for part in (
            "Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")),
    )
)  # fmt: skip
"""``core.avatar.skeleton.BONES``, for which numpy would have to be imported."""

GOOD_MM, USABLE_MM = 5.0, 12.0
"""Residual of a mirror up to which it is good, and up to which it is usable [mm]; in files of older versions, which
keep no judgement."""

READING = (
    "lens", "intrinsics", "depth_unit_mm", "turn", "mirrored", "min_confidence", "disparity", "kinect_calibration",
    "color", "own_mirrors",
)  # fmt: skip
"""What may be said of a capture's files, in the order in which the panels ask for it."""

RECORD = ("name", "source", "plane", "residual_mm", "message")
JUDGEMENT = ("quality", "reason", "error_mm")
"""What a record has of a mirror that was judged, see :mod:`..tasks.mirror_judgement`."""


def absolute(path: str) -> str:
    """A path as the user typed it, made absolute; “//” stands for the .blend's folder.

    Raises
    ------
    CaptureError
        When it is relative to a .blend that has no place yet.
    """
    if path.startswith("//") and not bpy.data.filepath:
        text = say("{path}: is relative to the .blend file, which is not saved yet; save it first")
        raise CaptureError(text.format(path=path), code="unsaved")
    return bpy.path.abspath(path)


def capture_root(path: str) -> str:
    """What to open when somebody points at a file: images and JSON stand for the folder of the capture they are in."""
    file = Path(path)
    if path and file.suffix.lower() in (".png", ".jpg", ".jpeg", ".json") and not file.is_dir():
        folder = file.parent
        return str(folder.parent if folder.name.lower() in ("depth", "color") else folder)
    return path


def capture_place(settings: bpy.types.PropertyGroup) -> str:
    """Where the scene's capture is, as an absolute path; "" when that cannot be told."""
    try:
        return absolute(capture_root(settings.capture_path))
    except CaptureError:  # relative to a .blend that is not saved
        return ""


def check_folder(folder: str) -> None:
    """Refuse a folder that cannot be made, before the work is done that would fill it.

    Raises
    ------
    OutputError
    """
    try:
        if not os.path.isdir(folder):
            os.mkdir(folder)
            os.rmdir(folder)
    except OSError as error:
        text = say("{folder}: cannot be written: {reason}; choose another folder")
        raise OutputError(text.format(folder=folder, reason=error.strerror or error)) from error


def records_of(settings: bpy.types.PropertyGroup) -> list[dict]:
    """The scene's mirrors as records."""
    return [
        {name: getattr(item, name) for name in (*RECORD, *JUDGEMENT)}
        | {"picks": [list(pick.pixel) for pick in item.picks]}
        for item in settings.mirrors
    ]


def set_records(settings: bpy.types.PropertyGroup, records: list[dict]) -> None:
    """Have the scene's mirrors be ``records``."""
    settings.mirrors.clear()
    for record in records:
        set_record(settings.mirrors.add(), record)
    settings.mirror_index = min(settings.mirror_index, max(len(records) - 1, 0))


def set_record(item: bpy.types.PropertyGroup, record: dict) -> None:
    for name in RECORD:
        setattr(item, name, record[name])
    set_judgement(item, record)
    item.picks.clear()
    for pixel in record["picks"]:
        item.picks.add().pixel = pixel


def set_judgement(item: bpy.types.PropertyGroup, record: dict) -> None:
    """Keep what a mirror was judged to be; nothing, where its record says nothing."""
    for name in JUDGEMENT:
        if name in record:
            setattr(item, name, record[name])
        else:
            item.property_unset(name)


def new_record(settings: bpy.types.PropertyGroup, name: str = "") -> dict:
    """The record of a mirror that nothing is known of yet, under a name that is free."""
    taken = {item.name for item in settings.mirrors}
    number = len(taken)
    while not name or name in taken:
        number += 1
        name = f"mirror {number}"
    return {"name": name, "picks": [], "source": "picked", "plane": "", "residual_mm": 0.0, "message": ""}


def placed_mirrors(settings: bpy.types.PropertyGroup) -> list[dict]:
    """Records of mirrors that are all placed.

    Raises
    ------
    MirrorError
        When there is none, or one that is not placed.
    """
    records = records_of(settings)
    if not records:
        raise MirrorError(
            say("There are no mirrors yet; find them or pick points on their frames first"), code="no_mirror"
        )
    for record in records:
        if not record["plane"]:
            text = say("{name}: is not placed; pick at least 3 points on its frame, or remove it")
            raise MirrorError(record["message"] or text.format(name=record["name"]))
    return records


def plane_of(item: bpy.types.PropertyGroup) -> dict | None:
    """The fitted mirror of an item in plain lists, for drawing; None when there is none."""
    if not item.plane:
        return None
    try:
        content = json.loads(item.plane)
    except ValueError:
        return None
    if not isinstance(content, dict):
        return None
    basis, rectangle = content.get("basis"), content.get("rectangle")
    sound = _numbers(content.get("point"), 3) and _numbers(content.get("normal"), 3)
    sound = sound and isinstance(basis, list) and len(basis) == 3 and all(_numbers(row, 3) for row in basis)
    if sound and rectangle is not None:
        sound = isinstance(rectangle, list) and len(rectangle) == 2 and all(_numbers(row, 2) for row in rectangle)
    return content if sound else None


def _numbers(value: object, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(isinstance(item, int | float) for item in value)


def quality_of(item: bpy.types.PropertyGroup) -> str:
    """How well a mirror is placed: "GOOD", "USABLE", "BAD", or "NONE" when it is not."""
    if item.message:
        return "BAD"
    if not item.plane:
        return "NONE"
    known = {"good": "GOOD", "usable": "USABLE", "wrong": "BAD"}.get(item.quality)
    if known is None:
        known = "GOOD" if item.residual_mm <= GOOD_MM else "USABLE" if item.residual_mm <= USABLE_MM else "BAD"
    return known


def quality_word(item: bpy.types.PropertyGroup) -> str:
    """How well a mirror is placed, in a word or two."""
    if item.message:
        return say("not placed")
    words = {"GOOD": say("good"), "USABLE": say("usable"), "BAD": say("wrong")}
    return words.get(quality_of(item), say("{count} picked").format(count=len(item.picks)))


def complaint_of(item: bpy.types.PropertyGroup) -> str:
    """What is wrong with a mirror and what to do, in English as core says it; "" when it can be used."""
    return item.message or (item.reason if quality_of(item) == "BAD" else "")


def mirror_figures(item: bpy.types.PropertyGroup) -> str:
    """How exactly a mirror is known, in millimetres; "" when it is not placed, or was given."""
    if item.message or not item.plane or item.source == "given":
        return ""
    text = say("Its frame is flat to {residual:.1f} mm")
    if item.error_mm > 0.0:
        text = say("Its frame is flat to {residual:.1f} mm; what is seen in it may be off by {error:.1f} mm")
    return text.format(residual=item.residual_mm, error=item.error_mm)


def parse_points(text: str) -> list[list[float]]:
    """Points as a script passes them: the text of a list of pairs (pixels) or of triples (places in the world).

    Raises
    ------
    MirrorError
        When it is anything else.
    """
    import ast

    try:
        points = [[float(value) for value in point] for point in ast.literal_eval(text)]
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise MirrorError(say("points: give a list such as [[485, 393], [561, 404], [568, 319]]")) from error
    sizes = {len(point) for point in points}
    if sizes not in ({2}, {3}) or not all(math.isfinite(value) for point in points for value in point):
        raise MirrorError(say("points: must be pairs of pixels or triples of coordinates, all finite numbers"))
    return points


def reading_of(settings: bpy.types.PropertyGroup) -> dict:
    """Fields of ``core.capture.ReadOptions``, but ``intrinsics`` is the path of a file, or "".

    Raises
    ------
    CaptureError
        When that path is relative to a .blend that has no place yet.
    """
    reading = settings.reading
    return {
        "lens": "" if reading.lens == "FILE" else reading.lens,
        "intrinsics": absolute(reading.intrinsics),
        "depth_unit_m": reading.depth_unit_mm / 1000.0 or None,
        "turn_degrees": None if reading.turn == "FILE" else int(reading.turn),
        "mirrored": {"FILE": None, "YES": True, "NO": False}[reading.mirrored],
        "min_confidence": int(reading.min_confidence),
        "disparity": reading.disparity,
        "kinect_calibration": reading.kinect_calibration,
        "color": reading.color,
        "mirrors": reading.own_mirrors,
    }


def view_settings(settings: bpy.types.PropertyGroup) -> dict:
    """Fields of ``core.views.ViewSettings``."""
    subject = settings.subject
    lengths = ("depth_limit", "floor_clearance", "reach", "max_height")
    click = tuple(subject.click) if subject.clicked else None
    return {name: getattr(subject, f"{name}_m") for name in lengths} | {"object": subject.object, "click": click}


def key_of(views: dict) -> str:
    """Settings of a search for the person, to see whether they have changed since."""
    return json.dumps(views, sort_keys=True)


def forget_subject(settings: bpy.types.PropertyGroup) -> None:
    """What was found out about the person is not true any more."""
    subject = settings.subject
    subject.message = subject.problem = subject.searched_with = ""


def measures(settings: bpy.types.PropertyGroup) -> str:
    """How the scene's camera measures, as ``core.depth.sensor_recognition`` names it; "unknown" if nothing says it."""
    try:
        return str(json.loads(settings.cloud[CLOUD])["measures"])
    except (KeyError, TypeError, ValueError):  # no capture, one of an older file, or edited into nonsense
        return "unknown"


def no_two_ways(settings: bpy.types.PropertyGroup) -> str:
    """Why light that comes two ways is not looked for; "" when it is."""
    if settings.quality.two_ways == "OFF":
        return say("Two-way light is off")
    if settings.quality.two_ways == "AUTO" and measures(settings) in ("angles", "pulses"):
        return say("Does not apply: only cameras with modulated light, such as the Azure Kinect, need it")
    return ""


def behind_frame(settings: bpy.types.PropertyGroup) -> float:
    """How far the mirrors seem to lie behind the front of their frames [m]."""
    from ...core.mirrors.curved_glass import REFRACTION

    return settings.quality.glass_offset_m + settings.quality.glass_thickness_m / REFRACTION


def build_settings(settings: bpy.types.PropertyGroup) -> dict:
    """What the panels set of ``core.pipeline.Settings``, stage by stage."""
    quality = settings.quality
    return {
        "depth": {"smoothing": quality.smoothing, "close_gaps": quality.close_gaps},
        "mirror": {"glass_offset": quality.glass_offset_m, "glass_thickness": quality.glass_thickness_m},
        "bow": {"use": quality.bowed},
        "light": {
            "two_ways": quality.two_ways.lower(),
            "frequencies": () if no_two_ways(settings) else tuple(f for f in quality.frequencies if f >= 1.0),
        },
        "views": view_settings(settings),
        "triangulation": {"outline": quality.outline},
        "closing": {
            "refine": quality.refine,
            "untangle": quality.untangle,
            "keep_islands": quality.keep_islands,
        },
    }


def allows(operator: type[bpy.types.Operator], problem: str) -> bool:
    """What ``poll`` answers: whether there is no problem; a problem is what the disabled button says."""
    if problem:
        operator.poll_message_set(problem)
    return not problem


def editable(context: bpy.types.Context) -> str:
    """Why the scene cannot be changed now; "" when it can. Cheap enough for ``poll``."""
    from ..background import job_operators

    if not context.scene.is_editable:
        return say("The scene is linked from another file and cannot be changed; use a scene of this file")
    if job_operators.running(context):
        return say("Mirror Scan is busy; wait or press Esc")
    if context.mode != "OBJECT":
        return say("Switch to Object Mode first")
    return ""


def no_cloud(context: bpy.types.Context) -> str:
    """Why there is no cloud to work on; "" when there is one."""
    from . import point_cloud

    found = point_cloud.cloud_of(context.scene)
    if found is None:
        return say("Load a capture first")
    if found.library is not None or found.data.library is not None:
        return say("The points are linked from another file and cannot be changed; load the capture here")
    return ""


def no_mirror(context: bpy.types.Context) -> str:
    """Why no mirror can be worked with; "" when one can."""
    if not context.scene.mirror_scan.mirrors:
        return say("Find the mirrors or pick points on their frames first")
    return ""
