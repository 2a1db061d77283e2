"""What can go wrong, told in the user's words: what is wrong, where, and what to do."""


class MirrorScanError(Exception):
    """Root of every error Mirror Scan raises on purpose; its text is shown to the user."""


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


class Cancelled(MirrorScanError):
    """The user stopped the work; nothing was changed."""
