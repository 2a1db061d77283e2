"""Edges and what lies beyond them, against dictionaries, on soups of pieces and on any triangles."""

from __future__ import annotations

import naive
import numpy as np
from hypothesis import given, settings
from meshes import seeds, soup
from mirror_scan.core.mesh.half_edges import edge_keys, open_edges, twins
from mirror_scan.core.mesh.submesh import (
    vertex_fans,
)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_twins_boundary_and_fans_on_manifold_pieces(seed):
    mesh = soup(seed)
    count = len(mesh.vertices)
    twin = twins(mesh.triangles, count)
    np.testing.assert_array_equal(twin, naive.twins(mesh.triangles))
    edges = open_edges(mesh.triangles, count)[:, :2]
    assert {tuple(e) for e in edges.tolist()} == naive.boundary_edges(mesh.triangles) and edges.shape[1:] == (2,)
    assert vertex_fans(mesh.triangles, count).tolist() == naive.vertex_fans(mesh.triangles, count)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_twins_on_any_triangles(seed):
    """Edges with three triangles, or two of the same direction, belong to nobody."""
    rng = np.random.default_rng(seed)
    triangles = np.array([rng.choice(7, 3, replace=False) for _ in range(rng.integers(1, 25))], np.int32)
    np.testing.assert_array_equal(twins(triangles, 7), naive.twins(triangles))


def test_undirected_edges():
    keys = edge_keys(np.array([[3, 1, 2], [1, 3, 0]], np.int32), 10)
    assert keys.tolist() == [[13, 12, 23], [13, 3, 1]]
