"""The unit of whole numbers, recognised by their pattern: millimetres, TUM's 0.2 mm, or SUN RGB-D's rotated bits."""

from __future__ import annotations

import numpy as np

from ..errors import CaptureError, Notice
from .kinect_disparity import NO_READING

_ENOUGH = 500  # readings before a pattern counts as one


def metres(values: np.ndarray, unit_m: float | None) -> tuple[np.ndarray, str]:
    """Whole or real numbers as depth (…) float32 [m], and a note of what was taken for what.

    Whole numbers are millimetres unless nearly all are multiples of 8 (SUN RGB-D: the low 3 bits hold what 16-bit
    millimetres have on top, of which up to 16 m use one) or of 5 (TUM RGB-D: 5000 to a metre, from millimetres). Real
    numbers are metres unless their median is beyond 100: then millimetres, as libfreenect2 has them.
    """
    if values.dtype.kind not in "uif" or (values.dtype.kind in "ui" and values.dtype.itemsize > 8):
        raise CaptureError(f"depth must be whole or real numbers, not {values.dtype}")
    note: str = ""
    if values.dtype.kind == "f":
        depth = np.where(np.isfinite(values) & (values > 0) & (values < 1e9), values, 0).astype(np.float32)
        if unit_m is None:
            positive = depth[depth > 0]
            unit_m = 0.001 if positive.size and np.median(positive) > 100 else 1.0
            unit = "millimetres" if unit_m == 0.001 else "metres"
            note = Notice("real numbers taken for {unit}", unit=unit)
        return (depth if unit_m == 1 else depth * np.float32(unit_m)), note
    values = np.maximum(values, 0)
    read = values[values > 0]
    if unit_m is None:
        unit_m = 0.001
        if read.size >= _ENOUGH and read.max() > 2000:
            low = read & 7
            if values.dtype == np.uint16 and (low <= 1).all() and (low == 0).mean() > 0.6:
                values = (values >> 3) | (values << 13)
                note = "depth is written with its bits rotated by three, as SUN RGB-D does"
            elif (read % 5 == 0).mean() > 0.99:
                unit_m = 0.0002
                note = "depth is taken to be 5000 to a metre, as TUM RGB-D writes it (its values are multiples of 5)"
    if unit_m == 0.001:
        return np.divide(values, 1000, dtype=np.float32), note  # as the folder reader has it, to the last bit
    if unit_m == 0.0002:
        return np.divide(values, 5000, dtype=np.float32), note
    return (values * unit_m).astype(np.float32), note


def is_raw_disparity(values: np.ndarray) -> bool:
    """Whether an image holds raw 11-bit values of a Kinect v1: none beyond 2047, which stands for no reading."""
    if values.dtype.kind not in "ui" or not values.size:
        return False
    largest = int(values.max())
    return (
        largest in (NO_READING, NO_READING + 1) and (values == 0).mean() < 0.01 and (values >= NO_READING).mean() > 1e-3
    )
