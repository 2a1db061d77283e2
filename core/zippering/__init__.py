"""Patches joined along their boundaries by dynamic time warping."""

__all__ = ["boundary_frames", "coronal_matching", "dtw", "exposure", "seam_strips", "zipper"]
