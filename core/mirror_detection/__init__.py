"""Mirrors found without a click, or near one."""

__all__ = ["detection", "edge_segments", "frameless_mirrors", "mirror_at_picks", "mirror_verification", "person_images"]
