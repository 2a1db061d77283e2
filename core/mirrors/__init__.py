"""Mirrors: planes, frames, reflections, rig files."""

from __future__ import annotations

from .mirror import Mirror

__all__ = [
    "Mirror",
    "curved_glass",
    "disparity_plane",
    "frame_fit",
    "frame_sides",
    "glass_extent",
    "glass_kernels",
    "mirror",
    "picked_mirror",
    "rig_file",
    "wall_behind_frame",
]
