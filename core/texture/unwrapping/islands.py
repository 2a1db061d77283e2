"""The skin cut into islands, each a topological disk, laid flat and packed: where each triangle lies in the image."""

from __future__ import annotations

import numpy as np

from ...avatar.pose import SkinWeights
from ...avatar.skeleton import BONES
from ...mesh.half_edges import twins
from ...mesh.normals import triangle_normals
from ...mesh.submesh import components_of, remove_bowties, renumbered
from ...mesh.triangle_mesh import Mesh
from ...numeric.threads import each
from .branches import FlatIsland, without_branches
from .disks import is_disk, without_small
from .flattening import flatten, flipped
from .packing import pack

_REGIONS = (
    ("Hips", "Spine", "Spine1", "Spine2", "LeftShoulder", "RightShoulder"), ("Neck", "Head"),
    ("LeftArm", "LeftForeArm"), ("RightArm", "RightForeArm"), ("LeftHand",), ("RightHand",),
    ("LeftUpLeg", "LeftLeg"), ("RightUpLeg", "RightLeg"), ("LeftFoot", "LeftToeBase"), ("RightFoot", "RightToeBase"),
)  # fmt: skip
"""Bones whose skin is cut as one piece."""

_SMALL = 0.002  # of the surface: a piece below goes to the neighbour with which it shares most of its border
_THING_SMALL, _THING_SMOOTHING = 0.006, 20  # the same of things, whose sides are more ragged than regions of bones
_SMOOTHING = 6  # rounds in which a triangle takes the region of most of its neighbours
_SLIVER = 0.02  # of a piece that is cut: as small
_LEAST = 8  # triangles of a piece that is still cut


def unwrap(mesh: Mesh, weights: SkinWeights | None, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3, 2) float32 of the triangles' corners in the image, and their islands (T,) int32.

    No triangle is flipped, and islands neither meet themselves nor one another.

    Parameters
    ----------
    mesh : Mesh
        A manifold, maybe with boundaries.
    weights : SkinWeights or None
        Of its vertices.
    gap : float
        Room that each island keeps about it, in parts of the image's side.
    """
    label = find_islands(mesh, weights)
    waiting = [np.flatnonzero(label == k) for k in range(int(label.max()) + 1)]
    pieces, flats, rows = [], [], []
    while waiting:
        laid = each(lambda piece: _laid_flat(mesh, piece), waiting)
        again = []
        for piece, (flat, triangles) in zip(waiting, laid, strict=True):
            if flat is None:
                again.extend(halved(mesh, piece))
                continue
            pieces.append(piece)
            flats.append(flat)
            rows.append(triangles)
        waiting = again
    if weights is None:
        parts = without_branches([FlatIsland(*one) for one in zip(pieces, flats, rows, strict=True)])
        pieces, flats, rows = ([part[k] for part in parts] for k in range(3))
    places = pack(flats, rows, gap)
    uv = np.empty((len(mesh.triangles), 3, 2), np.float32)
    island = np.empty(len(mesh.triangles), np.int32)
    order = sorted(range(len(pieces)), key=lambda k: int(pieces[k][0]))
    for number, k in enumerate(order):
        uv[pieces[k]] = places[k][rows[k]]
        island[pieces[k]] = number
    return uv, island


def _laid_flat(mesh: Mesh, piece: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Places (V, 2) of a piece's vertices, None where it must be cut, and its triangles in their numbers."""
    used, own = renumbered(mesh.triangles[piece], len(mesh.vertices))
    part = remove_bowties(Mesh(mesh.vertices[used], own))
    if not is_disk(own, len(used)):
        return None, own
    return flatten(part.vertices, part.triangles), part.triangles


def flipped_count(uv: np.ndarray) -> int:
    """How many of the triangles ``uv`` (T, 3, 2) are clockwise or without area in the image."""
    return int(flipped(uv.reshape(-1, 2).astype(np.float64), np.arange(3 * len(uv)).reshape(-1, 3)).sum())


def find_islands(mesh: Mesh, weights: SkinWeights | None = None) -> np.ndarray:
    """Number (T,) int32 of each triangle's island; every island is a disk.

    With weights the skin is cut along the regions of bones, each into its front and its back; without, by the side
    that the surface faces. Pieces that are no disk are halved across.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles.
    weights : SkinWeights, optional
        Of its vertices.

    Notes
    -----
    O(T) times the number of halvings of a piece, which is about 1.
    """
    triangles = mesh.triangles
    twin = twins(triangles, len(mesh.vertices))
    normals = triangle_normals(mesh.vertices, triangles)
    area = 0.5 * np.linalg.norm(normals, axis=1)
    bond = _bonds(normals, twin)
    if weights is None:
        label = _by_side(normals, twin, bond)
    else:
        label = _by_bone(mesh, weights, normals)
    rounds, least = (_SMOOTHING, _SMALL) if weights is not None else (_THING_SMOOTHING, _THING_SMALL)
    label = _smoothed(label, twin, area, bond, rounds)
    label = without_small(_without_spikes(label, twin), twin, area, least)
    pieces = [np.flatnonzero(label == k) for k in range(int(label.max()) + 1)] if len(label) else []
    island = np.full(len(triangles), -1, np.int32)
    count = 0
    while pieces:
        piece = pieces.pop()
        if is_disk(triangles[piece], len(mesh.vertices)):
            island[piece] = count
            count += 1
        else:
            pieces.extend(halved(mesh, piece))
    return island


