"""Seams between tubes, balls and plates of unlike resolution; the paper's split and pairing; strips wound right."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.mesh import SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import open_edges, twins
from mirror_scan.core.mesh.normals import triangle_normals
from mirror_scan.core.mesh.submesh import compact, remove_bowties
from mirror_scan.core.views.view_maps import view_maps
from mirror_scan.core.zippering.coronal_matching import Chain, match_chains, pairings, solidity, split_loop
from mirror_scan.core.zippering.dtw import dtw
from mirror_scan.core.zippering.seam_strips import _strip_kernel, add_triangles
from mirror_scan.core.zippering.zipper import ZipperSettings, zip_patches

UP = np.array((0.0, 0.0, 1.0))


def sheet(points, view=0, closed=False) -> Mesh:
    """A mesh over a grid of points (rows, columns, 3); ``closed`` joins the last column to the first."""
    rows, columns = points.shape[:2]
    at = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        at = np.column_stack((at, at[:, 0]))
    a, b, c, d = (x.ravel() for x in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)
    count = rows * columns
    return Mesh(
        points.reshape(-1, 3).astype(float), faces, np.full((count, 3), 50 * view, np.uint8),
        np.full(count, view, np.int8), np.zeros(len(faces), np.int8),
    )  # fmt: skip


def tube(bottom, top, rows, columns, view=0, turn=0.0, radius=0.2) -> Mesh:
    angle = 2 * np.pi * np.arange(columns) / columns + turn
    z = np.linspace(bottom, top, rows)
    ring = radius * np.column_stack((np.cos(angle), np.sin(angle)))
    points = np.concatenate(
        (np.broadcast_to(ring, (rows, columns, 2)), np.broadcast_to(z[:, None, None], (rows, columns, 1))), axis=2
    )
    return sheet(points, view, closed=True)


def trough(from_angle, to_angle, rows, columns, view=0, radius=0.2, height=0.8) -> Mesh:
    """Part of an upright tube, open along two vertical lines."""
    angle = np.linspace(from_angle, to_angle, columns)
    z = np.linspace(0, height, rows)
    points = np.empty((rows, columns, 3))
    points[..., 0], points[..., 1], points[..., 2] = radius * np.cos(angle), radius * np.sin(angle), z[:, None]
    return sheet(points, view)


def check_zipped(mesh: Mesh, patches):
    """Oriented and manifold; the patches are in it unchanged; arrays fit."""
    assert (twins(mesh.triangles, len(mesh.vertices)) >= -1).all()
    assert trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).is_winding_consistent
    surface = mesh.triangles[mesh.kind == SURFACE]
    assert len(surface) == sum(len(p.triangles) for p in patches)
    np.testing.assert_array_equal(mesh.vertices[surface], np.concatenate([p.vertices[p.triangles] for p in patches]))
    assert len(mesh.kind) == len(mesh.triangles) and len(mesh.view) == len(mesh.colors) == len(mesh.vertices)


GENERAL = ZipperSettings(compactness=2.0)


@pytest.mark.parametrize(("columns", "turn"), [(60, 0.0), (60, 0.05), (37, 0.2), (24, 0.0), (150, 1.0)])
def test_two_tubes_become_one(blind_maps, columns, turn):
    patches = [tube(0.0, 0.4, 12, 60), tube(0.42, 0.8, 9, columns, 1, turn)]
    mesh, seams, _ = zip_patches(patches, blind_maps, UP, np.zeros(3), None, GENERAL)
    check_zipped(mesh, patches)
    loops = boundary_loops(mesh.triangles, len(mesh.vertices))
    assert sorted(len(loop) for loop in loops) == sorted((60, columns)), "only the far ends stay open"
    strip = mesh.triangles[mesh.kind != SURFACE]
    assert len(strip) == 60 + columns and len(mesh.vertices) == 12 * 60 + 9 * columns, "one triangle a boundary edge"
    outwards = triangle_normals(mesh.vertices, strip)
    middle = mesh.vertices[strip].mean(axis=1)
    assert ((outwards * middle)[:, :2].sum(axis=1) > 0).all(), "wound as the tubes are"
    assert all(seam.views == (0, 1) for seam in seams)
    assert sum(seam.length for seam in seams) == pytest.approx(2 * np.pi * 0.2, rel=0.1)
    assert all(0.019 < seam.mean_gap < 0.03 and seam.mean_gap - 1e-9 < seam.max_gap < 0.05 for seam in seams)


def test_two_halves_of_a_ball_close(blind_maps):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    coarse = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    halves = []
    for view, (whole, keep) in enumerate(
        ((ball, ball.triangles_center[:, 2] > 0.02), (coarse, coarse.triangles_center[:, 2] < -0.02))
    ):
        half = trimesh.Trimesh(whole.vertices, whole.faces[keep])
        half.remove_unreferenced_vertices()
        count = len(half.vertices)
        halves.append(Mesh(
            np.array(half.vertices), half.faces.astype(np.int32), np.zeros((count, 3), np.uint8),
            np.full(count, view, np.int8), np.zeros(len(half.faces), np.int8),
        ))  # fmt: skip
    mesh, *_ = zip_patches(halves, blind_maps, UP, np.zeros(3), None, GENERAL)
    check_zipped(mesh, halves)
    assert not boundary_loops(mesh.triangles, len(mesh.vertices))
    closed = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert closed.is_watertight and closed.euler_number == 2
    assert closed.volume == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.03)


@pytest.mark.parametrize("way", ["general", "paper"])
def test_front_and_two_backs_of_a_tube(blind_maps, way):
    """The paper's three patches round an upright body: three vertical seams, top and bottom stay open."""
    third, gap = 2 * np.pi / 3, 0.06
    patches = [
        trough(k * third + gap, (k + 1) * third - gap, rows, columns, k)
        for k, (rows, columns) in enumerate(((60, 30), (33, 17), (41, 20)))
    ]
    if way == "paper":
        intrinsics = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
        compact = np.where(np.abs(np.arange(64) - 32) < 12, 0, -1).astype(np.int8) * np.ones((48, 1), np.int8)
        maps = view_maps(
            RgbdImage(np.zeros((48, 64), np.float32), intrinsics), compact, np.full_like(compact, -1), [], np.zeros(1)
        )
        mesh, seams, _ = zip_patches(patches, maps, UP, np.zeros(3), None, ZipperSettings(compactness=0.0))
        assert "coronal and sagittal planes" in {seam.method for seam in seams}
    else:
        mesh, seams, _ = zip_patches(patches, blind_maps, UP, np.zeros(3), None, GENERAL)
    check_zipped(mesh, patches)
    assert {seam.views for seam in seams} == {(0, 1), (0, 2), (1, 2)}
    loops = boundary_loops(mesh.triangles, len(mesh.vertices))
    assert len(loops) == 2
    heights = sorted(float(mesh.vertices[loop][:, 2].mean()) for loop in loops)
    assert heights[0] < 0.05 and heights[1] > 0.75
    for pair in ((0, 1), (0, 2), (1, 2)):
        assert 0.65 < sum(seam.length for seam in seams if seam.views == pair) < 0.95


