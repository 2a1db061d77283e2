"""What a scene and an object remember of a scan, kept in the .blend; and the progress shown while a job runs.

Everything the panels show and the operators use is here or in attributes of the cloud and the avatar, so that saving,
undo, copying and linking keep it; a session keeps nothing.
"""

from __future__ import annotations

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
        name="Metres", description="The length in metres, whatever the scene's units are", default=default,
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
    """What a capture's files cannot say of themselves, or say wrongly."""

    intrinsics: StringProperty(
        name="Intrinsics",
        description="File that says what the depth camera's lens does (intrinsic.json), for captures that do not. "
        "Leave empty for the capture's own",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    depth_unit_mm: FloatProperty(
        name="Depth Unit",
        description="What one unit in the depth pictures means, in millimetres. 0 = as the capture says",
        default=0.0, min=0.0, max=1e6, precision=4, translation_context=CONTEXT,
    )  # fmt: skip
    turn: EnumProperty(
        name="Turn",
        description="Clockwise turn that makes the pictures upright",
        items=(
            ("FILE", "As Recorded", "What the capture says of itself, else none"),
            ("0", "None", "Not turned, whatever the capture says"),
            ("90", "90°", "A quarter turn to the right"),
            ("180", "180°", "Upside down"),
            ("270", "270°", "A quarter turn to the left"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrored: EnumProperty(
        name="Mirrored",
        description="Whether left and right are exchanged in the pictures, as the second Kinect's software does it",
        items=(
            ("FILE", "As Recorded", "What the capture says of itself, else not"),
            ("YES", "Yes", "Left and right are exchanged back"),
            ("NO", "No", "Left and right stay as they are"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    min_confidence: EnumProperty(
        name="Confidence",
        description="Readings that the camera itself trusts less are dropped, where it says so",
        items=(
            ("0", "All", "Keep every reading"),
            ("1", "Medium", "Drop readings of low confidence"),
            ("2", "High", "Drop readings of low and medium confidence"),
        ),
        default="1", translation_context=CONTEXT,
    )  # fmt: skip
    disparity: EnumProperty(
        name="Raw Values",
        description="Formula that turns the raw values of a first Kinect into distances",
        items=(
            ("factory", "Factory", "That of the camera's drivers"),
            ("linear", "Linear", "The OpenKinect community's; 50 mm short at 1.2 m"),
            ("tangent", "Tangent", "Magnenat's, good to 3.8 m"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    kinect_calibration: EnumProperty(
        name="Kinect Lens",
        description="Lens of a first Kinect whose recording does not say it",
        items=(
            ("factory", "Factory", "The nominal values of the camera's drivers"),
            ("burrus", "Burrus", "As measured by Burrus for one camera, and in wide use"),
        ),
        translation_context=CONTEXT,
    )  # fmt: skip
    color: BoolProperty(
        name="Colour", description="Read the colour pictures too", default=True, translation_context=CONTEXT
    )


class MIRRORSCAN_PG_pick(bpy.types.PropertyGroup):
    """One point picked on a mirror's frame."""

    pixel: FloatVectorProperty(
        name="Pixel", description="Where in the depth image: from the left and from the top, in pixels",
        size=2, precision=1, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_mirror(bpy.types.PropertyGroup):
    """One mirror: what was picked on it, and where it stands."""

    name: StringProperty(
        name="Name", description="What you call this mirror; the report uses it", default="mirror",
        update=_name_changed, translation_context=CONTEXT,
    )  # fmt: skip
    picks: CollectionProperty(
        type=MIRRORSCAN_PG_pick, name="Picks", description="Points picked on the mirror's frame",
        translation_context=CONTEXT,
    )  # fmt: skip
    source: StringProperty(
        name="Source", description="Where the mirror is known from: picked, given, found or a rig file",
        translation_context=CONTEXT,
    )  # fmt: skip
    plane: StringProperty(
        name="Plane", description="The fitted mirror with all its figures, as JSON; empty while there is none",
        options={"HIDDEN"}, translation_context=CONTEXT,
    )  # fmt: skip
    residual_mm: FloatProperty(
        name="Residual", description="How far the frame's points lie off the fitted plane on average, in millimetres",
        precision=1, translation_context=CONTEXT,
    )  # fmt: skip
    message: StringProperty(
        name="Message", description="Why the mirror cannot be placed; empty when it is", translation_context=CONTEXT
    )


class MIRRORSCAN_PG_subject(bpy.types.PropertyGroup):
    """How the person is told from the room."""

    depth_limit_m: _metres(0.0, 0.0)
    depth_limit: _length(
        "depth_limit_m", "Depth Limit",
        "Everything farther from the camera than this is ignored; the way over a mirror counts whole. "
        "0 m = by itself, from where the person can be",
        step=5, precision=3, default=0.0, update=_search_changed,
    )  # fmt: skip
    floor_clearance_m: _metres(0.002, 0.0, 0.5)
    floor_clearance: _length(
        "floor_clearance_m", "Floor Clearance",
        "Up to this height above the floor everything counts as the floor. Raise it when pieces of the floor stick to "
        "the soles",
        step=0.1, precision=4, default=0.002, update=_search_changed,
    )  # fmt: skip
    reach_m: _metres(1.15, 0.2)
    reach: _length(
        "reach_m", "Reach", "How far from the place the mirrors look at the person may be",
        step=5, precision=3, default=1.15, update=_search_changed,
    )  # fmt: skip
    max_height_m: _metres(2.4, 0.2)
    max_height: _length(
        "max_height_m", "Max Height",
        "Everything higher above the floor than this is ignored, such as lamps and the ceiling",
        step=5, precision=3, default=2.4, update=_search_changed,
    )  # fmt: skip
    object: BoolProperty(
        name="Any Thing",
        description="The subject may be a thing of any height, on the floor, a table or a plinth: what it stands on is "
        "cut off",
        update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    clicked: BoolProperty(
        name="By Click",
        description="The person is who was clicked, not who stands where the mirrors look at",
        update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    click: FloatVectorProperty(
        name="Click", description="Where the person was clicked in the depth image: from the left and from the top, in "
        "pixels",
        size=2, precision=1, update=_search_changed, translation_context=CONTEXT,
    )  # fmt: skip
    message: StringProperty(
        name="Message", description="What the last search for the person found", translation_context=CONTEXT
    )
    problem: StringProperty(
        name="Problem", description="Why the last search for the person found nobody", translation_context=CONTEXT
    )
    searched_with: StringProperty(
        name="Searched With", description="The settings of the last search for the person, as JSON; empty before it",
        options={"HIDDEN"}, translation_context=CONTEXT,
    )  # fmt: skip
    stale: BoolProperty(
        name="Stale", description="Whether the person was searched for with other settings", options={"HIDDEN"},
        get=_is_stale, translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_quality(bpy.types.PropertyGroup):
    """How the avatar is made."""

    preset: EnumProperty(
        name="Preset",
        description="A set of values that go together",
        items=(
            ("FINE", "Fine", "Less smoothing, finer seams: for a quiet camera or a long burst"),
            ("BALANCED", "Balanced", "What fits most captures"),
            ("SMOOTH", "Smooth", "More smoothing: for a noisy camera or a single frame"),
            ("DRAFT", "Draft", "Quick, to see whether a capture is any good; seams may run through each other"),
            ("CUSTOM", "Custom", "The values below as you set them"),
        ),
        default="BALANCED", update=_preset_chosen, translation_context=CONTEXT,
    )  # fmt: skip
    smoothing: FloatProperty(
        name="Smoothing",
        description="How strongly the camera's noise is smoothed, as a multiple of what the measured noise asks for. "
        "0 = not at all",
        default=1.0, min=0.0, soft_max=3.0, max=10.0, step=10, precision=2, update=_quality_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    close_gaps: IntProperty(
        name="Close Gaps",
        description="Spots without a reading inside the surface are closed up to this width",
        default=2, min=0, soft_max=6, max=20, subtype="PIXEL", update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    outline: FloatProperty(
        name="Trim Outlines",
        description="How much of the ragged rim of each view is cut off before sewing. 0 = nothing",
        default=0.5, min=0.0, max=0.6, step=5, precision=2, update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    refine: FloatProperty(
        name="Seam Coarseness",
        description="Longest edge in seams and fills, as a multiple of the edges around them. Smaller is finer",
        default=2.0, min=1.0, soft_max=4.0, max=10.0, step=10, precision=2, update=_quality_changed,
        translation_context=CONTEXT,
    )  # fmt: skip
    untangle: BoolProperty(
        name="Untangle",
        description="Smooth places where the surface runs through itself until it no longer does",
        default=True, update=_quality_changed, translation_context=CONTEXT,
    )  # fmt: skip
    keep_islands: BoolProperty(
        name="Keep Islands", description="Keep pieces that nothing connects to the body, each closed on its own",
        translation_context=CONTEXT,
    )  # fmt: skip
    glass_offset_m: _metres(0.0)
    glass_offset: _length(
        "glass_offset_m", "Glass Depth",
        "How far the reflecting glass lies behind the front of the mirrors' frames. A wrong value puts the back of the "
        "person off by twice the error",
        step=0.1, precision=4, default=0.0,
    )  # fmt: skip


def _is_cloud(self, target: bpy.types.Object) -> bool:
    from .point_cloud import is_cloud

    return is_cloud(target)


class MIRRORSCAN_PG_scene(bpy.types.PropertyGroup):
    """A scan and what is to be made of it."""

    capture_path: StringProperty(
        name="Capture",
        description="Folder or file that the depth camera's images were recorded to",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst to average, 0 for all. More frames, less noise",
        default=0, min=0, soft_max=60, translation_context=CONTEXT,
    )  # fmt: skip
    reading: PointerProperty(
        type=MIRRORSCAN_PG_reading, name="Reading", description="What the capture's files cannot say of themselves",
        translation_context=CONTEXT,
    )  # fmt: skip
    cloud: PointerProperty(
        type=bpy.types.Object, name="Cloud", description="Object that holds the points of the capture", poll=_is_cloud,
        translation_context=CONTEXT,
    )  # fmt: skip
    color_image: PointerProperty(
        type=bpy.types.Image, name="Colour", description="Colour picture of the capture", translation_context=CONTEXT
    )
    depth_image: PointerProperty(
        type=bpy.types.Image, name="Depth", description="Depth picture of the capture: near is yellow, far is violet",
        translation_context=CONTEXT,
    )  # fmt: skip
    mirrors: CollectionProperty(
        type=MIRRORSCAN_PG_mirror, name="Mirrors", description="The mirrors of the capture", translation_context=CONTEXT
    )
    mirror_index: IntProperty(
        name="Active Mirror", description="The mirror that is picked or removed", min=0, update=_redraw,
        translation_context=CONTEXT,
    )  # fmt: skip
    subject: PointerProperty(
        type=MIRRORSCAN_PG_subject, name="Subject", description="How the person is told from the room",
        translation_context=CONTEXT,
    )  # fmt: skip
    quality: PointerProperty(
        type=MIRRORSCAN_PG_quality, name="Quality", description="How the avatar is made", translation_context=CONTEXT
    )
    show_cloud: BoolProperty(
        name="Show Points", description="Draw the points of the capture in the viewport", default=True, update=_redraw,
        translation_context=CONTEXT,
    )  # fmt: skip
    cloud_colors: EnumProperty(
        name="Colour By",
        description="What the colours of the points say",
        items=(
            ("CAPTURE", "Capture", "The colours of the capture; by distance when it has none"),
            ("DEPTH", "Depth", "Distance from the camera: near is yellow, far is violet"),
            ("VIEW", "View", "How the camera saw each point: directly, or through which mirror"),
            ("PART", "Part", "Person orange, floor green, what is beyond the depth limit red, the rest grey"),
        ),
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    fold: BoolProperty(
        name="Reflect Back",
        description="Draw what is seen through a mirror where it really is, flipped over the mirror's plane",
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    point_size: FloatProperty(
        name="Point Size", description="How large a point is drawn", default=2.0, min=1.0, max=10.0, subtype="PIXEL",
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    show_mirrors: BoolProperty(
        name="Show Mirrors", description="Draw the mirrors' planes, outlines and picked points", default=True,
        update=_redraw, translation_context=CONTEXT,
    )  # fmt: skip
    rig_message: StringProperty(
        name="Coverage", description="What the last virtual scan saw of the body", translation_context=CONTEXT
    )
    export_folder: StringProperty(
        name="Folder",
        description="Folder that the buttons below write to at once, over a file of that name. Leave empty to be asked "
        "each time",
        subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    problem_index: IntProperty(
        name="Problem", description="Which problem of the avatar was jumped to last, counted from 1; 0 = none",
        min=0, translation_context=CONTEXT,
    )  # fmt: skip


FRAME_WIDTH = 0.035  # of a mirror, as many have it [m]


def _became_mirror(self, context: bpy.types.Context) -> None:
    """The frame's usual width, in a scene whose unit is not the metre."""
    unit = metres_per_unit(context.scene)
    if self.is_mirror and unit != 1.0 and not self.is_property_set("frame_width"):
        self.frame_width = FRAME_WIDTH / unit


class MIRRORSCAN_PG_object(bpy.types.PropertyGroup):
    """What an object stands for in a virtual rig."""

    is_mirror: BoolProperty(
        name="Is a Mirror",
        description="This flat object is a mirror of the virtual rig: its glass fills the object's bounding box and "
        "reflects on the side its local Z axis points to",
        update=_became_mirror, translation_context=CONTEXT,
    )  # fmt: skip
    frame_width: FloatProperty(
        name="Frame Width", description="Width of the frame around the glass. 0 m = frameless", default=FRAME_WIDTH,
        min=0.0, step=0.5, precision=3, subtype="DISTANCE", unit="LENGTH", translation_context=CONTEXT,
    )  # fmt: skip
    frame_depth: FloatProperty(
        name="Frame Depth", description="How far the frame stands out before the glass", default=0.0, min=0.0,
        step=0.1, precision=3, subtype="DISTANCE", unit="LENGTH", translation_context=CONTEXT,
    )  # fmt: skip


class MIRRORSCAN_PG_progress(bpy.types.PropertyGroup):
    """How far the running job is; of this session only."""

    fraction: FloatProperty(name="Progress", subtype="FACTOR", min=0.0, max=1.0, options={"SKIP_SAVE"})
    message: StringProperty(name="Stage", options={"SKIP_SAVE"})
    operator: StringProperty(name="Job", options={"SKIP_SAVE"})
    picking: BoolProperty(name="Picking", options={"SKIP_SAVE"})


_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (
        MIRRORSCAN_PG_reading,
        MIRRORSCAN_PG_pick,
        MIRRORSCAN_PG_mirror,
        MIRRORSCAN_PG_subject,
        MIRRORSCAN_PG_quality,
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
