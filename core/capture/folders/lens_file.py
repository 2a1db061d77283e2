"""``intrinsic.json``: the lens and the depth unit that a file states, in our spelling or in that of other programs.

``color_intrinsic.json`` is one for the colour camera, and says where that is (:func:`read_color_file`).

A key that looks like a lens or a unit and has no effect is named in a note: what nobody uses must not pass for used.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...camera import Intrinsics
from ...camera.pinhole import brown_of_inverse, is_rigid
from ...errors import CaptureError, Notice
from ...io.json_files import load_json, number, numbers, short

DEFAULT_DEPTH_SCALE = 1000.0  # depth units per metre
MAX_SHIFT_M = 1.0  # between the depth and the colour camera of one device
_DISTORTION_KEYS = (
    "distortioncoefficients", "distortioncoeffs", "distortioncoefs", "distcoeffs", "distcoeff", "distcoefs",
    "coeffs", "coefficients", "distortionparameters", "distortionparams", "distortionvector", "lensdistortion",
    "distortion", "dist", "d",
)  # fmt: skip
_K_KEYS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
_UNIT_KEYS = (
    "depthscale", "depthunits", "depthunit", "depthfactor", "depthscalefactor", "pngdepthscale", "depthmapfactor",
)  # fmt: skip
_LOOSE_UNIT_KEYS = (
    "scale", "scalefactor", "unit", "units", "lengthunit", "metricscale", "meterscale", "zscale", "zunit", "zunits",
    "meterperunit", "metersperunit", "metresperunit", "unitspermeter", "unitspermetre", "unitinmeter",
)  # fmt: skip
_UNIT_WORDS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "cm": 0.01, "centimeter": 0.01,
    "centimeters": 0.01, "centimetre": 0.01, "centimetres": 0.01, "mm": 0.001, "millimeter": 0.001,
    "millimeters": 0.001, "millimetre": 0.001, "millimetres": 0.001, "um": 1e-6, "micrometer": 1e-6,
    "micrometers": 1e-6, "micrometre": 1e-6, "micrometres": 1e-6, "micron": 1e-6, "microns": 1e-6,
}  # fmt: skip
_MODEL_KEYS = ("model", "distortionmodel", "lensmodel", "cameramodel", "distortiontype")
_FISHEYE = ("fisheye", "equidistant", "kannala", "ftheta", "omni")
_OTHER_STREAM = ("color", "colour", "rgb", "extrinsic", "imu", "stereo", "infrared", "noise", "filter")
_MAX_NOTES = 6


@dataclass(frozen=True)
class LensFile:
    """What a file says of a depth camera.

    Parameters
    ----------
    intrinsics : Intrinsics or None
        With its distortion; None where they were not asked for and the file's are wrong.
    unit_m : float or None
        Metres in one stored unit; None where nobody wrote it.
    sensor : object
        The value of ``sensor``, whatever it is.
    sensor_from : str
        As in :class:`.capture.Capture`; our own folders say so where it was not a file.
    notes : tuple of str
        Spellings that were taken for ours, and keys that had no effect.
    """

    intrinsics: Intrinsics | None
    unit_m: float | None = None
    sensor: object = None
    sensor_from: str = "file"
    notes: tuple[str, ...] = ()


def lens_options(path: str | os.PathLike) -> dict[str, Any]:
    """The fields of :class:`.capture.ReadOptions` that a file of intrinsics, given as an option, stands for."""
    lens = read_lens_file(path)
    return {"intrinsics": lens.intrinsics, "lens_unit_m": lens.unit_m, "notes": lens.notes}


def read_intrinsics(path: str | os.PathLike) -> tuple[Intrinsics, float]:
    """Intrinsics and depth units per metre (1000 where the file does not say) of an ``intrinsic.json``.

    Raises
    ------
    CaptureError
        As :func:`read_lens_file` does.
    """
    lens = read_lens_file(path)
    assert lens.intrinsics is not None  # they were asked for
    return lens.intrinsics, DEFAULT_DEPTH_SCALE if lens.unit_m is None else 1 / lens.unit_m


def read_lens_file(path: str | os.PathLike, need_intrinsics: bool = True) -> LensFile:
    """Read an ``intrinsic.json``.

    ``intrinsic_matrix`` is nine numbers column by column, as Open3D writes it, or three rows of three; ``fx``, ``fy``,
    ``cx``, ``cy`` (RealSense: ``ppx``, ``ppy``) do as well. A ``depth_scale`` below 1 is metres per unit, as
    RealSense's software means it. ``distortion`` may hold 4, 5 or 8 coefficients as :class:`.pinhole.Intrinsics` has
    them. Other programs' names of the last two are understood.

    Parameters
    ----------
    path : path
        The file.
    need_intrinsics : bool
        False where other intrinsics take their place: then wrong ones here are nobody's concern.

    Raises
    ------
    CaptureError
        Unreadable JSON, a missing key, or values no pinhole camera has.
    """
    path = Path(path)
    notes: list[str] = []
    used: set[str] = {"intrinsic_matrix"}
    unit, content, intrinsics = None, {}, None
    try:
        loaded = load_json(path, CaptureError, "lens_wrong")
        if not isinstance(loaded, dict):
            raise CaptureError(
                f"{path}: must be a JSON object with width, height and intrinsic_matrix", code="lens_missing"
            )
        content = loaded
        unit = _unit(path, content, used, notes)
        intrinsics = _intrinsics(path, content, used, notes)
    except CaptureError:
        if need_intrinsics:
            raise
    given = content.get("sensor_from")
    sensor_from = given if given in ("format", "name", "size") else "file"
    if not need_intrinsics:
        return LensFile(None, unit, content.get("sensor"), sensor_from)
    assert intrinsics is not None  # without an error they were read
    notes += _resolution_note(path, intrinsics)
    for name, value in _unused(content, used):
        notes.append(
            Notice(
                "{name}: “{key}”: {value} was not used; the lens is written as “distortion” "
                "[k1, k2, p1, p2, k3, k4, k5, k6], the unit of depth as “depth_scale” (1000 for millimetres)",
                name=path.name, key=name, value=short(value),
            )
        )  # fmt: skip
    return LensFile(intrinsics, unit, content.get("sensor"), sensor_from, tuple(notes[:_MAX_NOTES]))


def read_color_file(path: Path) -> tuple[Intrinsics, np.ndarray | None, tuple[str, ...]]:
    """Read a ``color_intrinsic.json``: as ``intrinsic.json``, of the colour camera, plus ``depth_to_color``.

    ``depth_to_color`` is sixteen numbers column by column, as Open3D writes matrices, or four rows of four.

    Returns
    -------
    intrinsics : Intrinsics
        With its distortion.
    depth_to_color : np.ndarray [shape=(4, 4), dtype=float64] or None
        Takes points [m] of the depth camera's frame into the colour camera's; None where the file does not have it.
    notes : tuple of str

    Raises
    ------
    CaptureError
        As :func:`read_lens_file` does, and when ``depth_to_color`` is not a rotation and a shift in metres.
    """
    lens = read_lens_file(path)
    assert lens.intrinsics is not None  # they were asked for
    content = load_json(path, CaptureError, "lens_wrong")
    assert isinstance(content, dict)  # as was read above
    if "depth_to_color" not in content:
        return lens.intrinsics, None, lens.notes
    return lens.intrinsics, _depth_to_color(path, content["depth_to_color"]), lens.notes


def color_file(intrinsics: Intrinsics, depth_to_color: np.ndarray) -> dict[str, object]:
    """The content of a ``color_intrinsic.json`` that :func:`read_color_file` reads."""
    matrix = [intrinsics.fx, 0, 0, 0, intrinsics.fy, 0, intrinsics.cx, intrinsics.cy, 1]
    return {
        "width": intrinsics.width,
        "height": intrinsics.height,
        "intrinsic_matrix": matrix,
        **({} if intrinsics.is_pinhole else {"distortion": list(intrinsics.distortion)}),
        "depth_to_color": np.asarray(depth_to_color, np.float64).T.ravel().tolist(),
    }


def check_principal_point(where: object, intrinsics: Intrinsics) -> None:
    """Refuse a principal point at the edge of the image or outside, and one whose coordinates are exchanged.

    A picture cut out of a larger one has it off the middle; no scan has it at the edge. It is there when the
    intrinsics belong to another resolution: they would make an avatar of another shape and size.

    Raises
    ------
    CaptureError
        Naming ``where`` and the likely cause.
    """
    width, height = intrinsics.width, intrinsics.height
    fx, cx, cy = intrinsics.fx, intrinsics.cx, intrinsics.cy
    across, along = (cx + 0.5) / width, (cy + 0.5) / height
    scale = max(across, along) * 2
    said = f"{where}: cx={cx:g}, cy={cy:g} cannot be the image centre of {width}×{height} pixels"
    if 0.93 <= across <= 1.25 and 0.93 <= along <= 1.25:
        raise CaptureError(
            f"{said}, where it lies near half the size: these intrinsics look like those of a picture of double size; "
            "give the intrinsics of this resolution (halve fx, fy, cx and cy)",
            code="lens_wrong",
        )
    if fx < 0.55 * width and abs(across - 0.25) < 0.045 and abs(along - 0.25) < 0.045:
        raise CaptureError(
            f"{said}, where it lies near half the size: these intrinsics look like those of a picture of half the "
            "size; give the intrinsics of this resolution (double fx, fy, cx and cy)",
            code="lens_wrong",
        )
    if not (0.02 <= across <= 0.98 and 0.02 <= along <= 0.98):
        larger = f"; a picture {scale:.2g} times as large would have it there" if scale > 1.9 else ""
        raise CaptureError(
            f"{said}: it lies at the edge or outside, and must be in pixels, near half the size{larger}; "
            "give the intrinsics of this resolution",
            code="lens_wrong",
        )
    exchanged = abs(cx + 0.5 - height / 2) < 0.02 * height and abs(cy + 0.5 - width / 2) < 0.02 * width
    if exchanged and abs(width - height) > 0.15 * max(width, height):
        raise CaptureError(
            f"{said}: cx and cy look exchanged, as after a rotation of the picture; "
            f"write cx {cy:g} and cy {cx:g}, or give the intrinsics of this picture",
            code="lens_wrong",
        )


def _resolution_note(path: Path, intrinsics: Intrinsics) -> list[str]:
    """A doubt where the principal point is off the middle just as that of another usual resolution would be."""
    across, along = (intrinsics.cx + 0.5) / intrinsics.width, (intrinsics.cy + 0.5) / intrinsics.height
    usual = (1.6, 1.5, 4 / 3, 1.25, 0.8, 0.75, 2 / 3, 0.625)
    scale = next((s for s in usual if max(abs(2 * across - s), abs(2 * along - s)) < 0.015 * s), 0)
    if not scale or (scale < 1 and intrinsics.fx > 0.6 * intrinsics.width):  # a part cut out has a narrower view
        return []
    return [
        Notice(
            "{name}: the principal point lies at {share:.0%} of the width and of the height, as if the intrinsics were "
            "those of {width}×{height} pixels; give those of this resolution, unless the picture is part of a larger",
            name=path.name, share=scale / 2, width=round(intrinsics.width * scale),
            height=round(intrinsics.height * scale),
        )
    ]  # fmt: skip


def _intrinsics(path: Path, content: dict, used: set[str], notes: list[str]) -> Intrinsics:
    matrix = content.get("intrinsic_matrix")
    values = [content.get(key) for key in ("fx", "fy")]
    values += [content.get(key, content.get(other)) for key, other in (("cx", "ppx"), ("cy", "ppy"))]
    spelled = numbers(values, 4) if matrix is None else None
    missing = [key for key in ("width", "height", "intrinsic_matrix") if key not in content]
    if spelled is not None:
        missing = [key for key in missing if key != "intrinsic_matrix"]
    if missing:
        raise CaptureError(
            f"{path}: {', '.join(missing)} missing; write the values your camera's software gives", code="lens_wrong"
        )
    size = []
    for key in ("width", "height"):
        value = number(content[key])
        if not (value >= 1 and value == int(value)):
            raise CaptureError(
                f"{path}: {key} must be a positive whole number of pixels, not {short(content[key])}", code="lens_wrong"
            )
        size.append(int(value))
    width, height = size
    fx, fy, cx, cy = _pinhole(path, matrix) if spelled is None else (float(v) for v in spelled)
    _check_plausible(path, width, height, fx, fy, cx, cy)
    camera = Intrinsics(width, height, fx, fy, cx, cy)
    check_principal_point(path, camera)
    return Intrinsics(width, height, fx, fy, cx, cy, _distortion(path, content, camera, used, notes))


def _distortion(path: Path, content: dict, pinhole: Intrinsics, used: set[str], notes: list[str]) -> tuple[float, ...]:
    """Coefficients in our order; of a key of another name, a note says so."""
    key, coefficients = "", None
    if "distortion" in content:
        key, coefficients = "distortion", _coefficients(content["distortion"])
        if coefficients is None:
            raise CaptureError(
                f"{path}: distortion must be 4, 5 or 8 finite numbers [k1, k2, p1, p2, k3, k4, k5, k6], "
                f"not {short(content['distortion'])}",
                code="lens_wrong",
            )
    else:
        for name, value in content.items():
            if _plain(name) in _DISTORTION_KEYS and (coefficients := _coefficients(value)):
                key = name
                break
        single = {_plain(name): (name, value) for name, value in content.items() if _plain(name) in _K_KEYS}
        if not coefficients and single:
            values = [number(single[k][1]) if k in single else 0.0 for k in _K_KEYS]
            if np.isfinite(values).all():
                used |= {name for name, _ in single.values()}
                key, coefficients = ", ".join(name for name, _ in single.values()), values
    used.add(key)
    if not coefficients or not any(coefficients):
        return ()
    model = next((v for k, v in content.items() if _plain(k) in _MODEL_KEYS and isinstance(v, str)), "")
    if any(word in _plain(model) for word in _FISHEYE):
        raise CaptureError(
            f"{path}: its images are of a fisheye lens ({model[:30]}), which is not supported; rectify them, and give "
            "the intrinsics of the rectified ones",
            code="lens_wrong",
        )
    if key != "distortion":
        notes.append(Notice("{name}: the lens distortion is taken from “{key}”", name=path.name, key=key[:80]))
    if "inverse" in model.lower():
        return brown_of_inverse(tuple(coefficients), pinhole)
    return tuple(coefficients)


def _coefficients(value: object) -> list[float] | None:
    """0, 4, 5 or 8 numbers of a list, as it is or as OpenCV nests it; more when those are zero."""
    if isinstance(value, dict):
        value = value.get("data")
    while isinstance(value, list) and len(value) == 1 and isinstance(value[0], list):
        value = value[0]
    if isinstance(value, list) and value and all(isinstance(v, list) and len(v) == 1 for v in value):
        value = [v[0] for v in value]
    found = numbers(value, len(value)) if isinstance(value, list) else None
    if found is None:
        return None
    coefficients = [float(k) for k in found]
    if len(coefficients) in (12, 14) and not any(coefficients[8:]):
        coefficients = coefficients[:8]
    return coefficients if len(coefficients) in (0, 4, 5, 8) else None


def _unit(path: Path, content: dict, used: set[str], notes: list[str]) -> float | None:
    """Metres in a unit, where somebody wrote it."""
    if "depth_scale" in content:
        used.add("depth_scale")
        scale = number(content["depth_scale"])
        if not 0 < scale < math.inf:
            raise CaptureError(
                f"{path}: depth_scale must be a positive number of depth units per metre (1000 for millimetres), "
                f"not {short(content['depth_scale'])}",
                code="unit",
            )
        return 1 / scale if scale >= 1 else scale
    for name, value in content.items():
        plain = _plain(name)
        if plain not in _UNIT_KEYS:
            continue
        unit = _unit_of(value)
        if unit is None or (unit == 1 and "unit" in plain and not isinstance(value, str)):  # 1 of what?
            continue
        used.add(name)
        if abs(unit - 1 / DEFAULT_DEPTH_SCALE) > 1e-9:
            notes.append(
                Notice("{name}: a unit of depth is {unit:g} m by “{key}”", name=path.name, unit=unit, key=name[:80])
            )
        return unit
    return None


def _unit_of(value: object) -> float | None:
    """Metres that a number (1 and more: units in a metre) or a word means."""
    if isinstance(value, str):
        return _UNIT_WORDS.get(value.strip().lower())
    scale = number(value)
    if not 1e-7 <= scale <= 1e7:
        return None
    return 1 / scale if scale >= 1 else scale


def _unused(content: dict, used: set[str], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, object]]:
    """Keys, with their place, that look like a lens or a unit, say something, and were not used."""
    for name, value in content.items():
        plain = _plain(name)
        if (not prefix and name in used) or not isinstance(name, str):
            continue
        if isinstance(value, dict) and not (plain in _DISTORTION_KEYS and _says(value)):
            if depth < 3 and not any(word in plain for word in _OTHER_STREAM):
                yield from _unused(value, used, f"{prefix}{name[:40]}.", depth + 1)
        elif _looks_like_lens(plain, value) and _says(value):
            yield prefix + name[:40], value
        elif plain in _UNIT_KEYS or re.search(r"depth.*(scale|unit|factor|divisor|multipl|tomet)", plain):
            if value not in (None, "", []) and _unit_of(value) != 1 / DEFAULT_DEPTH_SCALE:
                yield prefix + name[:40], value
        elif plain in _LOOSE_UNIT_KEYS and _unit_of(value) not in (None, 1.0, 1 / DEFAULT_DEPTH_SCALE):
            yield prefix + name[:40], value  # 1 and “m” are said of other things, too


def _looks_like_lens(plain: str, value: object) -> bool:
    if plain in ("d", "dist"):  # as a single number, a distance
        return isinstance(value, list | dict)
    return plain in _DISTORTION_KEYS or plain in _K_KEYS or bool(re.search(r"distort|distcoe|coeff", plain))


def _says(value: object) -> bool:
    """Whether there is a number other than zero in a value."""
    if isinstance(value, list):
        return any(_says(v) for v in value[:100])
    if isinstance(value, dict):
        return any(_says(v) for k, v in value.items() if _plain(k) not in ("rows", "cols", "width", "height"))
    return bool(number(value)) and math.isfinite(number(value))


def _plain(name: object) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower()) if isinstance(name, str) else ""


def _pinhole(path: Path, value: object) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of ``intrinsic_matrix`` as it stands in the file."""
    nested = False
    if isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) for row in value):
        nested = True
        flat = numbers([v for row in value for v in row], 9)
    else:
        flat = numbers(value, 9)
    if flat is None:
        raise CaptureError(
            f"{path}: intrinsic_matrix must be nine finite numbers [fx,0,0, 0,fy,0, cx,cy,1], not {short(value)}",
            code="lens_wrong",
        )
    matrix = flat.reshape(3, 3) if nested else flat.reshape(3, 3).T
    if matrix[:2, 2].tolist() == [0, 0] and matrix[2, :2].any():
        order, wanted = ("column by column", matrix.T.tolist()) if nested else ("row by row", matrix.ravel().tolist())
        raise CaptureError(
            f"{path}: intrinsic_matrix is written {order}; write it as {json.dumps(wanted)}", code="lens_wrong"
        )
    fx, fy, cx, cy = (float(matrix[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if fx <= 0 or fy <= 0:
        raise CaptureError(
            f"{path}: focal lengths must be positive, got fx={fx:g}, fy={fy:g}; enter your camera's", code="lens_wrong"
        )
    skew = max(abs(matrix[0, 1]), abs(matrix[1, 0]))
    if skew > 1e-6 * fx or abs(matrix[2] - (0, 0, 1)).max() > 1e-9:
        raise CaptureError(
            f"{path}: intrinsic_matrix is not that of a pinhole camera; it must be [fx,0,0, 0,fy,0, cx,cy,1]",
            code="lens_wrong",
        )
    return fx, fy, cx, cy


def _depth_to_color(path: Path, value: object) -> np.ndarray:
    nested = isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) for row in value)
    flat = numbers([v for row in value for v in row] if nested else value, 16)  # type: ignore[attr-defined]
    if flat is None:
        raise CaptureError(
            f"{path}: depth_to_color must be sixteen finite numbers, column by column: a rotation, and a shift in "
            f"metres, not {short(value)}",
            code="color",
        )
    pose = flat.reshape(4, 4) if nested else flat.reshape(4, 4).T
    if not pose[:3, 3].any() and pose[3, :3].any():
        order, wanted = ("column by column", pose.T.tolist()) if nested else ("row by row", pose.ravel().tolist())
        raise CaptureError(f"{path}: depth_to_color is written {order}; write it as {json.dumps(wanted)}", code="color")
    if not is_rigid(pose):
        raise CaptureError(
            f"{path}: depth_to_color is not a rotation and a shift; write the transform of points of the depth "
            "camera's frame into the colour camera's (x right, y down, z forward), column by column",
            code="color",
        )
    shift = float(np.linalg.norm(pose[:3, 3]))
    if shift > MAX_SHIFT_M:
        raise CaptureError(
            f"{path}: depth_to_color moves points by {shift:.4g} m, and the two cameras of one device are not that far "
            "apart; its shift is in metres",
            code="color",
        )
    return pose


def _check_plausible(path: Path, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> None:
    """Refuse focal lengths in other units: they would distort the avatar without a warning."""
    if fx < 10 and fy < 10 and 0 < cx < 2 and 0 < cy < 2:
        raise CaptureError(
            f"{path}: fx={fx:g}, fy={fy:g}, cx={cx:g}, cy={cy:g} are in parts of the image's size; all are given in "
            f"pixels: fx and cx times {width}, fy and cy times {height}",
            code="lens_wrong",
        )
    for axis, focal, length in (("fx", fx, width), ("fy", fy, height)):
        if not 0.1 * length <= focal <= 50 * length:
            raise CaptureError(
                f"{path}: {axis}={focal:g} cannot be for {length} pixels (a field of view of "
                f"{2 * math.degrees(math.atan2(length, 2 * focal)):.3g}°); focal lengths are in pixels",
                code="lens_wrong",
            )
    for axis, centre, length in (("cx", cx, width), ("cy", cy, height)):
        if centre == 0:
            raise CaptureError(
                f"{path}: {axis}={centre:g} cannot be the image centre of {length} pixels; "
                "it is in pixels, near half the size, for this resolution",
                code="lens_wrong",
            )
