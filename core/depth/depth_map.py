"""A capture → the one depth map that everything after it works on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .burst_fusion import fuse_burst
from .outliers_and_dropouts import remove_flying_pixels
from .settings import DepthSettings

if TYPE_CHECKING:
    from ..capture import Capture


def one_depth_map(capture: Capture, settings: DepthSettings = DepthSettings()) -> tuple[np.ndarray, np.ndarray]:
    """The burst fused and its flying pixels removed.

    Parameters
    ----------
    capture : Capture
    settings : DepthSettings

    Returns
    -------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    spread : np.ndarray [shape=(H, W), dtype=float32]
        Of :func:`.burst_fusion.fuse_burst`: standard deviation over the frames, relative to z.

    Raises
    ------
    CaptureError
        When the capture holds no reading within the depth limits.

    Notes
    -----
    O(F log F) a pixel of F frames.
    """
    fused, spread = fuse_burst(capture.depth, settings)
    return remove_flying_pixels(fused, 1.0 / capture.intrinsics.fx, settings), spread
