"""Give an avatar a skeleton, and take another rest pose."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import kept_errors, scan_records
from ..scene.scan_records import armature_of, has_controls, no_mesh, no_skeleton, not_ours
from ..scene.units import metres_per_unit

UNSURE = 0.5  # confidence below which a joint is named as one to look at


class MIRRORSCAN_OT_add_skeleton(job_operators.JobOperator, bpy.types.Operator):
    """Find the joints of the selected avatar and give it a skeleton with skin weights, ready to be moved"""

    bl_idname = "mirror_scan.add_skeleton"
    bl_label = "Add Skeleton"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    controls: BoolProperty(
        name="IK Controls", description="Add a bone for each hand and foot that the arm or leg follows",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    metarig: BoolProperty(
        name="Rigify Metarig",
        description="Also add Rigify's human metarig, fitted to the joints, from which Rigify makes its own rig",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_mesh(context) or not_ours(context)
        if not problem and armature_of(context.object) is not None:
            problem = say("{name} has a skeleton already; delete that first").format(name=context.object.name)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import avatar_objects, avatar_texture

        avatar = context.object
        size = avatar_objects.even_size_of(avatar, metres_per_unit(context.scene))
        _check_shape_keys(avatar)
        surface = avatar_objects.read_surface(avatar, size)
        avatar_objects.check_finite(avatar, surface.vertices)
        self._uid, self._size = avatar.session_uid, float(size.mean())
        texture = avatar_texture.read_places(avatar)
        return job_operators.Task("skeleton_steps", (surface,) if texture is None else (surface, texture))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.avatar.skeleton import BONES
        from ..scene import armature, avatar_objects, avatar_texture, rig_controls, scan_collections

        avatar = avatar_objects.avatar_of(self._uid)
        if len(result.mesh.vertices) != len(avatar.data.vertices):
            material = avatar_texture.material_of(avatar.data)
            avatar_objects.refine(avatar, result.mesh, self._size)
            if result.texture is not None:
                avatar_texture.put_uv(avatar.data, result.texture, material)
        with armature.object_mode(context, target):
            home = _own_collection(avatar, target)
            bones = armature.add_armature(avatar, result.skeleton, result.weights, home, self._size)
            if self.controls:
                rig_controls.add_controls(bones)
            if self.metarig:
                scan_collections.move_to(rig_controls.add_metarig(avatar, result.skeleton, self._size), home)
        if target == context.scene:
            avatar_objects.select_only(context, avatar)
        unsure = [name for name, known in zip(BONES, result.skeleton.confidence, strict=True) if known < UNSURE]
        if unsure:
            text = say("{name}: look at these joints, they are less certain: {joints}")
            self.report({"WARNING"}, text.format(name=avatar.name, joints=", ".join(unsure)))
        text = say("{name}: a skeleton of {count} bones").format(name=avatar.name, count=len(BONES))
        self.report({"INFO"}, text)


class MIRRORSCAN_OT_rest_in_t_pose(bpy.types.Operator):
    """Make the T-pose the rest pose of the selected avatar, for motions and programs that expect it"""

    bl_idname = "mirror_scan.rest_in_t_pose"
    bl_label = "T-Pose as Rest"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_skeleton(context)
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.motion import t_pose, take_as_rest
        from ..scene import armature

        bones = armature_of(context.object)
        try:
            avatar = armature.body_of(context.object)
            _check_shape_keys(avatar)
            size = armature.unit_of(avatar, context.scene)
            had_motion = armature.action_of(bones) is not None
            shared = [armature.make_own(item) for item in (avatar, bones)]
            rigged = armature.read_avatar(avatar, size)
            vertices, skeleton = take_as_rest(
                rigged.mesh.vertices, rigged.weights, rigged.skeleton, t_pose(rigged.skeleton)
            )
            with armature.object_mode(context, context.scene):
                armature.move_rest(avatar, bones, vertices, skeleton, size)
            avatar[scan_records.RESTS_OTHERWISE] = True
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, kept_errors.keep(context, self, error))
            return {"CANCELLED"}
        kept_errors.forget(context, self)
        if any(shared):
            text = say("{name}: others shared its mesh or its bones and keep them as they are; it has its own now")
            self.report({"INFO"}, text.format(name=avatar.name))
        if had_motion:
            self.report({"WARNING"}, say("The motion was of the old rest pose and is no longer played; apply it again"))
        return {"FINISHED"}


class MIRRORSCAN_OT_use_controls(bpy.types.Operator):
    """Have hands and feet follow their IK control bones, or follow the motion again"""

    bl_idname = "mirror_scan.use_controls"
    bl_label = "Use IK Controls"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    on: BoolProperty(
        name="On", description="Follow the control bones", default=True, options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_skeleton(context)
        if not problem and not has_controls(armature_of(context.object)):
            problem = say("The skeleton has no IK controls; delete it, and turn on “IK Controls” in Add Skeleton")
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..scene import rig_controls

        rig_controls.switch_controls(armature_of(context.object), self.on)
        return {"FINISHED"}


def _check_shape_keys(avatar: bpy.types.Object) -> None:
    if avatar.data.shape_keys is not None:
        text = say("{name} has shape keys, which a changed mesh would lose; remove or apply them first")
        raise OutputError(text.format(name=avatar.name), code="avatar")


def _own_collection(avatar: bpy.types.Object, target: bpy.types.Scene) -> bpy.types.Collection:
    """The collection for a skeleton: its scan's, else a new one, named after the avatar, beside it."""
    from ..scene import scan_collections

    scan = scan_collections.scan_around(avatar, target)
    if scan is not None and not scan_collections.is_version(avatar):
        home = scan_collections.part_of(scan, scan_collections.RIG)
        for layer in target.view_layers:
            scan_collections.show_in_layer(home, layer)
        return home
    collection = bpy.data.collections.new(f"{avatar.name} Skeleton")
    beside = next((owner for owner in avatar.users_collection if owner in target.collection.children_recursive), None)
    (beside or target.collection).children.link(collection)
    return collection


CLASSES = (MIRRORSCAN_OT_add_skeleton, MIRRORSCAN_OT_rest_in_t_pose, MIRRORSCAN_OT_use_controls)
