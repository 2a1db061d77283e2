"""Load or record a capture, and show its points in the viewport."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import CollectionProperty, EnumProperty, IntProperty, StringProperty

from ...core.errors import CaptureError
from ..background import job_operators
from ..interface.viewport import look_from_camera
from ..language.texts import CONTEXT, say, tell
from ..scene import scan_records
from ..scene.capture_objects import show_capture
from ..scene.preferred import drop_makes


class MIRRORSCAN_OT_load_capture(job_operators.FileJobOperator, bpy.types.Operator):
    """Load a capture of a depth camera and show it as coloured points. Choose the folder or any file of the capture"""

    bl_idname = "mirror_scan.load_capture"
    bl_label = "Load Capture"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Capture", description="Folder or file of the capture", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    mirrors_filepath: StringProperty(
        name="Mirrors", description="File with points picked on the mirrors' frames. Leave empty to use the capture's",
        subtype="FILE_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst are averaged. 0 = all. Taken from the scene unless given",
        default=0, min=0, soft_max=60, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if properties.filepath:
            return say("Load {path} again").format(path=properties.filepath)
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def proposal(self, context: bpy.types.Context) -> str:
        return context.scene.mirror_scan.capture_path

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "frames")
        header, body = layout.panel("mirror_scan_load_options", default_closed=True)
        header.label(text="Load Options", text_ctxt=CONTEXT)
        if body is None:  # folded: most captures say all of it themselves
            return
        body.prop(self, "mirrors_filepath")
        for name in scan_records.READING:
            body.prop(context.scene.mirror_scan.reading, name)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        settings = context.scene.mirror_scan
        path = scan_records.absolute(scan_records.capture_root(self.filepath or settings.capture_path))
        if not path:
            raise CaptureError(say("No capture is chosen; choose its folder or file"), code="not_loaded")
        frames = self.frames if self.properties.is_property_set("frames") else settings.frames
        self._path, self._frames = scan_records.capture_root(self.filepath or settings.capture_path), frames
        mirrors = scan_records.absolute(self.mirrors_filepath)
        return job_operators.Task("load_steps", (path, frames, mirrors, scan_records.reading_of(settings)))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        cloud = show_capture(context, target, result)
        settings = target.mirror_scan
        settings.capture_path, settings.frames = self._path, self._frames
        if self._asked:
            look_from_camera(context, cloud)
        count = len(cloud.data.vertices)
        for note in result.info["notes"]:
            self.report({"WARNING"}, tell(note))
        for mirror in settings.mirrors:
            if complaint := scan_records.complaint_of(mirror):
                self.report({"WARNING"}, tell(complaint))
        text = say("{name}: {format}, {points:,} points, mirrors: {mirrors}").format(
            name=result.info["name"], format=result.info["format"], points=count, mirrors=len(settings.mirrors)
        )
        self.report({"INFO"}, text)


class MIRRORSCAN_OT_record(job_operators.FileJobOperator, bpy.types.Operator):
    """Record a burst from a connected depth camera to a new folder and load it. The person must hold still meanwhile"""

    bl_idname = "mirror_scan.record"
    bl_label = "Record"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Folder", description="New folder for the recording", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    camera: EnumProperty(
        name="Camera", description="Which camera to record from",
        items=(("realsense", "Intel RealSense", "Any RealSense depth camera; needs the Python package pyrealsense2"),),
        translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames", description="Number of depth frames to record; 30 take about a second", default=30, min=1,
        soft_max=90, max=500, translation_context=CONTEXT,
    )  # fmt: skip

    poll = MIRRORSCAN_OT_load_capture.poll

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        folder = scan_records.absolute(self.filepath)
        if not folder:
            raise CaptureError(say("Enter the name of a new folder for the recording"))
        scan_records.check_folder(folder)
        return job_operators.Task("record_steps", (self.camera, folder, self.frames))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        cloud = show_capture(context, target, result)
        target.mirror_scan.capture_path = self.filepath
        if self._asked:
            look_from_camera(context, cloud)
        self.report({"INFO"}, say("Recorded to {path}").format(path=self.filepath))


CAPTURES = ".json;.mkv;.bag;.db3;.oni;.pcd;.npz;.r3d;.dump;.pclzf"
"""Endings of files that are a capture, or lie in one, and that nothing else in Blender takes."""

PICTURES = ".png;.jpg;.jpeg;.ply"
"""Endings of files of a capture that Blender itself takes in the viewport."""


def in_viewport(context: bpy.types.Context) -> bool:
    """Whether something is dropped into a 3D viewport."""
    return context.area is not None and context.area.type == "VIEW_3D"


def on_sidebar(context: bpy.types.Context) -> bool:
    """Whether something is dropped on a 3D viewport's sidebar."""
    return in_viewport(context) and context.region is not None and context.region.type == "UI"


class Dropped:
    """What a dropped file is asked for: Blender's menu shows the names of operators, so these say it in the user's
    words and hand the file on."""

    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL"}

    filepath: StringProperty(
        name="Capture", description="A file of the capture", subtype="FILE_PATH", options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    _makes = ""  # the operator that it is handed on to

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self._hand_on("INVOKE_DEFAULT")

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._hand_on("EXEC_DEFAULT")

    def _hand_on(self, how: str) -> set[str]:
        import os

        from ..scene.blender_files import reason_of

        captures = {scan_records.capture_root(os.path.join(self.directory, file.name)) for file in self.files}
        if len(captures) > 1:
            text = say("Only {path} is taken; drop one capture at a time")
            self.report({"WARNING"}, text.format(path=scan_records.capture_root(self.filepath)))
        operator = getattr(bpy.ops.mirror_scan, self._makes)
        try:
            return operator(how, True, filepath=self.filepath) - {"RUNNING_MODAL"} or {"FINISHED"}
        except RuntimeError as error:  # what an operator reports as an error reaches callers so
            self.report({"ERROR"}, reason_of(str(error)))
            return {"CANCELLED"}


class MIRRORSCAN_OT_drop_look(Dropped, bpy.types.Operator):
    """Load the dropped capture and show its points"""

    bl_idname = "mirror_scan.drop_look"
    bl_label = "Only Look"
    _makes = "load_capture"


class MIRRORSCAN_FH_capture(bpy.types.FileHandler):
    """Captures dropped into a 3D viewport; to load a folder, drop any JSON file in it."""

    bl_idname = "MIRRORSCAN_FH_capture"
    bl_label = "Only Look (Mirror Scan)"
    bl_import_operator = "mirror_scan.drop_look"
    bl_file_extensions = CAPTURES

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return in_viewport(context) and drop_makes("LOOK")


class MIRRORSCAN_FH_picture(bpy.types.FileHandler):
    """Images of a capture dropped on the sidebar; in the viewport itself Blender makes them reference images."""

    bl_idname = "MIRRORSCAN_FH_picture"
    bl_label = "Only Look (Mirror Scan)"
    bl_import_operator = "mirror_scan.drop_look"
    bl_file_extensions = PICTURES

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return on_sidebar(context) and drop_makes("LOOK")


CLASSES = (
    MIRRORSCAN_OT_load_capture,
    MIRRORSCAN_OT_record,
    MIRRORSCAN_OT_drop_look,
    MIRRORSCAN_FH_capture,
    MIRRORSCAN_FH_picture,
)
