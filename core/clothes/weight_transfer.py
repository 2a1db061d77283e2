"""Skin weights of a garment, from those of the body it lies on."""

from __future__ import annotations

import numpy as np

from ..avatar.pose import SkinWeights
from ..avatar.skeleton import BONES
from ..avatar.skin_weights import make_harmonic, strongest, unique_edges
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.boundary_loops import boundary_loops
from ..mesh.normals import vertex_normals
from .body_distance import BodyDistance, SkinPoints
from .cloth_mesh import NeighbourMeans

_AGREE = np.cos(np.radians(50.0))  # between the garment's normal and the skin's, where weights are taken over
_FAR = 3.0  # times the usual distance: farther skin says nothing
_SMOOTHING = 6  # rounds, of the weights of a garment that is not ours
_SHORTEST = 1e-4  # shorter edges are taken for so long [m]


def dense(weights: SkinWeights) -> np.ndarray:
    """Weights (V, 22) of all bones."""
    out = np.zeros((len(weights.index), len(BONES)))
    np.add.at(out, (np.arange(len(out))[:, None], weights.index), weights.weight)
    return out


def at_skin(values: np.ndarray, triangles: np.ndarray, skin: SkinPoints) -> np.ndarray:
    """``values`` (V, K) of a body's vertices, at points of its skin (N, K)."""
    return np.einsum("nc,nck->nk", skin.shares, values[triangles[skin.triangle]])


def transferred(garment: Mesh, skin: SkinPoints, known: np.ndarray, smoothing: int) -> np.ndarray:
    """Weights (V, 22) of a garment: of the nearest skin where it faces the same way and is near, harmonic elsewhere.

    After Abdrashitov et al., "Robust Skin Weights Transfer via Weight Inpainting", 2023.

    Parameters
    ----------
    garment : Mesh
        Near the body, in the pose of it in which ``skin`` was asked for.
    skin : SkinPoints
        Nearest to each of the garment's vertices.
    known : np.ndarray [shape=(V, 22)]
        Weights there: see :func:`at_skin`.
    smoothing : int
        Rounds of averaging with neighbours, at the end.
    """
    weights = known.copy()
    normals = vertex_normals(garment.vertices, garment.triangles)
    usual = np.median(np.abs(skin.distance))
    trusted = np.einsum("vi,vi->v", normals, skin.normal) > _AGREE
    trusted &= np.abs(skin.distance) < _FAR * max(float(usual), _SHORTEST)
    edges = unique_edges(garment)
    if trusted.any() and not trusted.all():
        lengths = np.linalg.norm(garment.vertices[edges[:, 0]] - garment.vertices[edges[:, 1]], axis=1)
        make_harmonic(weights, ~trusted, edges, 1.0 / np.maximum(lengths, _SHORTEST))
        lost = weights.sum(axis=1) < 0.5  # pieces without any trusted vertex keep what was nearest
        weights[lost] = known[lost]
    means = NeighbourMeans(garment)
    for _ in range(smoothing):
        weights = 0.5 * weights + 0.5 * means.of(weights)
    return weights / weights.sum(axis=1, keepdims=True)


def garment_weights(garment: Mesh, body: Mesh, weights: SkinWeights) -> SkinWeights:
    """Skin weights of any garment that lies around a body, in the same pose.

    Parameters
    ----------
    garment : Mesh
        V vertices, of one piece or several, open or closed; in the body's frame [m].
    body : Mesh
        Closed [m].
    weights : SkinWeights
        Of the body.

    Raises
    ------
    MirrorScanError
        When the garment has no triangles.
    """
    if not len(garment.triangles):
        raise MirrorScanError("clothes: the garment has no faces; give a surface", code="no_person")
    at = BodyDistance(body)
    skin = at.at(garment.vertices)
    known = at_skin(dense(weights), at.triangles, skin)
    return strongest(transferred(garment, skin, known, smoothing=_SMOOTHING))


def top_edge(garment: Mesh, pinned: float, free: float) -> np.ndarray:
    """How much each vertex (V,) float32 is held when a garment hangs on its highest open edge.

    Parameters
    ----------
    garment : Mesh
        Z up. Where it has no open edge, its highest vertex stands for it.
    pinned, free : float
        1 up to the first distance from the edge, 0 from the second on [m].
    """
    loops = boundary_loops(garment.triangles, len(garment.vertices))
    edge = garment.vertices[garment.vertices[:, 2].argmax()][None]
    if loops:
        edge = garment.vertices[max(loops, key=lambda loop: garment.vertices[loop, 2].mean())]
    return held_near(garment.vertices, edge, pinned, free)


def held_near(vertices: np.ndarray, edge: np.ndarray, pinned: float, free: float) -> np.ndarray:
    """1 (V,) float32 within ``pinned`` of the points ``edge`` (K, 3), 0 beyond ``free``, smooth between [m]."""
    squares = (vertices**2).sum(axis=1)[:, None] - 2 * vertices @ edge.T + (edge**2).sum(axis=1)
    far = np.sqrt(np.maximum(squares.min(axis=1), 0.0))
    share = np.clip((free - far) / (free - pinned), 0.0, 1.0)
    return (share * share * (3 - 2 * share)).astype(np.float32)
