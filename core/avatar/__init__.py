"""The avatar: the closed mesh in its own frame, its skeleton, its poses."""

__all__ = [
    "avatar_file",
    "bone_axes",
    "clip",
    "coordinate_frame",
    "garment",
    "joints",
    "pose",
    "skeleton",
    "skin_weights",
    "weight_fields",
]
