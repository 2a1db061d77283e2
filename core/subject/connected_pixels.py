"""Connected components of pixels, not connected over depth jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from ..numeric.union_find import root_of

IN_FRONT = 0.05  # m: what is nearer by more than noise is in front of the other
# a depth jump: what a surface seen at a slant of 83° spans over a pixel, in pixels, and noise and rounding, of z
_SLANT, _NOISE = 8.0, 0.012
_OUTLINE_SAMPLES = 3000  # so many pixels of an outline say how far it is from something
_NEAREST, _WIDEST = 0.2, 60  # m: z that a window is sized for at least; px: its largest radius


@dataclass(frozen=True)
class Readings:
    """Every reading of a capture at its place in space: what the search for the subject works on.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z as read, along the whole path [m], 0 = no reading.
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each reading: 0 direct, 1..N through mirror N; -1 = none.
    points : np.ndarray [shape=(H, W, 3), dtype=float64]
        The readings, mirrored ones flipped back, camera frame [m].
    up : np.ndarray [shape=(3,)]
        Unit vertical, camera frame.
    pixel_angle : float
        Of one pixel [rad].
    """

    depth: np.ndarray
    seen: np.ndarray
    points: np.ndarray
    up: np.ndarray
    pixel_angle: float


@dataclass(frozen=True)
class Pieces(Readings):
    """Readings grouped into connected pieces, C in all.

    Parameters
    ----------
    component : np.ndarray [shape=(H, W), dtype=int32]
        Piece of each pixel, -1 = none.
    sizes : np.ndarray [shape=(C,), dtype=int64]
        Pixels of each piece.
    """

    component: np.ndarray
    sizes: np.ndarray

    @property
    def count(self) -> int:
        """C, how many pieces there are."""
        return len(self.sizes)

    def pixels_of(self, member: np.ndarray) -> np.ndarray:
        """Bool (H, W): pixels of the pieces that are a ``member`` (C,)."""
        return of_pixels(member, self.component)


def of_pixels(values: np.ndarray, component: np.ndarray) -> np.ndarray:
    """What is said of each piece, ``values`` (C,), for each pixel by its ``component`` (H, W); 0 where it has none.

    There may be no piece at all.
    """
    return np.append(values, np.zeros(1, values.dtype))[component]  # -1 is the last


def gather_pixels(readings: Readings, upright: np.ndarray) -> Pieces:
    """The connected pieces of the pixels whose view (H, W) int8 in ``upright`` is not negative."""
    component, sizes = connected_pixels(readings.depth, upright, readings.pixel_angle)
    return Pieces(
        readings.depth, readings.seen, readings.points, readings.up, readings.pixel_angle, component, sizes
    )  # fmt: skip


@njit(cache=True, nogil=True)
def gap_kernel(component, member, near, points, total, reach):
    """Least distance (C,) [m] from each ``near`` component to a ``member`` about it in the image, ``reach``/z px off.

    Its outline is asked, thinned out where it is long, and of what is around it every other row and column.
    """
    height, width = component.shape
    gap = np.full(len(member), np.inf)
    met = np.zeros(len(member), np.int64)
    for v in range(height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not near[k]:
                continue
            met[k] += 1
            border = v == 0 or u == 0 or v == height - 1 or u == width - 1
            if not border:  # the nearest pixel is one of the outline
                border = (
                    component[v - 1, u] != k or component[v + 1, u] != k
                    or component[v, u - 1] != k or component[v, u + 1] != k
                )  # fmt: skip
            if not border or met[k] % (total[k] // _OUTLINE_SAMPLES + 1):
                continue
            radius = min(int(reach / max(points[v, u, 2], _NEAREST)) + 2, _WIDEST)
            for y in range(max(v - radius, 0), min(v + radius + 1, height), 2):
                for x in range(max(u - radius, 0), min(u + radius + 1, width), 2):
                    j = component[y, x]
                    if j >= 0 and member[j]:
                        d = 0.0
                        for c in range(3):
                            d += (points[v, u, c] - points[y, x, c]) ** 2
                        gap[k] = min(gap[k], d)
    return np.sqrt(gap)


@njit(cache=True, nogil=True)
def dilated(labels, radius):
    """Where a pixel of the direct view (label 0) is within a square of so many pixels to either side."""
    height, width = labels.shape
    rows = np.zeros((height, width), np.bool_)
    for v in range(height):
        until = -1
        for u in range(width):
            if labels[v, u] == 0:
                until = u + radius
                for x in range(u - 1, max(u - radius, 0) - 1, -1):
                    if rows[v, x]:
                        break
                    rows[v, x] = True
            if u <= until:
                rows[v, u] = True
    out = np.zeros((height, width), np.bool_)
    seen_at = np.full(width, -radius - 1)
    for v in range(height):
        for u in range(width):
            if rows[v, u]:
                seen_at[u] = v
            out[v, u] = v - seen_at[u] <= radius
    seen_at[:] = height + radius + 1
    for v in range(height - 1, -1, -1):
        for u in range(width):
            if rows[v, u]:
                seen_at[u] = v
            out[v, u] |= seen_at[u] - v <= radius
    return out


def member_table(chosen: np.ndarray, count: int) -> np.ndarray:
    """Bool (count,): which components are chosen."""
    table = np.zeros(count, np.bool_)
    table[chosen] = True
    return table


@njit(cache=True, nogil=True)
def label_kernel(component, member, seen, label, labels):
    """Write ``label`` where a pixel seen in that view has a component that is a ``member``."""
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if component[v, u] >= 0 and seen[v, u] == label and member[component[v, u]]:
                labels[v, u] = label


def connected_pixels(
    depth: np.ndarray, seen: np.ndarray, pixel_angle: float, jump: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Connected components of each view's pixels, not connected over depth jumps (two-pass union-find).

    ``jump``: how large these are, for a slanting surface 1.

    Returns
    -------
    component : np.ndarray [shape=(H, W), dtype=int32]
        Component of each pixel, -1 where ``seen`` is negative.
    sizes : np.ndarray [shape=(C,), dtype=int64]
    """
    return _components_kernel(depth, seen, pixel_angle, jump)


