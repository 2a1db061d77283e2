"""Mirrors as the plain records that a scene keeps."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence

import numpy as np

from ...core.errors import MirrorError
from ...core.mirrors import Mirror
from .mirror_judgement import ENOUGH, picks_of


def record_of(mirror: Mirror, picks: Sequence = ()) -> dict:
    """A fitted mirror as a record; ``plane`` holds every field of it as JSON."""
    content = {field.name: _plain(getattr(mirror, field.name)) for field in dataclasses.fields(mirror)}
    return {
        "name": mirror.name,
        "picks": [list(map(float, pick)) for pick in picks],
        "source": mirror.source,
        "plane": json.dumps(content),
        "residual_mm": 1000.0 * float(mirror.residual),
        "message": "",
    }


def mirror_of(record: dict) -> Mirror:
    """The fitted mirror of a record, under the name that the record has now.

    Raises
    ------
    MirrorError
        When the record has none, or one that somebody edited into nonsense.
    """
    try:
        content = json.loads(record["plane"])
        known = {field.name for field in dataclasses.fields(Mirror)}
        values = {name: _restored(name, value) for name, value in content.items() if name in known}
        mirror = Mirror(**(values | {"name": record["name"]}))
        shapes = [np.shape(value) for value in (mirror.point, mirror.normal, mirror.basis)]
        if shapes != [(3,), (3,), (3, 3)]:
            raise ValueError(f"shapes are {shapes}")
        return dataclasses.replace(
            mirror, residual=float(mirror.residual), points_used=int(mirror.points_used), source=str(mirror.source)
        )
    except (ValueError, TypeError, AttributeError) as error:
        raise MirrorError(f"{record['name']}: is not placed; find the mirrors or pick points on its frame") from error


def _plain(value):
    """A field of a mirror as JSON has it."""
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _restored(name: str, value):
    """The inverse of :func:`_plain`: a list is an array, but for fields that are tuples."""
    if not isinstance(value, list):
        return value
    if name == "moved_by":
        return tuple(map(str, value))
    if name == "frame_bow":
        return tuple(map(float, value))
    if name == "bow_by_frame":
        return tuple(np.array(one, dtype=np.float64) for one in value)
    return np.array(value, dtype=np.float64)


def record_of_picks(known) -> dict:
    """What a capture says of a mirror, as a record that is not fitted yet, or of the plane it gives."""
    if known.frame_pixels is None:
        from ...core.mirrors.mirror import plane_mirror

        return record_of(plane_mirror(known.name, known.point, known.normal))
    picks = np.asarray(known.frame_pixels, dtype=float).tolist()
    return {"name": known.name, "picks": picks, "source": "picked", "plane": "", "residual_mm": 0.0, "message": ""}


def known_mirror(record: dict):
    """What to build with: picks, which are fitted again to all frames, else the plane that was given or found."""
    return picks_of(record) if len(record["picks"]) >= ENOUGH else mirror_of(record)
