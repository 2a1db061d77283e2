"""Experiments of the paper, repeated with this program's own functions."""

__all__ = ["cameras", "distance", "reflection", "turntable", "zippering"]
