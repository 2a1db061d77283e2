"""What the views prove empty: a camera that reads a surface through a point has seen that nothing is there."""

from __future__ import annotations

import numpy as np
from numba import njit

from .overlap import look_at


@njit(cache=True, nogil=True)
def in_free_space(p, to_view, depth, seen, lens, noise, slack):
    """Whether some view looks through ``p`` at something farther: then nothing of the subject is there.

    A view speaks only where the readings around the pixel are all its own and lie farther by more than ``slack`` and
    noise.
    """
    for k in range(len(to_view)):
        v, u, z = look_at(p, to_view[k], depth, lens[k])
        if v < 1 or u < 1 or v > depth.shape[0] - 2 or u > depth.shape[1] - 2:
            continue
        y, x = int(v + 0.5), int(u + 0.5)
        farther = 0
        free = True
        for dv in range(-1, 2):
            for du in range(-1, 2):
                d = depth[y + dv, x + du]
                if d == 0:
                    continue
                if seen[y + dv, x + du] != k or d <= z + slack + 3.0 * noise[k] * z:
                    free = False
                farther += 1
        if free and farther >= 4:
            return True
    return False


@njit(cache=True, nogil=True)
def bridge_is_free(a, b, to_view, depth, seen, lens, noise):
    """Whether the straight bridge from a to b crosses space that was seen to be empty."""
    length = np.sqrt(((a - b) ** 2).sum())
    if length < 0.02:
        return False
    steps = min(int(length / 0.015) + 1, 12)
    for s in range(1, steps):
        if in_free_space(a + (b - a) * (s / steps), to_view, depth, seen, lens, noise, 0.015):
            return True
    return False
