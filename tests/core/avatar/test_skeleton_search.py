"""Joints of standing people against the true ones, and what gets no skeleton."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
from mirror_scan.core.avatar.skeleton import BONES, OTHER_SIDE
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.submesh import keep_triangles
from mirror_scan.core.simulation.mannequin import Figure, random_figure, rigged_mannequin
from mirror_scan.core.simulation.props import box, chair

RIGGED = Path(__file__).resolve().parents[4] / "shared" / "data" / "rigged"
LIMBS = [BONES.index(s + n) for s in ("Left", "Right") for n in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")]
FIGURES = {
    "arms out, slim": (1.78, Figure(arm_angle_deg=20, girth=0.88)),
    "arms down, heavy": (1.64, Figure(arm_angle_deg=70, girth=1.2, leg_spread_deg=8)),
    "child": (1.15, Figure(arm_angle_deg=50, shoulder_width=0.92)),
    "arms ahead, a step": (1.85, Figure(arm_forward_deg=35, step_deg=10, bust=0.6)),
}


def errors(found, truth):
    """Millimetres (22,)."""
    return 1000 * np.linalg.norm(found.joints - truth, axis=1)


@pytest.fixture(scope="module")
def standing():
    mesh, skeleton = rigged_mannequin(1.70, Figure(), resolution=0.012)
    return mesh, skeleton


@pytest.mark.parametrize("name", FIGURES)
def test_a_mannequins_joints_are_found(name):
    height, figure = FIGURES[name]
    mesh, truth = rigged_mannequin(height, figure, resolution=0.012)
    found = find_skeleton(mesh)
    off = errors(found, truth.joints)
    assert off[LIMBS].mean() < 15
    assert off.max() < 50
    assert (found.joints[[BONES.index(b) for b in ("LeftHand", "LeftFoot")], 0] > 0).all()
    assert (found.joints[[BONES.index(b) for b in ("RightHand", "RightFoot")], 0] < 0).all()


@pytest.mark.skipif(not RIGGED.exists(), reason="no ../shared/data/rigged beside the checkout")
@pytest.mark.parametrize("name", ("s006", "s011", "s037"))
def test_a_given_bodys_joints_are_found(name):
    """Clothed and tall; a boy; heavy. The template has seen none of them."""
    listed = json.loads((RIGGED / name / "joints.json").read_text())
    off = errors(find_skeleton(read_mesh(RIGGED / name / "body.ply")), np.array([listed[bone] for bone in BONES]))
    assert off[LIMBS].mean() < 10
    assert np.percentile(off[LIMBS], 95) < 25
    assert off.max() < 40


def test_the_place_and_the_order_of_vertices_do_not_matter(standing):
    mesh, _ = standing
    before = find_skeleton(mesh)
    order = np.random.default_rng(3).permutation(len(mesh.vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    shift = np.array([0.4, -0.3, 0.0])
    other = Mesh(mesh.vertices[order] + shift, place[mesh.triangles].astype(np.int32))
    np.testing.assert_allclose(find_skeleton(other).joints - shift, before.joints, atol=2e-3)


def test_a_lost_hand_is_guessed_and_said_to_be(standing):
    """As where a camera reads too far on thin parts: the wrist stays, with less confidence than the other one."""
    mesh, truth = standing
    wrist = truth.joints[BONES.index("LeftHand")]
    forearm = wrist - truth.joints[BONES.index("LeftForeArm")]
    kept = (mesh.vertices[mesh.triangles].mean(axis=1) - wrist) @ forearm < 0
    cut = keep_triangles(mesh, kept | (mesh.vertices[mesh.triangles].mean(axis=1)[:, 0] < 0.3))
    found = find_skeleton(cut)
    assert errors(found, truth.joints)[BONES.index("LeftHand")] < 50
    assert found.confidence[BONES.index("LeftHand")] < found.confidence[BONES.index("RightHand")]


@pytest.mark.parametrize(("side", "angle"), [("Left", 45.0), ("Right", 74.0)])
def test_a_lost_forearm_is_taken_from_the_other_arm(side, angle):
    """As where a camera loses a thin arm: it must not be found in the trunk, and nobody is to trust it."""
    mesh, truth = rigged_mannequin(1.70, Figure(arm_angle_deg=angle), resolution=0.012)
    elbow, hand = BONES.index(f"{side}ForeArm"), BONES.index(f"{side}Hand")
    at = mesh.vertices[mesh.triangles].mean(axis=1)
    beyond = (at - truth.joints[elbow]) @ (truth.joints[hand] - truth.joints[elbow]) > 0
    outside = at[:, 0] * np.sign(truth.joints[elbow, 0]) > abs(truth.joints[elbow, 0]) - 0.06
    cut = keep_triangles(mesh, ~(beyond & outside & (at[:, 2] > 0.5)))
    found = find_skeleton(cut)
    assert errors(found, truth.joints)[hand] < 60
    assert found.confidence[hand] < 0.3 < found.confidence[OTHER_SIDE[hand]]


@pytest.mark.parametrize("sides", [("Left",), ("Left", "Right")])
def test_feet_that_were_not_read_are_guessed_on_the_floor(standing, sides):
    """As where a camera loses what lies near the floor: who stands there is whole, but nobody is to trust the toes."""
    mesh, truth = standing
    at = mesh.vertices[mesh.triangles].mean(axis=1)
    signs = [1.0 if side == "Left" else -1.0 for side in sides]
    cut = keep_triangles(mesh, (at[:, 2] > 0.07) | ~np.isin(np.sign(at[:, 0]), signs))
    found = find_skeleton(cut)
    feet = [BONES.index(side + part) for side in sides for part in ("Foot", "ToeBase")]
    assert errors(found, truth.joints)[feet].max() < 50
    assert errors(found, truth.joints)[LIMBS].mean() < 15
    toes = [BONES.index(f"{side}ToeBase") for side in sides]
    assert found.confidence[toes].max() < 0.7 * found.confidence[BONES.index("LeftLeg")]


@pytest.mark.parametrize(
    ("part", "word"),
    [("legs", "foot"), ("knees up", "whole"), ("head", "head"), ("left arm", "left"), ("chest", "whole")],
)
def test_who_is_not_whole_gets_no_skeleton(standing, part, word):
    mesh, truth = standing
    at = mesh.vertices[mesh.triangles].mean(axis=1)
    shoulder = truth.joints[BONES.index("LeftArm")]
    keep = {
        "legs": at[:, 2] > 0.10 * 1.7,
        "knees up": at[:, 2] > 0.3 * 1.7,
        "head": at[:, 2] < 0.88 * 1.7,
        "left arm": ~((at[:, 0] > shoulder[0] + 0.02) & (at[:, 2] > 0.8)),
        "chest": at[:, 2] > 0.6 * 1.7,
    }[part]
    cut = keep_triangles(mesh, keep)
    cut = replace(cut, vertices=cut.vertices - (0, 0, cut.vertices[np.unique(cut.triangles), 2].min()))
    with pytest.raises(ReconstructionError, match=word):
        find_skeleton(cut)


def test_things_and_people_who_lie_get_no_skeleton(standing):
    mesh, _ = standing
    lying = Mesh(mesh.vertices[:, [0, 2, 1]] * (1, 1, -1), mesh.triangles)
    for other in (chair(), box((-0.25, -0.2, 0.0), (0.25, 0.2, 1.7)), lying):
        with pytest.raises(ReconstructionError, match="upright"):
            find_skeleton(other)
    with pytest.raises(ReconstructionError, match="metres"):
        find_skeleton(replace(mesh, vertices=mesh.vertices * 1000))


def test_confidence_is_lower_where_errors_are_larger():
    """Over mannequins that the template has not seen: the surer half errs less."""
    off, sure = [], []
    for seed in range(900, 904):
        mesh, truth = rigged_mannequin(1.6, random_figure(np.random.default_rng(seed)), resolution=0.014)
        found = find_skeleton(mesh)
        off.append(errors(found, truth.joints))
        sure.append(found.confidence)
    off, sure = np.concatenate(off), np.concatenate(sure)
    assert ((sure >= 0) & (sure <= 1)).all()
    half = np.median(sure)
    assert off[sure >= half].mean() < off[sure < half].mean()


def test_what_was_filled_counts_less_than_what_was_measured(standing):
    """A shin that fills have swollen on one side: knee and ankle are nearer to the truth where fills are known."""
    mesh, truth = standing
    knee, foot = BONES.index("LeftLeg"), BONES.index("LeftFoot")
    low, high = truth.joints[foot, 2] + 0.02, truth.joints[knee, 2] + 0.05
    x, _, z = mesh.vertices.T
    swollen = (z > low) & (z < high) & (x > np.interp(z, (low, high), truth.joints[[foot, knee], 0]))
    bulged = mesh.vertices + np.where(swollen[:, None], (0.03, 0.0, 0.0), 0.0)
    kind = np.where(swollen[mesh.triangles].any(axis=1), FILL, SURFACE).astype(np.int8)
    off = [
        errors(find_skeleton(replace(mesh, vertices=bulged, kind=known)), truth.joints)[[knee, foot]].mean()
        for known in (kind, None)
    ]
    assert off[0] < 0.9 * off[1]


def test_what_a_noisy_view_showed_counts_less(standing):
    """A back that a mirror showed bent and shifted: joints are nearer to the truth where the views are known."""
    mesh, truth = standing
    rng = np.random.default_rng(3)
    behind = mesh.vertices[:, 1] > np.median(mesh.vertices[:, 1])
    bumps = 0.012 * np.sin(mesh.vertices @ rng.normal(0, 90.0, (3, 6)) + rng.uniform(0, 6, 6)).sum(axis=1)
    moved = np.where(behind, bumps + 0.015, 0.0)[:, None] * (0.0, 1.0, 0.0)
    noisy = replace(mesh, vertices=mesh.vertices + moved, kind=np.zeros(len(mesh.triangles), np.int8))
    off = [
        errors(find_skeleton(replace(noisy, view=view)), truth.joints)[LIMBS].mean()
        for view in (behind.astype(np.int8), None)
    ]
    assert off[0] < 0.9 * off[1]
