"""Lay a texture of the colour camera's pixels on an avatar."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, EnumProperty

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.preferred import preferred
from ..scene.properties import TEXTURE_SIZES
from ..scene.scan_records import armature_of, no_mesh, no_source, not_ours


class MIRRORSCAN_OT_texture(job_operators.JobOperator, bpy.types.Operator):
    """Lay a texture on the selected avatar: the colour camera's own pixels, seen directly and in the mirrors"""

    bl_idname = "mirror_scan.texture"
    bl_label = "Texture"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    size: EnumProperty(
        name="Size", description="Width and height of the texture",
        items=TEXTURE_SIZES, default="2048", translation_context=CONTEXT,
    )  # fmt: skip
    remove_light: BoolProperty(
        name="Remove Light",
        description="Remove the light and shadows of the room from the colours, as far as the views show them",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_mesh(context) or not_ours(context) or no_source(context)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        import numpy as np

        from ..scene import armature, avatar_objects, avatar_texture, capture_source

        avatar = context.object
        if not self.properties.is_property_set("size"):
            self.size = preferred("texture_size")
        avatar_texture.check_triangles(avatar)
        # where the camera saw it, not where the object stands now
        unit = capture_source.unit_as_built(avatar, context.scene)
        surface = avatar_objects.read_surface(avatar, np.full(3, unit))
        avatar_objects.check_finite(avatar, surface.vertices)
        weights = armature.read_weights(avatar) if armature_of(avatar) is not None else None
        source = capture_source.source_of(avatar, context.scene)
        self._uid = avatar.session_uid
        settings = {"size": int(self.size), "remove_light": self.remove_light}
        return job_operators.Task("texture_steps", (surface, weights, source, settings))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..interface.viewport import show_texture
        from ..scene import avatar_objects, avatar_texture, report_text

        avatar = avatar_objects.avatar_of(self._uid)
        avatar_texture.set_texture(avatar, result.texture)
        report = report_text.avatar_report(avatar) or {}
        report_text.set_report(avatar, report | {"texture": result.summary})
        show_texture(context)
        text = say("{name}: a texture of {size} × {size} pixels, {seen:.0%} of the skin seen")
        share = result.summary["seen_share"]
        self.report({"INFO"}, text.format(name=avatar.name, size=int(self.size), seen=share))


CLASSES = (MIRRORSCAN_OT_texture,)
