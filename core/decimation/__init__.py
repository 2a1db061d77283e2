"""Fewer triangles for the same surface: texture seams, skin weights and colours stay where they are."""

from .levels import Reduced, decimate, levels_of_detail

__all__ = ["Reduced", "decimate", "levels_of_detail"]
