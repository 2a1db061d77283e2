"""Views: which pixel is seen directly and which through which mirror, and what each view saw."""

__all__ = [
    "capture_placement",
    "floor_and_vertical",
    "free_space",
    "ray_sorting",
    "rig_axis",
    "silhouette_contact",
    "view_correspondences",
    "view_maps",
]
