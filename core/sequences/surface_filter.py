"""Closed surfaces steadied in time: each is drawn towards the one before, moved to where it would be now.

What flickers in a mesh is more than noise of depth: outlines, seams and fills fall out anew in every frame. So the
surface itself is averaged, too. Nodes spread over it find the rigid motion of their neighbourhoods that lays it on the
surface before (point to plane; nodes keep to their neighbours, as in embedded deformation, Sumner et al. 2007). What
then still lies between both, along the normal, is averaged where it is no more than what is usual; where it is more,
something moved in another way or came into view, and the vertex stays where it was measured. Triangles stay as they
are: the mesh is as closed as before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..mesh import Mesh
from ..mesh.bvh import Bvh, build_bvh, closest_point
from ..mesh.normals import triangle_normals, vertex_normals
from ..numeric.kernels import njit
from ..numeric.point_products import cross, lengths
from ..numeric.threads import each_range

_VOXEL, _REACH = 0.2, 0.3  # m: between nodes, and how far their motion reaches, one standard deviation
_NODES = 4  # nodes that move a point
_POINTS, _ROUNDS = 2500, 6  # points of the surface that are registered, and how often
_FAR, _NEAR = 0.15, 0.05  # m: where a point's partner is looked for, at first and at last
_FACING = 0.5  # cosine between normals; less is another side
_TURN, _SHIFT = 0.3, 0.08  # standard deviations of a neighbourhood's motion [rad], [m]
_NOISE = 0.004  # of a point of the surface [m], against these
_OUTLIER = 0.012  # m: from where a distance weighs less
_CLOSE = 0.42  # m: nodes that keep together
_MOST = 0.025  # m: no vertex is moved farther
_TINT = 40.0  # sRGB levels by which a colour may differ to be averaged


@dataclass(frozen=True)
class SurfaceFilterSettings:
    """How surfaces are steadied.

    Parameters
    ----------
    use : bool
    memory : int
        Frames that the mean goes back at most.
    deviations : float
        Of what usually lies between two surfaces: what differs by more is left.
    """

    use: bool = True
    memory: int = 10
    deviations: float = 4.0


@dataclass(frozen=True)
class _Surface:
    """The surface before: as steadied, with how many frames each vertex's mean has."""

    mesh: Mesh
    tree: Bvh
    normals: np.ndarray
    count: np.ndarray


class SurfaceFilter:
    """Filters the meshes of a sequence one after the other: ``filter.next(mesh)``."""

    def __init__(self, settings: SurfaceFilterSettings = SurfaceFilterSettings()) -> None:
        self._settings = settings
        self._before: _Surface | None = None

    def restart(self) -> None:
        """Forget the surface before."""
        self._before = None

    def begin(self, mesh: Mesh) -> None:
        """Take a mesh for the surface before: it is one that was steadied already."""
        if self._settings.use:
            self._keep(mesh, np.ones(len(mesh.vertices), np.float32))

    def next(self, mesh: Mesh) -> Mesh:
        """The next frame's mesh, steadied: the same triangles, vertices moved along their normals."""
        if not self._settings.use:
            return mesh
        count = np.ones(len(mesh.vertices), np.float32)
        if self._before is not None:
            mesh, count = self._steadied(mesh, self._before)
        self._keep(mesh, count)
        return mesh

    def _keep(self, mesh: Mesh, count: np.ndarray) -> None:
        normals = triangle_normals(mesh.vertices, mesh.triangles)
        normals = normals / np.maximum(lengths(normals), 1e-12)[:, None]
        self._before = _Surface(mesh, build_bvh(mesh.vertices, mesh.triangles), normals, count)

    def _steadied(self, mesh: Mesh, before: _Surface) -> tuple[Mesh, np.ndarray]:
        """The mesh drawn towards the one before, and how many frames each vertex's mean has."""
        normals = vertex_normals(mesh.vertices, mesh.triangles)
        nodes = _nodes(mesh.vertices)
        motion = _registered(mesh.vertices, normals, nodes, before)
        moved, turned = np.empty(normals.shape), np.empty(normals.shape)
        points = np.ascontiguousarray(mesh.vertices, np.float64)
        each_range(_moved_kernel, len(points), points, normals, nodes, motion, moved, turned)
        _, triangle, nearest = closest_point(before.tree, moved, _MOST)
        found = triangle >= 0
        found[found] = np.einsum("vi,vi->v", before.normals[triangle[found]], turned[found]) > _FACING
        gap = np.zeros(len(moved))
        gap[found] = np.einsum("vi,vi->v", nearest[found] - moved[found], turned[found])
        usual = 1.4826 * float(np.median(np.abs(gap[found]))) if found.any() else 0.0
        found &= np.abs(gap) <= min(self._settings.deviations * usual, _MOST)
        corners = before.mesh.triangles[triangle[found]]
        # the mean of the corners: their least would carry each new beginning on to all that lies about it
        frames = np.minimum(before.count[corners].mean(axis=1) + 1.0, self._settings.memory)
        share = 1.0 - 1.0 / frames
        vertices = points.copy()
        vertices[found] += (share * gap[found])[:, None] * normals[found]
        count = np.ones(len(vertices), np.float32)
        count[found] = frames
        vertices, back = _unfolded(points, vertices, mesh.triangles)
        count[back] = 1
        return replace(mesh, vertices=vertices, colors=_colors(mesh, before.mesh, found, corners, share)), count


