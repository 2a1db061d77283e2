"""Readers of captures that are folders."""

__all__ = ["rgbd_folder"]
