"""Skin weights: sums, symmetry, limbs that hold their own skin only, fills that bend, and bodies whose rig is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mirror_scan.core.avatar.pose import Pose, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, OTHER_SIDE, Skeleton
from mirror_scan.core.avatar.skin_weights import (
    LIMBS,
    _softmax,
    limbs_apart,
    skin_weights,
    skinned_mesh,
    squatting,
    strongest,
    unique_edges,
)
from mirror_scan.core.avatar.weight_fields import bone_coordinates, bone_likelihoods, known_fields
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.soundness import connectivity
from standing_body import standing_body

RIGGED = Path(__file__).resolve().parents[4] / "shared" / "data" / "rigged"
POSES = {"tpose": (1.0, 5.0), "armsup": (2.0, 7.0), "knee60": (0.5, 1.0), "squat": (1.2, 6.5)}
"""Mean and 95 % of how far a vertex may be from where true weights move it [mm]."""


def dense(weights) -> np.ndarray:
    out = np.zeros((len(weights.index), len(BONES)))
    np.add.at(out, (np.arange(len(out))[:, None], weights.index), weights.weight)
    return out


@pytest.fixture(scope="module")
def hanging():
    """Arms beside the trunk, thighs a finger apart."""
    mesh, skeleton = standing_body(arm_angle=76.0, leg_spread=8.0)
    return mesh, skeleton, skin_weights(mesh, skeleton)


@pytest.fixture(scope="module")
def spread():
    mesh, skeleton = standing_body()
    return mesh, skeleton, skin_weights(mesh, skeleton)


def test_at_most_four_bones_and_rows_sum_to_one(hanging):
    _, _, weights = hanging
    assert weights.index.dtype == np.uint8 and weights.weight.dtype == np.float32
    np.testing.assert_allclose(weights.weight.sum(axis=1), 1.0, atol=1e-6)
    assert (weights.weight >= 0).all() and (np.diff(weights.weight, axis=1) <= 0).all()
    assert (weights.index[weights.weight == 0] == 0).all()
    shares = dense(weights)
    np.testing.assert_allclose(np.take_along_axis(shares, weights.index, 1)[weights.weight > 0],
                               weights.weight[weights.weight > 0], atol=1e-6)  # fmt: skip  # no bone twice


def test_left_and_right_are_alike():
    mesh, skeleton = standing_body(resolution=0.02)
    other = Skeleton(
        skeleton.joints[list(OTHER_SIDE)] * (-1, 1, 1), skeleton.ends[[0, 2, 1, 4, 3]] * (-1, 1, 1), skeleton.confidence
    )
    mirrored = replace(mesh, vertices=mesh.vertices * (-1, 1, 1), triangles=mesh.triangles[:, ::-1].copy())
    one, two = dense(skin_weights(mesh, skeleton)), dense(skin_weights(mirrored, other))
    np.testing.assert_allclose(two[:, list(OTHER_SIDE)], one, atol=1e-4)


def test_a_limb_holds_no_other_limbs_skin(hanging):
    """Hands hang beside thighs, thighs beside each other: near, but far along the skin."""
    mesh, skeleton, weights = hanging
    by_limb = dense(weights) @ np.eye(5)[LIMBS]
    low = mesh.vertices[:, 2] < skeleton.joints[BONES.index("LeftUpLeg"), 2] - 0.12
    hand = by_limb[:, 1] + by_limb[:, 2] > 0.5
    assert (hand & low).sum() > 50 and (~hand & low).sum() > 500
    assert by_limb[hand & low][:, [0, 3, 4]].max() < 0.01
    assert by_limb[~hand & low][:, [1, 2]].max() < 0.01
    thigh = low & ~hand & (mesh.vertices[:, 2] < 0.7)  # where they have parted
    other = np.where(mesh.vertices[:, 0] > 0, by_limb[:, 4], by_limb[:, 3])
    assert np.quantile(other[thigh], 0.99) < 0.02 and other[thigh].max() < 0.15  # seen where they begin to part


@pytest.mark.parametrize("bone", ["LeftForeArm", "RightForeArm", "LeftLeg", "RightLeg", "LeftArm", "RightUpLeg"])
def test_the_middle_of_a_bone_is_its_own(spread, bone):
    mesh, skeleton, weights = spread
    number = BONES.index(bone)
    middle = 0.5 * (skeleton.joints + skeleton.tails())[number]
    along = skeleton.tails()[number] - skeleton.joints[number]
    along /= np.linalg.norm(along)
    offset = mesh.vertices - middle
    at = offset @ along
    around = np.linalg.norm(offset - at[:, None] * along, axis=1)
    ring = (np.abs(at) < 0.01) & (around < 0.11) & (np.sign(mesh.vertices[:, 0]) == np.sign(middle[0]))
    own = dense(weights)[:, number]
    held = ring & (dense(weights)[:, LIMBS == LIMBS[number]].sum(axis=1) > 0.5)
    assert held.sum() > 10 and own[held].min() > 0.8


def test_limbs_apart_stretch_no_edge_too_far(hanging):
    mesh, skeleton, weights = hanging
    raised = skinned(mesh.vertices, weights, bone_matrices(skeleton, limbs_apart(skeleton)))
    edges = unique_edges(mesh)
    before, after = (np.linalg.norm(v[edges[:, 0]] - v[edges[:, 1]], axis=1) for v in (mesh.vertices, raised))
    assert (after / np.maximum(before, 1e-3)).max() < 4.0
    hand = BONES.index("LeftHand")
    assert raised[dense(weights)[:, hand] == 1.0, 2].max() > 2.0  # they are up


def test_a_larger_body_keeps_its_weights(spread):
    mesh, skeleton, weights = spread
    tall = np.diag((1.2, 1.2, 1.2, 1.0))
    before = dense(weights)
    after = dense(skin_weights(mesh.transformed(tall), skeleton.transformed(tall)))
    assert np.abs(before - after).mean() < 2e-4


def test_fills_become_finer_and_the_mesh_stays_closed():
    mesh, skeleton = standing_body()
    near = np.linalg.norm(mesh.vertices - skeleton.joints[BONES.index("LeftArm")], axis=1) < 0.12
    kind = np.where(near[mesh.triangles].all(axis=1), FILL, SURFACE).astype(np.int8)
    scan = replace(mesh, view=np.where(near, -1, 0).astype(np.int8), kind=kind)
    coarse = coarser(scan, kind == FILL)
    finer, weights = skinned_mesh(coarse, skeleton)
    assert connectivity(finer)["watertight"] and connectivity(finer)["manifold"]
    assert (finer.kind == FILL).sum() > (coarse.kind == FILL).sum()
    count = len(coarse.vertices)
    np.testing.assert_array_equal(finer.vertices[:count], coarse.vertices)
    np.testing.assert_array_equal(finer.colors[:count], coarse.colors)
    assert (finer.view[count:] == -1).all() and len(weights.index) == len(finer.vertices)
    measured = {tuple(t) for t in np.sort(coarse.triangles[coarse.kind == SURFACE], axis=1).tolist()}
    assert measured == {tuple(t) for t in np.sort(finer.triangles[finer.kind == SURFACE], axis=1).tolist()}


def coarser(mesh: Mesh, chosen: np.ndarray) -> Mesh:
    """The mesh with one vertex in the middle of each ring of chosen triangles around an inner vertex pulled away."""
    degree = np.bincount(mesh.triangles.ravel(), minlength=len(mesh.vertices))
    inner = np.flatnonzero(np.bincount(mesh.triangles[chosen].ravel(), minlength=len(degree)) == degree)
    target = mesh.vertices[inner].mean(axis=0)
    farthest = inner[np.linalg.norm(mesh.vertices[inner] - target, axis=1).argsort()[: len(inner) // 3]]
    vertices = mesh.vertices.copy()
    vertices[farthest] += 1.5 * (vertices[farthest] - target)
    return replace(mesh, vertices=vertices)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_strongest_keep_sums_and_small_shares_of_limbs(seed, bones):
    rng = np.random.default_rng(seed)
    weights = np.zeros((20, len(BONES)))
    for row in weights:
        row[rng.choice(len(BONES), bones, replace=False)] = rng.dirichlet(np.full(bones, 0.4))
    kept = strongest(weights)
    np.testing.assert_allclose(kept.weight.sum(axis=1), 1.0, atol=1e-6)
    shares = dense(kept)
    assert ((shares > 0).sum(axis=1) <= 4).all()
    limbs = np.where(LIMBS > 0, weights, 0.0)
    least = np.sort(limbs, axis=1)[:, -2:]
    few = least[:, 0] >= 0.005
    held = np.take_along_axis(shares, np.argsort(limbs, axis=1)[:, -2:], axis=1)
    assert (held[few] >= least[few] - 1e-6).all()


def test_tables_are_read_as_they_say():
    """At a node a table's value is the node's; beyond its border it stays."""
    _, skeleton = standing_body()
    fields = known_fields()
    rng = np.random.default_rng(3)
    points = rng.normal(0, 0.4, (400, 3)) + (0, 0, 1)
    coordinates = bone_coordinates(points, skeleton)
    found = bone_likelihoods(points, skeleton, fields)
    steps = np.array(fields.values.shape[1:]) - 1
    for table, bone in ((0, "Hips"), (6, "LeftShoulder")):
        number = BONES.index(bone)
        at = (coordinates[:, number] - fields.low[table]) / (fields.high[table] - fields.low[table])
        at = np.clip(at, 0, 1) * steps
        low = np.minimum(at.astype(int), steps - 1)
        slow = np.zeros(len(points))
        for corner in np.ndindex(2, 2, 2):
            share = np.where(corner, at - low, 1 - (at - low)).prod(axis=1)
            slow += share * fields.values[table][tuple((low + corner).T)]
        np.testing.assert_allclose(found[:, number], slow, atol=1e-9)


@pytest.mark.parametrize("name", ["s009", "s011", "s037", "s038"])
def test_bodies_whose_rig_is_known_move_as_with_true_weights(name):
    folder = RIGGED / name
    if not folder.is_dir():
        pytest.skip("needs bodies with a rig beside the checkout")
    mesh = read_mesh(folder / "body.ply")
    skeleton = true_skeleton(folder, mesh)
    weights = skin_weights(mesh, skeleton)
    poses = json.loads((folder / "poses" / "poses.json").read_text())
    for pose, (mean, most) in POSES.items():
        matrices = np.array([poses[pose]["bones"][bone] for bone in BONES])
        hips = matrices[0, :3, :3] @ skeleton.joints[0] + matrices[0, :3, 3] - skeleton.joints[0]
        moved = skinned(mesh.vertices, weights, bone_matrices(skeleton, Pose(matrices[:, :3, :3], hips)))
        truth = np.load(folder / "poses" / f"{pose}.npy").astype(np.float64)
        apart = 1e3 * np.linalg.norm(moved - truth, axis=1)
        assert apart.mean() < mean and np.quantile(apart, 0.95) < most, pose
        crossing, true_crossing = (len(np.unique(self_intersections(v, mesh.triangles))) for v in (moved, truth))
        assert crossing <= 1.2 * true_crossing + 20, pose


def test_skin_folds_without_running_through_itself_far(spread):
    """Groins of somebody who squats: far fewer faces cross than where each vertex goes with its strongest bones."""
    mesh, skeleton, weights = spread
    plain = _softmax(bone_likelihoods(mesh.vertices, skeleton, known_fields()))
    counts = []
    for shares in (weights, strongest(plain)):
        folded = skinned(mesh.vertices, shares, bone_matrices(skeleton, squatting()))
        counts.append(len(np.unique(self_intersections(folded, mesh.triangles))))
    assert counts[0] < 0.5 * counts[1]


def true_skeleton(folder: Path, mesh: Mesh) -> Skeleton:
    joints = json.loads((folder / "joints.json").read_text())
    stored = np.load(folder / "weights.npz")
    main = stored["bones"][np.take_along_axis(stored["index"], stored["weight"].argmax(axis=1)[:, None], axis=1)[:, 0]]
    at = np.array([joints[bone] for bone in BONES])
    tips = []
    for side in ("Left", "Right"):
        hand = at[BONES.index(f"{side}Hand")]
        own = mesh.vertices[main == f"{side}Hand"]
        along = (own - hand) @ (hand - at[BONES.index(f"{side}ForeArm")])
        tips.append(own[along.argsort()[-20:]].mean(axis=0))
    ends = [joints["HeadTop_End"], *tips, joints["LeftToe_End"], joints["RightToe_End"]]
    return Skeleton(at, np.array(ends), np.ones(len(BONES)))