def _colors(mesh: Mesh, before: Mesh, found: np.ndarray, corners: np.ndarray, share: np.ndarray) -> np.ndarray | None:
    """Colours averaged with those of the surface before, where both are alike."""
    if mesh.colors is None or before.colors is None:
        return mesh.colors
    own = mesh.colors[found].astype(np.float64)
    other = before.colors[corners].mean(axis=1)
    alike = np.abs(other - own).max(axis=1) < _TINT
    colors = mesh.colors.copy()
    colors[found] = np.rint(own + (share * alike)[:, None] * (other - own)).astype(np.uint8)
    return colors


def _nodes(vertices: np.ndarray) -> np.ndarray:
    """Points (N, 3) spread over the surface: the mean of what lies in each cell of a grid."""
    cells = np.floor(vertices / _VOXEL).astype(np.int64)
    cells -= cells.min(axis=0)
    number = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, place, number = np.unique(number, return_inverse=True, return_counts=True)
    return np.stack([np.bincount(place, vertices[:, k]) for k in range(3)], axis=1) / number[:, None]


def _shares(points: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (V, K) that move each point, and how much of its motion each gives."""
    count = min(_NODES, len(nodes))
    index, share = np.empty((len(points), count), np.intp), np.empty((len(points), count))
    for first in range(0, len(points), 4096):
        part = slice(first, first + 4096)
        apart = (points[part] ** 2).sum(axis=1)[:, None] - 2.0 * points[part] @ nodes.T + (nodes**2).sum(axis=1)
        index[part] = np.argpartition(apart, count - 1, axis=1)[:, :count]
        near = np.take_along_axis(apart, index[part], axis=1)
        share[part] = np.exp(-0.5 * np.maximum(near - near.min(axis=1, keepdims=True), 0.0) / _REACH**2)
    return index, share / share.sum(axis=1, keepdims=True)


def _moved(
    points: np.ndarray, normals: np.ndarray, nodes: np.ndarray, motion: np.ndarray,
    shares: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Points (V, 3) and normals moved by their nodes' motions (N, 6): small turns [rad] about them, and shifts [m]."""
    index, share = shares
    turn, shift = motion[index, :3], motion[index, 3:]
    arm = points[:, None] - nodes[index]
    moved = points + np.einsum("vk,vki->vi", share, cross(turn, arm) + shift)
    turned = normals + cross(np.einsum("vk,vki->vi", share, turn), normals)
    return moved, turned / np.maximum(lengths(turned), 1e-12)[:, None]


def _registered(vertices: np.ndarray, normals: np.ndarray, nodes: np.ndarray, before: _Surface) -> np.ndarray:
    """The motions (N, 6) of the nodes that lay the surface on the one before."""
    chosen = np.random.default_rng(0).permutation(len(vertices))[:_POINTS]
    points, facing = vertices[chosen], normals[chosen]
    index, share = shares = _shares(points, nodes)
    together = _neighbours(nodes)
    motion = np.zeros((len(nodes), 6))
    prior = np.diag([(_NOISE / _TURN) ** 2] * 3 + [(_NOISE / _SHIFT) ** 2] * 3)
    for step in range(_ROUNDS):
        reach = _NEAR + (_FAR - _NEAR) * max(0.0, 1.0 - step / (0.6 * _ROUNDS))
        moved, turned = _moved(points, facing, nodes, motion, shares)
        _, triangle, nearest = closest_point(before.tree, moved, reach)
        near = np.flatnonzero(triangle >= 0)
        toward = before.normals[triangle[near]]
        same = np.einsum("vi,vi->v", toward, turned[near]) > _FACING
        near, toward = near[same], toward[same]
        off = np.einsum("vi,vi->v", nearest[near] - moved[near], toward)
        weight = 1.0 / (1.0 + (off / _OUTLIER) ** 2)
        # a row for each point and node: the node alone moves the point
        arm = points[near][:, None] - nodes[index[near]]
        rows = np.concatenate((cross(arm, toward[:, None]), np.broadcast_to(toward[:, None], arm.shape)), axis=-1)
        rows, node = rows.reshape(-1, 6), index[near].ravel()
        weight = (share[near] * weight[:, None]).ravel()
        off = np.repeat(off, index.shape[1])
        equations = np.empty((len(nodes), 6, 6))
        right = np.empty((len(nodes), 6))
        for a in range(6):
            right[:, a] = np.bincount(node, weight * rows[:, a] * off, len(nodes))
            for b in range(a + 1):
                equations[:, a, b] = np.bincount(node, weight * rows[:, a] * rows[:, b], len(nodes))
                equations[:, b, a] = equations[:, a, b]
        motion = motion + np.linalg.solve(equations + prior, (right - motion @ prior)[..., None])[..., 0]
        motion = _with_neighbours(motion, nodes, together)
    return motion


def _unfolded(before: np.ndarray, after: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices moved from ``before`` to ``after``, and which were put back, so that no triangle turns over."""
    first, after = triangle_normals(before, triangles), after.copy()
    back = np.zeros(len(before), np.bool_)
    has_area = (first != 0.0).any(axis=1)
    some = np.flatnonzero(has_area)
    while True:  # each time at least one more is put back
        facing = np.einsum("ti,ti->t", triangle_normals(after, triangles[some]), first[some])
        over = some[facing <= 0.0]
        if not len(over):
            return after, back
        back[triangles[over]] = True
        after[back] = before[back]
        some = np.flatnonzero(has_area & back[triangles].any(axis=1))


def _neighbours(nodes: np.ndarray) -> np.ndarray:
    """How much nodes (N, N) keep to each other; rows sum to 1, or are 0 for a node that is alone."""
    apart = np.linalg.norm(nodes[:, None] - nodes, axis=2)
    near = np.where((apart < _CLOSE) & (apart > 0.0), np.exp(-0.5 * (apart / _REACH) ** 2), 0.0)
    return near / np.maximum(near.sum(axis=1, keepdims=True), 1e-12)


def _with_neighbours(motion: np.ndarray, nodes: np.ndarray, together: np.ndarray) -> np.ndarray:
    """Motions averaged half and half with those of the neighbours, as these would move this node."""
    turn = together @ motion[:, :3]
    # a neighbour's shift, seen from here: t + ω × (here - there)
    there = together @ (motion[:, 3:] - cross(motion[:, :3], nodes))
    shift = there + cross(turn, nodes)
    mean = np.concatenate((turn, shift), axis=1)
    alone = together.sum(axis=1) < 0.5
    return np.where(alone[:, None], motion, 0.5 * motion + 0.5 * mean)


@njit(cache=True, nogil=True, error_model="numpy")
def _moved_kernel(begin, end, points, normals, nodes, motion, moved, turned):
    """:func:`_moved` of some points, whose nodes are found on the way."""
    count = min(_NODES, len(nodes))
    near, share = np.empty(count, np.int64), np.empty(count)
    for v in range(begin, end):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        found = 0
        for n in range(len(nodes)):
            away = (x - nodes[n, 0]) ** 2 + (y - nodes[n, 1]) ** 2 + (z - nodes[n, 2]) ** 2
            if found == count and away >= share[count - 1]:
                continue
            k = min(found, count - 1)
            while k > 0 and share[k - 1] > away:
                share[k], near[k] = share[k - 1], near[k - 1]
                k -= 1
            share[k], near[k] = away, n
            found = min(found + 1, count)
        least, total = share[0], 0.0
        for k in range(count):
            share[k] = np.exp(-0.5 * (share[k] - least) / _REACH**2)
            total += share[k]
        tx = ty = tz = mx = my = mz = 0.0
        for k in range(count):
            n, part = near[k], share[k] / total
            a, b, c = motion[n, 0], motion[n, 1], motion[n, 2]
            rx, ry, rz = x - nodes[n, 0], y - nodes[n, 1], z - nodes[n, 2]
            mx += part * (b * rz - c * ry + motion[n, 3])
            my += part * (c * rx - a * rz + motion[n, 4])
            mz += part * (a * ry - b * rx + motion[n, 5])
            tx, ty, tz = tx + part * a, ty + part * b, tz + part * c
        moved[v, 0], moved[v, 1], moved[v, 2] = x + mx, y + my, z + mz
        a, b, c = normals[v, 0], normals[v, 1], normals[v, 2]
        nx, ny, nz = a + ty * c - tz * b, b + tz * a - tx * c, c + tx * b - ty * a
        length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
        turned[v, 0], turned[v, 1], turned[v, 2] = nx / length, ny / length, nz / length
