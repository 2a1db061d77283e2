"""Patches: the depth grid of each view triangulated, clipped, compared where views overlap."""

__all__ = ["grid_triangulation", "outline_colors", "overlap", "view_comparison"]
