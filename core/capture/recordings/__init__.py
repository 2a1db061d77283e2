"""Readers of recordings, a file each; ``reader_choice`` imports them by name, when one is asked."""

__all__: list[str] = []
