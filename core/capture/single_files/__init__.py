"""Readers of single files: clouds, arrays, images."""

__all__ = ["pclzf", "single_image"]
