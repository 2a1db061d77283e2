"""What is said to people when something is wrong or worth knowing: errors and notices."""

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
