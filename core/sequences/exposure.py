"""One exposure for all frames: cameras choose it anew as the picture changes, and colours would flicker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..capture import Capture
from ..numeric.srgb import from_linear, to_linear

_DARKEST, _BRIGHTEST = 24, 240  # sRGB levels outside of these say nothing of the exposure
_FEWEST = 500  # pixels that must show the same in both frames
_STRIDE = 3  # of the pixels looked at
_LEAST = 0.004  # of a gain: smaller changes are noise
_MOST = 4.0  # larger gains are another light


def match_frame(capture: Capture, color: np.ndarray | None, background: np.ndarray) -> Capture:
    """The capture with its colours as the exposure of ``color`` would have them.

    Each channel gets one factor in linear light: the median ratio over the pixels where nothing moves. What is
    overexposed stays so.

    Parameters
    ----------
    capture : Capture
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        A frame of the same recording; None changes nothing.
    background : np.ndarray [shape=(H, W), dtype=float32]
        Depth [m] of what stands still in the whole recording; 0 elsewhere.
    """
    own = capture.color
    if own is None or color is None or own.shape != color.shape or background.shape != own.shape[:2]:
        return capture
    still = background[::_STRIDE, ::_STRIDE] > 0
    mine, wanted = own[::_STRIDE, ::_STRIDE][still], color[::_STRIDE, ::_STRIDE][still]
    told = ((mine >= _DARKEST) & (mine <= _BRIGHTEST) & (wanted >= _DARKEST) & (wanted <= _BRIGHTEST)).all(axis=1)
    if told.sum() < _FEWEST:
        return capture
    gains = np.median(to_linear(wanted[told] / 255.0) / to_linear(mine[told] / 255.0), axis=0)
    if not (np.abs(gains - 1.0) > _LEAST).any() or (gains > _MOST).any() or (gains < 1.0 / _MOST).any():
        return capture
    levels = to_linear(np.arange(256) / 255.0)[:, None] * gains
    table = np.clip(np.rint(255.0 * from_linear(np.clip(levels, 0.0, 1.0))), 0, 255).astype(np.uint8)
    table[255] = np.where(gains < 1.0, 255, table[255])
    return replace(capture, color=np.stack([table[own[..., k], k] for k in range(3)], axis=-1))
