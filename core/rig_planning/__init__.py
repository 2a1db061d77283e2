"""A rig planned before the picture is taken: what it would see, how good the avatar would be, what to move, a plan."""

__all__ = [
    "area_coverage",
    "placement_advice",
    "placement_search",
    "plan_drawing",
    "plan_files",
    "predicted_error",
    "rooms",
]
