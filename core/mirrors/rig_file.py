"""Rig files: mirrors that stay where they are, written once and used for every capture."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..errors import CaptureError, MirrorError
from ..io.atomic_files import replacing
from ..io.json_files import text_of
from .glass_extent import at_border
from .mirror import Mirror, oriented, plane_mirror

FORMAT, VERSION = "mirror-scan rig", 1
MAX_BYTES = 1_000_000
_LARGEST, _FARTHEST = 1e6, 1e3  # of all numbers, and of places [m]
_INTRINSICS_KEYS = ("width", "height", "fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class RigFile:
    """A camera's intrinsics and the mirrors in front of it."""

    intrinsics: Intrinsics
    mirrors: tuple[Mirror, ...]


def write_rig(path: str | os.PathLike, rig: RigFile) -> None:
    """Write a rig file; what was there is replaced only by a complete one. Raises OutputError."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "intrinsics": {key: getattr(rig.intrinsics, key) for key in _INTRINSICS_KEYS},
        "mirrors": [_entry(m) for m in rig.mirrors],
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _entry(m: Mirror) -> dict:
    assert m.rectangle is not None and m.outline is not None  # calibration takes no others
    return {
        "name": m.name,
        "point": m.point.tolist(),
        "normal": m.normal.tolist(),
        "down": m.basis[:, 1].tolist(),
        "rectangle": m.rectangle.tolist(),
        "outline": m.outline.tolist(),
        "covariance": None if m.covariance is None else m.covariance.tolist(),
        "residual_mm": 1000.0 * m.residual,
        "points_used": m.points_used,
        "sag_mm": 1000.0 * m.sag,
        "sag_error_mm": 1000.0 * m.sag_error,
        "glass_thickness_mm": 1000.0 * m.glass_thickness,
        "frame_ahead_mm": 1000.0 * m.frame_ahead,
    }


def read_rig(path: str | os.PathLike) -> RigFile:
    """Read what :func:`write_rig` wrote.

    Raises
    ------
    MirrorError
        The file is missing, no rig file, of a later version, or holds values that cannot be.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise MirrorError(f"{path}: is too large to be a rig file; calibrate the rig to have one", code="rig_file")
        content = json.loads(text_of(path.read_bytes(), "strict"))
    except (OSError, ValueError, RecursionError) as error:
        reason = f"{error.strerror if isinstance(error, OSError) else 'it is not JSON'}; choose another file"
        raise MirrorError(f"{path}: cannot be read as a rig file: {reason}", code="rig_file") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise MirrorError(f"{path}: is not a rig file; calibrate the rig to have one", code="rig_file")
    if content.get("version") != VERSION:
        raise MirrorError(
            f"{path}: has version {content.get('version')}, this program reads version {VERSION}; calibrate again",
            code="rig_file",
        )
    stored, entries = content.get("intrinsics"), content.get("mirrors")
    if not isinstance(stored, dict) or not isinstance(entries, list) or not entries:
        raise MirrorError(f"{path}: holds no camera or no mirrors; calibrate again", code="rig_file")
    width, height, fx, fy, cx, cy = (_number(path, "intrinsics", stored.get(key)) for key in _INTRINSICS_KEYS)
    try:
        intrinsics = Intrinsics(int(width), int(height), fx, fy, cx, cy)
    except CaptureError as error:
        raise MirrorError(f"{path}: {error}", code="rig_file") from error
    return RigFile(intrinsics, tuple(_mirror(path, k, entry, intrinsics) for k, entry in enumerate(entries, start=1)))


def _number(path: Path, where: str, value: object) -> float:
    # an integer of a file may be too large for a float
    if isinstance(value, bool) or not isinstance(value, int | float) or not -_LARGEST < value < _LARGEST:
        raise MirrorError(
            f"{path}: {where}: a number is missing, not finite or far too large; calibrate again", code="rig_file"
        )
    return float(value)


