"""Boundary loops filled: triangulated, refined, curved and faired."""
