"""Cameras: the pinhole and its lens, noise models of sensors, image registration."""

from __future__ import annotations

from .pinhole import Intrinsics, project, unproject
from .rgbd_image import RgbdImage

__all__ = [
    "Intrinsics",
    "RgbdImage",
    "project",
    "unproject",
    "image_registration",
    "image_resampling",
    "noise_models",
    "pinhole",
]
