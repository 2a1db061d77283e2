"""Every frame of a recording a closed avatar: the rig placed once, depth steadied in time, frames streamed."""

from __future__ import annotations

from .recording import Recording, open_recording
from .rig_placement import SequenceRig, place_rig
from .sequence import SequenceFrame, SequenceSettings, reconstruct_sequence
from .surface_filter import SurfaceFilter, SurfaceFilterSettings
from .temporal_filter import DepthFilter, FilterSettings

__all__ = [
    "DepthFilter",
    "FilterSettings",
    "Recording",
    "SequenceFrame",
    "SequenceRig",
    "SequenceSettings",
    "SurfaceFilter",
    "SurfaceFilterSettings",
    "open_recording",
    "place_rig",
    "reconstruct_sequence",
    "sequence_files",
    "skeleton_tracking",
    "video",
]
