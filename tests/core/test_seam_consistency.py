"""Seams that show a step: frames that stand proud, frames hardly seen; and mirrors that are where they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.agreement import expected_error
from mirror_scan.core.linear import transform
from mirror_scan.core.mirror import moved, plane_mirror, reflect, reflection_matrix
from mirror_scan.core.mirror_refinement import JointSettings
from mirror_scan.core.overlap import part_overlaps, view_maps
from mirror_scan.core.pipeline import Clock, Settings, reconstruct, scan_steps
from mirror_scan.core.seam_consistency import (
    SeamPieces,
    SeamSettings,
    _moves,
    _noise,
    _solve,
    align_seams,
    mirrored_views,
    move_views,
    seam_pieces,
    skin_read_twice,
)
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.zippering import zip_patches
from scipy.optimize import minimize


def finished(steps):
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


def scanned(capture, mirrors=()):
    return finished(scan_steps(capture, tuple(mirrors), Settings(), Clock(), (0.0, 1.0)))


def joined(scan, patches=None, maps=None):
    patches, maps = scan.patches if patches is None else patches, scan.maps if maps is None else maps
    return zip_patches(part_overlaps(patches, maps), maps, scan.up, scan.axis, scan.floor)[0]


def aligned(scan, mirrors, settings=None):
    return align_seams(
        mirrors, scan.patches, scan.maps, joined(scan), lambda patches, maps: joined(scan, patches, maps), settings
    )


def misplaced(mirrors, simulation) -> np.ndarray:
    """Median displacement of the reflected body [m]."""
    body = simulation.truth.body.vertices[::7]
    true = {m.name: plane_mirror(m.name, m.point, m.normal) for m in simulation.truth.mirrors}
    return np.array(
        [np.median(np.linalg.norm(reflect(body, m) - reflect(body, true[m.name]), axis=1)) for m in mirrors]
    )


@pytest.mark.parametrize("sensor", ["kinect_v1", "azure_kinect"])
def test_a_proud_frame_shows_in_the_seams(person, sensor):
    simulation = simulate(person, default_rig(sensor, frames=8, frame_depth=0.012, seed=1))
    picks, frames = simulation.capture.mirrors, Settings(alignment=JointSettings(use=False))
    before = reconstruct(simulation.capture, picks, replace(frames, seams=SeamSettings(use=False)))
    after = reconstruct(simulation.capture, picks, frames)
    wrong, right = misplaced(before.mirrors, simulation), misplaced(after.mirrors, simulation)
    assert (wrong > 0.02).all() and (right < 0.5 * wrong).all(), (wrong, right)
    assert all(m.moved_by == ("seams",) and abs(m.moved - 0.024) < 0.012 for m in after.mirrors)
    assert all(off < 3.0 * expected_error(m) for off, m in zip(right, after.mirrors, strict=True))
    assert sum("behind the front of its frame" in text for text in after.warnings) == 2
    assert not any("seams" in m.moved_by for m in before.mirrors)
    assert after.report["mesh"]["watertight"] and after.report["mirrors"][0]["moved_by"] == ["seams"]
    gaps = [sum(s["mean_gap_mm"] * s["length_m"] for s in made.report["seams"]) for made in (before, after)]
    assert gaps[1] != gaps[0], "zippered anew"


@pytest.mark.parametrize("sensor", ["kinect_v1", "azure_kinect", "realsense_d455", "ideal"])
def test_mirrors_in_their_place_stay(simulated, sensor):
    scan = scanned(simulated(sensor).capture)
    after, notes = aligned(scan, scan.mirrors)
    assert notes == () and all(a is b for a, b in zip(after, scan.mirrors, strict=True))


def test_frames_hardly_seen_are_helped(simulated):
    """What is unsure by centimetres comes nearer, and what is promised of it then is kept."""
    simulation = simulated("kinect_v1")
    placed = scanned(simulation.capture).mirrors
    slope, shift = 0.004, 0.008
    covariance = np.diag((slope**2, slope**2, shift**2))
    rng = np.random.default_rng(4)
    wrong, right, promised = [], [], []
    for _ in range(5):
        off = [moved(m, rng.normal(size=3) * (slope, slope, shift)) for m in placed]
        scan = scanned(simulation.capture, [replace(m, source="rig file") for m in off])
        off = [replace(m, covariance=covariance) for m in off]
        after, notes = aligned(scan, off)
        told = [m is not old for m, old in zip(after, off, strict=True)]
        assert [m.moved_by for m in after] == [("seams",) if asked else () for asked in told]
        assert sum(told) == len(notes)
        wrong += misplaced(off, simulation)[told].tolist()
        right += misplaced(after, simulation)[told].tolist()
        promised += [expected_error(m) for m, asked in zip(after, told, strict=True) if asked]
    assert len(right) >= 7, "a view that contradicts the others by decimetres is dropped and has no seams"
    rms = [float(np.sqrt(np.mean(np.square(errors)))) for errors in (wrong, right)]
    assert rms[1] < 0.7 * rms[0], (wrong, right, promised)
    assert (np.array(right) < 2.5 * np.array(promised)).all() and np.max(promised) < 0.016


def test_what_is_sure_or_far_off_stays(simulated):
    simulation = simulated("kinect_v1")
    placed = scanned(simulation.capture).mirrors
    scan = scanned(simulation.capture, [replace(moved(m, np.array((0, 0, 0.015))), source="rig file") for m in placed])
    off = [replace(m, source="picked") for m in scan.mirrors]
    assert aligned(scan, off)[1], "else this shows nothing"
    assert aligned(scan, off, SeamSettings(max_shift=0.004)) == (off, ())
    assert aligned(scan, off, SeamSettings(use=False)) == (off, ())
    assert aligned(scan, off, SeamSettings(min_pieces=10**6)) == (off, ())
    given = [replace(m, covariance=None, source="given") for m in off]
    assert aligned(scan, given) == (given, ()) and aligned(scan, scan.mirrors) == (scan.mirrors, ())
    two = replace(scan.maps, to_view=np.concatenate((scan.maps.to_view, np.eye(4)[None])))
    assert align_seams(off, scan.patches, two, joined(scan), None) == (off, ()), "two cameras"
    bare = joined(scan)
    bare = replace(bare, kind=np.zeros_like(bare.kind))
    assert align_seams(off, scan.patches, scan.maps, bare, None) == (off, ()), "no seams"


def test_moved_views_are_those_of_moved_mirrors(simulated):
    """Against the maps made anew for the moved mirrors, and the patches' distances from where they must be."""
    simulation = simulated("azure_kinect")
    scan = scanned(simulation.capture)
    steps = [np.array((0.003, -0.002, 0.01)), np.array((-0.004, 0.001, -0.02))]
    new = [moved(m, step) for m, step in zip(scan.mirrors, steps, strict=True)]
    motions = [reflection_matrix(n) @ reflection_matrix(m) for n, m in zip(new, scan.mirrors, strict=True)]
    behind = mirrored_views(scan.maps)
    np.testing.assert_array_equal(behind, (1, 2))
    patches, maps = move_views(scan.patches, scan.maps, behind, motions)
    anew = view_maps(
        scan.maps.depth, scan.maps.labels, scan.maps.labels, simulation.capture.intrinsics, new, scan.maps.noise
    )
    np.testing.assert_allclose(maps.to_view, anew.to_view, atol=1e-9)
    np.testing.assert_allclose(maps.normals, anew.normals, atol=1e-6)
    assert patches[0] is scan.patches[0]
    for old, patch, m, n in zip(scan.patches[1:], patches[1:], scan.mirrors, new, strict=True):
        np.testing.assert_allclose(reflect(patch.vertices, n), reflect(old.vertices, m), atol=1e-5)


