"""Import a sequence: a body a frame of the timeline."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ...core.errors import CaptureError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records


class MIRRORSCAN_OT_import_sequence(bpy.types.Operator):
    """Show a sequence on the timeline: a closed body in each frame. Choose its folder or a file in it, or an .abc or .usd file"""  # noqa: E501

    bl_idname = "mirror_scan.import_sequence"
    bl_label = "Import Sequence"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Sequence", description="Folder with a mesh file for each frame, a file in it, or an .abc or .usd file",
        subtype="FILE_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    start: IntProperty(
        name="Start", description="Frame of the timeline that shows the first body", default=1,
        translation_context=CONTEXT,
    )  # fmt: skip
    every: IntProperty(
        name="Every", description="Show only every second, third … frame. 1 = all", default=1, min=1, soft_max=10,
        translation_context=CONTEXT,
    )  # fmt: skip
    set_range: BoolProperty(
        name="Set Timeline",
        description="Set the frame range and the frame rate of the scene to those of the sequence", default=True,
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = ""
        if context.mode != "OBJECT":
            problem = say("Switch to Object Mode first")
        elif job_operators.running(context):
            problem = say("Mirror Scan is busy; wait or press Esc")
        return scan_records.allows(cls, problem)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.filepath:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            name, count, first = self._shown(context)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        text = say("{name}: {count} frames from frame {start} on")
        self.report({"INFO"}, text.format(name=name, count=count, start=first))
        return {"FINISHED"}

    def _shown(self, context: bpy.types.Context) -> tuple[str, int, int]:
        """Show what was chosen; the name, the number of frames, and the first on the timeline."""
        from pathlib import Path

        from ...core.io.frame_files import frame_files, frame_place
        from ..scene.sequence_cache import CACHES, import_cache, set_rate

        if not self.filepath:
            raise CaptureError(say("No sequence is chosen; choose its folder or a file in it"))
        path, scene = Path(scan_records.absolute(self.filepath)), context.scene
        if not path.exists():
            raise CaptureError(say("{path}: there is no such file or folder; choose another").format(path=path))
        folder = path if path.is_dir() else path.parent
        rate = _rate(folder)
        if path.suffix.lower() in CACHES and path.is_file():
            first, last = scene.frame_start, scene.frame_end
            if self.set_range and rate:  # of Alembic: its times are seconds
                set_rate(scene, rate)
            try:
                made = import_cache(path)
            except RuntimeError as error:
                text = say("{path}: Blender cannot read it: {reason}")
                raise CaptureError(text.format(path=path, reason=error)) from error
            if not made:
                raise CaptureError(say("{path}: holds nothing to show").format(path=path))
            began, count = scene.frame_start, scene.frame_end - scene.frame_start + 1
            if not self.set_range:
                scene.frame_start, scene.frame_end = first, last
            return path.stem, count, began
        found = sorted(frame_files(folder), key=frame_place)
        files = _by_time(found, self.every)
        name, count = folder.name, frame_place(found[-1]) // self.every + 1
        self._objects(scene, name, files)
        if self.set_range:
            scene.frame_start, scene.frame_end = self.start, self.start + count - 1
            if rate:
                set_rate(scene, rate / self.every)
            scene.frame_set(self.start)
        return name, count, self.start

    def _objects(self, scene: bpy.types.Scene, name: str, files) -> None:
        """An object a frame in a collection of their own."""
        from ...core.avatar.avatar_file import read_body
        from ..scene.avatar_objects import discard_on_error
        from ..scene.sequence_cache import show_frames
        from ..scene.units import metres_per_unit

        with discard_on_error() as made:
            collection = bpy.data.collections.new(name)
            made.append(collection)
            scene.collection.children.link(collection)
            meshes = ((file.stem, read_body(file)) for file in files.values())  # one at a time in memory
            show_frames(meshes, [self.start + place for place in files], collection, metres_per_unit(scene))


def _by_time(found, every):
    """The file that is seen from each of every so many frames on, by the numbers in their names.

    Frames that were lost have no file: the one before is seen in their place.
    """
    from ...core.io.frame_files import frame_place

    steps = {-(-frame_place(file) // every): file for file in found}  # of several in one step the last
    last = frame_place(found[-1])
    return {step: file for step, file in steps.items() if step * every <= last} or {0: found[0]}


def _rate(folder):
    """Frames a second as the report in a sequence's folder says; None where it does not."""
    import json

    from ...core.io.frame_files import REPORT

    report = folder / REPORT
    if not report.is_file():
        return None
    try:
        return float(json.loads(report.read_text(encoding="utf-8")).get("rate") or 0.0) or None
    except (ValueError, AttributeError, TypeError) as error:
        raise CaptureError(
            say("{path}: is damaged; copy the sequence again, or remove this file").format(path=report)
        ) from error


CLASSES = (MIRRORSCAN_OT_import_sequence,)