def plates(gap):
    y, z = np.meshgrid(np.linspace(-0.2, 0.2, 30), np.linspace(-0.2, 0.2, 30))
    left = np.stack((y - 0.2 - gap / 2, z, np.full(y.shape, 2.0)), axis=-1)
    right = np.stack((y + 0.2 + gap / 2, z, np.full(y.shape, 2.0)), axis=-1)
    return [sheet(left[::-1], 0), sheet(right[::-1], 1)]


def test_no_bridge_through_space_seen_to_be_empty(blind_maps):
    patches = plates(0.05)
    intrinsics = Intrinsics(300, 200, 300.0, 300.0, 149.5, 99.5)
    nobody = np.full((200, 300), -1, np.int8)

    def seams(depth, seen):
        maps = view_maps(
            RgbdImage(np.full((200, 300), depth, np.float32), intrinsics),
            nobody,
            np.full((200, 300), seen, np.int8),
            [],
            np.zeros(1),
        )
        return zip_patches(patches, maps, np.array((0, -1.0, 0)), np.array((0, 0, 2.0)), None, GENERAL)

    across = [
        s for s in zip_patches(patches, blind_maps, np.array((0, -1.0, 0)), np.array((0, 0, 2.0)), None, GENERAL)[1]
    ]
    assert {s.views for s in across} == {(0, 1)}
    mesh, none, twin = seams(5.0, 0)
    assert not [s for s in none if s.views == (0, 1)], "the camera looked through the gap"
    check_zipped(mesh, patches)
    np.testing.assert_array_equal(twin, twins(mesh.triangles, len(mesh.vertices)))
    assert {s.views for s in seams(2.0, 0)[1]} == {(0, 1)}, "a surface read right there hides nothing"
    assert {s.views for s in seams(5.0, 1)[1]} == {(0, 1)}, "what another view reads there says nothing"