@njit(cache=True, nogil=True)
def _link(depth, seen, parent, v, u, dv, du, reach):
    """Join a pixel's component to that of its neighbour before it, unless a depth jump is between them."""
    y, x = v + dv, u + du
    if y < 0 or x < 0 or x >= seen.shape[1] or seen[y, x] != seen[v, u]:
        return
    here, there = v * seen.shape[1] + u, y * seen.shape[1] + x
    if parent[here] == parent[there] or abs(depth[y, x] - depth[v, u]) >= reach * min(depth[v, u], depth[y, x]):
        return
    a, b = root_of(parent, here), root_of(parent, there)
    parent[max(a, b)] = min(a, b)
    parent[here] = parent[there] = min(a, b)


@njit(cache=True, nogil=True)
def _components_kernel(depth, seen, pixel_angle, jump):
    height, width = depth.shape
    parent = np.empty(height * width, np.int32)
    near, far = jump * (_SLANT * pixel_angle + _NOISE), jump * (2.0 * _SLANT * pixel_angle + _NOISE)
    for v in range(height):
        for u in range(width):
            if seen[v, u] < 0:
                continue
            parent[v * width + u] = v * width + u
            _link(depth, seen, parent, v, u, 0, -1, near)
            _link(depth, seen, parent, v, u, -1, 0, near)
            _link(depth, seen, parent, v, u, -1, -1, near)
            _link(depth, seen, parent, v, u, -1, 1, near)
            # up to two pixels away, so that a line of missing readings does not cut a limb
            _link(depth, seen, parent, v, u, 0, -2, far)
            _link(depth, seen, parent, v, u, -2, 0, far)
    component = np.full((height, width), -1, np.int32)
    sizes = np.zeros(height * width, np.int64)
    count = 0
    for v in range(height):
        for u in range(width):
            if seen[v, u] < 0:
                continue
            root = root_of(parent, v * width + u)
            if root == v * width + u:
                component[v, u] = count
                count += 1
            else:
                component[v, u] = component[root // width, root % width]
            sizes[component[v, u]] += 1
    return component, sizes[:count]
