"""What a camera wrote, as one data type: :class:`Capture`. ``open_capture(path)`` picks the reader."""

from __future__ import annotations

from .capture import Capture, MirrorPicks, ReadOptions
from .decoding.file_indices import FileIndices
from .frames import chosen_frames, empty_burst
from .reader_choice import frame_count, is_capture, open_capture

__all__ = [
    "Capture",
    "FileIndices",
    "MirrorPicks",
    "ReadOptions",
    "chosen_frames",
    "empty_burst",
    "frame_count",
    "is_capture",
    "open_capture",
    "camera_poses",
    "capture_summary",
    "depth_units",
    "folders",
    "frames",
    "live_camera",
    "nominal_intrinsics",
    "rgbd_writer",
    "single_files",
    "upright_grid",
]
