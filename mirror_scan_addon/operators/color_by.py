"""Choose what the colours of an avatar show."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import EnumProperty

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import kept_errors, scan_records
from ..scene.scan_records import no_mesh, not_ours


class MIRRORSCAN_OT_color_by(bpy.types.Operator):
    """Choose what the colours of the selected avatar show"""

    bl_idname = "mirror_scan.color_by"
    bl_label = "Colour By"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    mode: EnumProperty(
        name="Colour By", description="What the colours show",
        items=(
            ("CAPTURE", "Capture", "The colours of the capture"),
            ("VIEW", "View", "Which view saw the surface: direct yellow, each mirror its own colour, no view grey"),
            ("KIND", "Kind", "How the surface was made: measured grey, seam between two views red, filled blue"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        return say(properties.bl_rna.properties["mode"].enum_items[properties.mode].description)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or no_mesh(context) or not_ours(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self._show(context)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, kept_errors.keep(context, self, error))
            return {"CANCELLED"}
        kept_errors.forget(context, self)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D" and space.shading.type == "SOLID":
            space.shading.color_type = "VERTEX"
        return {"FINISHED"}

    def _show(self, context: bpy.types.Context) -> None:
        import numpy as np

        from ...core.errors import OutputError
        from ...core.preview import palette
        from ..scene import avatar_objects

        avatar = context.object
        data = avatar.data
        label, domain, colors_of = {
            "CAPTURE": (avatar_objects.COLOR, None, None),
            "VIEW": (avatar_objects.VIEW, "POINT", palette.view_colors),
            "KIND": (avatar_objects.KIND, "FACE", palette.kind_colors),
        }[self.mode]
        name = avatar_objects.DERIVED.get(self.mode, avatar_objects.COLOR)
        if colors_of is None:
            if data.color_attributes.get(avatar_objects.COLOR) is None:
                raise OutputError(say("{name} has no colours from a capture").format(name=avatar.name), code="no_data")
        else:
            values = avatar_objects.integers(data, label, domain)
            if values is None:
                text = say("{name} does not have this data; select an avatar that Mirror Scan built")
                raise OutputError(text.format(name=avatar.name), code="no_data")
            if self.mode == "KIND" and (values.min() < 0 or values.max() > 2):
                text = say("{name}: the data of how its surface was made is damaged; build the avatar again")
                raise OutputError(text.format(name=avatar.name), code="no_data")
            colors = colors_of(values)
            if domain == "FACE":  # Blender keeps the colours of a face at its corners
                totals = np.empty(len(data.polygons), np.int32)
                data.polygons.foreach_get("loop_total", totals)
                colors = np.repeat(colors, totals, axis=0)
            avatar_objects.set_colors(data, name, colors, "POINT" if domain == "POINT" else "CORNER")
        avatar_objects.show_colors(avatar, name)
        for other in avatar_objects.DERIVED.values():
            if other != name and (attribute := data.attributes.get(other)) is not None:
                data.attributes.remove(attribute)
        avatar_objects.show_colors(avatar, name)  # their indices have changed


CLASSES = (MIRRORSCAN_OT_color_by,)
