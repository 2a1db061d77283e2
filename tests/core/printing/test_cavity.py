"""Which points of a grid lie within a closed mesh."""

from __future__ import annotations

import numpy as np
import trimesh
from mirror_scan.core.printing.cavity import grid_around, solid_points


def on_grid(shape, wall=3.0):
    vertices, triangles = np.array(shape.vertices), np.array(shape.faces, np.int32)
    grid = grid_around(vertices, wall)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), axis=-1)
    return solid_points(vertices, triangles, grid), grid.points(index), grid


def test_a_ball_is_solid_where_it_should_be():
    solid, points, grid = on_grid(trimesh.creation.icosphere(4, 20.0))
    away = np.linalg.norm(points, axis=-1)
    assert solid[away < 19.9].all() and not solid[away > 20].any()
    assert abs(solid.sum() * grid.cell**3 / (4 / 3 * np.pi * 20**3) - 1) < 0.01


def test_overlapping_shells_are_one_solid_and_a_shell_that_looks_inwards_is_a_hollow():
    one, other = trimesh.creation.icosphere(3, 20.0), trimesh.creation.icosphere(3, 20.0)
    other.apply_translation((15, 3, 2))
    solid, points, _ = on_grid(trimesh.util.concatenate([one, other]))
    near = np.minimum(np.linalg.norm(points, axis=-1), np.linalg.norm(points - (15, 3, 2), axis=-1))
    assert solid[near < 19.6].all() and not solid[near > 20].any()
    hole = trimesh.creation.icosphere(3, 12.0)
    hole.invert()
    solid, points, _ = on_grid(trimesh.util.concatenate([one, hole]))
    away = np.linalg.norm(points, axis=-1)
    assert solid[(away > 12) & (away < 19.6)].all() and not solid[away < 11.7].any()


def test_columns_through_vertices_and_edges_are_counted_once():
    """A box whose faces' corners and edges lie in columns of the grid, to the last bit."""
    box = trimesh.creation.box((8, 8, 8)).subdivide().subdivide()
    vertices, triangles = np.array(box.vertices), np.array(box.faces, np.int32)
    grid = grid_around(vertices, 3.0)._replace(low=np.array((-6.0, -6.0, -6.3)), cell=1.0, shape=(13, 13, 13))
    solid = solid_points(vertices, triangles, grid)
    within = solid.sum(axis=2)
    assert set(np.unique(within).tolist()) == {0, 8}  # each column is in or out, and none goes on to the ceiling
    assert (within[3:10, 3:10] == 8).all() and not solid[:, :, -1].any()
