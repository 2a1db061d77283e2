"""The whole job, read top to bottom: :func:`reconstruct`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .mesh import Mesh

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Reconstruction:
    """What :func:`reconstruct` made of a capture.

    ``mesh`` is in ``frame`` ("avatar" or "camera"); ``report`` is the content of ``report.json``
    (plain dict, list, str, int, float, bool), except ``timings_ms`` of writing files.
    """

    mesh: Mesh
    frame: str
    camera_to_avatar: np.ndarray
    report: dict
    warnings: tuple[str, ...] = field(default=())
