"""Readers of recordings, one module a format; ``reader_choice`` imports them by name when needed."""

__all__: list[str] = []
