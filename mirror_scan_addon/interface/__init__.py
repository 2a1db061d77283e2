"""What the window shows: panels, overlays, viewports."""

__all__ = ["aiming", "overlay", "panels", "viewport"]
