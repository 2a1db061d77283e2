"""Move an avatar: a motion file, or one of our own clips."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...core.errors import CaptureError, OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.scan_records import armature_of, no_skeleton

CLIPS = (
    ("FILE", "File", "A motion file, BVH or FBX"),
    ("idle", "Idle", "Standing at ease"),
    ("walk", "Walk", "Walking"),
    ("arms_up", "Arms Up", "Both arms raised and lowered"),
    ("squat", "Squat", "Down and up again"),
    ("turn", "Turn", "The trunk turned to both sides"),
)
SUFFIXES = (".bvh", ".fbx")


class MIRRORSCAN_OT_apply_motion(job_operators.FileJobOperator, bpy.types.Operator):
    """Move the selected avatar by a motion file (BVH or FBX), whatever its skeleton, or by one of the clips"""

    bl_idname = "mirror_scan.apply_motion"
    bl_label = "Apply Motion"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="File", description="Motion file, BVH or FBX", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.bvh;*.fbx", options={"HIDDEN"})
    clip: EnumProperty(
        name="Clip", description="What moves the avatar", items=CLIPS, default="FILE", options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip
    in_place: BoolProperty(
        name="In Place", description="Stay in one place: leave out the movement across the floor", default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    lock_feet: BoolProperty(
        name="Lock Feet", description="Keep standing feet from sliding and from sinking into the floor", default=True,
        translation_context=CONTEXT,
    )  # fmt: skip
    loop: BoolProperty(
        name="Loop", description="Blend the end into the start and repeat the motion endlessly", default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    fit_range: BoolProperty(
        name="Fit Frame Range", description="Set the scene's first and last frame to the motion's", default=True,
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if properties.clip == "FILE":
            return ""
        clip = properties.bl_rna.properties["clip"].enum_items[properties.clip]
        return say("Move the selected avatar. {what}").format(what=say(clip.description))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or no_skeleton(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.clip != "FILE":
            return self.run(context)
        return super().invoke(context, event)

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(heading="Motion", heading_ctxt=CONTEXT)
        column.use_property_split = True
        for name in ("in_place", "lock_feet", "loop", "fit_range"):
            column.prop(self, name)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        import os

        from ...core.motion import palm_directions, sole_points
        from ..scene import armature

        source = self.clip
        if source == "FILE":
            if not self.filepath:
                raise CaptureError(
                    say("No motion is chosen; choose a BVH or FBX file, or one of the clips"), code="motion"
                )
            source = scan_records.absolute(self.filepath)
            ending = os.path.splitext(source)[1].lower()
            if ending not in SUFFIXES:
                text = say("{path}: is not a motion file; choose a BVH or FBX file")
                raise CaptureError(text.format(path=source), code="motion")
            if ending == ".fbx":
                from ..scene.fbx_motion import read_fbx_motion

                source = read_fbx_motion(source)
        avatar, bones = armature.body_of(context.object), armature_of(context.object)
        self._uid = bones.session_uid
        self._unit = armature.unit_of(bones, context.scene)
        rigged = armature.read_avatar(avatar, self._unit)
        skin = rigged.mesh.vertices, rigged.weights, rigged.skeleton
        rate = context.scene.render.fps / context.scene.render.fps_base
        options = {"in_place": self.in_place, "lock_feet": self.lock_feet, "loop": self.loop}
        return job_operators.Task(
            "motion_steps", (source, rigged.skeleton, sole_points(*skin), palm_directions(*skin), rate, options)
        )

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..scene import armature, avatar_objects, rig_controls

        bones = avatar_objects.object_of(self._uid)
        if bones is None:
            raise OutputError(say("The skeleton no longer exists"), code="no_skeleton")
        armature.add_clip(bones, result, self._unit, start=target.frame_start)
        if rig_controls.switch_controls(bones, False):
            self.report({"INFO"}, say("The IK controls are off while the motion moves the limbs"))
        if self.fit_range:
            target.frame_end = target.frame_start + len(result) - 1
            target.frame_set(target.frame_start)
        text = say("{name}: {motion}, {count} frames, {seconds:.1f} s")
        self.report(
            {"INFO"},
            text.format(name=bones.name, motion=result.name, count=len(result), seconds=result.duration),
        )


class MIRRORSCAN_FH_motion(bpy.types.FileHandler):
    bl_idname = "MIRRORSCAN_FH_motion"
    bl_label = "Apply Motion"
    bl_import_operator = "mirror_scan.apply_motion"
    bl_file_extensions = ".bvh"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D" and not no_skeleton(context)


CLASSES = (MIRRORSCAN_OT_apply_motion, MIRRORSCAN_FH_motion)
