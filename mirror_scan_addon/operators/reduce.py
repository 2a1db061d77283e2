"""An avatar with fewer triangles, or with quads."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, IntProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import scan_records
from ..scene.scan_records import no_mesh, not_ours
from ..scene.units import metres_per_unit

_FEWEST = 100
_GUIDE = 6  # triangles a quad of the surface that QuadriFlow is given; more only take longer
_LEAST_GUIDE = 20_000


class MIRRORSCAN_OT_reduce(job_operators.JobOperator, bpy.types.Operator):
    """Give the selected avatar fewer triangles; its shape, texture, colours and skin weights stay where they are"""

    bl_idname = "mirror_scan.reduce"
    bl_label = "Reduce"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    triangles: IntProperty(
        name="Triangles", description="Number of triangles to leave; two of them are one quad", default=8000,
        min=_FEWEST, soft_max=100_000, translation_context=CONTEXT,
    )  # fmt: skip
    quads: BoolProperty(
        name="Quads",
        description="Lay quads along the shape, for sculpting and subdivision. The texture is removed: it does not fit",
        default=False, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_mesh(context) or not_ours(context)
        if not problem and context.object.data.shape_keys is not None:
            text = say("{name} has shape keys, which a changed mesh would lose; remove or apply them first")
            problem = text.format(name=context.object.name)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import avatar_objects, reduced_mesh

        avatar = context.object
        self._uid = avatar.session_uid
        self._size = avatar_objects.size_of(avatar, metres_per_unit(context.scene))
        surface, texture = reduced_mesh.read_with_texture(avatar, self._size)
        avatar_objects.check_finite(avatar, surface.vertices)
        self._before = len(surface.vertices), len(surface.triangles)
        if self.quads:
            guide = max(_LEAST_GUIDE, _GUIDE * (self.triangles // 2))
            return job_operators.Task("reduce_steps", (surface, guide, None))
        if self.triangles >= len(surface.triangles):
            text = say("{name} has only {count:,} triangles; ask for fewer")
            raise OutputError(text.format(name=avatar.name, count=len(surface.triangles)), code="no_data")
        return job_operators.Task("reduce_steps", (surface, self.triangles, texture))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.mesh import Mesh
        from ..scene import armature, avatar_objects, avatar_texture, reduced_mesh, report_text

        avatar = avatar_objects.avatar_of(self._uid)
        avatar.data.calc_loop_triangles()
        if (len(avatar.data.vertices), len(avatar.data.loop_triangles)) != self._before:
            raise OutputError(
                say("{name} was changed meanwhile; reduce it again").format(name=avatar.name), code="no_data"
            )
        if self.quads:
            guide = Mesh(result.mesh.vertices / self._size, result.mesh.triangles)
            with armature.object_mode(context, target):
                reduced_mesh.quad_remesh(avatar, max(self.triangles // 2, 1), guide)
            avatar_texture.drop_texture(avatar)
        else:
            reduced_mesh.put_triangles(avatar, result, self._size)
            for note in result.notes:
                self.report({"WARNING"}, tell(note))
        report = report_text.avatar_report(avatar)
        if report:
            report.pop("problems", None)  # of places on the old mesh
            triangles = sum(len(polygon.vertices) - 2 for polygon in avatar.data.polygons)
            report.setdefault("mesh", {}).update(vertices=len(avatar.data.vertices), triangles=triangles)
            report_text.set_report(avatar, report)
        if target == context.scene:
            avatar_objects.select_only(context, avatar)
        text = say("{name}: {before:,} triangles became {after:,} quads") if self.quads else say(
            "{name}: {before:,} triangles became {after:,}"
        )  # fmt: skip
        count = len(avatar.data.polygons)
        self.report({"INFO"}, text.format(name=avatar.name, before=self._before[1], after=count))


CLASSES = (MIRRORSCAN_OT_reduce,)
