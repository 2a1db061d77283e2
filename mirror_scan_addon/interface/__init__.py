"""What the window shows: panels, what is drawn over the viewport, and where the viewport looks."""

__all__ = ["aiming", "live_picture", "menus", "overlay", "panels", "preferences", "rig_overlay", "viewport"]
