"""Messages for the user: errors and notices."""

from .codes import CODES, ErrorCode, code_of
from .exceptions import CaptureError, MirrorError, MirrorScanError, OutputError, PicksDisagreeError, ReconstructionError
from .notices import Notice

__all__ = [
    "CODES",
    "CaptureError",
    "ErrorCode",
    "MirrorError",
    "MirrorScanError",
    "Notice",
    "OutputError",
    "PicksDisagreeError",
    "ReconstructionError",
    "code_of",
]
