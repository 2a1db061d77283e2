"""What can go wrong, reported in the user's words: what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Iterable

from .notices import Notice


class MirrorScanError(Exception):
    """Root of every error Mirror Scan raises on purpose; its text is shown to the user.

    Parameters
    ----------
    text : str
        A template with ``values``, as of :class:`.notices.Notice`; a plain text or a notice without.
    mirrors, **values
        As of :class:`.notices.Notice`.
    """

    def __init__(self, text: str = "", /, *, mirrors: Iterable[str] = (), **values: object) -> None:
        super().__init__(Notice(text, mirrors=mirrors, **values) if values or mirrors else Notice.of(text))

    @property
    def notice(self) -> Notice:
        """The text with the parts it was made of."""
        return self.args[0]


class CaptureError(MirrorScanError):
    """The capture cannot be read: a file is missing, truncated or of the wrong kind."""


class MirrorError(MirrorScanError):
    """A mirror cannot be placed: too few points, collinear points, points on no reading."""


class PicksDisagreeError(MirrorError):
    """The points picked on a mirror lie in no common plane."""


class ReconstructionError(MirrorScanError):
    """The capture was read, but no avatar can be made of what it shows."""


class OutputError(MirrorScanError):
    """A result cannot be written; nothing that existed was touched."""
