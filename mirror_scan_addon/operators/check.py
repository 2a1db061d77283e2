"""Check an avatar, and show its problems."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import EnumProperty, IntProperty

from ..background import job_operators
from ..interface.viewport import show_within, upright_look, viewport
from ..language.texts import CONTEXT, say
from ..scene import report_text, scan_records
from ..scene.scan_records import no_mesh, not_ours
from ..scene.units import metres_per_unit


class MIRRORSCAN_OT_check(job_operators.JobOperator, bpy.types.Operator):
    """Check whether the selected mesh is closed, in one piece and does not intersect itself, and list its problems"""

    bl_idname = "mirror_scan.check"
    bl_label = "Check Avatar"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or scan_records.no_avatar(context) or not_ours(context)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import avatar_objects

        avatar = context.object
        self._uid = avatar.session_uid
        self._size = avatar_objects.size_of(avatar, metres_per_unit(context.scene))
        surface = avatar_objects.read_surface(avatar, self._size)
        avatar_objects.check_finite(avatar, surface.vertices)
        self._height = float(surface.vertices[:, 2].max() - surface.vertices[:, 2].min())
        return job_operators.Task("check_steps", (surface,))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.errors import OutputError
        from ..scene import avatar_objects

        avatar = avatar_objects.object_of(self._uid)
        if avatar is None:
            raise OutputError(say("The object that was checked no longer exists"), code="no_data")
        report = report_text.avatar_report(avatar) or {}
        mesh = report.setdefault("mesh", {})
        mesh.update({name: value for name, value in result.report.items() if name != "min_angle_deg"})
        mesh["height_m"] = self._height
        if result.report.get("volume_m3") is not None:
            mesh["volume_l"] = 1000.0 * result.report["volume_m3"]
        else:
            mesh.pop("volume_l", None)
        report["problems"] = [
            # in the object's own frame, so that they move along with it; sizes are in metres
            place | {name: (self._size**-1 * place[name]).tolist() for name in ("point", "normal")}
            for place in result.problems
        ]
        report_text.set_report(avatar, report)
        target.mirror_scan.problem_index = 0
        if result.problems:
            worst = report_text.problem_text(result.problems[0], target)
            text = say("{name}: problems found: {count}; the worst: {worst}")
            self.report({"INFO"}, text.format(name=avatar.name, count=len(result.problems), worst=worst))
        else:
            self.report({"INFO"}, say("{name}: closed, in one piece, no problems found").format(name=avatar.name))


class MIRRORSCAN_OT_jump_to_problem(bpy.types.Operator):
    """Show a problem of the selected avatar and mark it"""

    bl_idname = "mirror_scan.jump_to_problem"
    bl_label = "Jump to Problem"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER"}

    direction: EnumProperty(
        name="Direction", description="Which problem to show",
        items=(("NEXT", "Next", "The next problem"), ("PREVIOUS", "Previous", "The previous problem"),
               ("NUMBER", "Number", "The problem with the given number")),
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    number: IntProperty(
        name="Number", description="Number of the problem, counted from 1", default=1, min=1,
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if properties.direction == "NUMBER":
            return say("Show a problem of the selected avatar and mark it")
        if properties.direction == "NEXT":
            return say("Show the next problem of the selected avatar and mark it")
        return say("Show the previous problem of the selected avatar and mark it")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = no_mesh(context)
        if not problem and not context.scene.is_editable:
            problem = say("The scene is linked from another file and cannot be changed; use a scene of this file")
        if not problem:
            report = report_text.avatar_report(context.object)
            if report is None or "problems" not in report:
                problem = say("Check the avatar first")
            elif not report["problems"]:
                problem = say("The avatar has no problems")
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings, avatar = context.scene.mirror_scan, context.object
        problems = report_text.problems_of(report_text.avatar_report(avatar))
        if not problems:
            self.report({"ERROR"}, say("The list of problems is damaged; check the avatar again"))
            return {"CANCELLED"}
        if self.direction == "NUMBER":
            if self.number > len(problems):
                text = say("There is no problem number {number}; the last one is number {count}")
                self.report({"ERROR"}, text.format(number=self.number, count=len(problems)))
                return {"CANCELLED"}
            number = self.number
        else:
            number = (settings.problem_index - 1 + (1 if self.direction == "NEXT" else -1)) % len(problems) + 1
            if not settings.problem_index:
                number = 1 if self.direction == "NEXT" else len(problems)
        settings.problem_index = number
        place = problems[number - 1]
        _look_at_problem(context, avatar, place)
        text = say("{number} of {count}: {problem}")
        problem = report_text.problem_text(place, context.scene)
        self.report({"INFO"}, text.format(number=number, count=len(problems), problem=problem))
        return {"FINISHED"}


def _look_at_problem(context: bpy.types.Context, avatar: bpy.types.Object, place: dict) -> None:
    """Have the 3D viewport look at the surface of a problem, from outside."""
    from mathutils import Vector

    area = viewport(context)
    if area is None:
        return
    view = area.spaces.active.region_3d
    axes = avatar.matrix_world.to_3x3()
    view.view_location = avatar.matrix_world @ Vector(place["point"])
    view.view_rotation = upright_look(axes @ Vector(place["normal"]), axes @ Vector((0, -1, 0)))
    view.view_distance = max(0.35, 4.0 * place["size"]) / metres_per_unit(context.scene)
    show_within(area, 0.1 * view.view_distance, 100.0 * view.view_distance)
    area.tag_redraw()


CLASSES = (MIRRORSCAN_OT_check, MIRRORSCAN_OT_jump_to_problem)