def halved(mesh: Mesh, piece: np.ndarray) -> list[np.ndarray]:
    """A piece's triangles (K,) in two or more parts, cut by a plane through its middle.

    Of some planes the one that leaves the fewest parts and handles, and of those the one whose parts are flattest: have
    the longest border for their area. So tubes and fingers are cut lengthwise.
    """
    triangles = mesh.triangles[piece]
    if len(piece) <= _LEAST:
        return [piece[k : k + 1] for k in range(len(piece))]
    middle = mesh.vertices[triangles].mean(axis=1)
    area = np.linalg.norm(triangle_normals(mesh.vertices, triangles), axis=1) + 1e-15
    spread = middle - np.average(middle, axis=0, weights=area)
    axes = np.linalg.eigh((spread * area[:, None]).T @ spread)[1].T
    twin = twins(triangles, len(mesh.vertices))
    sides = mesh.vertices[np.roll(triangles, -1, axis=1)] - mesh.vertices[triangles]
    length = np.linalg.norm(sides, axis=2).ravel()
    best: tuple | None = None
    for axis in (*axes, axes[0] + axes[1], axes[0] - axes[1]):
        along = spread @ axis
        side = (along > np.average(along, weights=area)).astype(np.int64)
        parts = without_small(side, twin, area, _SLIVER)
        count = int(parts.max()) + 1
        if count < 2:
            continue
        groups = [piece[parts == k] for k in range(count)]
        bad = sum(not is_disk(mesh.triangles[group], len(mesh.vertices)) for group in groups)
        own = parts[np.arange(len(twin)) // 3]
        border = np.bincount(
            own[(twin < 0) | (own != parts[twin // 3])], length[(twin < 0) | (own != parts[twin // 3])]
        )
        rank = (bad + count, float((np.bincount(parts, area) / border**2).max()))
        if best is None or rank < best[0]:
            best = (rank, groups)
    if best is None:
        order = (np.arange(len(piece)) >= len(piece) // 2).astype(np.int64)
        parts = _components(triangles, order, len(mesh.vertices))
        return [piece[parts == k] for k in range(int(parts.max()) + 1)]
    return best[1]


def _by_bone(mesh: Mesh, weights: SkinWeights, normals: np.ndarray) -> np.ndarray:
    """Region of bones and side (T,) of each triangle: front or back, of feet top or sole, of hands which face."""
    triangles = mesh.triangles
    region_of = np.empty(len(BONES), np.int64)
    for region, names in enumerate(_REGIONS):
        region_of[[BONES.index(name) for name in names]] = region
    dense = np.zeros((len(weights.index), len(_REGIONS)))
    rows = np.arange(len(dense))
    for k in range(4):
        dense[rows, region_of[weights.index[:, k]]] += weights.weight[:, k]
    region = dense[triangles].sum(axis=1).argmax(axis=1)
    side = normals[:, 1] > 0
    for number, names in enumerate(_REGIONS):
        own = region == number
        if names[0].endswith("Foot"):
            side[own] = normals[own, 2] < 0
        elif names[0].endswith("Hand") and own.any():
            middle = mesh.vertices[triangles[own]].mean(axis=1)
            across = np.linalg.eigh(np.cov(middle.T))[1][:, 0] if len(middle) > 2 else np.array((0.0, 1.0, 0.0))
            side[own] = normals[own] @ across > 0
    return 2 * region + side


def _bonds(normals: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """0..1 (T, 3): how much each triangle has to do with its neighbours, nothing across creases."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    cosine = np.einsum("tc,tkc->tk", unit, unit[_neighbours(twin)])
    return np.clip(cosine, 0.0, 1.0) ** 4 * (twin.reshape(-1, 3) >= 0)


def _neighbours(twin: np.ndarray) -> np.ndarray:
    """The triangle (T, 3) at each side of each; itself at a border."""
    return np.where(twin >= 0, twin // 3, np.arange(len(twin)) // 3).reshape(-1, 3)


def _by_side(normals: np.ndarray, twin: np.ndarray, bond: np.ndarray) -> np.ndarray:
    """Side (T,) that each triangle faces: the nearest of six directions, of normals that are smoothed first."""
    smooth, neighbour = normals.copy(), _neighbours(twin)
    for _ in range(2 * _SMOOTHING):
        smooth = smooth + (bond[:, :, None] * smooth[neighbour]).sum(axis=1)
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    return (smooth @ axes.T).argmax(axis=1)


def _smoothed(label: np.ndarray, twin: np.ndarray, area: np.ndarray, bond: np.ndarray, rounds: int) -> np.ndarray:
    """Labels whose borders run straighter: a triangle takes what most of the area around it has."""
    neighbour = _neighbours(twin)
    share = np.zeros((len(label), int(label.max()) + 1))
    share[np.arange(len(label)), label] = 1.0
    own, weight = area + 1e-15, (area[neighbour] + 1e-15) * bond
    total = own + weight.sum(axis=1)
    own, weight = (own / total)[:, None], weight / total[:, None]
    for _ in range(rounds):
        share = share * own + sum(weight[:, k, None] * share[neighbour[:, k]] for k in range(3))
    return share.argmax(axis=1)


def _without_spikes(label: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Labels in which no triangle reaches out alone into another region: it takes what two of its neighbours have."""
    neighbour = _neighbours(twin)
    for turn in range(4 * _SMOOTHING):
        around = label[neighbour]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            spike = (around[:, a] == around[:, b]) & (around[:, a] != label)
            # neighbours do not change at the same time, or they might exchange their labels for ever
            spike &= np.arange(len(label)) % 2 == turn % 2
            label = np.where(spike, around[:, a], label)
    return label


def _components(triangles: np.ndarray, label: np.ndarray, vertex_count: int) -> np.ndarray:
    """Connected pieces (T,) of triangles with one label."""
    twin = twins(triangles, vertex_count)
    other = twin // 3
    same = (twin >= 0) & (label[np.arange(len(twin)) // 3] == label[other])
    return components_of(np.where(same, twin, -1).astype(np.int32), len(triangles))[0]
