"""A capture to try everything with: the mannequin before a virtual rig, with the flaws that real cameras have."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import functools
import os

import bpy

from ..background import job_operators
from ..extension_root import ROOT_PACKAGE
from ..interface.viewport import look_from_camera
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.capture_objects import show_capture

FOLDER = "Sample Capture"
"""Below the extension's user folder; objects are named after it."""


class MIRRORSCAN_OT_sample_capture(job_operators.JobOperator, bpy.types.Operator):
    """Load a capture of a mannequin between two mirrors, to try everything without a camera. It is computed once and then kept"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.sample_capture"
    bl_label = "Sample Capture"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        self._folder = sample_folder()
        if os.path.isdir(self._folder):
            return job_operators.Task("load_steps", (self._folder, 0))
        return job_operators.Task("sample_steps", (self._folder,))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        points = show_capture(context, target, result)
        target.mirror_scan.capture_path, target.mirror_scan.frames = self._folder, 0
        if target == context.scene and not bpy.app.background and self._worker is None and context.area is not None:
            look_from_camera(context, points)
        count = len(points.data.vertices)
        self.report({"INFO"}, say("Sample capture: {points:,} points; build an avatar of it").format(points=count))


@functools.cache
def sample_folder() -> str:
    """Where the sample is kept: in the extension's user folder; in one of this session where there is none."""
    try:
        return os.path.join(bpy.utils.extension_path_user(ROOT_PACKAGE, create=True), FOLDER)
    except (ValueError, OSError):  # no extension, or nowhere to write
        import atexit
        import shutil
        import tempfile

        temporary = tempfile.mkdtemp(prefix="mirror_scan_sample_")
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        return os.path.join(temporary, FOLDER)


CLASSES = (MIRRORSCAN_OT_sample_capture,)
