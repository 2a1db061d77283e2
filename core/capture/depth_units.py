"""The unit of stored depth, recognised by its pattern where neither an option nor the file states it.

Who decides, everywhere in this package: an option, then what the file or its format states, then the pattern of the
values (:func:`recognise_unit`), then millimetres for whole and metres for real numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import CaptureError, Notice
from .kinect_disparity import HEIGHT, NO_READING, WIDTH

UNIT_MISTAKES = (
    (Notice("millimetres taken for metres"), 0.001),
    (Notice("metres taken for millimetres"), 1000.0),
    (Notice("TUM's 5000 to a metre taken for millimetres"), 0.2),
    (Notice("13 bits of millimetres above three of the player (Kinect's SDK) taken for millimetres"), 0.125),
    (Notice("tenths of millimetres taken for millimetres"), 0.1),
    (Notice("centimetres taken for millimetres, or millimetres for tenths of them"), 10.0),
    (Notice("millimetres taken for TUM's 5000 to a metre"), 5.0),
)
"""Usual mistakes, and by what the depth unit must be multiplied."""

SCENE_DEPTH_M = 10.0  # what repeats exactly beyond this, far behind all else, is no reading of a depth camera
_ENOUGH = 500  # readings before a pattern counts as one
_USUAL_M = (0.15, 8.0)  # half of a scan's readings lie in between
_DISTINCT = 50  # different values before a pattern counts as one: a test card is no camera
_SAMPLE = 60_000  # readings that a pattern is looked for in
_FAR = 8000  # whole numbers that do not go beyond are millimetres: no camera here sees farther
_PLAYER_UNKNOWN = 8191  # millimetres that Kinect's SDK 1 writes where it knows nothing

_ROTATED = "depth is written with its bits rotated by three, as SUN RGB-D does"
_PLAYER = "depth is written as millimetres above three bits that name the player, as Kinect's SDK 1 does"
_FIVES = "depth is taken to be 5000 to a metre, as TUM RGB-D writes it (its values are multiples of 5)"


@dataclass(frozen=True)
class DepthUnit:
    """Metres in one unit, and what precedes the multiplication.

    ``bits`` is "" for plain numbers, ``rotated`` for SUN RGB-D's and ``player`` for millimetres above three bits of
    player. ``note`` says what was taken for what, for a person; empty where that goes without saying.
    """

    metres: float
    bits: str = ""
    note: str = ""


def metres(values: np.ndarray, unit_m: float | None) -> tuple[np.ndarray, str]:
    """Whole or real numbers as depth (…) float32 [m], and a note of what was taken for what.

    Parameters
    ----------
    values : np.ndarray [shape=(..., H, W)]
        As stored; what is not positive or not finite is no reading.
    unit_m : float or None
        Metres in a unit, as an option or the file states it; None goes by :func:`recognise_unit`.
    """
    unit = DepthUnit(unit_m) if unit_m is not None else recognise_unit(values)
    return in_metres(values, unit), unit.note


def in_metres(values: np.ndarray, unit: DepthUnit) -> np.ndarray:
    """Depth (…) float32 [m] of numbers in a known unit.

    Raises
    ------
    CaptureError
        When they are neither whole nor real numbers.
    """
    _check_type(values)
    if values.dtype.kind == "f":
        depth = _readings(values)
        return depth if unit.metres == 1 else depth * np.float32(unit.metres)
    largest = np.iinfo(values.dtype).max
    values = np.maximum(values, 0)
    if largest * unit.metres < SCENE_DEPTH_M:  # else it is too far to be a reading anyhow
        values[values == largest] = 0
    if unit.bits:
        wide = values.astype(np.uint32)
        values = wide >> 3
        unknown = (values == _PLAYER_UNKNOWN) & (wide & 7 == 0)
        beside = int(((values < _PLAYER_UNKNOWN) & (values > _PLAYER_UNKNOWN - 10)).sum())
        if int(unknown.sum()) > 10 * beside:  # more than a wall at that distance would have
            values[unknown] = 0
        if unit.bits == "rotated":
            values |= (wide & 7) << 13
    for units, unit_m in ((1000, 0.001), (5000, 0.0002)):  # divided, as the folder reader does, to the last bit
        if unit.metres == unit_m:
            return np.divide(values, units, dtype=np.float32)
    return (values * unit.metres).astype(np.float32)


def recognise_unit(values: np.ndarray) -> DepthUnit:
    """The unit that the pattern of the values speaks for; the default where none does.

    Real numbers are metres unless their median is beyond 100: then millimetres, as libfreenect2 has them. What
    renderers write where nothing was hit (:func:`background_limit`) does not count.

    Whole numbers are millimetres unless they would go beyond 8 m, and

    - neighbours nearly always have the same three low bits: millimetres shifted up by three, and the low bits are what
      16-bit millimetres have on top (SUN RGB-D) or the number of the player (Kinect's SDK 1);
    - nearly all are multiples of 5, and not of 10: TUM RGB-D's 5000 to a metre, made from millimetres.
    """
    _check_type(values)
    if values.dtype.kind == "f":
        depth = _readings(values.ravel()[:: max(1, values.size // (10 * _SAMPLE))])
        seen = depth[(depth > 0) & (depth < background_limit(depth))]
        if seen.size and np.median(seen) > 100:
            return DepthUnit(0.001, note=Notice("real numbers taken for {unit}", unit="millimetres"))
        return DepthUnit(1.0, note=Notice("real numbers taken for {unit}", unit="metres"))
    sample = values[..., :: max(1, min(values.size // _SAMPLE, values.shape[-2] // 16)), :]
    sample = np.where((sample > 0) & (sample < min(np.iinfo(values.dtype).max, 65535)), sample, 0)
    sample[sample >= background_limit(sample)] = 0
    read = sample[sample > 0]
    if read.size < _ENOUGH or np.percentile(read, 99) <= _FAR:
        return DepthUnit(0.001)
    left, right = sample[..., :-1], sample[..., 1:]
    differ = (left > 0) & (right > 0) & (left != right)
    same = ((left[differ] ^ right[differ]) & 7) == 0
    shifted = (same.size > _DISTINCT and same.mean() > 0.9) or (read & 7).max() <= 1
    if shifted and _varied(read):
        player = _names_players(np.where((values > 0) & (values < 65535), values, 0).astype(np.int32))
        return DepthUnit(0.001, "player", _PLAYER) if player else DepthUnit(0.001, "rotated", _ROTATED)
    if (read % 5 == 0).mean() > 0.99 and 0.2 < (read % 10 == 5).mean() < 0.8 and _varied(read):
        return DepthUnit(0.0002, note=_FIVES)
    return DepthUnit(0.001)


def doubt(values: np.ndarray, unit_m: float) -> list[str]:
    """A note where the unit that a file states puts the readings where no scan has them, and their pattern does not."""
    sample = values.ravel()[:: max(1, values.size // _SAMPLE)]
    typical = float(np.median(sample[sample > 0])) if (sample > 0).any() else 1 / unit_m
    if _USUAL_M[0] <= typical * unit_m <= _USUAL_M[1]:
        return []
    other = recognise_unit(values)
    likely_m = other.metres / 8 if other.bits else other.metres
    if not _USUAL_M[0] <= typical * likely_m <= _USUAL_M[1]:
        return []
    return [
        Notice(
            "the file states a depth unit of {unit:g} m, which puts half of the readings {side} {distance:.3g} m; by "
            "their pattern it is {likely:g} m: if so, give that as an option (--depth-unit) or correct the file",
            unit=unit_m, side="beyond" if typical * unit_m > 1 else "nearer than", distance=typical * unit_m,
            likely=likely_m,
        )
    ]  # fmt: skip


def background_limit(depth: np.ndarray, beyond: float = 0.0) -> float:
    """The value from which on depth is background that a renderer wrote where nothing was hit; inf where there is none.

    A far plane, the largest half or whole number, 1e10 and their like have three marks: one value that is repeated
    exactly, all else at less than half of it, and hardly anything in between (edges that were averaged with it). Of a
    value that a hundredth of the pixels have, and that counts by its distance, all else may be nearer to it.

    Parameters
    ----------
    depth : np.ndarray
        Readings in any unit; 0 where there is none.
    beyond : float
        Only what is at least so far counts; a wall that is seen squarely has one value, too.
    """
    limit = np.inf
    for _ in range(4):  # one image may have several of them
        seen = depth[(depth > 0) & (depth < limit)]
        top = float(seen.max(initial=0.0))
        nearer, equal = int((seen < top / 2).sum()), int((seen == seen.dtype.type(top)).sum())
        between = seen.size - nearer - equal
        if top < max(beyond, 1e-9) or equal < 5 or nearer < max(20, 0.002 * seen.size):
            break
        if between <= equal / 4:
            limit = max(top / 2, min(beyond, 0.85 * top))
        elif beyond and equal > 0.01 * depth.size and int((seen > 0.85 * top).sum()) - equal <= equal / 4:
            limit = 0.85 * top
        else:
            break
    return limit


def is_raw_disparity(values: np.ndarray) -> bool:
    """Whether an image holds raw 11-bit values of a Kinect v1: none beyond 2047, which stands for no reading."""
    if values.dtype.kind not in "ui" or not values.size or values.shape[-2:] != (HEIGHT, WIDTH):
        return False
    largest = int(values.max())
    return (
        largest in (NO_READING, NO_READING + 1) and (values == 0).mean() < 0.01 and (values >= NO_READING).mean() > 1e-3
    )


def _check_type(values: np.ndarray) -> None:
    if values.dtype.kind in "ui" and values.dtype.itemsize == 1:
        raise CaptureError(
            "depth cannot be numbers of 8 bits; save the frame again without converting it", code="not_a_capture"
        )
    if values.dtype.kind not in "uif" or (values.dtype.kind in "ui" and values.dtype.itemsize > 8):
        raise CaptureError(f"depth must be whole or real numbers, not {values.dtype}", code="not_a_capture")


def _readings(values: np.ndarray) -> np.ndarray:
    """Real numbers (…) float32, 0 where they are no reading."""
    with np.errstate(over="ignore", invalid="ignore"):
        values = values.astype(np.float32, copy=False)  # half floats end at 65504
        return np.where(np.isfinite(values) & (values > 0) & (values < 1e9), values, np.float32(0))


def _varied(read: np.ndarray) -> bool:
    return len(np.unique(read)) >= _DISTINCT


def _names_players(values: np.ndarray) -> bool:
    """Whether the three low bits name players, and are not the top of distances beyond 8.19 m.

    Where they change from one pixel to the next, one of the two readings makes a continuous surface: a person who
    stands on the floor, or a room that goes on beyond 8.19 m. Where neither does, distances beyond 8.19 m would begin
    there, and a person is never nearer than what the camera can see.
    """
    near, low = values >> 3, values & 7
    if not low.any():
        return False
    far = near + (low << 13)
    players = rooms = 0
    for axis in (-1, -2)[: values.ndim]:
        a, b = (tuple(np.moveaxis(v, axis, 0)[s] for v in (near, low, far)) for s in (slice(1, None), slice(-1)))
        change = (a[0] > 0) & (b[0] > 0) & (a[1] != b[1])
        players += int((np.abs(a[0] - b[0])[change] <= 20 + 0.03 * np.minimum(a[0], b[0])[change]).sum())
        rooms += int((np.abs(a[2] - b[2])[change] <= 500).sum())
    if max(players, rooms) >= 3:
        return players > rooms
    return bool(np.percentile(near[low > 0], 5) >= 400)
