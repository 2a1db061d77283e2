"""Mirrors that cross, with narrow views of their frames, in noise: told apart, moved together, doubted when wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.checks.view_disagreement import check_agreement, disagreements
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirror_alignment.view_alignment import AgreementSettings, align_views
from mirror_scan.core.mirrors.mirror import expected_error, moved, person_before, plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.subject_search import find_subject


def clean(capture) -> np.ndarray:
    return one_depth_map(capture)[0]


def misplaced(mirrors, simulation) -> np.ndarray:
    """Median displacement of the reflected body [m]."""
    body = simulation.truth.body.vertices[::7]
    true = [plane_mirror(m.name, m.point, m.normal) for m in simulation.truth.mirrors]
    return np.array([
        np.median(np.linalg.norm(reflect(body, m) - reflect(body, t), axis=1))
        for m, t in zip(mirrors, true, strict=True)
    ])  # fmt: skip


@pytest.fixture(scope="module", params=[(1, 3), (3, 5)], ids=["1 frame", "3 frames"])
def crossing(person, request):
    """Three mirrors before a RealSense D455, two of them through one another; of one frame little is seen."""
    frames, seed = request.param
    rig = default_rig(
        "realsense_d455", mirrors=(115.0, -120.0, -152.0), path_length=4.6, frames=frames, seed=seed,
        interference=False,
    )  # fmt: skip
    simulation = simulate(person, rig)
    depth = clean(simulation.capture)
    intrinsics = simulation.capture.intrinsics
    return (
        simulation,
        depth,
        [place_mirror(RgbdImage(depth, intrinsics), picks) for picks in simulation.capture.mirrors],
    )


def test_frames_that_cross_are_told_apart(crossing):
    simulation, _, placed = crossing
    wrong = misplaced(placed, simulation)
    assert (wrong < 0.03).all(), wrong
    assert all(m.residual < 0.026 for m in placed), "a frame with another's pixels has more"


def test_what_is_seen_twice_ties_mirrors_down(crossing):
    simulation, depth, placed = crossing
    intrinsics = simulation.capture.intrinsics
    together, notes = align_views(RgbdImage(depth, intrinsics), placed)
    assert notes == ()
    before, after = misplaced(placed, simulation), misplaced(together, simulation)
    assert (after < 0.009).all() and np.linalg.norm(after) < np.linalg.norm(before) + 5e-4, (before, after)
    body = simulation.truth.body.vertices
    for mirror, first, off in zip(together, placed, after, strict=True):
        assert mirror.moved_by == (("views",) if mirror is not first else ())
        assert mirror.displacement(body) <= first.displacement(body) + 1e-9 and off < 3.5 * mirror.displacement(body)
        np.testing.assert_allclose(mirror.basis.T @ mirror.basis, np.eye(3), atol=1e-12)
    assert align_views(RgbdImage(depth, intrinsics), placed, AgreementSettings(use=False)) == (placed, ())
    assert align_views(RgbdImage(depth, intrinsics), placed, AgreementSettings(uncertainty=1.0)) == (placed, ())


def test_nothing_is_asked_of_views_that_show_nothing(crossing):
    simulation, depth, placed = crossing
    intrinsics = simulation.capture.intrinsics
    for ugly in (np.zeros_like(depth), np.full_like(depth, 1.0)):
        assert align_views(RgbdImage(ugly, intrinsics), placed) == (placed, ())
    # one wall right across the image fits no mirror: none is moved by more than its frame leaves open
    for m, frame in zip(align_views(RgbdImage(np.full_like(depth, 5.0), intrinsics), placed)[0], placed, strict=True):
        person = person_before(frame)
        shift = np.linalg.norm(reflect(person, m) - reflect(person, frame), axis=1)
        assert np.median(shift) < 4.0 * expected_error(frame)
    given = [replace(m, covariance=None, source="given") for m in placed]
    assert align_views(RgbdImage(depth, intrinsics), given) == (given, ()) and expected_error(given[0]) == 0.0


def test_two_unsure_mirrors_do_not_agree_with_each_other(simulated):
    """Without a witness, the direct view or a mirror that is sure, what both show moves neither."""
    simulation = simulated("azure_kinect")
    intrinsics, depth = simulation.capture.intrinsics, clean(simulation.capture)
    placed = [place_mirror(RgbdImage(depth, intrinsics), picks) for picks in simulation.capture.mirrors]
    loose = np.diag((0.008, 0.002, 0.004)) ** 2
    turned = [
        replace(moved(m, np.array((turn, 0.0, 0.0))), covariance=loose)
        for m, turn in zip(placed, (0.008, -0.006), strict=True)
    ]
    unseen = np.where(simulation.truth.labels == 0, np.float32(0.0), depth)
    image = RgbdImage(unseen, intrinsics)
    assert align_views(image, turned)[0] == turned
    # one that is sure is a witness
    sure = [placed[0], turned[1]]
    together = align_views(image, sure)[0]
    assert misplaced(together, simulation)[1] <= misplaced(sure, simulation)[1]
    assert together[0] is placed[0] or together[0].moved < 0.002


@pytest.mark.parametrize("sensor", ["ideal", "azure_kinect", "realsense_d455", "kinect_v1"])
def test_a_turned_mirror_is_found_out(simulated, sensor):
    simulation = simulated(sensor)
    intrinsics = simulation.capture.intrinsics
    depth = clean(simulation.capture)
    placed = [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors]
    good = find_subject(RgbdImage(depth, intrinsics), placed)
    assert disagreements(RgbdImage(depth, intrinsics), good, placed) == []
    assert check_agreement(RgbdImage(depth, intrinsics), good, placed)[1] == []
    for k in (0, 1):
        for degrees in (2.0, -3.0, 6.0):
            wrong = list(placed)
            wrong[k] = moved(placed[k], np.array((np.radians(degrees), 0.0, 0.0)))
            views = find_subject(RgbdImage(depth, intrinsics), wrong)
            left, told = check_agreement(RgbdImage(depth, intrinsics), views, wrong)
            name = placed[k].name
            seen = (views.labels == k + 1).any()  # what is too far off is not even taken for the subject
            assert not seen or any(f"“{name}”" in text and "pick points" in text for text in told), (degrees, told)
            # the other is only named where nothing says which of the two it is
            assert all(
                f"“{name}”" in text and (text.find(f"“{name}”") < 20 or "one of the two" in text) for text in told
            )
            if any("is left out" in text for text in told):
                assert not (left.labels == k + 1).any() and (left.labels == 2 - k).any()


def test_a_mirror_left_out_doubles_nothing(simulated):
    """The body is closed without it, and the report says why."""
    capture = simulated("azure_kinect").capture
    depth = clean(capture)
    right, left = (place_mirror(RgbdImage(depth, capture.intrinsics), m) for m in capture.mirrors)
    wrong = replace(moved(right, np.array((np.radians(2.5), 0.0, 0.0))), covariance=None, source="given")
    made = reconstruct(capture, (wrong, left))
    assert any("“right” is left out" in text for text in made.warnings)
    assert made.report["views"][1]["pixels"] == 0 and made.report["mesh"]["watertight"]
