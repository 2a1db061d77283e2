"""Mesh adjacency against dictionaries, networkx and trimesh, on soups of pieces and on bow-ties."""

from __future__ import annotations

from dataclasses import replace

import naive
import networkx
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import edge_keys, open_edges, twins
from mirror_scan.core.mesh.normals import triangle_normals, vertex_normals
from mirror_scan.core.mesh.submesh import (
    compact,
    drop_small_components,
    keep_triangles,
    remove_bowties,
    triangle_components,
    vertex_fans,
)
from mirror_scan.core.mesh.triangle_mesh import merge

seeds = st.integers(0, 2**32 - 1)


def coloured(vertices, triangles, rng) -> Mesh:
    return Mesh(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(triangles, dtype=np.int32),
        rng.integers(0, 256, (len(vertices), 3)).astype(np.uint8),
        rng.integers(-1, 3, len(vertices)).astype(np.int8),
        rng.integers(0, 3, len(triangles)).astype(np.int8),
    )


def soup(seed: int) -> Mesh:
    """Oriented 2-manifold pieces with random triangles missing, numbered at random; some vertices are never used."""
    rng = np.random.default_rng(seed)
    parts = [
        trimesh.creation.icosphere(subdivisions=1),
        trimesh.creation.torus(1.0, 0.3, major_sections=8, minor_sections=5),
        trimesh.creation.box(),
    ]
    whole = trimesh.util.concatenate([parts[i] for i in rng.integers(0, 3, rng.integers(1, 4))])
    faces = whole.faces[rng.random(len(whole.faces)) > rng.choice([0.0, 0.1, 0.5])]
    number = rng.permutation(len(whole.vertices))
    vertices = np.empty_like(whole.vertices)
    vertices[number] = whole.vertices + rng.normal(size=whole.vertices.shape)
    return coloured(vertices, rng.permutation(number[faces]), rng)


def shape_of(mesh: Mesh) -> np.ndarray:
    """What the mesh looks like, however its vertices are numbered: corners with colour and view, and each kind."""
    t = mesh.triangles
    corners = np.concatenate((mesh.vertices[t], mesh.colors[t], mesh.view[t][..., None]), axis=2).reshape(len(t), -1)
    return np.column_stack((corners, mesh.kind))


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


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_loops_share_out_the_boundary(seed):
    mesh = soup(seed)
    count = len(mesh.vertices)
    loops = boundary_loops(mesh.triangles, count)
    edges = [(int(i), int(j)) for loop in loops for i, j in zip(loop, np.roll(loop, -1), strict=True)]
    assert len(edges) == len(set(edges)) and set(edges) == naive.boundary_edges(mesh.triangles)
    assert all(len(set(loop.tolist())) == len(loop) >= 3 for loop in loops), "a loop passes a vertex twice"
    assert [len(loop) for loop in loops] == sorted((len(loop) for loop in loops), reverse=True)
    parted = remove_bowties(mesh)
    apart = boundary_loops(parted.triangles, len(parted.vertices))
    boundary = networkx.Graph(open_edges(parted.triangles, len(parted.vertices))[:, :2].tolist())
    assert len(apart) == networkx.number_connected_components(boundary)


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


def test_two_holes_that_touch_in_a_vertex_are_two_loops():
    """A grid without the two cells diagonally across from each other at its middle."""
    n = 6
    cells = [(i, j) for i in range(n) for j in range(n) if (i, j) not in ((2, 2), (3, 3))]
    quads = np.array([[i * 7 + j, i * 7 + j + 1, (i + 1) * 7 + j + 1, (i + 1) * 7 + j] for i, j in cells])
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]])).astype(np.int32)
    loops = boundary_loops(triangles, 49)
    assert [len(loop) for loop in loops] == [24, 4, 4]
    assert {3 * 7 + 3} == set(loops[1].tolist()) & set(loops[2].tolist())


def test_surface_lies_on_the_left_of_its_boundary():
    disc = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=24)
    up = disc.faces[disc.face_normals[:, 2] > 0.5].astype(np.int32)
    (loop,) = boundary_loops(up, len(disc.vertices))
    p = np.asarray(disc.vertices)[loop]
    assert (np.cross(p, np.roll(p, -1, axis=0))[:, 2] > 0).all(), "seen from above the boundary runs counter-clockwise"


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_normals(seed):
    mesh = soup(seed)
    np.testing.assert_allclose(
        vertex_normals(mesh.vertices, mesh.triangles), naive.vertex_normals(mesh.vertices, mesh.triangles), atol=1e-12
    )
    theirs = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    twice = triangle_normals(mesh.vertices, mesh.triangles)
    np.testing.assert_allclose(twice, theirs.face_normals * 2 * theirs.area_faces[:, None], atol=1e-9)
    expected = np.zeros(len(mesh.vertices), bool)
    expected[mesh.triangles] = True
    assert (np.linalg.norm(vertex_normals(mesh.vertices, mesh.triangles), axis=1) > 0.5).tolist() == expected.tolist()


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


def test_undirected_edges():
    keys = edge_keys(np.array([[3, 1, 2], [1, 3, 0]], np.int32), 10)
    assert keys.tolist() == [[13, 12, 23], [13, 3, 1]]


def test_nothing_at_all():
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32), None, np.empty(0, np.int8), np.empty(0, np.int8))
    assert boundary_loops(empty.triangles, 0) == [] and len(open_edges(empty.triangles, 0)) == 0
    assert triangle_components(empty.triangles, 0)[1] == 0
    assert remove_bowties(empty) is empty and drop_small_components(empty, 3) is empty
    assert len(compact(replace(empty, vertices=np.zeros((3, 3)), view=np.zeros(3, np.int8))).vertices) == 0
    assert len(vertex_normals(np.zeros((3, 3)), empty.triangles)) == 3
    assert len(keep_triangles(empty, np.zeros(0, bool)).triangles) == 0


def test_transformed():
    mesh = soup(4)
    matrix = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3])
    moved = mesh.transformed(matrix)
    np.testing.assert_allclose(moved.vertices, trimesh.transformations.transform_points(mesh.vertices, matrix))
    assert moved.triangles is mesh.triangles and (SURFACE, SEAM, FILL) == (0, 1, 2)
    with pytest.raises(AttributeError):
        mesh.vertices = moved.vertices
