"""What the window shows: panels, overlays, viewports."""
