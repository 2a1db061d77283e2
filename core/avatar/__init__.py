"""The avatar: the closed mesh in its own frame."""

__all__ = ["coordinate_frame"]
