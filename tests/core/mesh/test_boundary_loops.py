"""Boundary loops, against dictionaries, on soups of pieces and on holes that touch."""

from __future__ import annotations

import naive
import networkx
import numpy as np
import trimesh
from hypothesis import given, settings
from meshes import seeds, soup
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import open_edges
from mirror_scan.core.mesh.submesh import (
    remove_bowties,
)


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