def _array(path: Path, name: str, entry: dict, key: str, shape: tuple[int, ...]) -> np.ndarray:
    try:
        array = np.array(entry.get(key), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise MirrorError(f"{path}: {name}: “{key}” holds no numbers; calibrate again", code="rig_file") from error
    if array.shape != shape or not (np.abs(array) < _FARTHEST).all():
        raise MirrorError(
            f"{path}: {name}: “{key}” must hold {' × '.join(map(str, shape))} numbers below {_FARTHEST:g}; "
            "calibrate again",
            code="rig_file",
        )
    return array


def _mirror(path: Path, place: int, entry: object, intrinsics: Intrinsics) -> Mirror:
    if not isinstance(entry, dict):
        raise MirrorError(f"{path}: mirror {place} is not a JSON object; calibrate again", code="rig_file")
    given = entry.get("name")
    name = given if isinstance(given, str) else f"mirror {place}"
    point, normal, down = (_array(path, name, entry, key, (3,)) for key in ("point", "normal", "down"))
    rectangle = _array(path, name, entry, "rectangle", (2, 2))
    if (rectangle[:, 0] >= rectangle[:, 1]).any() or np.linalg.norm(np.cross(normal, down)) < 0.1:
        raise MirrorError(
            f"{path}: {name}: its rectangle is empty, or “normal” and “down” are parallel; calibrate again",
            code="rig_file",
        )
    placed = plane_mirror(name, point, normal)
    normal, basis = oriented(placed.normal, point, down)
    covariance = entry.get("covariance")
    if covariance is not None:
        covariance = _array(path, name, entry, "covariance", (3, 3))
        spread = np.linalg.eigvalsh(0.5 * (covariance + covariance.T))
        if spread[0] < -1e-6 * max(spread[-1], 0.0) or np.abs(covariance - covariance.T).max() > 1e-6 * spread[-1]:
            raise MirrorError(
                f"{path}: {name}: “covariance” is not a covariance matrix; calibrate again", code="rig_file"
            )
    return at_border(
        replace(
            placed,
            normal=normal,
            basis=basis,
            rectangle=rectangle,
            residual=_number(path, name, entry.get("residual_mm")) / 1000.0,
            points_used=int(_number(path, name, entry.get("points_used"))),
            refined=True,
            source="rig file",
            covariance=covariance,
            # older files lack these: flat, thin glass, level with its frame
            sag=_number(path, name, entry.get("sag_mm", 0.0)) / 1000.0,
            sag_error=_number(path, name, entry.get("sag_error_mm", 0.0)) / 1000.0,
            glass_thickness=_number(path, name, entry.get("glass_thickness_mm", 0.0)) / 1000.0,
            frame_ahead=_number(path, name, entry.get("frame_ahead_mm", 0.0)) / 1000.0,
        ),
        intrinsics,
        np.zeros((2, 2), np.bool_),
    )


def mirrors_for(rig: RigFile, intrinsics: Intrinsics) -> tuple[Mirror, ...]:
    """The rig's mirrors, when it was calibrated with this camera; else MirrorError."""
    old = rig.intrinsics
    if (old.width, old.height) != (intrinsics.width, intrinsics.height):
        raise MirrorError(
            f"the rig was calibrated at {old.width}×{old.height} pixels, the capture has "
            f"{intrinsics.width}×{intrinsics.height}; calibrate it with the same camera and mode",
            code="rig_file",
        )
    difference = max(abs(old.fx / intrinsics.fx - 1), abs(old.fy / intrinsics.fy - 1))
    if difference > 0.005 or max(abs(old.cx - intrinsics.cx), abs(old.cy - intrinsics.cy)) > 2.0:
        raise MirrorError(
            "the rig was calibrated with another lens: its focal lengths or centre differ from the capture's; "
            "calibrate it with the same camera and mode",
            code="rig_file",
        )
    return rig.mirrors
