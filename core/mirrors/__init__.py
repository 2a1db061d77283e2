"""Mirrors: planes, frames, reflections, rig files."""

from __future__ import annotations

from .mirror import Mirror

__all__ = ["Mirror"]
