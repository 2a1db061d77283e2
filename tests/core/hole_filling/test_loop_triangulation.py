"""Holes cut into closed surfaces are closed again: manifold, oriented, and exact where the hole is flat."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import open_edges, twins
from mirror_scan.core.mesh.normals import triangle_normals
from mirror_scan.core.mesh.submesh import remove_bowties
from mirror_scan.core.views.view_maps import view_maps
from scipy.spatial import Delaunay


def measured(vertices, faces) -> Mesh:
    """As a patch comes from a capture: all its triangles measured, all its vertices seen directly."""
    rng = np.random.default_rng(len(faces))
    return Mesh(
        np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int32),
        rng.integers(0, 256, (len(vertices), 3)).astype(np.uint8), np.zeros(len(vertices), np.int8),
        np.zeros(len(faces), np.int8),
    )  # fmt: skip


def check_closed(filled: Mesh, given_: Mesh):
    """Every edge has two triangles of opposite direction; what was there is there; all arrays fit."""
    assert (twins(filled.triangles, len(filled.vertices)) >= 0).all()
    assert (filled.triangles != np.roll(filled.triangles, 1, axis=1)).all()
    old, count = len(given_.triangles), len(given_.vertices)
    np.testing.assert_array_equal(filled.triangles[:old], given_.triangles)
    np.testing.assert_array_equal(filled.vertices[:count], given_.vertices)
    np.testing.assert_array_equal(filled.colors[:count], given_.colors)
    assert (filled.kind[:old] == given_.kind).all() and (filled.kind[old:] == FILL).all()
    assert (filled.view[count:] == -1).all() and len(filled.view) == len(filled.colors) == len(filled.vertices)
    assert filled.triangles.dtype == np.int32 and filled.kind.dtype == filled.view.dtype == np.int8
    assert filled.colors.dtype == np.uint8


SHAPES = {
    "sphere": trimesh.creation.icosphere(subdivisions=3),
    "torus": trimesh.creation.torus(1.0, 0.35, major_sections=40, minor_sections=20),
}


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.integers(0, 2**32 - 1), st.integers(1, 8), st.sampled_from([16, 64]))
def test_surfaces_with_random_holes_are_closed(shape, seed, holes, largest):
    """Overlapping balls cut out of a surface, some triangles besides: ragged loops, loops that touch, crumbs."""
    whole, rng = SHAPES[shape], np.random.default_rng(seed)
    middle = whole.triangles_center
    keep = rng.random(len(middle)) > rng.choice([0.0, 0.02, 0.15])
    for _ in range(holes):
        keep &= np.linalg.norm(middle - middle[rng.integers(len(middle))], axis=1) > rng.uniform(0.05, 0.45)
    mesh = remove_bowties(measured(whole.vertices, whole.faces[keep]))
    filled = fill_loops(mesh, largest=largest)
    check_closed(filled, mesh)


def test_small_holes_in_a_sphere_cost_little_volume():
    whole = SHAPES["sphere"]
    middle = whole.triangles_center
    keep = (np.linalg.norm(middle - (0, 0, 1), axis=1) > 0.3) & (np.linalg.norm(middle - (1, 0, 0), axis=1) > 0.2)
    mesh = remove_bowties(measured(whole.vertices, whole.faces[keep]))
    filled = fill_loops(mesh)
    check_closed(filled, mesh)
    closed = trimesh.Trimesh(filled.vertices, filled.triangles, process=False)
    assert closed.is_watertight and closed.is_winding_consistent and closed.euler_number == 2
    # a cap of height h = d²/2 holds π h² (1 - h/3)
    lost = sum(np.pi * h * h * (1 - h / 3) for h in (0.3**2 / 2, 0.2**2 / 2))
    assert whole.volume - 3 * lost < closed.volume < whole.volume


def framed(polygon) -> Mesh:
    """A flat ring between a polygon (counter-clockwise about the origin) and one half as large again."""
    n = len(polygon)
    vertices = np.column_stack((np.concatenate((polygon, 1.5 * polygon)), np.zeros(2 * n)))
    i, j = np.arange(n), (np.arange(n) + 1) % n
    return measured(vertices, np.concatenate((np.column_stack((i, i + n, j + n)), np.column_stack((i, j + n, j)))))


def area(mesh, which=slice(None)):
    return np.linalg.norm(triangle_normals(mesh.vertices, mesh.triangles[which]), axis=1).sum() / 2


@pytest.mark.parametrize("n", [3, 4, 5, 17, 64, 65, 150, 400])
def test_flat_polygons_are_filled_exactly(n):
    angle = 2 * np.pi * np.arange(n) / n
    ring = framed(np.column_stack((np.cos(angle), np.sin(angle))))
    filled = fill_loops(ring, diameter=2.9)  # not the outer loop, that spans 3
    fill = filled.kind == FILL
    assert fill.sum() == n - 2 and len(filled.vertices) == len(ring.vertices)
    assert (triangle_normals(filled.vertices, filled.triangles)[:, 2] > 0).all(), "wound as the ring is"
    assert [len(loop) for loop in boundary_loops(filled.triangles, len(filled.vertices))] == [n]
    assert area(filled, fill) == pytest.approx(n / 2 * np.sin(2 * np.pi / n), rel=1e-9)
    hull = Delaunay(ring.vertices[:n, :2]).simplices
    assert area(filled, fill) == pytest.approx(area(measured(ring.vertices, hull)), rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(5, 90))
def test_jagged_flat_polygons_are_filled_without_a_fold(seed, n):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
    polygon = rng.uniform(0.7, 1.0, n)[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    ring = framed(polygon)
    filled = fill_loops(ring, diameter=np.linalg.norm(np.ptp(polygon, axis=0)) * 1.01)
    x, y = polygon.T
    gauss = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    if n <= 64:  # longer loops are cut in two by a chord that need not lie inside
        assert area(filled, filled.kind == FILL) == pytest.approx(gauss, rel=1e-9)
    assert (filled.kind == FILL).sum() == n - 2


def test_a_loop_in_space():
    """A tube with a rim that goes up and down, closed at both ends; the fills keep to the hull of their rims."""
    n = 48
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack((np.cos(angle), np.sin(angle), 1 + 0.3 * np.sin(3 * angle)))
    foot = np.column_stack((np.cos(angle), np.sin(angle), -1 + 0.2 * np.cos(2 * angle)))
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate((np.column_stack((i, i + n, j + n)), np.column_stack((i, j + n, j))))
    mesh = measured(np.concatenate((rim, foot)), faces)
    filled = fill_loops(mesh)
    check_closed(filled, mesh)
    volume = trimesh.Trimesh(filled.vertices, filled.triangles, process=False).volume
    assert abs(volume) == pytest.approx(2 * np.pi, abs=np.pi * (0.3 + 0.2)) and len(filled.triangles) == 2 * n + 2 * (
        n - 2
    )


def test_a_missing_face_is_put_back():
    box = trimesh.creation.icosahedron()
    mesh = measured(box.vertices, box.faces[:-1])
    filled = fill_loops(mesh)
    check_closed(filled, mesh)
    assert set(filled.triangles[-1].tolist()) == set(box.faces[-1].tolist())
    assert fill_loops(filled) is filled, "nothing is open any more"


def test_a_loop_whose_every_chord_is_taken_gets_a_middle():
    """A square hole whose two diagonals are edges elsewhere: with two triangles one of them would have four."""
    corner = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    tents = np.array([(0.5, 0.5, 1.0), (0.4, 0.6, 1.5), (0.5, 0.5, 2.0), (0.6, 0.6, 2.5)])
    faces = [((k + 1) % 4, k, 4) for k in range(4)]  # a pyramid without its base
    for a, c, p, q in ((0, 2, 5, 6), (1, 3, 7, 8)):  # a closed tetrahedron on each diagonal
        faces += [(a, c, p), (c, a, q), (a, p, q), (c, q, p)]
    mesh = measured(np.concatenate((corner, [(0.5, 0.5, -1.0)], tents)), faces)
    filled = fill_loops(mesh)
    check_closed(filled, mesh)
    np.testing.assert_allclose(filled.vertices[9:], [(0.5, 0.5, 0)])
    assert np.abs(filled.colors[9] - mesh.colors[:4].astype(float).mean(axis=0)).max() <= 0.5
    assert (filled.triangles[len(faces) :] == 9).sum() == len(filled.triangles) - len(faces) == 4


def test_holes_that_share_two_corners_do_not_share_a_chord():
    """Two square holes that meet in two opposite corners; their other diagonals are taken already."""
    corners = [(-1, 0, 0), (1, 0, 0), (0, -2, 0.5), (0, 2, 0.5), (0, -2, -0.5), (0, 2, -0.5)]
    faces = [(0, 4, 2), (4, 1, 2), (0, 3, 5), (3, 1, 5)]
    tents = [(1, 0, 2), (-1, 0, 2), (1, 0, -2), (-1, 0, -2)]
    for a, c, p, q in ((2, 3, 6, 7), (4, 5, 8, 9)):  # a closed tetrahedron on each
        faces += [(a, c, p), (c, a, q), (a, p, q), (c, q, p)]
    mesh = measured(corners + tents, faces)
    filled = fill_loops(mesh)
    check_closed(filled, mesh)
    assert len(filled.vertices) == 11, "the first hole takes the chord, the second is closed round a middle"


def test_known_open_edges_change_nothing():
    whole = SHAPES["torus"]
    mesh = remove_bowties(
        measured(whole.vertices, whole.faces[np.random.default_rng(3).random(len(whole.faces)) > 0.05])
    )
    plain = fill_loops(mesh)
    told = fill_loops(mesh, edges=open_edges(mesh.triangles, len(mesh.vertices)))
    np.testing.assert_array_equal(plain.triangles, told.triangles)
    small = fill_loops(mesh, diameter=0.25)
    assert 0 < (small.kind == FILL).sum() <= (plain.kind == FILL).sum()
    assert (fill_loops(mesh, diameter=0.0).kind == SURFACE).all()


def test_fills_keep_out_of_space_seen_to_be_empty():
    """A saddle-shaped rim can be closed by either of two sheets; a camera saw through where one of them would be."""
    n = 40
    angle = 2 * np.pi * (np.arange(n) + 0.5) / n
    rim = 0.2 * np.column_stack((np.cos(angle), np.sin(angle), 1.2 * np.cos(2 * angle))) + (0, 0, 2.0)
    outside = (rim - (0, 0, 2.0)) * (1.6, 1.6, 1.0) + (0, 0, 2.0)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate((np.column_stack((i, i + n, j + n)), np.column_stack((i, j + n, j))))
    mesh = measured(np.concatenate((rim, outside)), faces)
    intrinsics = Intrinsics(200, 200, 400.0, 400.0, 99.5, 99.5)
    nothing = np.full((200, 200), -1, np.int8)

    def middle(depth):
        maps = view_maps(
            RgbdImage(depth, intrinsics), nothing, np.where(depth > 0, 0, -1).astype(np.int8), [], np.zeros(1)
        )
        size = np.linalg.norm(np.ptp(rim, axis=0)) * 1.01
        filled = fill_loops(mesh, maps, diameter=size)
        chosen = filled.vertices[filled.triangles[filled.kind == FILL]].mean(axis=1)
        return chosen[np.linalg.norm(chosen[:, :2], axis=1) < 0.1][:, 2].mean()

    blind = middle(np.zeros((200, 200), np.float32))
    # a camera that reads something behind 2.0 m saw all that is nearer empty
    told = middle(np.full((200, 200), 2.05, np.float32))
    assert told > 2.03 and told >= blind - 1e-9
