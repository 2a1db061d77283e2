"""Settings kept in the .blend with each scene, and the progress shown while a job runs."""

import bpy
from bpy.props import FloatProperty, IntProperty, PointerProperty, StringProperty


class MIRRORSCAN_PG_scene(bpy.types.PropertyGroup):
    """What to build an avatar from."""

    capture_path: StringProperty(
        name="Capture",
        description="Folder the depth camera's images were recorded to: intrinsic.json, depth and color",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    mirrors_path: StringProperty(
        name="Mirrors",
        description="File with points picked on the mirrors' frames. Leave empty to use the capture's own mirrors.json",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst to average, 0 for all. More frames, less noise",
        default=0,
        min=0,
        soft_max=60,
    )


class MIRRORSCAN_PG_progress(bpy.types.PropertyGroup):
    """How far the running job is; of this session only."""

    fraction: FloatProperty(name="Progress", subtype="FACTOR", min=0.0, max=1.0, options={"SKIP_SAVE"})
    message: StringProperty(name="Stage", options={"SKIP_SAVE"})


_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (MIRRORSCAN_PG_scene, MIRRORSCAN_PG_progress)
)


def register() -> None:
    _register_classes()
    bpy.types.Scene.mirror_scan = PointerProperty(type=MIRRORSCAN_PG_scene, name="Mirror Scan")
    bpy.types.WindowManager.mirror_scan = PointerProperty(type=MIRRORSCAN_PG_progress, name="Mirror Scan Progress")


def unregister() -> None:
    del bpy.types.WindowManager.mirror_scan
    del bpy.types.Scene.mirror_scan
    _unregister_classes()
