"""Made surface becomes as dense as asked for; measured surface stays as it is, and the mesh sound."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.normals import triangle_normals
from mirror_scan.core.mesh.submesh import compact, remove_bowties, vertex_fans


def measured(vertices, faces) -> Mesh:
    vertices = np.array(vertices, dtype=np.float64)
    shade = np.clip(np.rint(127 * (vertices + 1)), 0, 255).astype(np.uint8)
    return Mesh(
        vertices,
        np.array(faces, dtype=np.int32),
        shade,
        np.zeros(len(vertices), np.int8),
        np.zeros(len(faces), np.int8),
    )


def ball_with_a_lid(radius=0.6, subdivisions=4) -> Mesh:
    """A sphere whose cap is missing, the hole closed by a coarse, nearly flat fill."""
    whole = trimesh.creation.icosphere(subdivisions=subdivisions)
    keep = np.linalg.norm(whole.triangles_center - (0, 0, 1), axis=1) > radius
    return fill_loops(remove_bowties(compact(measured(whole.vertices, whole.faces[keep]))))


def check_sound(mesh: Mesh):
    assert (twins(mesh.triangles, len(mesh.vertices)) >= -1).all()
    assert set(vertex_fans(mesh.triangles, len(mesh.vertices)).tolist()) == {1}
    assert len(mesh.view) == len(mesh.vertices) == len(mesh.colors) and len(mesh.kind) == len(mesh.triangles)
    assert mesh.triangles.dtype == np.int32 and mesh.colors.dtype == np.uint8


def inner_edges(mesh: Mesh) -> np.ndarray:
    """Edges (E, 2) between two made triangles."""
    made = mesh.triangles[mesh.kind != SURFACE]
    twin = twins(made, len(mesh.vertices))
    e = np.flatnonzero(twin > np.arange(len(twin)))
    return np.column_stack((made.ravel()[e], np.roll(made, -1, axis=1).ravel()[e]))


def check_measured_surface_stays(before: Mesh, after: Mesh):
    old = before.triangles[before.kind == SURFACE]
    np.testing.assert_array_equal(after.triangles[after.kind == SURFACE], old)
    np.testing.assert_array_equal(after.vertices[: len(before.vertices)], before.vertices)
    np.testing.assert_array_equal(after.colors[: len(before.vertices)], before.colors)
    assert (after.view[: len(before.vertices)] == before.view).all()
    assert (after.view[len(before.vertices) :] == -1).all()


@pytest.mark.parametrize("size", [0.03, 0.07, 0.2])
def test_a_lid_becomes_as_dense_as_asked(size):
    mesh = ball_with_a_lid()
    out, parents = refine(mesh, np.full(len(mesh.vertices), size), 1.4)
    check_sound(out)
    check_measured_surface_stays(mesh, out)
    assert (twins(out.triangles, len(out.vertices)) >= 0).all(), "still closed"
    edges = inner_edges(out)
    length = np.linalg.norm(out.vertices[edges[:, 0]] - out.vertices[edges[:, 1]], axis=1)
    # the flips after the last split may draw out a few edges again
    assert (length <= 1.4 * size).mean() > 0.98 and length.max() < 1.4 * 1.35 * size
    new = out.vertices[len(mesh.vertices) :]
    if size < 0.1:
        assert len(new) > 10 and np.median(length) > 0.3 * size, "not much denser than asked"
    closed = trimesh.Trimesh(out.vertices, out.triangles, process=False)
    assert closed.is_watertight and closed.is_winding_consistent and closed.euler_number == 2
    assert len(parents) == len(new) and (parents < len(mesh.vertices) + np.arange(len(new))[:, None]).all()
    np.testing.assert_allclose(out.vertices[parents].mean(axis=1), new, atol=1e-12)
    blend = np.abs(out.colors[len(mesh.vertices) :] - 127 * (new + 1))
    assert not len(new) or blend.max() < 12, "colours are blended from the rim's"


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.floats(0.02, 0.5), st.sampled_from([1.0, 1.7, 3.0]))
def test_any_fill_stays_manifold(seed, holes, size, factor):
    whole, rng = trimesh.creation.torus(1.0, 0.4, major_sections=36, minor_sections=18), np.random.default_rng(seed)
    middle = whole.triangles_center
    keep = rng.random(len(middle)) > 0.03
    for _ in range(holes):
        keep &= np.linalg.norm(middle - middle[rng.integers(len(middle))], axis=1) > rng.uniform(0.1, 0.5)
    mesh = remove_bowties(fill_loops(remove_bowties(compact(measured(whole.vertices, whole.faces[keep])))))
    target = size * rng.uniform(0.5, 1.5, len(mesh.vertices))
    out, parents = refine(mesh, target, factor)
    check_sound(out)
    assert (twins(out.triangles, len(out.vertices)) >= 0).all()
    check_measured_surface_stays(mesh, out)
    again, _ = refine(mesh, target, factor)
    np.testing.assert_array_equal(again.triangles, out.triangles)


def test_flat_fills_stay_flat_and_become_delaunay():
    n = 30
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack((np.cos(angle), 0.4 * np.sin(angle), np.zeros(n)))
    i, j = np.arange(n), (np.arange(n) + 1) % n
    ring = np.concatenate((np.column_stack((i, i + n, j + n)), np.column_stack((i, j + n, j))))
    hole = measured(np.concatenate((rim, 1.3 * rim)), ring)
    mesh = fill_loops(hole, diameter=np.linalg.norm((2.0, 0.8)) * 1.01)
    out, _ = refine(mesh, np.full(len(mesh.vertices), 0.1), 1.4)
    check_sound(out)
    made = out.triangles[out.kind != SURFACE]
    normals = triangle_normals(out.vertices, made)
    assert (normals[:, 2] > 0).all() and not out.vertices[:, 2].any(), "folded"
    before = triangle_normals(mesh.vertices, mesh.triangles[mesh.kind != SURFACE])[:, 2].sum()
    assert normals[:, 2].sum() == pytest.approx(before, rel=1e-12), "area is kept"
    # opposite angles of each inner edge sum to 180° at most
    twin = twins(made, len(out.vertices))
    e = np.flatnonzero(twin >= 0)

    def opposite(h):
        p = out.vertices[made[h // 3]][np.arange(len(h))[:, None], (h[:, None] % 3 + [2, 0, 1]) % 3]
        a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))

    assert (opposite(e) + opposite(twin[e])).max() < np.pi + 0.03


def test_kinds_are_inherited():
    mesh = ball_with_a_lid()
    made = np.flatnonzero(mesh.kind == FILL)
    kind = mesh.kind.copy()
    kind[made[mesh.vertices[mesh.triangles[made]].mean(axis=1)[:, 0] > 0]] = SEAM
    out, _ = refine(
        Mesh(mesh.vertices, mesh.triangles, mesh.colors, mesh.view, kind), np.full(len(mesh.vertices), 0.05), 1.4
    )
    middle = out.vertices[out.triangles].mean(axis=1)[:, 0]
    assert {SURFACE, SEAM, FILL} == set(out.kind.tolist())
    assert (middle[out.kind == SEAM] > -0.25).all() and (middle[out.kind == FILL] < 0.25).all()


def test_nothing_made_nothing_changed():
    whole = trimesh.creation.icosphere(subdivisions=2)
    mesh = measured(whole.vertices, whole.faces)
    same, parents = refine(mesh, np.full(len(mesh.vertices), 1e-3), 1.4)
    assert same is mesh and parents.shape == (0, 2)
    lid = ball_with_a_lid()
    coarse, _ = refine(lid, np.full(len(lid.vertices), 100.0), 1.4)
    assert len(coarse.vertices) == len(lid.vertices)
    bare, _ = refine(Mesh(lid.vertices, lid.triangles, None, lid.view, lid.kind), np.full(len(lid.vertices), 0.1), 1.4)
    assert bare.colors is None and len(bare.vertices) > len(lid.vertices)


def test_edge_lengths_of_the_surface_around():
    whole = trimesh.creation.icosphere(subdivisions=3)
    mesh = measured(whole.vertices, whole.faces)
    kind = mesh.kind.copy()
    kind[mesh.vertices[mesh.triangles].mean(axis=1)[:, 2] > 0.3] = FILL
    length = edge_length_at_vertices(Mesh(mesh.vertices, mesh.triangles, None, mesh.view, kind))
    around: dict[int, list[float]] = {v: [] for v in np.unique(mesh.triangles[kind == FILL])}
    for corners in mesh.triangles[kind == SURFACE]:
        for i, j in zip(corners, np.roll(corners, -1), strict=True):
            for v in (i, j):
                if v in around:
                    around[v].append(np.linalg.norm(mesh.vertices[i] - mesh.vertices[j]))
    expected = {v: np.mean(found) for v, found in around.items() if found}
    assert 10 < len(expected) < len(around)
    np.testing.assert_allclose(length[list(expected)], list(expected.values()), rtol=1e-12)
    np.testing.assert_allclose(np.delete(length, list(expected)), np.median(list(expected.values())), rtol=1e-12)
    made = Mesh(mesh.vertices, mesh.triangles, None, mesh.view, np.full(len(mesh.triangles), FILL, np.int8))
    assert (edge_length_at_vertices(made) > 0).all()
