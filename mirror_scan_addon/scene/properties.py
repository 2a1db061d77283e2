"""What a scene and an object remember of a scan, kept in the .blend; and the progress shown while a job runs.

Everything the panels show and the operators use is here or in attributes of the cloud and the avatar, so that saving,
undo, copying and linking keep it; a session keeps nothing.
"""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..language.texts import CONTEXT
from .units import metres_per_unit

QUALITY = {
    "FINE": {"smoothing": 0.7, "close_gaps": 2, "outline": 0.4, "refine": 1.4, "untangle": True},
    "BALANCED": {"smoothing": 1.0, "close_gaps": 2, "outline": 0.5, "refine": 2.0, "untangle": True},
    "SMOOTH": {"smoothing": 1.6, "close_gaps": 3, "outline": 0.6, "refine": 2.4, "untangle": True},
    "DRAFT": {"smoothing": 1.0, "close_gaps": 2, "outline": 0.5, "refine": 3.0, "untangle": False},
}
"""Values of each preset, by the names of :class:`MIRRORSCAN_PG_quality`."""

TEXTURE_SIZES = (
    ("1024", "1K", "1024 × 1024 pixels"),
    ("2048", "2K", "2048 × 2048 pixels"),
    ("4096", "4K", "4096 × 4096 pixels"),
    ("8192", "8K", "8192 × 8192 pixels"),
)
"""Items of a choice of a texture's width and height."""

SENSORS = (
    ("azure_kinect", "Azure Kinect", "Time of flight, 640 × 576"),
    ("femto_bolt", "Femto Bolt", "Time of flight, 640 × 576"),
    ("kinect_v1", "Kinect v1", "Structured light, 640 × 480; no readings where two patterns overlap"),
    ("realsense_d455", "RealSense D455", "Active stereo, 848 × 480"),
    ("ideal", "Ideal", "No noise, 640 × 480"),
)
"""Items of a choice of a depth camera."""

QUALITY_KEPT = (*QUALITY["BALANCED"], "keep_islands")
"""What a user's own preset keeps, in the order in which the panel shows it."""


def _redraw(self, context: bpy.types.Context) -> None:
    from ..background.job_operators import redraw

    redraw(context)


def _preset_chosen(self, context: bpy.types.Context) -> None:
    for name, value in QUALITY.get(self.preset, {}).items():
        if getattr(self, name) != value:
            setattr(self, name, value)  # the preset turns “Custom” in between and is back after the last one


def _quality_changed(self, context: bpy.types.Context) -> None:
    """The preset goes to “Custom” when a value leaves it, and back when all fit again."""
    fitting = (
        preset
        for preset, values in QUALITY.items()
        if all(abs(getattr(self, name) - value) < 1e-6 for name, value in values.items())
    )
    preset = next(fitting, "CUSTOM")
    if self.preset != preset:
        self.preset = preset


def _search_changed(self, context: bpy.types.Context) -> None:
    """What the search for the person goes by: it is searched for again, and until then sorted by the new limits."""
    from . import live_subject

    live_subject.schedule(self.id_data)
    _redraw(self, context)


def _rig_changed(self, context: bpy.types.Context) -> None:
    """What the planned rig sees is measured again."""
    from . import live_rig

    live_rig.schedule(self.id_data)
    _redraw(self, context)


def _rig_sensor_changed(self, context: bpy.types.Context) -> None:
    """The rig's camera has the field of view of its sensor."""
    from ...core.simulation.sensors import find_sensor
    from . import live_rig, virtual_rig

    camera = live_rig.planned_camera(self.id_data)
    if camera is not None and camera.type == "CAMERA" and camera.data.is_editable:
        virtual_rig.fit_lens(camera, find_sensor(self.rig_sensor).intrinsics)
    _rig_changed(self, context)


def _frame_changed(self, context: bpy.types.Context) -> None:
    """The frame that is shown round a mirror is made anew."""
    from . import live_rig, virtual_rig

    virtual_rig.refresh_frame(self.id_data)
    live_rig.schedule(context.scene)


def _is_stale(self) -> bool:
    from . import scan_records

    now = scan_records.key_of(scan_records.view_settings(self.id_data.mirror_scan))
    return bool(self.searched_with) and self.searched_with != now


def _name_changed(self, context: bpy.types.Context) -> None:
    """Never empty, and no other mirror's: files and reports name mirrors by it."""
    taken = {item.name for item in self.id_data.mirror_scan.mirrors if item != self}
    name = wanted = self.name.strip() or "mirror"
    number = 1
    while name in taken:
        number += 1
        name = f"{wanted} {number}"
    if self.name != name:
        self.name = name


