"""Components, bow-ties and selections, against networkx and dictionaries, on soups of pieces."""

from __future__ import annotations

from dataclasses import replace

import naive
import networkx
import numpy as np
from hypothesis import given, settings
from meshes import coloured, seeds, shape_of, soup
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.submesh import (
    compact,
    drop_small_components,
    keep_triangles,
    remove_bowties,
    triangle_components,
    vertex_fans,
)
from mirror_scan.core.mesh.triangle_mesh import merge


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_components_against_networkx(seed):
    mesh = soup(seed)
    label, count = triangle_components(mesh.triangles, len(mesh.vertices))
    graph = networkx.Graph()
    graph.add_nodes_from(range(len(mesh.triangles)))
    graph.add_edges_from((e // 3, f // 3) for e, f in enumerate(naive.twins(mesh.triangles).tolist()) if f >= 0)
    expected = {frozenset(c) for c in networkx.connected_components(graph)}
    assert {frozenset(np.flatnonzero(label == k).tolist()) for k in range(count)} == expected
    least = int(np.random.default_rng(seed).integers(1, 40))
    kept = drop_small_components(mesh, least)
    assert len(kept.triangles) == sum(len(c) for c in expected if len(c) >= least)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_removing_bowties_only_parts_vertices(seed):
    mesh = soup(seed)
    parted = remove_bowties(mesh)
    assert set(vertex_fans(parted.triangles, len(parted.vertices)).tolist()) <= {0, 1}
    np.testing.assert_array_equal(shape_of(parted), shape_of(mesh))
    np.testing.assert_array_equal(
        twins(parted.triangles, len(parted.vertices)), twins(mesh.triangles, len(mesh.vertices))
    )
    fans = naive.vertex_fans(mesh.triangles, len(mesh.vertices))
    assert len(np.unique(parted.triangles)) == sum(fans)


def test_bowtie_of_two_triangles():
    rng = np.random.default_rng(0)
    mesh = coloured(rng.normal(size=(6, 3)), [[0, 1, 2], [2, 3, 4]], rng)  # vertex 5 is unused
    assert vertex_fans(mesh.triangles, 6).tolist() == [1, 1, 2, 1, 1, 0]
    assert sorted(len(loop) for loop in boundary_loops(mesh.triangles, 6)) == [3, 3]
    parted = remove_bowties(mesh)
    assert len(parted.vertices) == 6 and triangle_components(parted.triangles, 6)[1] == 2
    np.testing.assert_array_equal(shape_of(parted), shape_of(mesh))


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_selections_keep_what_belongs_together(seed):
    mesh = soup(seed)
    packed = compact(mesh)
    assert len(packed.vertices) == len(np.unique(mesh.triangles)) and packed.triangles.dtype == np.int32
    np.testing.assert_array_equal(shape_of(packed), shape_of(mesh))
    assert compact(packed) is packed
    keep = np.random.default_rng(seed).random(len(mesh.triangles)) > 0.5
    chosen = keep_triangles(mesh, keep)
    np.testing.assert_array_equal(shape_of(chosen), shape_of(mesh)[keep])
    assert len(chosen.vertices) == len(np.unique(mesh.triangles[keep]))
    both = merge([mesh, chosen])
    np.testing.assert_array_equal(shape_of(both), np.concatenate((shape_of(mesh), shape_of(chosen))))
    assert merge([mesh, replace(chosen, colors=None)]).colors is None
