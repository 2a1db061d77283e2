"""Mirror planes corrected until what the views show fits together."""

__all__ = [
    "floor_alignment",
    "frame_shape",
    "glass_alignment",
    "own_reflection",
    "person_alignment",
    "pose_solver",
    "reflection_alignment",
    "seam_alignment",
    "seam_glass",
    "seam_offsets",
    "view_alignment",
]
