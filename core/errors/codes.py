"""What kinds of errors there are, by codes that stay as they are while the words of messages change.

A program goes by the code, a person reads the text. The add-on offers what cures each (``scene/kept_errors.py``).
"""

from __future__ import annotations

import errno
from typing import Literal, get_args

ErrorCode = Literal[
    # the capture
    "unsaved", "not_loaded", "not_a_capture", "gone", "damaged", "empty", "frames", "memory",
    "lens_missing", "lens_wrong", "rotation", "unit", "color", "camera",
    # what it shows
    "no_mirror", "mirror", "mirror_file", "rig_file", "nobody", "size", "noise",
    # the avatar and what is made of it
    "avatar", "scaled", "no_skeleton", "no_person", "no_data", "motion", "stream", "writing",
    # the program
    "program", "wheels", "worker", "other",
]  # fmt: skip
"""``unsaved``: a path relative to a file that has no place yet. ``not_loaded``: no capture is there to work with.
``gone``: a file or folder is missing or cannot be read. ``frames``: none or too many are chosen. ``rotation``: width
and height are exchanged. ``size``: the result is not of a person's size. ``no_person``: a mesh is not of a whole
person. ``no_data``: a mesh lacks what only an avatar has. ``worker``: the process that does the work ended."""

CODES: frozenset[str] = frozenset(get_args(ErrorCode))


def code_of(error: OSError) -> ErrorCode:
    """The code of an error of the operating system: a full disk cannot be written to, what is missing is gone."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG):
        return "writing"
    return "memory" if error.errno == errno.ENOMEM else "gone"
