"""Places to look at, on meshes whose faults are known; and the colours and shares that tell of views."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.soundness import CROSSING, EDGE, GUESS, HOLE, PIECE, find_problems
from mirror_scan.core.preview import palette


def grid_box(n=10, size=1.0, at=(0, 0, 0)):
    """A closed box of n × n squares a side."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((size, size, size))
    for _ in range(int(np.log2(n))):
        box = box.subdivide()
    return Mesh(
        np.array(box.vertices) + at, np.array(box.faces, np.int32), None, None,
        np.full(len(box.faces), SURFACE, np.int8),
    )  # fmt: skip


def both(a: Mesh, b: Mesh) -> Mesh:
    return Mesh(
        np.concatenate((a.vertices, b.vertices)),
        np.concatenate((a.triangles, b.triangles + len(a.vertices))).astype(np.int32),
        None, None, np.concatenate((a.kind, b.kind)),
    )  # fmt: skip


def test_a_sound_mesh_has_none():
    assert find_problems(grid_box()) == []
    assert find_problems(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), None, None, None)) == []


def test_each_fault_is_found_where_it_is():
    box = grid_box()
    centers = box.vertices[box.triangles].mean(axis=1)
    hole = np.linalg.norm(centers - (0, -0.5, 0.1), axis=1) < 0.2
    (place,) = find_problems(Mesh(box.vertices, box.triangles[~hole], None, None, box.kind[~hole]))
    assert place.kind == HOLE
    np.testing.assert_allclose(place.point, (0, -0.5, 0.1), atol=0.08)
    np.testing.assert_allclose(place.normal, (0, -1, 0), atol=1e-9)

    apart = both(box, grid_box(4, 0.1, (2, 0, 0)))
    (place,) = find_problems(apart)
    assert place.kind == PIECE and place.point == pytest.approx((2, 0, 0)) and place.area == pytest.approx(0.06)

    through = find_problems(both(box, grid_box(4, 0.3, (0.5, 0.02, 0.013))))
    kinds = {place.kind for place in through}
    assert kinds == {CROSSING, PIECE}
    assert all(abs(place.point[0] - 0.5) < 0.2 for place in through if place.kind == CROSSING)

    made_up = np.abs(centers[:, 2] + 0.5) < 1e-9
    kind = np.where(made_up, FILL, SURFACE).astype(np.int8)
    (place,) = find_problems(Mesh(box.vertices, box.triangles, None, None, kind))
    assert place.kind == GUESS and place.area == pytest.approx(1.0) and place.normal[2] == pytest.approx(-1)
    assert find_problems(Mesh(box.vertices, box.triangles, None, None, kind), min_guess=1.1) == []


def test_an_edge_of_three_faces_is_named():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    kinds = {place.kind for place in find_problems(Mesh(vertices, triangles, None, None, None))}
    assert EDGE in kinds


def test_colours_go_by_number():
    views, kinds = palette.VIEW_PALETTE, palette.KIND_PALETTE
    shown = palette.view_colors(np.array([0, 1, -1, len(views)], np.int8))
    np.testing.assert_array_equal(shown, [views[0], views[1], palette.MADE, views[0]])
    np.testing.assert_array_equal(palette.kind_colors(np.array([2, 0], np.int8)), [kinds[2], kinds[0]])
    depth = np.array([[0, 1.0], [2.0, 3.0]])
    picture = palette.depth_colors(depth)
    assert (picture[0, 0] == 0).all() and picture[0, 1, 0] > 200 and picture[1, 1, 0] < 90
    assert (palette.depth_colors(np.zeros((2, 2))) == 0).all()
    part = palette.sort_parts(np.array([-1, -1, 0, 1, 0], np.int8), np.array([1.0, 0.001, 1.0, 3.0, 1.0]),
                              np.array([2.0, 2, 2, 2, 9]), 0.01, 2.4, 5.0)  # fmt: skip
    assert part.tolist() == [0, 1, 2, 0, 3]


def test_coverage_is_what_a_ray_sees(request):
    """On a ball before the camera: its near half is seen directly, what no view reaches is not."""
    from mirror_scan.core.simulation.coverage import coverage, shares
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate

    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    mesh = Mesh(np.array(ball.vertices) + (0, 0, 1.0), np.array(ball.faces, np.int32), None, None, None)
    alone = simulate(mesh, default_rig(sensor="ideal", mirrors=0, frames=1))
    view = coverage(alone)
    camera = np.array(alone.rig.camera)
    outward = ball.vertices / 0.3
    cosine = np.einsum("ij,ij->i", outward, camera - mesh.vertices)
    cosine /= np.linalg.norm(camera - mesh.vertices, axis=1)
    assert (view[cosine > 0.35] == 0).all() and (view[cosine < 0.2] == -1).all()
    seen = shares(view, mesh.vertices, mesh.triangles, 1)
    assert sum(seen) == pytest.approx(1) and 0.25 < seen[0] < 0.5
    with_mirrors = coverage(simulate(mesh, default_rig(sensor="ideal", mirrors=2, frames=1)))
    assert set(np.unique(with_mirrors)) >= {0, 1, 2} and (with_mirrors >= 0).mean() > seen[0] + 0.3
