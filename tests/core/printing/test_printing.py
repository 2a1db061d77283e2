"""Prints: the size asked for, closed, hollow with the wall asked for, on a plate; and what stands in the way."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io import write_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.numeric.isosurface import split_quads, surface_nets
from mirror_scan.core.printing import PrintLimits, PrintSettings, check_print, prepare_print
from mirror_scan.core.simulation.mannequin import mannequin
from scipy.spatial import ConvexHull


def solid(shape) -> Mesh:
    mesh = shape.subdivide() if len(shape.faces) < 50 else shape
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces, np.int32))


def ball(radius=0.05) -> Mesh:
    return solid(trimesh.creation.icosphere(4, radius))


@pytest.fixture(scope="module")
def figure() -> Mesh:
    mesh = mannequin(resolution=0.015)
    colors = np.tile(np.uint8((200, 30, 60)), (len(mesh.vertices), 1))
    return Mesh(mesh.vertices, mesh.triangles, colors)


def check_sound(mesh: Mesh, pieces=1):
    report = mesh_report(mesh)
    assert report["watertight"] and report["manifold"] and report["components"] == pieces
    assert report["self_intersections"] == 0
    return report


def test_a_figure_is_as_high_as_asked_and_stands_on_the_bed(figure):
    made = prepare_print(figure, PrintSettings(height_mm=180))
    low, high = made.vertices.min(axis=0), made.vertices.max(axis=0)
    assert low[2] == 0 and high[2] == pytest.approx(0.180)
    tenth = prepare_print(figure, PrintSettings(scale=0.1))
    np.testing.assert_allclose(np.ptp(tenth.vertices, axis=0), 0.1 * np.ptp(figure.vertices, axis=0))
    np.testing.assert_array_equal(made.triangles, figure.triangles)
    np.testing.assert_array_equal(made.colors, figure.colors)


def test_a_plate_is_one_closed_piece_with_the_body(figure):
    plain = check_sound(prepare_print(figure, PrintSettings(height_mm=180)))
    made = prepare_print(figure, PrintSettings(height_mm=180, base_mm=3, margin_mm=5))
    report = check_sound(made)
    mm = 1000 * made.vertices
    sunk = min(0.006 * 180, 1.5)
    assert mm[:, 2].min() == 0 and mm[:, 2].max() == pytest.approx(180 + 3 - sunk, abs=0.01)
    plate = mm[mm[:, 2] == 0]
    area = ConvexHull(plate[:, :2]).volume
    # the plate, and what of the body is above it
    plain_mm = 1000 * prepare_print(figure, PrintSettings(height_mm=180)).vertices
    vertices, faces, _ = trimesh.intersections.slice_faces_plane(plain_mm, figure.triangles, (0, 0, 1), (0, 0, sunk))
    above = vertices[faces] - (0, 0, sunk)
    above = np.linalg.det(above).sum() / 6  # seen from the plane, the cut adds nothing
    assert report["volume_m3"] * 1e9 == pytest.approx(area * 3 + above, rel=2e-3)
    assert report["volume_m3"] > plain["volume_m3"]
    feet = 180 / np.ptp(figure.vertices[:, 2]) * figure.vertices
    feet = feet[feet[:, 2] - feet[:, 2].min() < sunk]
    assert plate[:, 0].max() == pytest.approx(feet[:, 0].max() + 5, abs=0.6)
    assert (made.colors[np.flatnonzero(mm[:, 2] == 0)] == made.colors[-1]).all()
    assert (made.colors == (200, 30, 60)).all(axis=1).mean() > 0.9


@pytest.mark.parametrize("wall", [1.5, 4.0])
def test_a_hollow_ball_has_the_wall_asked_for(wall):
    made = prepare_print(ball(), PrintSettings(wall_mm=wall))
    report = check_sound(made, 2)
    radius = 50 - wall
    expected = 4 / 3 * np.pi * (50**3 - radius**3)
    assert report["volume_m3"] * 1e9 == pytest.approx(expected, rel=0.03)
    inner = 1000 * made.vertices[len(ball().vertices) :] - (0, 0, 50)
    away = np.linalg.norm(inner, axis=1)
    np.testing.assert_allclose(away, radius, atol=0.12)


def test_the_wall_of_a_figure_is_nowhere_thinner(figure):
    made = prepare_print(figure, PrintSettings(height_mm=180, wall_mm=1.5))
    check_sound(made, mesh_report(made)["components"])
    outer = 1000 * made.vertices[: len(figure.vertices)]
    inner = 1000 * made.vertices[len(figure.vertices) :]
    distance, _, _ = closest_point(build_bvh(outer, figure.triangles), inner)
    assert len(inner) > 1000 and np.median(distance) == pytest.approx(1.5, abs=0.05)
    assert (distance > 0.95 * 1.5).mean() > 0.998 and distance.min() > 0.7 * 1.5


def merged_by_place(mesh: Mesh, folder) -> trimesh.Trimesh:
    """What a slicer makes of the STL file, whose triangles have corners of their own."""
    write_mesh(folder / "print.stl", mesh)
    corners = trimesh.load(folder / "print.stl", process=False).triangles.reshape(-1, 3).astype(np.float32)
    places, number = np.unique(corners, axis=0, return_inverse=True)
    return trimesh.Trimesh(places, number.reshape(-1, 3), process=False)


def worst_edge(made: trimesh.Trimesh) -> tuple[int, int]:
    """How few and how many triangles meet in an edge."""
    count = np.unique(made.edges_sorted, axis=0, return_counts=True)[1]
    return int(count.min()), int(count.max())


@pytest.mark.parametrize(
    "size", [(180, 2, 3, 0), (180, 2, 3, 3), (90, 1.5, 0, 0), (180, 0.8, 0, 0), (300, 5, 0, 0), (100, 2, 2, 0)]
)
def test_vertices_merged_by_place_are_a_manifold_still(figure, size, tmp_path):
    height, wall, base, drain = size
    made = prepare_print(figure, PrintSettings(height_mm=height, wall_mm=wall, base_mm=base, drain_mm=drain))
    merged = merged_by_place(made, tmp_path)
    assert len(merged.faces) == len(made.triangles) and len(merged.vertices) == len(made.vertices)
    assert worst_edge(merged) == (2, 2)
    assert merged.is_watertight and merged.is_winding_consistent
    assert 1e-9 * merged.volume == pytest.approx(mesh_report(made)["volume_m3"], rel=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_surface_nets_keep_vertices_apart_where_the_grid_lies_on_the_surface(seed):
    """Balls whose surface runs through points of the grid, that touch in points, edges and corners."""
    rng = np.random.default_rng(seed)
    index = np.stack(np.meshgrid(*[np.arange(40.0)] * 3, indexing="ij"), axis=-1)
    centers, radii = rng.integers(12, 28, (6, 3)), rng.integers(3, 9, 6)
    field = np.min([np.linalg.norm(index - c, axis=-1) - r for c, r in zip(centers, radii, strict=True)], axis=0)
    points, quads = surface_nets(field.astype(np.float32), 0.05)
    places, number = np.unique((points / 7.0 + 100.0).astype(np.float32), axis=0, return_inverse=True)
    assert len(places) == len(points)
    assert worst_edge(trimesh.Trimesh(places, number.reshape(-1)[split_quads(points, quads)], process=False)) == (2, 2)


@pytest.mark.parametrize("base", [0.0, 3.0])
def test_drain_holes_open_the_hollow_to_below(figure, base):
    settings = PrintSettings(height_mm=220, wall_mm=1.5, base_mm=base, drain_mm=3)
    made = prepare_print(figure, settings)
    report = check_sound(made)  # inside and outside are one surface now
    assert report["euler_characteristic"] <= 0  # two holes into one hollow: a handle at least
    solid_one = check_sound(prepare_print(figure, PrintSettings(height_mm=220, base_mm=base)))
    assert report["volume_m3"] < 0.75 * solid_one["volume_m3"]


def test_a_finished_print_passes_its_check(figure):
    notices = check_print(prepare_print(figure, PrintSettings(height_mm=180, base_mm=3)))
    assert all("mid-air" in notice for notice in notices)  # hands and chin begin there


def said(mesh, **limits):
    return "\n".join(check_print(mesh, PrintLimits(**limits)))


def test_each_fault_is_reported():
    block = solid(trimesh.creation.box((0.04, 0.03, 0.02)))
    block = Mesh(block.vertices + (0, 0, 0.01), block.triangles)
    assert check_print(block) == []
    assert "not closed: 3 edges" in said(Mesh(block.vertices, block.triangles[1:]))
    inside_out = Mesh(block.vertices, np.ascontiguousarray(block.triangles[:, ::-1]))
    assert "inside out" in said(inside_out)
    two = Mesh(
        np.concatenate((block.vertices, block.vertices + (0.1, 0, 0))),
        np.concatenate((block.triangles, block.triangles + len(block.vertices))).astype(np.int32),
    )
    assert "2 separate pieces" in said(two)
    assert "room for 30 × 30 × 30 mm; scale it by 0.75" in said(block, volume_mm=(30, 30, 30))
    through = Mesh(np.concatenate((block.vertices, block.vertices + (0.013, 0.004, 0.003))), two.triangles)
    assert "run through others" in said(through)


def test_thin_places_are_found_and_told_where():
    plate = solid(trimesh.creation.box((0.04, 0.04, 0.0006)).subdivide().subdivide())
    plate = Mesh(plate.vertices + (0, 0, 0.0003), plate.triangles)
    assert "thinner than 0.8 mm, down to 0.60 mm" in said(plate)
    assert "thinner" not in said(plate, wall_mm=0.5)


def test_what_begins_in_mid_air_and_what_does_not_stand():
    assert "only in a point" in said(ball())
    grid = np.stack(np.meshgrid(*(np.arange(-24.0, 25) for _ in range(2)), np.arange(-3.0, 45), indexing="ij"), axis=-1)

    def box(middle, size):
        return (np.abs(grid - middle) - np.array(size) / 2).max(axis=-1)

    drop = np.linalg.norm(grid - (10, 0, 30), axis=-1) - 4
    joined = np.min([box((0, 0, 35), (40, 40, 10)), box((-15, 0, 18), (9, 9, 36)), drop], axis=0)
    points, quads = surface_nets(joined.astype(np.float32))
    table = Mesh((points + (-24, -24, -3)) / 1000, split_quads(points, quads))
    found = said(table)
    assert "tips over" in found and "1 places begin in mid-air, the lowest at (10, 0, 26) mm" in found


@pytest.mark.parametrize("settings, text", [
    ({"height_mm": 0.1}, "0.1 mm high"),
    ({"scale": 0.0}, "scale of 0"),
    ({"wall_mm": -1.0}, "wall of -1 mm"),
    ({"drain_mm": 3.0}, "need a hollow print"),
    ({"wall_mm": 60.0}, "leaves no hollow"),
    ({"wall_mm": 5.0, "drain_mm": 99.0}, "no drain hole of 99 mm fits"),
])  # fmt: skip
def test_what_cannot_be_made_is_refused(settings, text):
    with pytest.raises(MirrorScanError, match=text):
        prepare_print(ball(), PrintSettings(**settings))


def test_an_open_mesh_is_refused():
    mesh = ball()
    with pytest.raises(MirrorScanError, match="3 open or branching edges"):
        prepare_print(Mesh(mesh.vertices, mesh.triangles[1:]))
    with pytest.raises(MirrorScanError, match="inside out"):
        prepare_print(Mesh(mesh.vertices, mesh.triangles[:, ::-1]))
