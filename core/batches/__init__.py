"""Many captures: found, identified by their content, their results kept and summed up."""

from .batch_folder import BatchFolder, Finished, open_batch_folder
from .batch_summary import Row, write_summary
from .capture_list import Found, find_captures, small_capture
from .digests import content_digest, settings_by_content, settings_digest, surroundings

__all__ = [
    "BatchFolder",
    "Finished",
    "Found",
    "Row",
    "content_digest",
    "find_captures",
    "settings_by_content",
    "open_batch_folder",
    "settings_digest",
    "small_capture",
    "surroundings",
    "write_summary",
]
