"""Where each view's colours lie beside the mesh: its outline is moved to where colours of skin end.

Colours well inside and well outside of the outline are counted; how much likelier the one is than the other, summed
over a band along the outline, is largest where the outline lies on the subject's. Patterns on skin or wall do not
matter as long as their colours differ.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..mesh import Mesh
from .color_cameras import ColorView
from .visibility import depth_buffer, distance_to, hidden_pixels

_FARTHEST = 0.01  # shifts are sought up to so much of the image's width
_LEVELS = 12  # of each channel, where colours are counted
_ENOUGH = 300  # pixels inside and outside
_BLOCK = 24  # rows of the blocks that make the two halves [px]
_AGREE = 1.0  # both halves must say the same so nearly [px]
_UNCERTAIN, _NEAR = 0.0015, 0.75  # shifts below say more of the mesh's outline, and of pixels, than of colours [m, px]
_GROWN = (-1.5, 0.0, 1.5)  # by how much the mesh's outline may be too wide or too narrow [px]
_AS_GOOD = 0.97  # of the best score: that too wide or too narrow outlines fit as well
_LEAST = 0.04  # mean log likelihood ratio over the band, below which outlines say nothing


def view_shifts(mesh: Mesh, views: Sequence[ColorView]) -> np.ndarray:
    """By how much each view's image lies beside where its camera sees the mesh (K, 2) [px].

    0 where that is less than outlines are certain to, or uncertain: where alternate blocks of rows, taken for
    themselves, do not say the same, or colours of subject and surroundings are too much alike. Where two views of a
    camera agree its other views take their mean.
    """
    found = [_shift(mesh, view) for view in views]
    shifts = np.zeros((len(views), 2))
    for k, view in enumerate(views):
        if found[k] is not None:
            shifts[k] = found[k]
            continue
        others = [f for f, v in zip(found, views, strict=True) if f is not None and v.image is view.image]
        if len(others) > 1 and np.ptp(others, axis=0).max() < 0.002 * view.intrinsics.width:
            shifts[k] = np.mean(others, axis=0)
    return shifts


def _shift(mesh: Mesh, view: ColorView) -> np.ndarray | None:
    """One view's shift (2,) [px], None where it is uncertain."""
    depth, scale = depth_buffer(mesh, view.from_avatar, view.intrinsics)
    mask = np.isfinite(depth)
    if mask.sum() < _ENOUGH:
        return None
    reach = max(4, int(np.ceil(_FARTHEST * depth.shape[1])))
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    margin = 4 * reach
    window = (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )
    mask, image = mask[window], _scaled(view.image, depth.shape)[window]
    unusable = hidden_pixels(mesh, view, depth, scale)[window]
    outside, inside = distance_to(mask), distance_to(~mask)
    clear = distance_to(unusable) > reach if unusable.any() else np.ones(mask.shape, np.bool_)
    code = (image.astype(np.int64) * _LEVELS // 256) @ (_LEVELS * _LEVELS, _LEVELS, 1)
    within = code[(inside > reach) & clear]
    without = code[(outside > reach) & (outside < margin) & clear]
    if min(len(within), len(without)) < _ENOUGH:
        return None
    ratio = _log_ratio(within, without)[code]
    height = np.where(mask, inside - 0.5, 0.5 - outside)
    shape = [-(-(n + 2 * reach) // 64) * 64 for n in mask.shape]  # sizes that the transform is quick with
    spectrum = np.fft.rfft2(ratio, shape)
    found = []
    for grown in _GROWN:
        sign = _band(height + grown, reach, clear)
        scores = _scores(sign, spectrum, shape, reach)
        found.append((float(scores.max() / max(np.abs(sign).sum(), 1.0)), _peak(scores), sign, scores))
    most, whole, sign, scores = max(found, key=lambda one: one[0])
    half = (np.arange(len(mask)) // _BLOCK)[:, None] % 2 == 0
    first = _scores(np.where(half, sign, 0.0), spectrum, shape, reach)
    peaks = [_peak(first), _peak(scores - first)]
    if whole is None or peaks[0] is None or peaks[1] is None or most < _LEAST:
        return None
    if np.abs(peaks[0] - peaks[1]).max() > _AGREE:
        return None
    # a mesh that is too thin or too thick moves to where most of its outline is known
    others = [peak for worth, peak, _, _ in found if peak is not None and worth > _AS_GOOD * most]
    told = np.ptp(others, axis=0) <= _AGREE
    # no nearer than the mesh's own outline is known
    pixel = float(np.median(depth[np.isfinite(depth)])) / view.intrinsics.fx
    shift = (whole - reach) / scale
    told &= np.abs(shift) > max(_UNCERTAIN / pixel, _NEAR / scale)
    return np.where(told, shift, 0.0)


def _scaled(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The image at the size of a depth buffer: each pixel's nearest."""
    rows = ((np.arange(shape[0]) + 0.5) * image.shape[0] / shape[0]).astype(np.int64)
    columns = ((np.arange(shape[1]) + 0.5) * image.shape[1] / shape[1]).astype(np.int64)
    return image[rows[:, None], columns]


def _log_ratio(within: np.ndarray, without: np.ndarray) -> np.ndarray:
    """How much likelier each colour is inside than outside, natural logarithm, from counts smoothed over neighbours."""
    tables = []
    for codes in (within, without):
        table = np.bincount(codes, minlength=_LEVELS**3).reshape(_LEVELS, _LEVELS, _LEVELS).astype(np.float64)
        for axis in range(3):
            padded = np.pad(table, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            low, high = [slice(None)] * 3, [slice(None)] * 3
            low[axis], high[axis] = slice(0, -2), slice(2, None)
            table = 0.5 * table + 0.25 * (padded[tuple(low)] + padded[tuple(high)])
        tables.append((table.ravel() + 0.5) / (table.sum() + 0.5 * table.size))
    return np.clip(np.log(tables[0] / tables[1]), -2.0, 2.0)


def _band(height: np.ndarray, reach: int, clear: np.ndarray) -> np.ndarray:
    """1 inside and -1 outside of an outline at ``height`` 0 (h, w), as far as ``reach``; both weigh the same."""
    sign = np.where(height > 0, 1.0, -1.0) * ((np.abs(height) <= reach) & clear)
    sign[height > 0] *= (sign < 0).sum() / max((sign > 0).sum(), 1)
    return sign


def _scores(sign: np.ndarray, spectrum: np.ndarray, shape: list[int], reach: int) -> np.ndarray:
    """Σ sign(x) ratio(x + s) for shifts s up to ``reach`` each way: (2 reach + 1, 2 reach + 1), rows first."""
    product = np.fft.irfft2(np.conj(np.fft.rfft2(sign, shape)) * spectrum, shape)
    near = np.arange(-reach, reach + 1)
    return product[near[:, None] % shape[0], near % shape[1]]


def _peak(scores: np.ndarray) -> np.ndarray | None:
    """Place (x, y) of the largest score, between places by parabolas; None when it lies at the border."""
    row, column = np.unravel_index(int(scores.argmax()), scores.shape)
    if not (0 < row < scores.shape[0] - 1 and 0 < column < scores.shape[1] - 1):
        return None
    place = []
    for before, at, after in (
        (scores[row, column - 1], scores[row, column], scores[row, column + 1]),
        (scores[row - 1, column], scores[row, column], scores[row + 1, column]),
    ):
        bend = 2 * at - before - after
        place.append(0.5 * (after - before) / bend if bend > 0 else 0.0)
    return np.array((column + place[0], row + place[1]))
