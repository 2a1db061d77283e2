"""Whether readings show light that comes two ways, in a camera that measures phase."""

from __future__ import annotations

import numpy as np

from .irradiance import seen_at
from .lit_scene import LitScene, Surface

GHOST = 0.25
"""So near the middle of both ways is a reading of it [m]."""
FEWEST = 15
"""Readings astray below which there is no evidence."""

_SAMPLE = 700  # pixels of a view by which the evidence is judged
_DECISIVE = 3.0  # ratio from which a reading of the other way is expected
_AGREES = 0.12  # so near the skin is a reading of it [m]
_EVEN, _LOSING = 0.3, 1.5  # ways that differ by less [m] are mixed smoothly; ratio from which a pattern would be lost
_MOSTLY = 0.6  # share of such readings that is missing where a pattern is lost


def agreement(scene: LitScene) -> tuple[int, int, int]:
    """Of readings in mirrors that the camera's direct light must dominate: how many agree with the skin it shows.

    Also how many there are, those missing included, and how many are ghosts: in the middle between both ways.
    """
    agree = missing = ghosts = 0
    surface, light, lengths = sample(scene, 0)
    for other in range(1, len(scene.sources)):
        strong = (surface.z > 0) & (light[:, other] > 0) & (light[:, 0] > _DECISIVE * light[:, other])
        y, x, z, inside = seen_at(surface.points[strong], other, scene.mirrors, scene.intrinsics)
        there = scene.depth[y, x].astype(np.float64)
        middle = z * 0.5 * (1.0 + lengths[strong, 0] / lengths[strong, other])
        near = inside & (np.abs(there - z) < _AGREES)
        agree += int(near.sum())
        missing += int((inside & (there == 0)).sum())
        ghosts += int((inside & ~near & (np.abs(there - middle) < GHOST)).sum())
    return agree, agree + missing + ghosts, ghosts


def loses_its_pattern(scene: LitScene) -> bool:
    """Whether what two mirrors light over ways of almost the same length is missing.

    A camera that measures phase reads it: all its frequencies agree. One that loses its pattern does not.
    """
    missing = counted = 0
    for view in range(1, len(scene.sources)):
        surface, light, lengths = sample(scene, view)
        for other in range(1, len(scene.sources)):
            if other == view:
                continue
            even = np.abs(lengths[:, view] - lengths[:, other]) < _EVEN
            strong = (surface.z > 0) & even & (light[:, other] > 0) & (light[:, view] > _LOSING * light[:, other])
            y, x, _, inside = seen_at(surface.points[strong], other, scene.mirrors, scene.intrinsics)
            counted += int(inside.sum())
            missing += int((inside & (scene.depth[y, x] == 0)).sum())
    return counted >= FEWEST and missing > _MOSTLY * counted


def sample(scene: LitScene, view: int) -> tuple[Surface, np.ndarray, np.ndarray]:
    """Some pixels of a view as they are read, with :func:`.irradiance.irradiance` of what only readings hide."""
    rows, columns = np.nonzero((scene.labels == view) & (scene.depth > 0))
    step = max(len(rows) // _SAMPLE, 1)
    surface = scene.surface(scene.depth, scene.labels >= 0, rows[::step], columns[::step])
    return surface, *scene.light(surface.points, surface.normals, surface.view, (scene.depth, scene.labels))
