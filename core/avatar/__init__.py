"""The avatar: the closed mesh in its own frame, its skeleton, its poses."""

__all__ = ["coordinate_frame", "pose", "skeleton"]
