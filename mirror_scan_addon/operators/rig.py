"""A virtual rig: objects of the scene represent camera and mirrors, and a mesh is scanned with them."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ...core.errors import MirrorScanError
from ..background import job_operators, kernel_compilation, second_process
from ..interface.viewport import look_at, look_from_camera
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.capture_objects import show_capture
from ..scene.preferred import preferred
from ..scene.properties import SENSORS
from ..scene.units import metres_per_unit

DISTANCE, PATH = 2.5, 4.6
"""Default lengths from the camera to the person, directly and via a mirror [m]."""

NEAREST = 0.5  # least distance at which a depth camera measures [m]


class _WithSensor:
    def _begin_with_preference(self) -> None:
        """Have the sensor be the preferred one unless the caller, or the last use in this session, chose one."""
        if not self.properties.is_property_set("sensor"):
            self.sensor = preferred("sensor")


class MIRRORSCAN_OT_add_rig(_WithSensor, bpy.types.Operator):
    """Add a camera and mirrors to plan a rig. Place them where the real ones will be"""

    bl_idname = "mirror_scan.add_rig"
    bl_label = "Add Rig"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    sensor: EnumProperty(
        name="Sensor", description="Depth camera whose field of view is used", items=SENSORS,
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrors: IntProperty(
        name="Mirrors", description="Number of mirrors", default=2, min=0, max=6, translation_context=CONTEXT
    )
    distance: FloatProperty(
        name="Distance", description="Distance from the camera to the person", default=DISTANCE, min=0.0, step=5,
        precision=2, subtype="DISTANCE", unit="LENGTH", translation_context=CONTEXT,
    )  # fmt: skip
    angle: FloatProperty(
        name="View Angle",
        description="Angle around the person from which the mirrors show them. 180° = from behind",
        default=2.0943951, min=1.0471976, max=3.0543262, subtype="ANGLE", unit="ROTATION", translation_context=CONTEXT,
    )  # fmt: skip
    path: FloatProperty(
        name="Path via Mirror", description="Length of the path from the camera via a mirror to the person",
        default=PATH, min=0.0, step=5, precision=2, subtype="DISTANCE", unit="LENGTH", translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        import math

        from ...core.simulation.scene import default_rig
        from ..scene import virtual_rig

        self._begin_with_preference()
        unit = metres_per_unit(context.scene)
        for name, metres in (("distance", DISTANCE), ("path", PATH)):
            value = unit * getattr(self, name) if self.properties.is_property_set(name) else metres
            setattr(self, name, max(value, NEAREST) / unit)
        try:
            arranged = default_rig(
                self.sensor, unit * self.distance, math.degrees(self.angle), self.mirrors, path_length=unit * self.path
            )
            made = virtual_rig.add_objects(context.scene, arranged)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        if not bpy.app.background and context.window is not None:
            second_process.compile_ahead(kernel_compilation.RIG)  # a rig that is added is soon scanned with
        self.report({"INFO"}, say("Added a camera; mirrors added: {count}").format(count=len(made) - 1))
        return {"FINISHED"}


class MIRRORSCAN_OT_simulate(_WithSensor, job_operators.JobOperator, bpy.types.Operator):
    """Scan the selected mesh with a virtual rig: the scene's camera and the objects marked as mirrors, or a default
    rig if there are none. Shows the capture, and colours the mesh by what each view sees"""

    bl_idname = "mirror_scan.simulate"
    bl_label = "Run Virtual Scan"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filepath: StringProperty(
        name="Folder", description="Empty folder to write the capture to. If none is given, only the .blend keeps it",
        subtype="DIR_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    sensor: EnumProperty(
        name="Sensor", description="Depth camera that is simulated, with its field of view and noise",
        items=SENSORS, translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames", description="Number of depth frames in the burst", default=10, min=1, soft_max=60,
        max=500, translation_context=CONTEXT,
    )  # fmt: skip
    seed: IntProperty(
        name="Seed", description="Seed of the noise. The same number gives the same capture", default=0, min=0,
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context)
        active = context.object
        if not problem and active is not None and active.type == "MESH" and active.data.polygons:
            if not active.mirror_scan.is_mirror and not active.data.is_editable:
                problem = say("{name} is linked from another file; make it local so that its colours can be changed")
                problem = problem.format(name=active.name)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import virtual_rig

        body = virtual_rig.subject_of(context)
        self._uid = 0 if body is None else body.session_uid
        self._begin_with_preference()
        surface = None if body is None else virtual_rig.world_surface(context, body)
        options = {"sensor": self.sensor, "frames": self.frames, "seed": self.seed}
        mirrors = virtual_rig.mirrors_of(context.scene) or None
        if mirrors and context.scene.camera is None:
            raise MirrorScanError(say("There are mirrors but no camera; add one and make it the active camera"))
        if mirrors:
            options |= virtual_rig.camera_of(context.scene.camera, metres_per_unit(context.scene)) | {"room": None}
        self._folder = scan_records.absolute(self.filepath)
        if self._folder:
            scan_records.check_folder(self._folder)
        return job_operators.Task("simulate_steps", (surface, options, mirrors, self._folder))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.preview import palette
        from ..scene import avatar_objects, virtual_rig

        body = avatar_objects.object_of(self._uid)
        if body is not None and len(body.data.vertices) == len(result.coverage) and body.data.is_editable:
            avatar_objects.set_colors(body.data, virtual_rig.COVERAGE, palette.view_colors(result.coverage), "POINT")
            avatar_objects.show_colors(body, virtual_rig.COVERAGE)
        if not self._folder:
            result.loaded.info["name"] = say("Virtual Scan") if body is None else body.name
        points = show_capture(context, target, result.loaded, beside=False)
        target.mirror_scan.capture_path = self.filepath if self._folder else ""
        if target == context.scene:
            if body is not None:
                avatar_objects.select_only(context, body)
            if not bpy.app.background and self._worker is None and context.area is not None:
                if body is not None:
                    look_at(context, body)
                else:
                    look_from_camera(context, points)
        names = [say("direct"), *(mirror.name for mirror in target.mirror_scan.mirrors)]
        parts = [f"{name} {share:.0%}" for name, share in zip(names, result.shares, strict=False)]
        text = say("The rig sees {seen:.0%} of the surface: {parts}; not seen: {rest:.0%}")
        text = text.format(seen=1 - result.shares[-1], parts=", ".join(parts), rest=result.shares[-1])
        target.mirror_scan.rig_message = text
        self.report({"INFO"}, text)


CLASSES = (MIRRORSCAN_OT_add_rig, MIRRORSCAN_OT_simulate)
