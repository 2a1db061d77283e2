"""What the zipper left open is closed: one oriented 2-manifold."""

__all__ = ["mesh_closing", "reading_fit"]
