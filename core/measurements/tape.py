"""A tape about points of a plane: their convex hull, its length, and what each part of it rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plane_cuts import plane_axes

DIRECTIONS = 360
"""In which the tape is asked what it rests on; a circle comes out short by 0.001 %."""


@dataclass(frozen=True)
class Tape:
    """A closed convex loop.

    Parameters
    ----------
    length : float
        [m]
    loop : np.ndarray [shape=(K, 3), dtype=float64]
        Its corners in order; the last is followed by the first [m].
    rests_on : np.ndarray [shape=(DIRECTIONS,), dtype=int64]
        The point, of those it was laid about, that is farthest out in each direction.
    outward : np.ndarray [shape=(DIRECTIONS, 3), dtype=float64]
        The directions. A surface that lies further out by d in directions of an angle α makes the tape longer by α d
        (Cauchy's formula: the length is the integral of the distance of the tangents over all directions).
    """

    length: float
    loop: np.ndarray
    rests_on: np.ndarray
    outward: np.ndarray


def lay_tape(points: np.ndarray, normal: np.ndarray) -> Tape:
    """The tape about points (P, 3), P ≥ 1, of a plane with ``normal`` (3,) [m]. O(P · DIRECTIONS)."""
    first, second = plane_axes(normal)
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outward = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    rests_on = np.einsum("dk,pk->dp", outward, points - points[0]).argmax(axis=1)
    corners = rests_on[rests_on != np.roll(rests_on, 1)]
    if not len(corners):
        corners = rests_on[:1]
    loop = points[corners]
    length = float(np.linalg.norm(loop - np.roll(loop, -1, axis=0), axis=1).sum())
    return Tape(length, loop, rests_on, outward)
