"""Patches: the depth grid of each view triangulated, clipped, compared where views overlap."""
