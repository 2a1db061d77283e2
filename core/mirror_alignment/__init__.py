"""Mirror planes corrected until what the views show fits together."""

__all__ = ["floor_alignment", "reflection_alignment", "seam_alignment", "view_alignment"]
