"""Readers of single files: clouds, arrays, images."""
