"""Readers of captures that are folders."""

__all__ = ["lens_file", "rgbd_folder"]
