"""Offsets across each seam, and between surfaces that are seen twice: what they show of the mirrors."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..mesh import SEAM, Mesh
from ..numeric.kernels import njit
from ..views.view_maps import ViewMaps

_WINDOW = 4  # px to each side over which a normal is averaged
_SAME_SURFACE = 0.05  # readings at a greater distance are of other surfaces [m]
_SEEN_TWICE = 0.015  # so near to what another view reads, it is the same surface [m]
_BLOCK, _ALIKE = 16, 0.7  # px across a block of surface seen twice, and least cosine between both normals
_LEAST_NORMALS_SUM = 1.0  # length of the sum of two ends' normals: across sharper bends nothing is known
_EVEN = 0.7  # cosine between that sum and the way against both lines of sight
_LEAST_SIGHTS_SUM = 0.2  # length of the sum of both lines of sight, beside the seam: of opposite ones nothing is known
_FEWEST_TRIANGLES = 6  # of a piece: fewer average too little noise
_FEWEST_NORMALS = 3.0  # length of the sum of the normals around a point: shorter, too few or too unlike to average
_TINY = 1e-9  # a length that must not divide [m]


@dataclass(frozen=True)
class SeamPieces:
    """Pieces of seams: where their two ends are, and how they face.

    ``low`` and ``high`` (K, 3) the middle of each end [m], ``views`` (K, 2) which views they are of, the lower first,
    ``along`` (K, 3) the unit vectors half way against both lines of sight, beside the seam: where the surface faces,
    free of the normals' noise. ``offset`` (K,) the chord's part along the sum of the ends' normals [m], ``gap`` (K,)
    the chord's length [m], ``bend`` (K,) half the angle between the ends' normals [rad]. Of surface seen twice, too
    (``twice`` (K,)): then ``along`` is its normal, and there is no gap to be bridged and no bend.
    """

    low: np.ndarray
    high: np.ndarray
    views: np.ndarray
    along: np.ndarray
    offset: np.ndarray
    gap: np.ndarray
    bend: np.ndarray
    twice: np.ndarray

    def and_also(self, other: SeamPieces) -> SeamPieces:
        """Both together."""
        return SeamPieces(*(np.concatenate((getattr(self, f.name), getattr(other, f.name))) for f in fields(self)))


def seam_pieces(mesh: Mesh, maps: ViewMaps, piece: float = 0.12) -> SeamPieces:
    """Cut the zippered seams into pieces and measure each.

    Seams between surface that both views see are left out: overlaps were brought to one surface and cut, whatever
    the mirrors.

    Parameters
    ----------
    mesh : Mesh
        As :func:`.zipper.zip_patches` leaves it: a seam's triangles follow each other.
    maps : ViewMaps
    piece : float
        Length of a piece [m].

    Notes
    -----
    O(seam triangles).
    """
    assert mesh.view is not None and mesh.kind is not None  # zippering knows both
    seam = mesh.triangles[mesh.kind == SEAM]
    view = mesh.view[seam]
    low, high = view.min(axis=1), view.max(axis=1)
    seam, view = seam[(low >= 0) & (low < high)], view[(low >= 0) & (low < high)]
    low, high = view.min(axis=1), view.max(axis=1)
    two = ((view == low[:, None]) | (view == high[:, None])).all(axis=1)
    seam, view, low, high = seam[two], view[two], low[two], high[two]
    used, seam = np.unique(seam, return_inverse=True)
    seam = seam.reshape(-1, 3)
    points = mesh.vertices[used]
    normals, twice = _ends_kernel(
        points, mesh.view[used], maps.depth, maps.labels, maps.normals, maps.to_view, maps.intrinsics, _WINDOW
    )
    # of each triangle one vertex is at one end and the edge across from it at the other
    at_low = (view == low[:, None]).astype(np.float64)
    weight = [at / at.sum(axis=1, keepdims=True) for at in (at_low, 1.0 - at_low)]
    ends = [np.einsum("tk,tkc->tc", w, points[seam]) for w in weight]
    faces = [np.einsum("tk,tkc->tc", w, normals[seam]) for w in weight]
    known = (np.linalg.norm(normals, axis=1) > 0.5)[seam].all(axis=1) & ~twice[seam].any(axis=1)
    number = _numbered(seam, low, high, 0.5 * (ends[0] + ends[1]), piece)
    number[~known] = -1
    count = np.bincount(number + 1, minlength=2)[1:]

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(number + 1, column, len(count) + 1)[1:] for column in values.T]
        return np.column_stack(sums) / np.maximum(count, 1)[:, None]

    p, q, n, m = (mean(values) for values in (*ends, *faces))
    first = np.full(len(count), -1)
    first[number[known][::-1]] = np.flatnonzero(known)[::-1]
    last = np.full(len(count), -1)
    last[number[known]] = np.flatnonzero(known)
    middle = 0.5 * (ends[0] + ends[1])
    enough = count >= _FEWEST_TRIANGLES
    p, q, n, m, first, last = p[enough], q[enough], n[enough], m[enough], first[enough], last[enough]
    n, m = _unit(n), _unit(m)
    chord, facing = q - p, n + m
    size = np.linalg.norm(facing, axis=1)
    facing = facing / np.maximum(size, _TINY)[:, None]
    views = np.column_stack((low, high))[first].astype(np.int64)
    # both views lose the surface where it turns away from them: half way between it faces against both lines of sight
    tangent = _unit(middle[last] - middle[first])
    against = -sum(_sight(end, side, maps) for end, side in ((p, views[:, 0]), (q, views[:, 1])))
    against -= (against * tangent).sum(axis=1)[:, None] * tangent
    against *= np.sign((against * facing).sum(axis=1))[:, None]
    even = np.linalg.norm(against, axis=1)
    good = (size > _LEAST_NORMALS_SUM) & (even > _LEAST_SIGHTS_SUM) & ((against * facing).sum(axis=1) > _EVEN * even)
    bend = 0.5 * np.arccos(np.clip((n * m).sum(axis=1), -1.0, 1.0))
    return SeamPieces(
        p[good],
        q[good],
        views[good],
        _unit(against)[good],
        (chord * facing).sum(axis=1)[good],
        np.linalg.norm(chord, axis=1)[good],
        bend[good],
        np.zeros(int(good.sum()), np.bool_),
    )


def surface_seen_twice(maps: ViewMaps, least: int = 12) -> SeamPieces:
    """Blocks of surface that two views see, and the offset between where they place it: no gap lies between.

    Parameters
    ----------
    maps : ViewMaps
    least : int
        Readings that a block of ``_BLOCK`` × ``_BLOCK`` pixels must have.

    Notes
    -----
    O(pixels of the subject).
    """
    low, high, normal, offset, views = _twice_kernel(
        maps.depth, maps.labels, maps.normals, maps.to_view, np.linalg.inv(maps.to_view), maps.intrinsics, least
    )
    none = np.zeros(len(offset))
    return SeamPieces(low, high, views, _unit(normal), offset, none, none, np.ones(len(offset), np.bool_))


def _sight(points: np.ndarray, views: np.ndarray, maps: ViewMaps) -> np.ndarray:
    """Unit vectors (N, 3) along which each point is seen by its view, where the subject really is."""
    rotation = maps.to_view[views, :3, :3]
    projected = np.einsum("nij,nj->ni", rotation, points) + maps.to_view[views, :3, 3]
    return np.einsum("nji,nj->ni", rotation, _unit(projected))


def _numbered(seam: np.ndarray, low: np.ndarray, high: np.ndarray, middle: np.ndarray, piece: float) -> np.ndarray:
    """The piece that each seam triangle belongs to: runs of triangles side by side, cut into equal lengths."""
    if not len(seam):
        return np.empty(0, np.int64)
    shared = (seam[1:, :, None] == seam[:-1, None, :]).sum(axis=(1, 2))
    begins = np.concatenate(([True], (shared < 2) | (low[1:] != low[:-1]) | (high[1:] != high[:-1])))
    run = np.cumsum(begins) - 1
    start = np.flatnonzero(begins)
    far = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))))
    far -= far[start][run]
    end = np.concatenate((start[1:], [len(seam)])) - 1
    length = far[end]
    parts = np.maximum(np.rint(length / piece), 1.0)
    at = np.minimum(far / np.maximum(length, _TINY)[run] * parts[run], parts[run] - 1).astype(np.int64)
    first = np.concatenate(([0], np.cumsum(parts[:-1]))).astype(np.int64)
    return first[run] + at


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), _TINY)[:, None]


@njit(cache=True, nogil=True)
def _ends_kernel(points, view, depth, labels, normals, to_view, intrinsics, window):
    """Unit normals (N, 3), averaged over the readings around each point in its own view, 0 where there are too few.

    And (N,) whether another view reads the same surface there.
    """
    height, width = depth.shape
    out, twice = np.zeros((len(points), 3)), np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        for k in range(len(to_view)):
            M = to_view[k]
            x = M[0, 0] * points[i, 0] + M[0, 1] * points[i, 1] + M[0, 2] * points[i, 2] + M[0, 3]
            y = M[1, 0] * points[i, 0] + M[1, 1] * points[i, 1] + M[1, 2] * points[i, 2] + M[1, 3]
            z = M[2, 0] * points[i, 0] + M[2, 1] * points[i, 1] + M[2, 2] * points[i, 2] + M[2, 3]
            if z <= 0.0:
                continue
            u, v = (
                int(np.rint(x / z * intrinsics[k, 0] + intrinsics[k, 2])),
                int(np.rint(y / z * intrinsics[k, 1] + intrinsics[k, 3])),
            )
            reach = window if k == view[i] else 0
            for row in range(max(v - reach, 0), min(v + reach + 1, height)):
                for column in range(max(u - reach, 0), min(u + reach + 1, width)):
                    if labels[row, column] != k:
                        continue
                    off = abs(depth[row, column] - z)
                    if k != view[i]:
                        twice[i] |= off < _SEEN_TWICE
                    elif off < _SAME_SURFACE:
                        for c in range(3):
                            out[i, c] += normals[row, column, c]
        length = np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
        for c in range(3):
            out[i, c] = out[i, c] / length if length > _FEWEST_NORMALS else 0.0
    return out, twice


@njit(cache=True, nogil=True)
def _twice_kernel(depth, labels, normals, to_view, from_view, intrinsics, least):
    """Means over blocks of pixels of a view and over what a later view reads of the same surface.

    Both places (K, 3), the sums of both normals (K, 3), the latter's offset from the former along these (K,), and the
    views (K, 2).
    """
    height, width = depth.shape
    count = len(to_view)
    rows, columns = (height + _BLOCK - 1) // _BLOCK, (width + _BLOCK - 1) // _BLOCK
    room = rows * columns * count
    low, high, normal = np.empty((room, 3)), np.empty((room, 3)), np.empty((room, 3))
    offsets = np.empty(room)
    views = np.empty((room, 2), np.int64)
    sums, number = np.empty((count, count, 10)), np.empty((count, count), np.int64)
    p, other_eye = np.empty(3), np.empty(3)
    n = 0
    for block in range(rows * columns):
        top, left = block // columns * _BLOCK, block % columns * _BLOCK
        sums[:], number[:] = 0.0, 0
        for v in range(top, min(top + _BLOCK, height), 2):
            for u in range(left, min(left + _BLOCK, width), 2):
                a = labels[v, u]
                if a < 0 or a >= count - 1:
                    continue
                z = depth[v, u]
                x, y = (u - intrinsics[a, 2]) / intrinsics[a, 0] * z, (v - intrinsics[a, 3]) / intrinsics[a, 1] * z
                for r in range(3):
                    p[r] = from_view[a, r, 0] * x + from_view[a, r, 1] * y + from_view[a, r, 2] * z + from_view[a, r, 3]
                for b in range(a + 1, count):
                    for r in range(3):
                        other_eye[r] = to_view[b, r, 3]
                        for c in range(3):
                            other_eye[r] += to_view[b, r, c] * p[c]
                    if other_eye[2] <= 0.0:
                        continue
                    column = int(np.rint(other_eye[0] / other_eye[2] * intrinsics[b, 0] + intrinsics[b, 2]))
                    row = int(np.rint(other_eye[1] / other_eye[2] * intrinsics[b, 1] + intrinsics[b, 3]))
                    if row < 0 or column < 0 or row >= height or column >= width or labels[row, column] != b:
                        continue
                    other = depth[row, column]
                    if abs(other - other_eye[2]) > _SAME_SURFACE:
                        continue
                    alike = 0.0
                    for c in range(3):
                        alike += normals[v, u, c] * normals[row, column, c]
                    if alike < _ALIKE:
                        continue
                    x, y = (
                        (column - intrinsics[b, 2]) / intrinsics[b, 0] * other,
                        (row - intrinsics[b, 3]) / intrinsics[b, 1] * other,
                    )
                    number[a, b] += 1
                    ahead, size = 0.0, 0.0
                    for r in range(3):
                        q = (
                            from_view[b, r, 0] * x + from_view[b, r, 1] * y + from_view[b, r, 2] * other
                            + from_view[b, r, 3]
                        )  # fmt: skip
                        facing = normals[v, u, r] + normals[row, column, r]
                        ahead += (q - p[r]) * facing
                        size += facing * facing
                        sums[a, b, r] += p[r]
                        sums[a, b, 3 + r] += q
                        sums[a, b, 6 + r] += facing
                    sums[a, b, 9] += ahead / np.sqrt(size)
        for a in range(count):
            for b in range(a + 1, count):
                if number[a, b] < least:
                    continue
                for r in range(3):
                    low[n, r], high[n, r] = sums[a, b, r] / number[a, b], sums[a, b, 3 + r] / number[a, b]
                    normal[n, r] = sums[a, b, 6 + r]
                offsets[n] = sums[a, b, 9] / number[a, b]
                views[n, 0], views[n, 1] = a, b
                n += 1
    return low[:n], high[:n], normal[:n], offsets[:n], views[:n]