def isthmus(rng) -> Mesh:
    """A plate in front of another, as a chin before a neck, and a narrow ragged strip of skin that joins them."""
    cell, width, step = 0.004, rng.uniform(0.016, 0.03), rng.uniform(0.02, 0.05)
    x, z = np.meshgrid(np.arange(-0.06, 0.0601, cell), np.arange(-0.12, 0.1001, cell))
    points = np.stack((x, np.interp(z, [-0.02, 0.0], [step, 0.0]), z), axis=-1)
    points += cell * rng.normal(0.0, (0.075, 0.15, 0.075), points.shape)
    kept = (z < -0.019) | (z > -0.001) | (np.abs(x) <= 0.5 * width)
    inner = np.zeros_like(kept)
    inner[1:-1, 1:-1] = kept[2:, 1:-1] & kept[:-2, 1:-1] & kept[1:-1, 2:] & kept[1:-1, :-2]
    kept &= inner | (rng.random(kept.shape) < 0.6)
    whole = sheet(points)
    known = kept.ravel()[whole.triangles].all(axis=1)
    return remove_bowties(compact(replace(whole, triangles=whole.triangles[known], kind=whole.kind[known])))


@pytest.mark.parametrize("seed", [14, 17, 19, 21, 25, 26, 27, 29])
def test_nothing_is_bridged_over_the_strip_between_its_own_shores(blind_maps, seed):
    """That would tie off what hangs by the strip: a face by its chin."""
    patch = isthmus(np.random.default_rng(seed))
    mesh, _, _ = zip_patches([patch], blind_maps, UP, np.zeros(3), None, GENERAL)
    check_zipped(mesh, [patch])
    x = mesh.vertices[mesh.triangles[mesh.kind == SEAM], 0]
    assert not ((x.min(axis=1) < -0.006) & (x.max(axis=1) > 0.006)).any()


def test_wide_gaps_stay_open(blind_maps):
    patches = plates(0.25)
    mesh, seams, _ = zip_patches(
        patches, blind_maps, UP, np.zeros(3), None, ZipperSettings(gaps=(0.03, 0.08), compactness=2.0)
    )
    assert not seams and (mesh.kind == SURFACE).all() and len(mesh.vertices) == 1800


def test_nothing_to_zip(blind_maps):
    empty = Mesh(
        np.empty((0, 3)),
        np.empty((0, 3), np.int32),
        np.empty((0, 3), np.uint8),
        np.empty(0, np.int8),
        np.empty(0, np.int8),
    )
    mesh, seams, _ = zip_patches([empty, empty], blind_maps, UP, np.zeros(3), None)
    assert len(mesh.triangles) == 0 and seams == []
    one = tube(0, 0.4, 5, 60)
    mesh, seams, _ = zip_patches([one, empty], blind_maps, UP, np.zeros(3), None, GENERAL)
    np.testing.assert_array_equal(mesh.triangles, one.triangles)
    torus = trimesh.creation.torus(0.3, 0.1)
    closed = Mesh(
        np.array(torus.vertices), torus.faces.astype(np.int32), None, np.zeros(len(torus.vertices), np.int8),
        np.zeros(len(torus.faces), np.int8),
    )  # fmt: skip
    mesh, seams, _ = zip_patches([closed], blind_maps, UP, np.zeros(3), None)
    assert not seams and len(mesh.triangles) == len(torus.faces)


def test_what_is_no_sheet_is_refused_in_words(blind_maps):
    one = tube(0, 0.4, 5, 60)
    turned = one.triangles.copy()
    turned[40:60] = turned[40:60, ::-1]
    for triangles in (turned, np.concatenate((one.triangles, one.triangles[:9])), [[0, 0, 1]]):
        triangles = np.array(triangles, np.int32)
        patch = Mesh(one.vertices, triangles, one.colors, one.view, np.zeros(len(triangles), np.int8))
        with pytest.raises(MirrorScanError, match="zippering: [0-9]+ triangles"):
            zip_patches([patch], blind_maps, UP, np.zeros(3), None)
        with pytest.raises(MirrorScanError, match="filling: [0-9]+ triangles"):
            fill_loops(patch, blind_maps)
    with pytest.raises(MirrorScanError, match="no patch is given"):
        zip_patches([], blind_maps, UP, np.zeros(3), None)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 25), st.integers(2, 25))
