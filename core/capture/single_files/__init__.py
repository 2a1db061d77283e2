"""Readers of single files: clouds, arrays, images."""

__all__ = ["single_image"]