def test_pieces_show_a_shift_as_a_step(simulated):
    """Patches moved along the pieces' normals: each step grows by as much; in no frame of reference more or less."""
    scan = scanned(simulated("kinect_v1").capture)
    mesh = joined(scan)
    pieces = seam_pieces(mesh, scan.maps)
    assert len(pieces.gap) > 40 and (pieces.views[:, 0] < pieces.views[:, 1]).all()
    assert abs(np.median(pieces.step)) < 0.003 and np.median(np.abs(pieces.step)) < 0.3 * np.median(pieces.gap)
    np.testing.assert_allclose(np.linalg.norm(pieces.along, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(pieces.gap, np.linalg.norm(pieces.high - pieces.low, axis=1), atol=1e-9)
    # one view pushed outwards, to the side: what is between it and the direct one steps outwards there
    push = np.eye(4)
    push[0, 3] = 0.006
    shifted = replace(mesh, vertices=mesh.vertices.copy())
    mine = mesh.view == 1
    shifted.vertices[mine] = transform(mesh.vertices[mine], push)
    to_view = scan.maps.to_view.copy()
    to_view[1] = to_view[1] @ np.linalg.inv(push)
    after = seam_pieces(shifted, replace(scan.maps, to_view=to_view))
    pair = [(p.views == (0, 1)).all(axis=1) for p in (pieces, after)]
    grown = np.median(after.step[pair[1]] / after.along[pair[1], 0]) - np.median(
        pieces.step[pair[0]] / pieces.along[pair[0], 0]
    )
    assert grown == pytest.approx(0.006, abs=0.002)


def test_skin_read_twice_shows_a_moved_mirror(simulated):
    """Blocks of it part by as much as the derivatives say; what one view alone reads is not among them."""
    scan = scanned(simulated("azure_kinect").capture)
    blocks = skin_read_twice(scan.maps)
    assert len(blocks.step) > 30 and blocks.twice.all() and np.median(np.abs(blocks.step)) < 0.002
    assert len(skin_read_twice(scanned(simulated("kinect_v1").capture).maps).step) < 0.3 * len(blocks.step)
    step = np.array((0.003, 0.0, 0.006))
    new = [moved(scan.mirrors[0], step), scan.mirrors[1]]
    motions = [reflection_matrix(n) @ reflection_matrix(m) for n, m in zip(new, scan.mirrors, strict=True)]
    maps = move_views(scan.patches, scan.maps, mirrored_views(scan.maps), motions)[1]
    after = skin_read_twice(maps)
    mine = [(b.views == (0, 1)).all(axis=1) for b in (blocks, after)]
    rows = _moves(blocks, scan.mirrors, np.array((1, 2)), np.array((-1, 0, 3)), 6)[mine[0], :3]
    grown = np.median(after.step[mine[1]]) - np.median(blocks.step[mine[0]])
    assert grown == pytest.approx(np.median(rows @ step), abs=0.0025) and abs(grown) > 0.002


def test_the_step_is_the_least_squares_one():
    """Against scipy on the same cost; without noise the step that made the seams' steps comes back."""
    rng = np.random.default_rng(0)
    count = 120
    mirror = plane_mirror("left", np.array((-0.8, 0.0, 3.4)), np.array((0.5, 0.0, -0.85)))
    low = rng.normal(size=(count, 3)) * (0.25, 0.6, 0.15) + (0.0, 0.0, 2.6)
    along = rng.normal(size=(count, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    pieces = SeamPieces(
        low, low + 0.03 * rng.normal(size=(count, 3)), np.tile((0, 1), (count, 1)), along, np.zeros(count),
        np.full(count, 0.03), rng.uniform(0.2, 0.7, count), np.zeros(count, np.bool_),
    )  # fmt: skip
    rows = _moves(pieces, [mirror], np.array([1]), np.array([-1, 0]), 3)
    true = np.array((0.004, -0.003, 0.01))
    loose = np.diag((1.0 / 0.05**2,) * 3)
    exact = replace(pieces, step=-rows @ true)
    step, _ = _solve(exact, rows, loose, np.zeros(3))
    np.testing.assert_allclose(step, true, atol=2e-4)
    np.testing.assert_allclose(_solve(exact, rows, loose, true)[0], true, atol=2e-4)
    # the rows are what the pieces' steps really do
    near = 1e-6 * np.array((1.0, -2.0, 0.5))
    laid = reflect(pieces.high, mirror)
    change = ((reflect(laid, moved(mirror, near)) - pieces.high) * along).sum(axis=1)
    np.testing.assert_allclose(change, rows @ near, atol=1e-10)

    noise = rng.normal(size=count) * _noise(pieces) + (rng.random(count) < 0.1) * 0.1
    noisy = replace(pieces, step=-rows @ true + noise)
    step, covariance = _solve(noisy, rows, loose, np.zeros(3))

    def cost(x):
        left = (noisy.step + rows @ x[:3] + x[3] + x[4] * pieces.gap * np.sin(pieces.bend)) / _noise(pieces)
        return (
            0.5 * (4.0 * np.log1p((left / 2.0) ** 2)).sum() / 2.0
            + 0.5 * x[:3] @ loose @ x[:3] + 0.5 * (x[3] / 0.002) ** 2 + 0.5 * (x[4] / 0.2) ** 2
        )  # fmt: skip

    best = minimize(cost, np.zeros(5), method="BFGS", options={"gtol": 1e-9}).x[:3]
    assert cost(np.concatenate((step, np.zeros(2)))) < cost(np.zeros(5))
    np.testing.assert_allclose(step, best, atol=0.1 * np.sqrt(np.diag(covariance)).max())
    assert (np.abs(step - true) < 4.0 * np.sqrt(np.diag(covariance))).all()
