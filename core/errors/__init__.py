"""Messages for the user: errors and notices."""

from .exceptions import CaptureError, MirrorError, MirrorScanError, OutputError, PicksDisagreeError, ReconstructionError
from .notices import Notice

__all__ = [
    "CaptureError",
    "MirrorError",
    "MirrorScanError",
    "Notice",
    "OutputError",
    "PicksDisagreeError",
    "ReconstructionError",
]
