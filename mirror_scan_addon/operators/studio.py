"""Show an avatar: a studio to render it in, and its place in the asset library."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.scan_records import no_mesh, not_ours
from ..scene.units import metres_per_unit

FROM = (0.42, -0.9, 0.12)
"""Where the viewer of an asset's picture stands, in the avatar frame."""


class MIRRORSCAN_OT_add_studio(bpy.types.Operator):
    """Set up lights, a camera and a backdrop around the selected avatar, in their own collection. F12 renders it"""

    bl_idname = "mirror_scan.add_studio"
    bl_label = "Add Studio"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or no_mesh(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        import numpy as np

        from ..scene import avatar_objects, studio

        try:
            avatar_objects.check_finite(context.object, np.array(context.object.matrix_world))
            studio.add_studio(context.scene, context.object)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        self.report({"INFO"}, say("{name}: press F12 for a picture").format(name=context.object.name))
        return {"FINISHED"}


class MIRRORSCAN_OT_remove_studio(bpy.types.Operator):
    """Remove the studio. The scene gets its camera, resolution and view transform back"""

    bl_idname = "mirror_scan.remove_studio"
    bl_label = "Remove Studio"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context)
        if not problem and scan_records.studio_of(context.scene) is None:
            problem = say("There is no studio in this scene")
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..scene import studio

        studio.remove_studio(context.scene)
        return {"FINISHED"}


class MIRRORSCAN_OT_mark_as_asset(job_operators.JobOperator, bpy.types.Operator):
    """Put the selected avatar into the asset browser, with a picture of it"""

    bl_idname = "mirror_scan.mark_as_asset"
    bl_label = "Mark as Asset"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_mesh(context) or not_ours(context)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import avatar_objects

        avatar = context.object
        self._uid = avatar.session_uid
        surface = avatar_objects.read_surface(avatar, avatar_objects.size_of(avatar, metres_per_unit(context.scene)))
        avatar_objects.check_finite(avatar, surface.vertices)
        return job_operators.Task("picture_steps", (surface, FROM))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..scene import avatar_objects

        avatar = avatar_objects.avatar_of(self._uid)
        avatar.asset_mark()
        avatar_objects.set_picture(avatar, result)
        text = say(
            "{name} is in the asset browser; save the file into a folder of an asset library to use it elsewhere"
        )
        self.report({"INFO"}, text.format(name=avatar.name))


CLASSES = (MIRRORSCAN_OT_add_studio, MIRRORSCAN_OT_remove_studio, MIRRORSCAN_OT_mark_as_asset)
