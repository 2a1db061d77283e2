"""Mirror planes corrected until what the views show fits together."""

__all__ = [
    "floor_alignment",
    "frame_shape",
    "glass_alignment",
    "own_reflection",
    "person_alignment",
    "reflection_alignment",
    "seam_alignment",
    "seam_check",
    "seam_glass",
    "seam_thickness",
    "view_alignment",
]
