"""Self-intersections against pairs known by hand and MeshLab."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.mesh.self_intersections import self_intersections

trimesh = pytest.importorskip("trimesh")
BODIES = Path(__file__).resolve().parents[4] / "shared" / "data" / "bodies"


def arrays(mesh):
    return np.ascontiguousarray(mesh.vertices, np.float64), np.ascontiguousarray(mesh.faces, np.int32)


FLAT = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize(
    ("points", "triangles", "meet"),
    [
        (FLAT + [[1, 1, -1], [1, 1, 1], [9, 9, 1]], [[0, 1, 2], [3, 4, 5]], True),  # pierced
        (FLAT + [[1, 1, 0], [9, 9, 1], [9, 8, 1]], [[0, 1, 2], [3, 4, 5]], True),  # touched by a corner
        (FLAT + [[1, 1, 0.01], [1, 1, 1], [9, 9, 1]], [[0, 1, 2], [3, 4, 5]], False),  # above
        (FLAT + [[3, 3, -1], [3, 3, 1], [9, 9, 0]], [[0, 1, 2], [3, 4, 5]], False),  # beside
        (FLAT + [[1, 1, 0], [5, 1, 0], [1, 5, 0]], [[0, 1, 2], [3, 4, 5]], True),  # in one plane, edges cross
        (FLAT + [[1, 1, 0], [2, 1, 0], [1, 2, 0]], [[0, 1, 2], [3, 4, 5]], True),  # in one plane, one inside
        (FLAT + [[3, 3, 0], [5, 3, 0], [3, 5, 0]], [[0, 1, 2], [3, 4, 5]], False),  # in one plane, apart
        (FLAT + [[4, 0, 0], [4, 4, 0], [0, 4, 0]], [[0, 1, 2], [3, 4, 5]], True),  # seam not welded
        (FLAT + [[2, 1, -1], [2, 1, 1]], [[0, 1, 2], [0, 3, 4]], True),  # fan, edge goes through
        (FLAT + [[8, 8, -1], [8, 8, 1]], [[0, 1, 2], [0, 3, 4]], True),  # fan, the other's edge goes through
        (FLAT + [[-2, -1, -1], [-2, -1, 1]], [[0, 1, 2], [0, 3, 4]], False),  # fan, on the other side
        (FLAT + [[-4, 0, 0], [0, -4, 0]], [[0, 1, 2], [0, 3, 4]], False),  # flat fan
        (FLAT + [[4, 4, 0]], [[0, 1, 2], [2, 1, 3]], False),  # flat neighbours
        (FLAT + [[0, 0, 1]], [[0, 1, 2], [2, 1, 3]], False),  # sharply bent neighbours
        (FLAT + [[1, 1, 0]], [[0, 1, 2], [2, 1, 3]], True),  # folded flat
        (FLAT, [[0, 1, 2], [1, 0, 2]], True),  # the same one twice
        (FLAT + [[1, 1, 1], [1, 1, -1]], [[0, 1, 2], [3, 4, 4]], True),  # a needle through it
        (FLAT + [[9, 9, 1], [9, 9, -1]], [[0, 1, 2], [3, 4, 4]], False),  # a needle beside it
    ],
)
def test_pairs_of_triangles(points, triangles, meet):
    rng = np.random.default_rng(4)
    points, triangles = np.array(points, float), np.array(triangles, np.int32)
    for _ in range(4):
        assert len(self_intersections(points, triangles)) == meet
        # the same pair in other words: corners turned, triangles swapped, axes changed
        triangles = np.roll(triangles, rng.integers(3), axis=1)[::-1]
        points = points[:, rng.permutation(3)] * rng.choice([-1, 1], 3)


def jittered_sphere():
    vertices, triangles = arrays(trimesh.creation.icosphere(4))
    return vertices + np.random.default_rng(5).normal(0, 0.04, vertices.shape), triangles


@pytest.mark.parametrize("name", ["soup", "jittered sphere", "mh_woman_armsdown", "mh_man_apose"])
def test_self_intersections_agree_with_meshlab(name):
    pymeshlab = pytest.importorskip("pymeshlab")
    if name == "soup":
        rng = np.random.default_rng(6)
        vertices = (rng.uniform(-1, 1, (500, 1, 3)) + rng.normal(0, 0.1, (500, 3, 3))).reshape(-1, 3)
        triangles = np.arange(1500, dtype=np.int32).reshape(-1, 3)
    elif name == "jittered sphere":
        vertices, triangles = jittered_sphere()
    elif (BODIES / f"{name}.ply").exists():
        vertices, triangles = arrays(trimesh.load(BODIES / f"{name}.ply", process=False, force="mesh"))
    else:
        pytest.skip(f"{name}.ply is not here")
    pairs = self_intersections(vertices, triangles)
    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(vertices, triangles))
    scene.compute_selection_by_self_intersections_per_face()
    np.testing.assert_array_equal(np.unique(pairs), np.flatnonzero(scene.current_mesh().face_selection_array()))
    assert (pairs[:, 0] < pairs[:, 1]).all() and len(np.unique(pairs, axis=0)) == len(pairs)
    if name == "mh_woman_armsdown":
        assert len(pairs) == 78
