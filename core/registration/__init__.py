"""Views of one subject without poses: registered in pairs (ICP, by another's package), then all jointly."""

__all__ = ["joint", "pairwise", "turntable"]
