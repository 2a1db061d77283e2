"""A virtual rig: objects of the scene represent camera and mirrors, and a mesh is scanned with them."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ...core.errors import MirrorScanError
from ..background import job_operators, kernel_compilation, second_process
from ..interface.viewport import FRONT, look_at, look_from_camera
from ..language.texts import CONTEXT, say
from ..scene import live_rig, scan_records
from ..scene.capture_objects import show_capture
from ..scene.preferred import preferred
from ..scene.properties import SENSORS
from ..scene.units import metres_per_unit

DISTANCE, PATH = 2.5, 4.6
"""Default lengths from the camera to the person, directly and via a mirror [m]."""

NEAREST = 0.5  # least distance at which a depth camera measures [m]


ROOM_SIZES = {"SMALL": "small", "BEDROOM": "bedroom", "LIVING": "living_room", "GARAGE": "garage", "STUDIO": "studio"}
"""Choices of *Find a Rig* and the names that core has for them."""

MIRROR_SIZES = {"DOOR": "door", "WARDROBE": "wardrobe", "STANDING": "standing", "GYM": "gym"}


def _look_at_rig(
    context: bpy.types.Context, rig: list[bpy.types.Object], person: bpy.types.Object | None
) -> None:  # fmt: skip
    """Have the viewport that was clicked in show camera, mirrors and person; then the person is selected, if there is
    one."""
    from ..scene import avatar_objects

    if bpy.app.background or context.area is None or context.area.type != "VIEW_3D":
        return
    avatar_objects.select_only(context, rig[0])
    for item in (*rig, *([] if person is None else [person])):
        if item.name in context.view_layer.objects:
            item.select_set(True)
    look_at(context, max(rig, key=lambda item: max(item.dimensions)), FRONT)
    avatar_objects.select_only(context, rig[0] if person is None else person)


class _WithSensor:
    def _begin_with_preference(self) -> None:
        """Have the sensor be the preferred one unless the caller, or the last use in this session, chose one."""
        if not self.properties.is_property_set("sensor"):
            self.sensor = preferred("sensor")


def _room_length(name: str, description: str, metres: float) -> object:
    """A length in metres, whatever the scene's units are: a search in a room begins with a tape measure."""
    return FloatProperty(
        name=name, description=description, default=metres, min=0.0, max=50.0, step=5, precision=3,
        translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_OT_add_rig(_WithSensor, bpy.types.Operator):
    """Add a depth camera, mirrors and a mannequin, to plan a rig. Move them to where the real ones will be"""

    bl_idname = "mirror_scan.add_rig"
    bl_label = "Add Rig"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    sensor: EnumProperty(
        name="Depth Camera", description="Depth camera whose field of view is used", items=SENSORS,
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

    person: BoolProperty(
        name="Mannequin",
        description="Add a mannequin for the rig to look at, unless the active object is a mesh of a person's size",
        default=True, translation_context=CONTEXT,
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
            person = virtual_rig.person_of(context)
            place = (0.0, 0.0) if person is None else virtual_rig.standing_place(person)
            made = virtual_rig.add_objects(context.scene, arranged, place)
            if person is not None:
                context.scene.mirror_scan.rig_person = person
            elif self.person:
                live_rig.bring_person(context.scene)
            live_rig.schedule(context.scene)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        _look_at_rig(context, made, person)
        if not bpy.app.background and context.window is not None:
            second_process.compile_ahead(kernel_compilation.RIG)  # a rig that is added is soon scanned with
        text = say("Added a camera; mirrors added: {count}").format(count=len(made) - 1)
        if context.scene.camera != made[0]:
            text = say("{done}. The scene's camera is still {name}").format(done=text, name=context.scene.camera.name)
        self.report({"INFO"}, text)
        return {"FINISHED"}


class MIRRORSCAN_OT_simulate(_WithSensor, job_operators.JobOperator, bpy.types.Operator):
    """Scan the active mesh, or the mannequin, with a virtual rig: its camera and the objects marked as mirrors, or a default rig if there are none. Shows the capture, and colours the mesh by what each view sees"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.simulate"
    bl_label = "Run Virtual Scan"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filepath: StringProperty(
        name="Folder", description="Empty folder to write the capture to. If none is given, only the .blend keeps it",
        subtype="DIR_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    sensor: EnumProperty(
        name="Depth Camera", description="Depth camera that is simulated, with its field of view and noise",
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

    any_size: BoolProperty(
        name="Any Size",
        description="Scan the active mesh even if it does not have the size of a person. Otherwise the mannequin is "
        "scanned then", translation_context=CONTEXT,
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

        chosen = virtual_rig.subject_of(context)
        body = chosen if self.any_size and chosen is not None else virtual_rig.person_of(context)
        if chosen is not None and body is not chosen:
            text = say(
                "{name} does not have the size of a person, so the mannequin is scanned; turn on Any Size for it"
            )
            self.report({"INFO"}, text.format(name=chosen.name))
        self._uid = 0 if body is None else body.session_uid
        planned = live_rig.planned_camera(context.scene) is not None
        if planned and not self.properties.is_property_set("sensor"):
            self.sensor = context.scene.mirror_scan.rig_sensor
        self._begin_with_preference()
        surface = None if body is None else virtual_rig.world_surface(context, body)
        options = {"sensor": self.sensor, "frames": self.frames, "seed": self.seed}
        mirrors = virtual_rig.mirrors_of(context.scene) or None
        camera = virtual_rig.rig_camera(context.scene)
        if mirrors and camera is None:
            raise MirrorScanError(say("There are mirrors but no camera; add one and make it the active camera"))
        if mirrors or planned:
            options |= virtual_rig.camera_of(camera, metres_per_unit(context.scene)) | {"room": None}
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
                    look_at(context, body, FRONT)  # not from where the rig's camera stands
                else:
                    look_from_camera(context, points)
        names = [say("direct"), *(mirror.name for mirror in target.mirror_scan.mirrors)]
        parts = [f"{name} {share:.0%}" for name, share in zip(names, result.shares, strict=False)]
        text = say("The rig sees {seen:.0%} of the surface: {parts}; not seen: {rest:.0%}")
        text = text.format(seen=1 - result.shares[-1], parts=", ".join(parts), rest=result.shares[-1])
        target.mirror_scan.rig_message = text
        self.report({"INFO"}, text)


class _AboutRig(job_operators.JobOperator):
    """What checks or writes the rig that is planned."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context)
        if not problem and live_rig.planned_camera(context.scene) is None:
            problem = say("There is no planned rig; press Add Rig or Find a Rig")
        return scan_records.allows(cls, problem)


class MIRRORSCAN_OT_check_rig(_AboutRig, bpy.types.Operator):
    """Measure what the planned rig sees of the person: head, hands and feet in each mirror, and what to move"""

    bl_idname = "mirror_scan.check_rig"
    bl_label = "Check Rig"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER"}

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        return live_rig.task_for(context.scene, live_rig.person_of(context.scene))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        live_rig.deliver(target, result)
        self.report({"INFO"}, say("The rig sees {seen:.0%} of the body").format(seen=result.seen))
        job_operators.redraw(context)


class MIRRORSCAN_OT_find_rig(_WithSensor, job_operators.JobOperator, bpy.types.Operator):
    """Find the best place for camera, person and mirrors in a room, and put them there in place of the present rig"""

    bl_idname = "mirror_scan.find_rig"
    bl_label = "Find a Rig"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    preset: EnumProperty(
        name="Room", description="Size of the room",
        items=(
            ("CUSTOM", "Custom", "The sizes below"),
            ("SMALL", "Small Room", "3.0 × 3.5 m, 2.4 m high"),
            ("BEDROOM", "Bedroom", "3.2 × 4.0 m, 2.4 m high"),
            ("LIVING", "Living Room", "4.0 × 5.0 m, 2.5 m high"),
            ("GARAGE", "Garage", "3.0 × 6.0 m, 2.3 m high"),
            ("STUDIO", "Studio", "6.0 × 7.5 m, 2.8 m high"),
        ),
        default="SMALL", translation_context=CONTEXT,
    )  # fmt: skip
    room_width: _room_length("Width (m)", "Width of the room, wall to wall, in metres", 3.0)
    room_depth: _room_length("Depth (m)", "Depth of the room, wall to wall, in metres", 3.5)
    room_height: _room_length("Height (m)", "Height of the room, floor to ceiling, in metres", 2.4)
    sensor: EnumProperty(
        name="Depth Camera", description="Depth camera that the rig is for", items=SENSORS,
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrors: IntProperty(
        name="Mirrors", description="Number of mirrors", default=2, min=1, max=6, translation_context=CONTEXT
    )
    glass: EnumProperty(
        name="Mirror Size", description="Size of the mirrors' glass",
        items=(
            ("CUSTOM", "Custom", "The sizes below"),
            ("DOOR", "Door Mirror", "0.4 × 1.6 m"),
            ("WARDROBE", "Wardrobe Mirror", "0.6 × 1.7 m"),
            ("STANDING", "Standing Mirror", "0.8 × 1.75 m"),
            ("GYM", "Gym Mirror", "1.2 × 2.0 m"),
        ),
        default="STANDING", translation_context=CONTEXT,
    )  # fmt: skip
    mirror_width: _room_length("Mirror Width (m)", "Width of the glass in metres", 0.8)
    mirror_height: _room_length("Mirror Height (m)", "Height of the glass in metres", 1.75)
    frame_width: _room_length("Frame Width (m)", "Width of the frames around the glass in metres. 0 = frameless", 0.035)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "preset")
        if self.preset == "CUSTOM":
            for name in ("room_width", "room_depth", "room_height"):
                layout.prop(self, name)
        layout.prop(self, "sensor")
        layout.prop(self, "mirrors")
        layout.prop(self, "glass")
        if self.glass == "CUSTOM":
            layout.prop(self, "mirror_width")
            layout.prop(self, "mirror_height")
        layout.prop(self, "frame_width")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._begin_with_preference()
        if bpy.app.background:
            return self.execute(context)
        self._asked = True
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        # the dialog calls this when it is confirmed; the search goes on beside the window then
        if getattr(self, "_asked", False) and not bpy.app.background and self._worker is None:
            return self.run(context)
        return super().execute(context)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ...core.rig_planning.rooms import MIRRORS, ROOMS
        from ..scene import virtual_rig

        self._begin_with_preference()
        if self.preset == "CUSTOM":
            room = (self.room_width, self.room_depth, self.room_height)
        else:
            known = ROOMS[ROOM_SIZES[self.preset]]
            room = (known.width, known.depth, known.height)
        size = (self.mirror_width, self.mirror_height)
        if self.glass != "CUSTOM":
            size = MIRRORS[MIRROR_SIZES[self.glass]]
        person = virtual_rig.person_of(context)
        surface = None
        self._uid = 0
        if person is not None and person.get(virtual_rig.RIG_TAG) != "person":
            surface, self._uid = virtual_rig.surface_at_origin(context, person), person.session_uid
        return job_operators.Task(
            "find_rig_steps", (surface, room, self.sensor, [size] * self.mirrors, self.frame_width)
        )

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..scene import avatar_objects, virtual_rig

        placement, person = result
        chosen = avatar_objects.object_of(self._uid)
        place = (0.0, 0.0) if chosen is None else virtual_rig.standing_place(chosen)
        virtual_rig.remove_rig(target)
        made = virtual_rig.add_objects(target, placement.rig, place)
        if chosen is not None:
            target.mirror_scan.rig_person = chosen
        elif self._uid:  # it was deleted meanwhile
            live_rig.bring_person(target)
        else:
            live_rig.keep_mannequin(person)
            virtual_rig.add_person(target, person)
        virtual_rig.add_room(target, placement.rig.room, place)
        if target == context.scene:
            _look_at_rig(context, made, target.mirror_scan.rig_person)
        text = say("The rig sees {seen:.0%} of the body; predicted mean error {error:.1f} mm")
        text = text.format(seen=placement.coverage.share, error=placement.error.mean_mm)
        target.mirror_scan.rig_message = text
        self.report({"INFO"}, text)
        live_rig.schedule(target)


class MIRRORSCAN_OT_save_plan(_AboutRig, job_operators.FileJobOperator, bpy.types.Operator):
    """Write the planned rig as a page to print: the room to scale, tape marks, distances and angles (SVG)"""

    bl_idname = "mirror_scan.save_plan"
    bl_label = "Save Plan"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER"}

    filepath: StringProperty(
        name="File", description="SVG file to write", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.svg", options={"HIDDEN"})
    check_existing: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def proposal(self, context: bpy.types.Context) -> str:
        return "plan.svg"

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import virtual_rig

        path = scan_records.absolute(self.filepath)
        if not path:
            raise MirrorScanError(say("Enter the name of the file to write"))
        if not path.lower().endswith(".svg"):
            path += ".svg"
        person = live_rig.person_of(context.scene)
        place = (0.0, 0.0) if person is None else virtual_rig.standing_place(person)
        surface = None if person is None else virtual_rig.surface_at_origin(context, person)
        rig, mirrors = virtual_rig.rig_in_room(context.scene, place)
        return job_operators.Task("plan_steps", (surface, rig, mirrors, path))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        self.report({"INFO"}, say("Wrote {path}").format(path=result))


CLASSES = (
    MIRRORSCAN_OT_add_rig,
    MIRRORSCAN_OT_simulate,
    MIRRORSCAN_OT_check_rig,
    MIRRORSCAN_OT_find_rig,
    MIRRORSCAN_OT_save_plan,
)
