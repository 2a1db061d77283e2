"""Seams that show an offset: frames that project, frames hardly seen; and mirrors that are where they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.mirror_alignment.glass_alignment import ThicknessSettings
from mirror_scan.core.mirror_alignment.reflection_alignment import JointSettings
from mirror_scan.core.mirror_alignment.seam_alignment import (
    SeamSettings,
    _fit_offsets,
    _jacobian,
    _noise,
    _note,
    align_seams,
    mirrored_views,
    move_views,
)
from mirror_scan.core.mirror_alignment.seam_offsets import SeamPieces, seam_pieces, surface_seen_twice
from mirror_scan.core.mirrors.mirror import (
    expected_error,
    moved,
    person_before,
    plane_mirror,
    reflect,
    reflection_matrix,
    reflection_shift,
)
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.pipeline.scan import Clock, scan_steps
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.views.view_maps import view_maps
from mirror_scan.core.zippering.zipper import zip_patches
from scipy.optimize import minimize

SEAMS_ONLY = Settings(thickness=ThicknessSettings(use=False))
"""What is seen twice would show the same before."""


def finished(steps):
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


def scanned(capture, mirrors=()):
    return finished(scan_steps(capture, tuple(mirrors), SEAMS_ONLY, Clock(), (0.0, 1.0)))


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
def test_a_projecting_frame_shows_in_the_seams(person, sensor):
    simulation = simulate(person, default_rig(sensor, frames=8, frame_depth=0.012, seed=1))
    picks, frames = simulation.capture.mirrors, replace(SEAMS_ONLY, alignment=JointSettings(use=False))
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


@pytest.mark.parametrize("sensor", ["kinect_v1", "ideal"])
def test_a_flush_frame_beside_a_projecting_one_stays(person, sensor):
    """It is not dragged along, and then the other comes nearer than if both had to be solved for."""
    rig = default_rig(sensor, frames=8, seed=3)
    rig = replace(rig, mirrors=(replace(rig.mirrors[0], frame_depth=0.016), rig.mirrors[1]))
    simulation = simulate(person, rig)
    scan = scanned(simulation.capture, simulation.capture.mirrors)
    after, notes = aligned(scan, scan.mirrors)
    wrong, right = misplaced(scan.mirrors, simulation), misplaced(after, simulation)
    assert wrong[0] > 0.03 and wrong[1] < 0.003
    assert after[1] is scan.mirrors[1] and len(notes) == 1 and notes[0].startswith(scan.mirrors[0].name)
    assert right[0] < 0.25 * wrong[0] and right[0] < 2.0 * expected_error(after[0]), (wrong, right)


def test_notes_tell_the_depth_of_the_glass_from_the_front_of_the_frame():
    """With what was taken for it already, on either side, wherever on its plane the mirror has its point."""
    old = plane_mirror("left", np.array((-0.8, 0.0, 3.4)), np.array((0.5, 0.0, -0.85)))
    old = replace(old, source="picked", rectangle=np.array(((-0.1, 0.7), (-0.9, 0.9))))

    def note(step, taken=0.0, doubted=False, old=old):
        new = moved(old, np.array(step))
        return _note(old, new, reflection_shift(person_before(old), new, old), doubted, taken)

    assert "moved by 30 mm at the person, as if its glass were 15 mm behind the front" in note((0.0, 0.0, -0.015))
    assert "were 15 mm in front of its frame" in note((0.0, 0.0, 0.015))
    assert "were 25 mm behind the front of its frame" in note((0.0, 0.0, -0.015), 0.01)
    assert "were 5 mm behind the front of its frame" in note((0.0, 0.0, 0.015), 0.02)
    assert "were 0 mm " in note((0.0, 0.0, 0.0152), 0.015)
    turned = note((0.004, 0.0, -0.015))  # its middle is 0.3 m aside
    assert f"were {1000 * (0.015 - 0.3 * 0.004):.0f} mm behind" in turned
    assert note((0.01, 0.0, -0.001)).endswith("at the person"), "turned above all"
    assert "leaves uncertain" in (text := note((0.0, 0.0, -0.015), doubted=True)) and "as if" not in text
    assert "as if" not in note((0.0, 0.0, -0.015), old=replace(old, moved_by=("reflections",)))


def test_no_glass_lies_clearly_in_front_of_its_frame(simulated):
    """Unless it was taken to lie too far behind."""
    simulation = simulated("ideal")
    placed = scanned(simulation.capture).mirrors
    off = [replace(moved(m, np.array((0.0, 0.0, -0.01))), source="rig file") for m in placed]
    scan = scanned(simulation.capture, off)
    off = [replace(m, source="picked", moved_by=()) for m in off]

    def after(taken):
        return align_seams(
            off, scan.patches, scan.maps, joined(scan), lambda p, m: joined(scan, p, m), None, taken
        )  # fmt: skip

    assert after(0.0) == (off, ())
    mirrors, notes = after(0.012)
    assert notes and (misplaced(mirrors, simulation) < 0.6 * misplaced(off, simulation)).all(), notes


@pytest.mark.parametrize("make", [
    lambda c: np.zeros((3, 3)),
    lambda c: -c,
    lambda c: c - np.diag((0.0, 0.0, 2.0 * c[2, 2])),
    lambda c: 1e-30 * c,
    lambda c: 1e30 * np.eye(3),
    lambda c: np.diag((0.0, 1e12, 0.0)),
    lambda c: np.ones((3, 3)),
    lambda c: np.full((3, 3), np.nan),
    lambda c: np.diag((np.inf, 1e-6, 1e-6)),
    lambda c: None,
], ids=["zero", "negative", "indefinite", "tiny", "huge", "flat", "singular", "nan", "inf", "none"])  # fmt: skip
def test_any_covariance_will_do(simulated, make):
    scan = scanned(simulated("kinect_v1").capture)
    odd = [replace(scan.mirrors[0], covariance=make(scan.mirrors[0].covariance)), scan.mirrors[1]]
    with np.errstate(all="raise", under="ignore"):
        after, _ = aligned(scan, odd)
    assert after[1] is scan.mirrors[1]
    shift = np.linalg.norm(after[0].point - odd[0].point)
    assert shift < 0.03 and (after[0] is odd[0] or np.linalg.eigvalsh(after[0].covariance).min() > 0.0)


def test_views_that_see_nothing_and_hardly_any_pieces(simulated):
    scan = scanned(simulated("kinect_v1").capture)
    off = [replace(moved(m, np.array((0, 0, 0.012))), source="picked") for m in scan.mirrors]
    labels = np.where(scan.maps.labels == 2, -1, scan.maps.labels)
    empty = replace(
        scan.patches[2], **{f: getattr(scan.patches[2], f)[:0] for f in ("vertices", "triangles", "colors", "view",
                                                                       "kind")})  # fmt: skip
    blind = replace(scan, patches=[*scan.patches[:2], empty], maps=replace(scan.maps, labels=labels))
    after, notes = aligned(blind, off)
    assert after[1] is off[1] and not any(note.startswith(off[1].name) for note in notes)
    nobody = replace(scan.maps, labels=np.full_like(labels, -1))
    assert align_seams(off, scan.patches, nobody, joined(scan), None) == (off, ())
    assert len(surface_seen_twice(nobody).offset) == 0
    # the least that can be halved, and fewer
    mesh = joined(scan)
    for keep in (0, 6, 40, 90):
        few = replace(mesh, kind=np.where(np.cumsum(mesh.kind == 1) <= keep, mesh.kind, 0).astype(np.int8))
        any_number = SeamSettings(min_pieces=0)
        after, _ = align_seams(off, scan.patches, scan.maps, few, lambda p, m, few=few: few, any_number)
        assert len(after) == 2


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


def test_what_is_certain_or_far_off_stays(simulated):
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
        RgbdImage(scan.maps.depth, simulation.capture.intrinsics),
        scan.maps.labels,
        scan.maps.labels,
        new,
        scan.maps.noise,
    )
    np.testing.assert_allclose(maps.to_view, anew.to_view, atol=1e-9)
    np.testing.assert_allclose(maps.normals, anew.normals, atol=1e-6)
    assert patches[0] is scan.patches[0]
    for old, patch, m, n in zip(scan.patches[1:], patches[1:], scan.mirrors, new, strict=True):
        np.testing.assert_allclose(reflect(patch.vertices, n), reflect(old.vertices, m), atol=1e-5)


def test_pieces_show_a_shift_as_an_offset(simulated):
    """Patches moved along the pieces' normals: each offset grows by as much; in no frame of reference more or less."""
    scan = scanned(simulated("kinect_v1").capture)
    mesh = joined(scan)
    pieces = seam_pieces(mesh, scan.maps)
    assert len(pieces.gap) > 40 and (pieces.views[:, 0] < pieces.views[:, 1]).all()
    assert abs(np.median(pieces.offset)) < 0.003 and np.median(np.abs(pieces.offset)) < 0.3 * np.median(pieces.gap)
    np.testing.assert_allclose(np.linalg.norm(pieces.along, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(pieces.gap, np.linalg.norm(pieces.high - pieces.low, axis=1), atol=1e-9)
    # one view pushed outwards, to the side: what is between it and the direct one is offset outwards there
    push = np.eye(4)
    push[0, 3] = 0.006
    shifted = replace(mesh, vertices=mesh.vertices.copy())
    mine = mesh.view == 1
    shifted.vertices[mine] = transform(mesh.vertices[mine], push)
    to_view = scan.maps.to_view.copy()
    to_view[1] = to_view[1] @ np.linalg.inv(push)
    after = seam_pieces(shifted, replace(scan.maps, to_view=to_view))
    pair = [(p.views == (0, 1)).all(axis=1) for p in (pieces, after)]
    grown = np.median(after.offset[pair[1]] / after.along[pair[1], 0]) - np.median(
        pieces.offset[pair[0]] / pieces.along[pair[0], 0]
    )
    assert grown == pytest.approx(0.006, abs=0.002)


def test_surface_seen_twice_shows_a_moved_mirror(simulated):
    """Blocks of it part by as much as the derivatives say; what one view alone reads is not among them."""
    scan = scanned(simulated("azure_kinect").capture)
    blocks = surface_seen_twice(scan.maps)
    assert len(blocks.offset) > 30 and blocks.twice.all() and np.median(np.abs(blocks.offset)) < 0.002
    assert len(surface_seen_twice(scanned(simulated("kinect_v1").capture).maps).offset) < 0.3 * len(blocks.offset)
    step = np.array((0.003, 0.0, 0.006))
    new = [moved(scan.mirrors[0], step), scan.mirrors[1]]
    motions = [reflection_matrix(n) @ reflection_matrix(m) for n, m in zip(new, scan.mirrors, strict=True)]
    maps = move_views(scan.patches, scan.maps, mirrored_views(scan.maps), motions)[1]
    after = surface_seen_twice(maps)
    mine = [(b.views == (0, 1)).all(axis=1) for b in (blocks, after)]
    rows = _jacobian(blocks, scan.mirrors, np.array((1, 2)), np.array((-1, 0, 3)), 6)[mine[0], :3]
    grown = np.median(after.offset[mine[1]]) - np.median(blocks.offset[mine[0]])
    assert grown == pytest.approx(np.median(rows @ step), abs=0.0025) and abs(grown) > 0.002


def test_the_correction_is_the_least_squares_one():
    """Against scipy on the same cost; without noise the correction that made the seams' offsets comes back."""
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
    rows = _jacobian(pieces, [mirror], np.array([1]), np.array([-1, 0]), 3)
    true = np.array((0.004, -0.003, 0.01))
    loose = np.diag((1.0 / 0.05**2,) * 3)
    exact = replace(pieces, offset=-rows @ true)
    step = _fit_offsets(exact, rows, loose, np.zeros(3)).correction
    np.testing.assert_allclose(step, true, atol=2e-4)
    np.testing.assert_allclose(_fit_offsets(exact, rows, loose, true).correction, true, atol=2e-4)
    # the rows are what the pieces' offsets really do
    near = 1e-6 * np.array((1.0, -2.0, 0.5))
    laid = reflect(pieces.high, mirror)
    change = ((reflect(laid, moved(mirror, near)) - pieces.high) * along).sum(axis=1)
    np.testing.assert_allclose(change, rows @ near, atol=1e-10)

    noise = rng.normal(size=count) * _noise(pieces) + (rng.random(count) < 0.1) * 0.1
    noisy = replace(pieces, offset=-rows @ true + noise)
    fit = _fit_offsets(noisy, rows, loose, np.zeros(3))
    step, covariance = fit.correction, fit.covariance

    def cost(x):
        left = (noisy.offset + rows @ x[:3] + x[3] + x[4] * pieces.gap * np.sin(pieces.bend)) / _noise(pieces)
        return (
            0.5 * (4.0 * np.log1p((left / 2.0) ** 2)).sum() / 2.0
            + 0.5 * x[:3] @ loose @ x[:3] + 0.5 * (x[3] / 0.002) ** 2 + 0.5 * (x[4] / 0.2) ** 2
        )  # fmt: skip

    best = minimize(cost, np.zeros(5), method="BFGS", options={"gtol": 1e-9}).x[:3]
    assert cost(np.concatenate((step, np.zeros(2)))) < cost(np.zeros(5))
    np.testing.assert_allclose(step, best, atol=0.1 * np.sqrt(np.diag(covariance)).max())
    assert (np.abs(step - true) < 4.0 * np.sqrt(np.diag(covariance))).all()