def test_strips_follow_the_path_and_wind_like_the_patches(seed, n, m):
    """Two boundaries in a plane, one above the other, run over by the warping path: all triangles face the viewer."""
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0, 1, n))[::-1]  # the upper patch's boundary runs to the left: surface on its left is below
    y = np.sort(rng.uniform(0, 1, m))[::-1]
    a, b = np.column_stack((x, np.full(n, 0.0), np.zeros(n))), np.column_stack((y, np.full(m, 0.3), np.zeros(m)))
    path = dtw(a, b).path
    strip = np.empty((2 * len(path), 3), np.int32)
    used = _strip_kernel(np.concatenate((a, b)), np.arange(n + m), np.arange(n), n + np.arange(m), path, strip, 0)
    strip = strip[:used]
    steps = np.diff(path, axis=0)
    assert len(strip) == steps.sum() and strip.dtype == np.int32
    edges = {frozenset(e) for t in strip.tolist() for e in zip(t, t[1:] + t[:1], strict=True)}
    for (i, j), both in zip(path[:-1], (steps == 1).all(axis=1), strict=True):
        if both:  # a quadrilateral is split along its shorter diagonal
            one, other = np.linalg.norm(a[i + 1] - b[j]), np.linalg.norm(a[i] - b[j + 1])
            assert (frozenset((int(i) + 1, n + int(j))) in edges) == (one <= other)
    assert (triangle_normals(np.concatenate((a, b)), strip)[:, 2] > 0).all()
    directed = {(int(i), int(j)) for t in strip for i, j in zip(t, np.roll(t, -1), strict=True)}
    assert len(directed) == 3 * len(strip)
    assert {(k + 1, k) for k in range(n - 1)} <= directed, "each boundary edge is met from the other side"
    assert {(n + k, n + k + 1) for k in range(m - 1)} <= directed
    assert len(open_edges(strip, n + m)) == n + m


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_no_directed_edge_comes_twice(seed):
    rng = np.random.default_rng(seed)
    old = rng.integers(0, 9, (rng.integers(0, 8), 3)).astype(np.int32)
    new = rng.integers(0, 9, (rng.integers(1, 15), 3)).astype(np.int32)
    assert add_triangles(old, new, 9).tolist() == naive.first_come(old, new)


def test_adding_triangles_by_example():
    old = np.array([[0, 1, 2]], np.int32)
    new = np.array([[0, 1, 3], [1, 0, 3], [0, 3, 4], [3, 0, 5], [2, 2, 5], [6, 7, 8], [7, 8, 6]], np.int32)
    # the first repeats 0 → 1, the third 0 → 3 of the second, the fifth is none, the last is the sixth again
    assert add_triangles(old, new, 9).tolist() == [False, True, False, True, False, True, False]


def test_pairings_are_all_there():
    assert list(pairings([])) == [[]] and list(pairings([0])) == [] and list(pairings([0, 0])) == []
    ways = list(pairings([0, 0, 1, 1, 2, 2]))
    assert len(ways) == 8 == len({frozenset(way) for way in ways})
    assert len(list(pairings(list(range(6))))) == 15  # perfect matchings of six: 5 · 3 · 1
    for way in ways:
        assert sorted(k for pair in way for k in pair) == list(range(6))


def test_a_loop_is_split_at_top_and_bottom():
    angle = 2 * np.pi * np.arange(40) / 40
    points = np.column_stack((0.3 * np.cos(angle), np.zeros(40), 0.9 * np.sin(angle)))
    loop = np.roll(np.arange(40), 13)
    first, second = split_loop(points, loop, UP, np.zeros(3))
    assert {first[0], first[-1]} == {second[0], second[-1]} == {10, 30} and first[-1] == second[0]
    assert len(first) + len(second) == 42
    assert set(first.tolist()) | set(second.tolist()) == set(range(40))
    steps = np.diff(np.concatenate((first, second[1:]))) % 40
    assert (steps == 1).all(), "both run in the loop's direction"
    assert split_loop(points * (1, 1, 0), loop, UP, np.zeros(3)) is None


def test_the_cheapest_pairing_is_found():
    third, gap = 2 * np.pi / 3, 0.1
    z = np.linspace(0, 1, 30)
    points, chains = [], []
    for k in range(3):
        for angle, order in ((k * third + gap, 1), ((k + 1) * third - gap, -1)):
            chain = np.column_stack((np.full(30, np.cos(angle)), np.full(30, np.sin(angle)), z))[::order]
            chains.append(Chain(k, np.arange(30) + 30 * len(points)))
            points.append(chain)
    found = {(a.patch, b.patch) for a, b, _ in match_chains(np.concatenate(points), chains)}
    assert found == {(0, 1), (1, 2), (0, 2)}
    for a, b, warping in match_chains(np.concatenate(points), chains):
        assert warping.distance == pytest.approx(30 * 2 * np.sin(gap), rel=1e-9)
        assert warping.path.tolist() == [[k, k] for k in range(30)] and a.patch != b.patch
    assert match_chains(np.concatenate(points), chains[:1]) == []


def test_solidity_of_silhouettes():
    labels = np.full((10, 20), -1, np.int8)
    assert solidity(labels) == 0
    labels[2:8, 5:15] = 0
    assert solidity(labels) == 1
    labels[2:8, 8:12] = 1
    assert solidity(labels) == pytest.approx(0.6) and solidity(labels, 1) == 1
