"""The skin cut into islands, laid flat and packed into the image."""

from __future__ import annotations

from .islands import unwrap

__all__ = ["branches", "disks", "flattening", "islands", "packing", "unwrap"]
