"""Patches joined along their boundaries by dynamic time warping."""

__all__ = ["boundary_frames", "coronal_matching", "dtw", "seam_strips", "zipper"]
