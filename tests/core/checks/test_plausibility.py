"""Avatars that cannot be right are refused with their likely cause; people of all sizes and poses are not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.checks.plausibility import VOLUMES, ScanFacts, check_avatar, implausible_lens
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.pipeline import reconstruct


def stretched(mesh, x=1.0, y=1.0, z=1.0):
    return replace(mesh, vertices=mesh.vertices * (x, y, z))


def judge(mesh, any_object=False, **facts):
    check_avatar(mesh, mesh_report(mesh)["volume_m3"], ScanFacts(**facts), any_object)


def with_raised_arms(mesh):
    """Arms of 5 cm as boxes that reach 45 cm over the head; the body's own hang down and are small beside it."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    box = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    top = mesh.vertices[:, 2].max()
    arms = [corners * (0.05, 0.05, 0.8) + (x, 0.0, top - 0.35) for x in (-0.25, 0.2)]
    first = len(mesh.vertices)
    return Mesh(np.concatenate((mesh.vertices, *arms)), np.concatenate((mesh.triangles, box + first, box + first + 8)))


def sounds(person):
    arms_up = with_raised_arms(person)
    yield from (stretched(person, s, s, s) for s in (0.36, 0.6, 1.0, 1.2))  # a baby of 61 cm to somebody of 2.04 m
    yield from (stretched(person, 0.8, 0.8), stretched(person, 1.45, 1.45), stretched(person, 1.3, 2.0))
    yield from (arms_up, stretched(arms_up, 0.8, 0.8))


def test_people_of_all_sizes_pass(person):
    for mesh in sounds(person):
        judge(mesh, highest=2.6)
    thinnest = stretched(with_raised_arms(person), 0.8, 0.8)
    assert mesh_report(thinnest)["volume_m3"] < VOLUMES[0] * np.ptp(thinnest.vertices[:, 2]) ** 3, "arms are discounted"
    trunk = stretched(person, 1.0, 1.0, 0.5)  # as much volume for its height as one that ends at the waist
    judge(trunk, stands=False)
    judge(trunk, cut=("bottom",))


@pytest.mark.parametrize(
    ("x", "y", "z", "words"),
    [
        (0.2, 0.2, 0.2, "0.34 m tall, too small for a person.*--object"),
        (1.5, 1.5, 1.5, "too tall for a person"),
        (0.6, 0.6, 1.0, "only 2. l at a height of 1.70 m, and a person has more than"),
        (1.0, 0.35, 1.0, "only .* l"),
        (2.0, 2.0, 1.0, "and a person has less than"),
        (1.0, 1.0, -1.0, "no inside"),
    ],
)
def test_what_no_person_can_be_is_refused(person, x, y, z, words):
    with pytest.raises(ReconstructionError, match=words) as caught:
        judge(stretched(person, x, y, z))
    assert "\n" not in str(caught.value)
    if "no inside" not in words:
        judge(stretched(person, x, y, z), any_object=True)


def test_a_board_is_no_person(person):
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (1.5, 0.01, 1.2)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    board = Mesh(corners, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]))
    with pytest.raises(ReconstructionError, match="10 mm thick at a height of 1.20 m, as flat as a board"):
        judge(board)
    judge(board, any_object=True)


def test_a_person_who_reaches_to_where_the_search_ends(person):
    with pytest.raises(ReconstructionError, match="1.70 m tall or more"):
        judge(person, highest=1.705)


def test_the_cause_is_told_by_the_evidence(person):
    small, thin = stretched(person, 0.1, 0.1, 0.1), stretched(person, 1.0, 0.3, 1.0)
    edge = Intrinsics(640, 576, 1008.0, 1008.0, 639.5, 575.5)
    rough = SimpleNamespace(name="left", residual=0.02, displacement=lambda points: 0.001)
    good = SimpleNamespace(name="right", residual=0.001, displacement=lambda points: None)
    for mesh, facts, words in (
        (small, {"lenses": [edge]}, r"the intrinsics do not fit the picture: their centre \(640, 576\)"),
        (small, {"distance": 0.25}, r"multiply the depth unit \(--depth-unit\) by 10"),
        (
            stretched(person, 5, 5, 5),
            {"distance": 11.0},
            r"TUM's 5000.*multiply the depth unit \(--depth-unit\) by 0.2",
        ),
        (stretched(person, 0.27, 0.27, 0.27), {"distance": 0.6, "cut": ("top",)}, "only 0.6. m from the camera"),
        (stretched(person, 2, 2, 2), {}, "check the depth unit"),
        (thin, {"cut": ("top",)}, "the picture cuts it off"),
        (thin, {"blind": ["left"], "warnings": ["“left” is dark; clean it"]}, "in “left”.*clean it"),
        (thin, {"blind": ["left"], "warnings": ["points were left out", "left: nobody"]}, r"\(left: nobody\)"),
        (thin, {"blind": ["b: l"], "warnings": ["a: “l” is dark", "b: “l” is wet"]}, r"\(b: “l” is wet\)"),
        (thin, {"mirrors": [good, rough]}, "the plane of the mirror “left” is very uncertain"),
        (thin, {"warnings": ["first of all"]}, "first of all"),
        (thin, {}, "check the depth unit .*, the intrinsics and the mirrors' planes"),
    ):
        with pytest.raises(ReconstructionError, match=words):
            judge(mesh, **facts)


def test_a_mirror_is_judged_where_the_camera_sees_the_person(person):
    to_avatar, seen = np.array([[1, 0, 0, 0], [0, 0, 1, -2.5], [0, -1, 0, 1.2], [0, 0, 0, 1.0]]), []
    mirror = SimpleNamespace(name="left", residual=0.0, displacement=seen.append)
    with pytest.raises(ReconstructionError):
        judge(stretched(person, 1.0, 0.3, 1.0), mirrors=[mirror], to_avatar=to_avatar)
    assert np.ptp(seen[0], axis=0).argmax() == 1 and seen[0][:, 2].mean() == pytest.approx(2.5, abs=0.1)


def test_lenses():
    for width, height, focal in ((640, 576, 504), (512, 512, 252), (320, 288, 252), (640, 480, 525), (256, 192, 212)):
        assert implausible_lens(Intrinsics(width, height, focal, focal, 0.52 * width, 0.47 * height)) is None
    for cx, cy, focal in ((639.5, 288, 504), (320, 20, 504), (320, 288, 50), (320, 288, 8000)):
        assert implausible_lens(Intrinsics(640, 576, focal, focal, cx, cy))


def test_a_capture_in_a_wrong_unit_gives_no_avatar(simulated):
    capture = simulated("azure_kinect").capture
    for factor, words in ((0.2, "only 0.6. m from the camera"), (1.45, "2.4. m tall or more")):
        wrong = replace(capture, depth=(factor * capture.depth).astype(np.float32))
        with pytest.raises(ReconstructionError, match=words):
            reconstruct(wrong)
