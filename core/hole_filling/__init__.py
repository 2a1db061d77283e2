"""Boundary loops filled: triangulated, refined, curved and faired."""

__all__ = ["delaunay_refinement", "foot_hulls", "loop_triangulation", "silhouette_bulge", "soles", "thin_plate_fairing"]
