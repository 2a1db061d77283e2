"""What stands in Blender's scene: properties, captures, mirrors, avatars."""

__all__ = [
    "armature",
    "avatar_objects",
    "blend_avatar",
    "blender_files",
    "capture_objects",
    "export",
    "fbx_motion",
    "live_subject",
    "point_cloud",
    "properties",
    "report_text",
    "rig_controls",
    "scan_records",
    "units",
    "virtual_rig",
]
