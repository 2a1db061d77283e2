"""Capture folder → avatar in the scene."""

import bpy
from bpy.props import IntProperty, StringProperty

from ...core.errors import CaptureError
from .. import jobs, kernels, scene


class MIRRORSCAN_OT_build_avatar(jobs.JobOperator, bpy.types.Operator):
    """Reconstruct the captured person as a closed, coloured mesh"""

    bl_idname = "mirror_scan.build_avatar"
    bl_label = "Build Avatar"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Capture",
        description="Folder of the capture. Leave empty for the one chosen in the scene",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    mirrors_filepath: StringProperty(
        name="Mirrors",
        description="File with points picked on the mirrors' frames. Leave empty for the one chosen in the scene",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst to average, 0 for all. Taken from the scene unless given",
        default=0,
        min=0,
        soft_max=60,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave the editing mode first: the avatar is added in Object Mode")
            return False
        if not context.scene.is_editable:
            cls.poll_message_set("The scene is linked from another file and cannot be changed")
            return False
        if jobs.running(context):
            cls.poll_message_set("Mirror Scan is busy; wait or press Esc")
            return False
        return True

    def start(self, context: bpy.types.Context) -> jobs.Job:
        settings = context.scene.mirror_scan
        path = _absolute(self.filepath or settings.capture_path)
        if not path:
            raise CaptureError("No capture chosen; set the capture folder in the Mirror Scan tab of the sidebar")
        mirrors_path = _absolute(self.mirrors_filepath or settings.mirrors_path)
        frames = self.frames if self.properties.is_property_set("frames") else settings.frames
        return build_steps(path, mirrors_path, frames)

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        # The user may be in another scene by now; the avatar belongs where the button was pressed.
        here = target == context.scene
        collection = context.collection if here else target.collection
        if not collection.is_editable or (here and context.layer_collection.exclude):
            collection = target.collection
        avatar = scene.create_avatar(result.mesh, collection=collection, report=result.report)
        if here:
            scene.select_only(context, avatar)
        dropped = len(result.mesh.triangles) - len(avatar.data.polygons)
        if dropped:
            self.report({"WARNING"}, f"{avatar.name}: Blender removed {dropped} degenerate or doubled faces")
        for warning in result.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"{avatar.name}: {len(avatar.data.vertices):,} vertices")


def _absolute(path: str) -> str:
    """A path as the user typed it, made absolute; “//” stands for the .blend's folder."""
    if path.startswith("//") and not bpy.data.filepath:
        raise CaptureError(f"{path}: is relative to the .blend file, which has no place yet; save it first")
    return bpy.path.abspath(path)


def build_steps(path: str, mirrors_path: str, frames: int) -> jobs.Job:
    """The job: read, then reconstruct; core's heavy modules are imported here, when somebody asks for them."""
    yield 0.0, "Preparing (compiles once, at the first use)"
    kernels.prepare_kernels()
    from ...core.capture import open_capture
    from ...core.capture.rgbd_folder import read_mirrors

    yield 0.02, "Reading the capture"
    capture = open_capture(path, frames or None)
    mirrors = read_mirrors(mirrors_path, capture.intrinsics) if mirrors_path else None
    from ...core.pipeline import reconstruction_steps

    steps = reconstruction_steps(capture, mirrors)
    while True:
        try:
            fraction, message = next(steps)
        except StopIteration as end:
            return end.value
        yield 0.05 + 0.95 * fraction, message