def _metres(default: float, low: float | None = None, high: float | None = None) -> object:
    """A length as it is kept, whatever the scene's units are; the panels show it by :func:`_length`."""
    limits = {name: value for name, value in (("min", low), ("max", high)) if value is not None}
    return FloatProperty(
        name="Metres", description="Length in metres, whatever the units of the scene are", default=default,
        options={"HIDDEN"}, translation_context=CONTEXT, **limits,
    )  # fmt: skip


def _length(kept: str, name: str, description: str, step: float, precision: int, default: float, **options) -> object:
    """What a length kept in metres is in Blender units, so that Blender shows it in the units of the scene."""

    def get(self) -> float:
        return getattr(self, kept) / metres_per_unit(self.id_data)

    def set(self, value: float) -> None:
        setattr(self, kept, value * metres_per_unit(self.id_data))

    return FloatProperty(
        name=name, description=description, default=default, step=step, precision=precision, subtype="DISTANCE",
        unit="LENGTH", get=get, set=set, translation_context=CONTEXT, **options,
    )  # fmt: skip


class MIRRORSCAN_PG_reading(bpy.types.PropertyGroup):
    """What the files of a capture lack, or have wrong."""

    intrinsics: StringProperty(
        name="Lens File",
        description="File that describes the depth camera's lens (intrinsic.json), for captures that lack it. "
        "Leave empty to use the capture's own",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    lens: EnumProperty(
        name="Lens",
        description="Use the published lens of this camera instead of the capture's. A lens file of your own camera is "
        "more exact",
        items=(
            ("FILE", "As Recorded", "As the capture says"),
            ("azure_kinect", "Azure Kinect", "Microsoft Azure Kinect, Orbbec Femto Bolt"),
            ("kinect_v1", "Kinect", "The first Kinect, and other PrimeSense cameras"),
            ("kinect_v2", "Kinect v2", "The second Kinect"),
            ("realsense_d455", "RealSense D455", "Intel RealSense D455 and D435 at 16:9"),
            ("phone", "iPhone or iPad", "Apple's LiDAR"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    depth_unit_mm: FloatProperty(
        name="Depth Unit",
        description="Millimetres per unit of the depth images. 0 = as the capture says",
        default=0.0, min=0.0, max=1e6, precision=4, translation_context=CONTEXT,
    )  # fmt: skip
    turn: EnumProperty(
        name="Rotation",
        description="Clockwise rotation that makes the images upright",
        items=(
            ("FILE", "As Recorded", "As the capture says; none if it says nothing"),
            ("0", "None", "Do not rotate, whatever the capture says"),
            ("90", "90°", "Rotate by 90° clockwise"),
            ("180", "180°", "Rotate by 180°, for images that are upside down"),
            ("270", "270°", "Rotate by 90° counter-clockwise"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrored: EnumProperty(
        name="Mirrored",
        description="Whether left and right are swapped in the images, as the software of the second Kinect does",
        items=(
            ("FILE", "As Recorded", "As the capture says; not mirrored if it says nothing"),
            ("YES", "Yes", "Swap left and right back"),
            ("NO", "No", "Keep left and right as they are"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    min_confidence: EnumProperty(
        name="Confidence",
        description="Drop depth readings that the camera marked as uncertain. Only for cameras that record this",
        items=(
            ("0", "All", "Keep every reading"),
            ("1", "Medium", "Drop readings of low confidence"),
            ("2", "High", "Drop readings of low and medium confidence"),
        ),
        default="1", translation_context=CONTEXT,
    )  # fmt: skip
    disparity: EnumProperty(
        name="Raw Values",
        description="Formula that converts the raw values of a first Kinect to distances",
        items=(
            ("factory", "Factory", "The formula of the camera's drivers"),
            ("linear", "Linear", "The formula of the OpenKinect community; 50 mm too short at 1.2 m"),
            ("tangent", "Tangent", "Magnenat's formula; accurate up to 3.8 m"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    kinect_calibration: EnumProperty(
        name="Kinect Lens",
        description="Lens of a first Kinect, for recordings that lack it",
        items=(
            ("factory", "Factory", "Nominal values of the camera's drivers"),
            ("burrus", "Burrus", "Measured by Burrus on one camera, and widely used"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    color: BoolProperty(
        name="Colour", description="Read the colour images too", default=True, translation_context=CONTEXT
    )
    own_mirrors: BoolProperty(
        name="Capture's Mirrors", description="Use the mirrors that the capture's files give, if they give any",
        default=True, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_pick(bpy.types.PropertyGroup):
    """One point picked on a mirror's frame."""

    pixel: FloatVectorProperty(
        name="Pixel", description="Position in the depth image, in pixels from the left and from the top",
        size=2, precision=1, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_mirror(bpy.types.PropertyGroup):
    """One mirror: the points picked on it, and its plane."""

    name: StringProperty(
        name="Name", description="Name of the mirror, as used in reports", default="mirror",
        update=_name_changed, translation_context=CONTEXT,
    )  # fmt: skip
    picks: CollectionProperty(
        type=MIRRORSCAN_PG_pick, name="Picks", description="Points picked on the mirror's frame",
        translation_context=CONTEXT,
    )  # fmt: skip
    source: StringProperty(
        name="Source", description="Where the mirror comes from: picked, given, found or a rig file",
        translation_context=CONTEXT,
    )  # fmt: skip
    plane: StringProperty(
        name="Plane", description="The fitted mirror with all its values, as JSON. Empty until it is fitted",
        options={"HIDDEN"}, translation_context=CONTEXT,
    )  # fmt: skip
    residual_mm: FloatProperty(
        name="Residual", description="Average distance of the frame's points from the fitted plane, in millimetres",
        precision=1, translation_context=CONTEXT,
    )  # fmt: skip
    message: StringProperty(
        name="Message", description="Why the mirror cannot be placed. Empty if it is", translation_context=CONTEXT
    )
    quality: StringProperty(
        name="Quality", description="What the mirror was found to be: good, usable or wrong. Empty before",
        translation_context=CONTEXT,
    )  # fmt: skip
    reason: StringProperty(
        name="Reason", description="What is not good about the mirror, and what to do. Empty if it is good",
        translation_context=CONTEXT,
    )  # fmt: skip
    error_mm: FloatProperty(
        name="Error", description="How far what is seen in the mirror may be off, in millimetres", precision=1,
        translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_subject(bpy.types.PropertyGroup):
    """How the person is separated from the room."""

    depth_limit_m: _metres(0.0, 0.0)
    depth_limit: _length(
        "depth_limit_m", "Depth Limit",
        "Ignore everything farther from the camera than this. For reflections the whole path via the mirror counts. "
        "0 m = automatic",
        step=5, precision=3, default=0.0, update=_search_changed,
    )  # fmt: skip
    floor_clearance_m: _metres(0.002, 0.0, 0.5)
    floor_clearance: _length(
        "floor_clearance_m", "Floor Height",
        "Everything up to this height above the floor counts as floor. Raise it if pieces of the floor stick to the "
        "soles",
        step=0.1, precision=4, default=0.002, update=_search_changed,
    )  # fmt: skip
    reach_m: _metres(1.15, 0.2)
    reach: _length(
        "reach_m", "Reach", "Greatest distance of the person from the place that the mirrors face",
        step=5, precision=3, default=1.15, update=_search_changed,
    )  # fmt: skip
    max_height_m: _metres(2.4, 0.2)
    max_height: _length(
        "max_height_m", "Max Height",
        "Ignore everything higher above the floor than this, such as lamps and the ceiling",
        step=5, precision=3, default=2.4, update=_search_changed,
    )  # fmt: skip
    object: BoolProperty(
        name="Any Object",
        description="The subject may be an object of any height, on the floor or on a table. What it stands on is "
        "cut off",
        update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    clicked: BoolProperty(
        name="By Click",
        description="Make the avatar of the person that was clicked. Off: of the person at the place that the mirrors "
        "face",
        update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    click: FloatVectorProperty(
        name="Click", description="Position of the click in the depth image, in pixels from the left and from the top",
        size=2, precision=1, update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    message: StringProperty(
        name="Message", description="Result of the last search for the person", translation_context=CONTEXT
    )
    problem: StringProperty(
        name="Problem", description="Why the last search did not find a person", translation_context=CONTEXT
    )
    searched_with: StringProperty(
        name="Searched With", description="Settings of the last search for the person, as JSON. Empty before it",
        options={"HIDDEN"}, translation_context=CONTEXT,
    )  # fmt: skip
    stale: BoolProperty(
        name="Stale", description="Whether the settings have changed since the last search for the person",
        options={"HIDDEN"}, get=_is_stale, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_quality(bpy.types.PropertyGroup):
    """How the avatar is made."""

    preset: EnumProperty(
        name="Preset",
        description="A set of values for the settings below",
        items=(
            ("FINE", "Fine", "Less smoothing, finer seams: for a camera with little noise or a long burst"),
            ("BALANCED", "Balanced", "For most captures"),
            ("SMOOTH", "Smooth", "More smoothing: for a noisy camera or a single frame"),
            ("DRAFT", "Draft", "Quick, to see whether a capture is usable; the surface may intersect itself at seams"),
            ("CUSTOM", "Custom", "Your own values"),
        ),
        default="BALANCED", update=_preset_chosen, translation_context=CONTEXT,
    )  # fmt: skip
    smoothing: FloatProperty(
        name="Smoothing",
        description="Strength of the smoothing, as a multiple of what the measured noise requires. 0 = no smoothing",
        default=1.0, min=0.0, soft_max=3.0, max=10.0, step=10, precision=2, update=_quality_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    close_gaps: IntProperty(
        name="Close Gaps",
        description="Fill missing readings inside the surface, up to this width",
        default=2, min=0, soft_max=6, max=20, subtype="PIXEL", update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    outline: FloatProperty(
        name="Trim Outlines",
        description="How much of the ragged outline of each view is cut off before the views are joined. 0 = nothing",
        default=0.5, min=0.0, max=0.6, step=5, precision=2, update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    refine: FloatProperty(
        name="Seam Coarseness",
        description="Longest edge in seams and filled holes, as a multiple of the edges around them. Smaller is finer",
        default=2.0, min=1.0, soft_max=4.0, max=10.0, step=10, precision=2, update=_quality_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    untangle: BoolProperty(
        name="Fix Intersections",
        description="Smooth the surface where it intersects itself, until it no longer does",
        default=True, update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    keep_islands: BoolProperty(
        name="Keep Islands", description="Keep pieces that are not connected to the body, each closed separately",
        translation_context=CONTEXT,
    )  # fmt: skip
    glass_offset_m: _metres(0.0)
    glass_offset: _length(
        "glass_offset_m", "Glass Depth",
        "How far the glass lies behind the front of the mirrors' frames. An error here shifts the back of the person "
        "by twice as much",
        step=0.1, precision=4, default=0.0,
    )  # fmt: skip
    glass_thickness_m: _metres(0.0, 0.0, 0.025)
    glass_thickness: _length(
        "glass_thickness_m", "Glass Thickness",
        "Thickness of the mirrors' glass. 0 = found automatically, where the capture shows it",
        step=0.1, precision=4, default=0.0,
    )  # fmt: skip
    bowed: BoolProperty(
        name="Bowed Mirrors",
        description="Correct for mirrors whose glass is bowed, where the capture confirms it. Off: all are taken to "
        "be flat",
        default=True, translation_context=CONTEXT,
    )  # fmt: skip
    two_ways: EnumProperty(
        name="Two-Way Light",
        description="Correct distances that are falsified by light that reaches the person both directly and by a "
        "mirror. It matters for cameras that measure with modulated light, such as the Azure Kinect",
        items=(
            ("AUTO", "Automatic", "Where the camera is, or may be, such a camera, and the capture shows such light"),
            ("ON", "On", "The camera measures with modulated light, whatever its file says"),
            ("OFF", "Off", "Never"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    frequencies: FloatVectorProperty(
        name="Modulation (MHz)",
        description="Frequencies in MHz with which the camera modulates its light. 0 = not known: the floor in the "
        "capture shows how the camera measures",
        size=3, default=(0.0, 0.0, 0.0), min=0.0, max=1000.0, precision=1, step=100, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_look(bpy.types.PropertyGroup):
    """What the buttons of the panel Avatar make."""

    texture_size: EnumProperty(
        name="Size", description="Width and height of the texture",
        items=TEXTURE_SIZES, default="2048", translation_context=CONTEXT,
    )  # fmt: skip
    remove_light: BoolProperty(
        name="Remove Light",
        description="Remove the light and shadows of the room from the colours, as far as the views show them",
        translation_context=CONTEXT,
    )  # fmt: skip
    triangles: IntProperty(
        name="Triangles", description="How many triangles the reduced avatar has at most", default=8000, min=100,
        soft_max=100_000, step=1000, translation_context=CONTEXT,
    )  # fmt: skip
    ease: FloatProperty(
        name="Ease (mm)",
        description="Distance from the skin to the garment in millimetres. A garment that falls is wider at its hem",
        default=15.0, min=2.0, max=80.0, soft_max=40.0, precision=0, translation_context=CONTEXT,
    )  # fmt: skip
    tight: BoolProperty(
        name="Tight",
        description="The garment lies close to the body and moves with the skeleton, without a cloth simulation",
        translation_context=CONTEXT,
    )  # fmt: skip


def _is_cloud(self, target: bpy.types.Object) -> bool:
    from .point_cloud import is_cloud

    return is_cloud(target)


class MIRRORSCAN_PG_scene(bpy.types.PropertyGroup):
    """A scan and its settings."""

    capture_path: StringProperty(
        name="Capture",
        description="Folder or file that the depth camera recorded",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst are averaged. More frames give less noise. 0 = all",
        default=0, min=0, soft_max=60, translation_context=CONTEXT,
    )  # fmt: skip
    reading: PointerProperty(
        type=MIRRORSCAN_PG_reading, name="Load Options",
        description="What the capture's files do not say, or say wrongly", translation_context=CONTEXT,
    )  # fmt: skip
    cloud: PointerProperty(
        type=bpy.types.Object, name="Points", description="Object with the points of the capture", poll=_is_cloud,
        translation_context=CONTEXT,
    )  # fmt: skip
    color_image: PointerProperty(
        type=bpy.types.Image, name="Colour", description="Colour image of the capture", translation_context=CONTEXT
    )
    depth_image: PointerProperty(
        type=bpy.types.Image, name="Depth", description="Depth image of the capture: near is yellow, far is violet",
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrors: CollectionProperty(
        type=MIRRORSCAN_PG_mirror, name="Mirrors", description="The mirrors of the capture", translation_context=CONTEXT
    )
    mirror_index: IntProperty(
        name="Active Mirror", description="The mirror that is picked or removed next", min=0, update=_redraw,
        translation_context=CONTEXT,
    )  # fmt: skip
    subject: PointerProperty(
        type=MIRRORSCAN_PG_subject, name="Subject", description="How the person is separated from the room",
        translation_context=CONTEXT,
    )  # fmt: skip
    quality: PointerProperty(
        type=MIRRORSCAN_PG_quality, name="Quality", description="How the avatar is made", translation_context=CONTEXT
    )
    look: PointerProperty(
        type=MIRRORSCAN_PG_look, name="Look", description="How the avatar is dressed and textured",
        translation_context=CONTEXT,
    )  # fmt: skip
    show_cloud: BoolProperty(
        name="Show Points", description="Draw the points of the capture in the viewport", default=True, update=_redraw,
        translation_context=CONTEXT,
    )  # fmt: skip
    cloud_colors: EnumProperty(
        name="Colour By",
        description="What the colours of the points show",
        items=(
            ("CAPTURE", "Capture", "Colours of the capture, or distance if it has none"),
            ("DEPTH", "Depth", "Distance from the camera: near is yellow, far is violet"),
            ("VIEW", "View", "Which view each point belongs to: the direct one or that of a mirror"),
            ("PART", "Part", "Person orange, floor green, beyond the depth limit red, the rest grey"),
        ),
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    fold: BoolProperty(
        name="Reflect Back",
        description="Draw the points seen in a mirror where they really are, reflected across the mirror's plane",
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    point_size: FloatProperty(
        name="Point Size", description="Size of the points as drawn", default=2.0, min=1.0, max=10.0, subtype="PIXEL",
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    show_mirrors: BoolProperty(
        name="Show Mirrors", description="Draw the mirrors' planes, outlines and picked points", default=True,
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    rig_message: StringProperty(
        name="Coverage", description="What the last virtual scan saw of the body", translation_context=CONTEXT
    )
    rig_camera: PointerProperty(
        type=bpy.types.Object, name="Rig Camera", description="Camera of the rig that is planned",
        translation_context=CONTEXT,
    )  # fmt: skip
    rig_person: PointerProperty(
        type=bpy.types.Object, name="Rig Person", description="Body that the planned rig looks at",
        translation_context=CONTEXT,
    )  # fmt: skip
    rig_sensor: EnumProperty(
        name="Depth Camera", description="Depth camera of the planned rig", items=SENSORS, update=_rig_sensor_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    rig_live: BoolProperty(
        name="Live Coverage",
        description="Measure what the rig sees again whenever its camera, a mirror or the person is moved",
        default=True, update=_rig_changed, translation_context=CONTEXT,
    )  # fmt: skip
    rig_show: BoolProperty(
        name="Show Distances", description="Draw distances and angles of the rig over the viewport", default=True,
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    rig_picture: BoolProperty(
        name="Show Camera View", description="Draw what the rig's camera sees in a corner of the viewport",
        default=True, update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    rig_checked: StringProperty(
        name="Rig Check", description="What the planned rig sees, as it was measured last", options={"HIDDEN"},
        translation_context=CONTEXT,
    )  # fmt: skip
    rig_room: FloatVectorProperty(
        name="Room", description="Walls and ceiling of the room of the planned rig, in metres", size=5,
        options={"HIDDEN"}, translation_context=CONTEXT,
    )  # fmt: skip
    export_folder: StringProperty(
        name="Folder",
        description="Folder that the buttons below write to without asking; they replace files of the same name. Leave "
        "empty to be asked each time",
        subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    keep_versions: BoolProperty(
        name="Keep Last Version",
        description="When an avatar is built again, keep the one before, hidden in a collection of its own, instead of "
        "replacing it",
        translation_context=CONTEXT,
    )  # fmt: skip
    problem_index: IntProperty(
        name="Problem", description="The problem of the avatar that was shown last, counted from 1. 0 = none",
        min=0, translation_context=CONTEXT,
    )  # fmt: skip


FRAME_WIDTH = 0.035  # of a mirror, as many have it [m]


def _became_mirror(self, context: bpy.types.Context) -> None:
    """The frame's usual width, in a scene whose unit is not the metre; what the rig sees is measured again."""
    from . import live_rig

    unit = metres_per_unit(context.scene)
    if self.is_mirror and unit != 1.0 and not self.is_property_set("frame_width"):
        self.frame_width = FRAME_WIDTH / unit
    live_rig.schedule(context.scene)


class MIRRORSCAN_PG_object(bpy.types.PropertyGroup):
    """What an object represents in a virtual rig."""

    is_mirror: BoolProperty(
        name="Is a Mirror",
        description="Use this flat object as a mirror of the virtual rig: the glass fills the object's bounding box "
        "and reflects on the side that the local Z axis points to",
        update=_became_mirror, translation_context=CONTEXT,
    )  # fmt: skip
    frame_width: FloatProperty(
        name="Frame Width", description="Width of the frame around the glass. 0 m = frameless", default=FRAME_WIDTH,
        min=0.0, step=0.5, precision=3, subtype="DISTANCE", unit="LENGTH", update=_frame_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    frame_depth: FloatProperty(
        name="Frame Depth", description="How far the frame projects in front of the glass", default=0.0, min=0.0,
        step=0.1, precision=3, subtype="DISTANCE", unit="LENGTH", update=_frame_changed,
        translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_progress(bpy.types.PropertyGroup):
    """How far the running job is, and what went wrong last; of this session only."""

    fraction: FloatProperty(name="Progress", subtype="FACTOR", min=0.0, max=1.0, options={"SKIP_SAVE"})
    message: StringProperty(name="Stage", options={"SKIP_SAVE"})
    operator: StringProperty(name="Job", options={"SKIP_SAVE"})
    left: StringProperty(name="Time Left", options={"SKIP_SAVE"})
    picking: BoolProperty(name="Picking", options={"SKIP_SAVE"})
    picked: BoolProperty(name="Picking Is Done", options={"SKIP_SAVE"})
    error: StringProperty(name="Error", options={"SKIP_SAVE"})
    getting_ready: StringProperty(name="Getting Ready", options={"SKIP_SAVE"})


_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (
        MIRRORSCAN_PG_reading,
        MIRRORSCAN_PG_pick,
        MIRRORSCAN_PG_mirror,
        MIRRORSCAN_PG_subject,
        MIRRORSCAN_PG_quality,
        MIRRORSCAN_PG_look,
        MIRRORSCAN_PG_scene,
        MIRRORSCAN_PG_object,
        MIRRORSCAN_PG_progress,
    )
)


def register() -> None:
    _register_classes()
    bpy.types.Scene.mirror_scan = PointerProperty(type=MIRRORSCAN_PG_scene, name="Mirror Scan")
    bpy.types.Object.mirror_scan = PointerProperty(type=MIRRORSCAN_PG_object, name="Mirror Scan")
    bpy.types.WindowManager.mirror_scan = PointerProperty(type=MIRRORSCAN_PG_progress, name="Mirror Scan Progress")


def unregister() -> None:
    del bpy.types.WindowManager.mirror_scan
    del bpy.types.Object.mirror_scan
    del bpy.types.Scene.mirror_scan
    _unregister_classes()
