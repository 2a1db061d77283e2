"""The whole job, read top to bottom: :func:`reconstruct`."""

from __future__ import annotations

from .reconstruction import finish, reconstruct, reconstruction_steps
from .scan import KnownScene
from .settings import Settings
from .surface import Reconstruction

__all__ = [
    "KnownScene",
    "Reconstruction",
    "Settings",
    "finish",
    "reconstruct",
    "reconstruction_steps",
    "avatar_stages",
    "inspection",
    "mirror_placement",
    "multi_camera",
    "reconstruction",
    "report",
    "rig_calibration",
    "scan",
]
