"""What stands in Blender's scene: properties, captures, mirrors, avatars."""

__all__ = [
    "avatar_objects",
    "capture_objects",
    "export",
    "live_subject",
    "point_cloud",
    "properties",
    "report_text",
    "scan_records",
    "units",
    "virtual_rig",
]
