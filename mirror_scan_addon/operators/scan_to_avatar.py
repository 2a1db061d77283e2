"""One press: from a capture's file to the avatar."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import IntProperty, StringProperty

from ...core.errors import CaptureError
from ..background import job_operators
from ..interface.viewport import FRONT, look_from_camera
from ..language.texts import CONTEXT, say, tell
from ..scene import kept_errors, scan_collections, scan_records
from ..scene.capture_objects import show_capture
from ..scene.preferred import drop_makes
from .build_avatar import MIRRORSCAN_OT_build_avatar
from .load_capture import CAPTURES, PICTURES, Dropped, in_viewport, on_sidebar


class MIRRORSCAN_OT_scan_to_avatar(job_operators.FileJobOperator, bpy.types.Operator):
    """Make an avatar of a capture: load it, find its mirrors and build. Choose its folder or any file of it"""

    bl_idname = "mirror_scan.scan_to_avatar"
    bl_label = "Scan to Avatar"
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

    _aligns = True
    _turn = FRONT  # as after Load Capture, which turns the view to the person's front
    _put_avatar = MIRRORSCAN_OT_build_avatar.finish

    @property
    def _frame_view(self) -> bool:
        return self._asked

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def proposal(self, context: bpy.types.Context) -> str:
        return context.scene.mirror_scan.capture_path

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.prop(self, "frames")

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        settings = context.scene.mirror_scan
        root = scan_records.capture_root(self.filepath or settings.capture_path)
        path = scan_records.absolute(root)
        if not path:
            raise CaptureError(say("No capture is chosen; choose its folder or file"), code="not_loaded")
        frames = self.frames if self.properties.is_property_set("frames") else settings.frames
        reading, options = scan_records.reading_of(settings), scan_records.build_settings(settings)
        options["views"] |= {"click": None}  # that of another capture
        self._root, self._built_from = root, (path, frames, reading)
        self._source = {"path": path, "name": scan_collections.capture_name(path)}
        self._keep = settings.keep_versions
        mirrors, offset = scan_records.absolute(self.mirrors_filepath), scan_records.behind_frame(settings)
        return job_operators.Task("scan_steps", (path, frames, mirrors, options, reading, offset))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        cloud = show_capture(context, target, result.loaded)
        settings = target.mirror_scan
        settings.capture_path, settings.frames = self._root, self._built_from[1]
        for note in result.loaded.info["notes"]:
            self.report({"WARNING"}, tell(note))
        if result.problem is None:
            self._put_avatar(context, target, result.built)
            return
        # The points stay: they show what is wrong, and the cure is to be clicked on them.
        if self._asked:
            look_from_camera(context, cloud)
        self.report({"ERROR"}, kept_errors.keep(context, self, result.problem))


class MIRRORSCAN_OT_drop_avatar(Dropped, bpy.types.Operator):
    """Load the dropped capture and make an avatar of it"""

    bl_idname = "mirror_scan.drop_avatar"
    bl_label = "Make Avatar"
    _makes = "scan_to_avatar"


class MIRRORSCAN_FH_avatar(bpy.types.FileHandler):
    """Captures dropped into a 3D viewport, of which an avatar is made; Blender asks whether to do this or only look."""

    bl_idname = "MIRRORSCAN_FH_avatar"
    bl_label = "Make Avatar (Mirror Scan)"
    bl_import_operator = "mirror_scan.drop_avatar"
    bl_file_extensions = CAPTURES

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return in_viewport(context) and drop_makes("AVATAR")


class MIRRORSCAN_FH_avatar_picture(bpy.types.FileHandler):
    """The same for images of a capture, dropped on the sidebar."""

    bl_idname = "MIRRORSCAN_FH_avatar_picture"
    bl_label = "Make Avatar (Mirror Scan)"
    bl_import_operator = "mirror_scan.drop_avatar"
    bl_file_extensions = PICTURES

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return on_sidebar(context) and drop_makes("AVATAR")


CLASSES = (
    MIRRORSCAN_OT_scan_to_avatar,
    MIRRORSCAN_OT_drop_avatar,
    MIRRORSCAN_FH_avatar,
    MIRRORSCAN_FH_avatar_picture,
)
