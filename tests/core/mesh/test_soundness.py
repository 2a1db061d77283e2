"""Places to look at on meshes whose faults are known, and reports against trimesh."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import lopsided, ours, sphere
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.soundness import CROSSING, EDGE, HOLE, PIECE, find_problems, mesh_report


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
    filled = Mesh(box.vertices, box.triangles, None, None, kind)
    assert find_problems(filled) == []  # what no view saw is no fault, but a share
    assert mesh_report(filled)["filled_share"] == pytest.approx(1 / 6)
    assert "filled_share" not in mesh_report(Mesh(box.vertices, box.triangles))


def test_an_edge_of_three_faces_is_named():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    kinds = {place.kind for place in find_problems(Mesh(vertices, triangles, None, None, None))}
    assert EDGE in kinds


trimesh = pytest.importorskip("trimesh")


@pytest.mark.parametrize("shape", ["box", "torus", "open box", "flipped", "two spheres", "body of one's own"])
def test_report_agrees_with_trimesh(shape):
    pytest.importorskip("scipy", reason="trimesh needs it to count components")
    mesh = {
        "torus": lambda: trimesh.creation.torus(1, 0.3),
        "two spheres": lambda: sphere(level=2) + sphere(0.5, (3, 0, 0), 2),
        "body of one's own": lopsided,
    }.get(shape, trimesh.creation.box)()
    faces = mesh.faces.copy()
    if shape == "open box":
        faces = faces[1:]
    if shape == "flipped":
        faces[0] = faces[0, ::-1]
    mesh = trimesh.Trimesh(mesh.vertices, faces, process=False)
    report = mesh_report(ours(mesh))
    assert report["watertight"] == (mesh.is_watertight and mesh.is_winding_consistent)
    assert report["winding_consistent"] == mesh.is_winding_consistent
    assert report["components"] == len(mesh.split(only_watertight=False))
    assert report["euler_characteristic"] == mesh.euler_number
    assert report["area_m2"] == pytest.approx(mesh.area)
    assert report["manifold"]
    assert report["boundary_edges"] == (3 if shape == "open box" else 0)
    assert report["nonmanifold_edges"] == report["nonmanifold_vertices"] == report["self_intersections"] == 0
    if report["watertight"]:
        assert report["volume_m3"] == pytest.approx(mesh.volume)
    else:
        assert report["volume_m3"] is None
    smallest = np.degrees(mesh.face_angles.min(axis=1))
    assert list(report["min_angle_deg"].values()) == pytest.approx(np.percentile(smallest, [0, 1, 5, 50]).tolist())


def test_report_of_what_is_not_manifold():
    box = trimesh.creation.box()
    on_an_edge = trimesh.Trimesh(*_welded(box, box.copy().apply_translation((1, 1, 0))), process=False)
    report = mesh_report(ours(on_an_edge))
    assert (report["nonmanifold_edges"], report["manifold"], report["watertight"]) == (1, False, False)
    at_a_corner = trimesh.Trimesh(*_welded(box, box.copy().apply_translation((1, 1, 1))), process=False)
    report = mesh_report(ours(at_a_corner))
    assert report["watertight"] and not report["manifold"]
    assert (report["nonmanifold_vertices"], report["components"]) == (1, 2)
    empty = mesh_report(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)))
    assert not empty["watertight"] and empty["components"] == empty["area_m2"] == 0


def _welded(a, b):
    vertices, index = np.unique(np.concatenate((a.vertices, b.vertices)), axis=0, return_inverse=True)
    return vertices, index.ravel()[np.concatenate((a.faces, b.faces + len(a.vertices)))]
