"""Look at a camera live: what to change before the shutter, the burst taken by itself, and the avatar made of it."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import os

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ...core.errors import CaptureError
from ..background import job_operators
from ..interface import live_picture
from ..interface.viewport import look_from_front
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.blender_files import reason_of

IGNORED = {
    "ARMS": ("arms_close", "arms_hide"), "FEET": ("feet_hidden", "feet_cut"), "PEOPLE": ("two_people",),
    "MIRRORS": ("step", "aside", "not_shown", "mirror_small", "glass_edge", "image_edge", "far", "body_hides",
                "blocked"),
}  # fmt: skip
"""What the burst can be told not to wait for: kinds of core's advice."""


class MIRRORSCAN_OT_live_view(job_operators.FileJobOperator, bpy.types.Operator):
    """Look at a depth camera live: advice in the viewport says what to change; when all is well, the burst is taken by itself and an avatar is made of it"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.live_view"
    bl_label = "Live View"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    source: EnumProperty(
        name="Source", description="What is looked at",
        items=(
            ("realsense", "Intel RealSense", "Any RealSense depth camera; needs the Python package pyrealsense2"),
            ("azure_kinect", "Azure Kinect", "Azure Kinect DK; needs the Python package pyk4a"),
            ("femto", "Orbbec Femto", "Femto Bolt or Mega; needs the Python package pyorbbecsdk"),
            ("playback", "Recording", "A recording or capture, played as if it were a camera"),
        ),
        default="realsense", translation_context=CONTEXT,
    )  # fmt: skip
    filepath: StringProperty(
        name="Recording", description="Folder or file of the recording that is played", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    folder: StringProperty(
        name="Folder",
        description="New folder for the burst. Leave empty for one beside the .blend file, or a temporary one",
        subtype="DIR_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    countdown: FloatProperty(
        name="Countdown", description="Seconds to count down when all is well", default=3.0, min=0.0, max=60.0,
        subtype="TIME_ABSOLUTE", translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames", description="Number of depth frames of the burst; 30 take about a second", default=30, min=1,
        max=300, translation_context=CONTEXT,
    )  # fmt: skip
    mirrors: IntProperty(
        name="Mirrors", description="How many mirrors there are; the burst waits until so many are found", default=2,
        min=1, max=8, translation_context=CONTEXT,
    )  # fmt: skip
    rate: FloatProperty(
        name="Rate", description="Frames per second at which a recording is played", default=30.0, min=1.0, max=240.0,
        translation_context=CONTEXT,
    )  # fmt: skip
    fast: BoolProperty(
        name="Every Frame", description="Look at every frame of a recording, however long that takes", default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    ignore: EnumProperty(
        name="Ignore", description="Advice that the burst does not wait for", options={"ENUM_FLAG"},
        items=(
            ("ARMS", "Arms", "That arms hang at the body, or hide it"),
            ("FEET", "Feet", "That feet are hidden or cut off"),
            ("PEOPLE", "Second Person", "That somebody else is in the picture; a door that opens may look like it"),
            ("MIRRORS", "Mirrors", "That mirrors do not show the whole person"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    make_avatar: BoolProperty(
        name="Make Avatar", description="Make an avatar of the burst; else it is only loaded", default=True,
        translation_context=CONTEXT,
    )  # fmt: skip

    _seen = -1
    _pictures = ""

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if properties.is_property_set("source") and properties.source == "playback":
            return say("Play a recording as if it were a live camera, with the same advice")
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def proposal(self, context: bpy.types.Context) -> str:
        return context.scene.mirror_scan.capture_path

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        recording = ("rate", "fast") if self.source == "playback" else ()
        for name in ("mirrors", "countdown", "frames", "ignore", "make_avatar", "folder", *recording):
            # one below the other, since their words are too long for buttons side by side
            (layout.column() if name == "ignore" else layout).prop(self, name)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.source == "playback":
            return super().invoke(context, event)  # which asks for the recording
        self._asked = True
        if bpy.app.background:
            return self.run(context)
        return context.window_manager.invoke_props_dialog(self)  # how many mirrors there are cannot be guessed

    def run(self, context: bpy.types.Context) -> set[str]:
        result = super().run(context)
        if result == {"RUNNING_MODAL"}:
            look_from_front(context)
        else:
            self._forget_pictures()
        return result

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        serial = ""
        if self.source == "playback":
            serial = scan_records.absolute(scan_records.capture_root(self.filepath))
            if not serial:
                raise CaptureError(say("No recording is chosen; choose its folder or file"), code="not_loaded")
        import tempfile

        self._capture = _capture_folder(scan_records.absolute(self.folder))
        self._pictures = tempfile.mkdtemp(prefix="mirror_scan_live_")
        self._seen = -1
        source = {"camera": self.source, "serial": serial, "paced": not self.fast, "rate": self.rate,
                  "mirrors": self.mirrors}  # fmt: skip
        ignored = tuple(kind for group in sorted(self.ignore) for kind in IGNORED[group])
        shutter = {"countdown_s": self.countdown, "frames": self.frames, "ignore": ignored}
        return job_operators.Task("live_steps", (source, self._capture, self._pictures, shutter))

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            return super().execute(context)
        finally:
            if self._worker is None:  # no window's modal operator has it now
                self._forget_pictures()

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "TIMER":
            self._draw_newest(context)
        return super().modal(context, event)

    def cancel(self, context: bpy.types.Context) -> None:
        super().cancel(context)
        self._forget_pictures()

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result: str) -> None:
        text, kind = say("The burst is in {path}"), "INFO"
        if bpy.app.tempdir and os.path.realpath(result).startswith(os.path.realpath(bpy.app.tempdir)):
            text = say("The burst is in {path}, which is deleted when Blender ends; copy it if you want to keep it")
            kind = "WARNING"
        self.report({kind}, text.format(path=result))
        operator = bpy.ops.mirror_scan.scan_to_avatar if self.make_avatar else bpy.ops.mirror_scan.load_capture
        how = "INVOKE_DEFAULT" if self._asked and not bpy.app.background else "EXEC_DEFAULT"
        try:
            operator(how, filepath=result)
        except RuntimeError as error:  # what an operator reports as an error reaches callers so
            self.report({"ERROR"}, reason_of(str(error)))

    def _draw_newest(self, context: bpy.types.Context) -> None:
        from ..tasks.live_frames import newest_picture

        picture = newest_picture(self._pictures, self._seen)
        if picture is not None:
            self._seen = picture.number
            live_picture.show(picture)
            job_operators.redraw(context)

    def _forget_pictures(self) -> None:
        import shutil

        live_picture.show(None)
        if self._pictures:
            shutil.rmtree(self._pictures, ignore_errors=True)
            self._pictures = ""


def _capture_folder(wanted: str) -> str:
    """The folder for the burst: the wanted one, or a new one beside the file or among the session's temporary ones."""
    if wanted:
        scan_records.check_folder(wanted)
        return wanted
    beside = os.path.dirname(bpy.data.filepath) or bpy.app.tempdir
    number = 1
    while os.path.exists(os.path.join(beside, f"live_capture_{number:03d}")):
        number += 1
    return os.path.join(beside, f"live_capture_{number:03d}")


CLASSES = (MIRRORSCAN_OT_live_view,)
