"""The colours that views, kinds of surface, parts of a capture and depths are shown in, the same everywhere."""

from __future__ import annotations

import numpy as np

KIND_PALETTE = ((206, 206, 209), (222, 30, 36), (52, 112, 220))
"""sRGB of surface, seam and fill, by :data:`.triangle_mesh.SURFACE`, ``SEAM`` and ``FILL``."""

VIEW_PALETTE = ((226, 178, 74), (66, 150, 214), (122, 190, 88), (190, 110, 200), (230, 120, 90), (90, 200, 190))
"""sRGB of what is seen directly, then through each mirror; begins again after the last."""

MADE = (150, 150, 152)
"""sRGB of what no view saw."""

PART_PALETTE = ((96, 98, 104), (70, 104, 92), (240, 160, 60), (120, 64, 64))
"""sRGB of the room, the floor, the subject and what lies beyond the depth limit, by the numbers of :data:`PARTS`."""

PARTS = ("room", "floor", "subject", "too far")


def view_colors(view: np.ndarray) -> np.ndarray:
    """SRGB (V, 3) uint8 of view numbers: 0 direct, 1… through that mirror, negative = no view."""
    view = np.asarray(view)
    table = np.array(VIEW_PALETTE, np.uint8)
    colors = table[view % len(table)]
    colors[view < 0] = MADE
    return colors


def kind_colors(kind: np.ndarray) -> np.ndarray:
    """SRGB (T, 3) uint8 of kinds of triangle: 0 surface, 1 seam, 2 fill."""
    return np.array(KIND_PALETTE, np.uint8)[np.asarray(kind)]


def part_colors(part: np.ndarray) -> np.ndarray:
    """SRGB (N, 3) uint8 of parts of a capture, numbers as in :data:`PARTS`."""
    return np.array(PART_PALETTE, np.uint8)[np.asarray(part)]


def depth_colors(depth: np.ndarray) -> np.ndarray:
    """SRGB (..., 3) uint8 of distances: near yellow, far violet, no reading (0) black.

    The range is that of the middle 98 % of the readings.
    """
    depth = np.asarray(depth)
    valid = depth > 0
    image = np.zeros((*depth.shape, 3), np.uint8)
    if valid.any():
        near, far = np.percentile(depth[valid], (1, 99))
        shade = np.clip((far - depth[valid]) / max(far - near, 1e-6), 0, 1)
        anchors = ((68, 1, 84), (65, 68, 135), (42, 120, 142), (34, 168, 132), (122, 209, 81), (253, 231, 37))
        stops = np.linspace(0, 1, len(anchors))
        image[valid] = np.rint(np.stack([np.interp(shade, stops, c) for c in np.transpose(anchors)], axis=-1))
    return image


def sort_parts(
    view: np.ndarray,
    height: np.ndarray,
    depth: np.ndarray,
    clearance: float,
    max_height: float,
    depth_limit: float,
) -> np.ndarray:
    """What each reading shows, as a number of :data:`PARTS`: room, floor, subject or too far.

    The thresholds of :func:`.views.find_subject` are applied at once to what it found earlier, for sliders;
    connectivity is not computed again.

    Parameters
    ----------
    view : np.ndarray [shape=(N,), dtype=int8]
        View of the subject's readings, negative elsewhere.
    height : np.ndarray [shape=(N,)]
        Above the floor, of where a reading really is [m].
    depth : np.ndarray [shape=(N,)]
        z [m].
    clearance, max_height : float
        The subject is looked for between these heights [m]; what is lower is the floor, as far as it is near it.
    depth_limit : float
        Readings beyond are too far [m]; 0 = none is.

    Returns
    -------
    np.ndarray [shape=(N,), dtype=int8]
    """
    part = np.zeros(len(view), np.int8)
    low = height <= clearance
    part[low & (height > -0.1)] = 1
    part[(view >= 0) & ~low & (height < max_height)] = 2
    if depth_limit > 0:
        part[depth > depth_limit] = 3
    return part
