"""Joint registration against closed forms: cycles whose error is known, and an independent least squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.numeric.rotations import from_vectors, to_vectors
from mirror_scan.core.registration.joint import Edge, closed_cycle, joint_registration
from scipy.optimize import least_squares


def motions(rng, count, turn=np.pi, shift=2.0):
    made = np.tile(np.eye(4), (count, 1, 1))
    made[:, :3, :3] = from_vectors(rng.uniform(-turn, turn, (count, 3)) / np.sqrt(3))
    made[:, :3, 3] = rng.uniform(-shift, shift, (count, 3))
    return made


def edges_of(poses, pairs, noise=None):
    """Registrations source → target of views with these poses, each moved by its own noise (4, 4)."""
    noise = np.tile(np.eye(4), (len(pairs), 1, 1)) if noise is None else noise
    return [Edge(s, t, np.linalg.inv(poses[t]) @ poses[s] @ n) for (s, t), n in zip(pairs, noise, strict=True)]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 9))
def test_a_cycle_takes_its_error_in_equal_parts(seed, count):
    rng = np.random.default_rng(seed)
    cycle = motions(rng, count)
    product = np.linalg.multi_dot(cycle) if count > 2 else cycle[0] @ cycle[1]
    closed = closed_cycle(cycle)
    after = np.linalg.multi_dot(closed) if count > 2 else closed[0] @ closed[1]
    np.testing.assert_allclose(after, np.eye(4), atol=1e-9)
    turned = np.linalg.norm(to_vectors(np.swapaxes(cycle[:, :3, :3], 1, 2) @ closed[:, :3, :3]), axis=1)
    # no rotations that add up to one by an angle are smaller than equal shares of it
    np.testing.assert_allclose(turned, np.linalg.norm(to_vectors(product[:3, :3])) / count, atol=1e-7)
    shifted = np.linalg.norm(closed[:, :3, 3] - cycle[:, :3, 3], axis=1)
    np.testing.assert_allclose(shifted, shifted[0], atol=1e-9)


def test_a_cycle_with_known_error_and_weights():
    """Four quarter turns about z with 4° too much, and 8 mm too much along z: shares as 1 over the weight."""
    cycle = np.tile(np.eye(4), (4, 1, 1))
    cycle[:, :3, :3] = from_vectors(np.array([(0, 0, np.radians(91.0))] * 4))
    cycle[:, 2, 3] = 0.002
    closed = closed_cycle(cycle, np.array([1.0, 1.0, 2.0, 2.0]))
    angles = np.degrees(to_vectors(closed[:, :3, :3])[:, 2])
    np.testing.assert_allclose(angles, 91.0 - 4.0 * np.array([2, 2, 1, 1]) / 6.0, atol=1e-9)
    np.testing.assert_allclose(closed[:, 2, 3], 0.002 - 0.008 * np.array([2, 2, 1, 1]) / 6.0, atol=1e-12)


def test_consistent_views_are_found_exactly():
    rng = np.random.default_rng(1)
    poses = motions(rng, 7)
    poses = np.linalg.inv(poses[0]) @ poses
    pairs = [(1, 0), (1, 2), (3, 2), (4, 3), (4, 5), (5, 6), (6, 0), (2, 0), (5, 3), (1, 4)]
    found = joint_registration(7, edges_of(poses, pairs))
    np.testing.assert_allclose(found.poses, poses, atol=1e-7)
    assert found.turned.max() < 1e-7 and found.shifted.max() < 1e-9
    tree = joint_registration(7, edges_of(poses, [(6, 0), (5, 6), (5, 4), (3, 4), (3, 2), (1, 2)]))
    np.testing.assert_allclose(tree.poses, poses, atol=1e-12)


def test_rounding_does_not_grow_round_a_long_ring():
    rng = np.random.default_rng(4)
    poses = motions(rng, 36)
    poses = np.linalg.inv(poses[0]) @ poses
    pairs = [(k, (k + step) % 36) for k in range(36) for step in (1, 2)]
    found = joint_registration(36, edges_of(poses, pairs))
    np.testing.assert_allclose(found.poses, poses, atol=1e-9)


def test_as_good_as_least_squares_over_all_poses():
    """scipy's least squares over all poses at once has the same sum of squares, but for what is of second order."""
    rng = np.random.default_rng(2)
    poses = motions(rng, 6)
    pairs = [(1, 0), (2, 1), (3, 2), (4, 3), (5, 4), (0, 5), (2, 0), (3, 1), (5, 3)]
    edges = edges_of(poses, pairs, motions(rng, len(pairs), 0.03, 0.01))
    weights = rng.uniform(0.3, 1.0, len(edges))
    edges = [Edge(e.source, e.target, e.pose, w) for e, w in zip(edges, weights, strict=True)]
    found = joint_registration(6, edges)

    def rotations(free):
        return np.concatenate((np.eye(3)[None], found.poses[1:, :3, :3] @ from_vectors(free.reshape(5, 3))))

    def turned(free):
        r = rotations(free)
        return np.concatenate([np.sqrt(e.weight) * to_vectors(e.pose[:3, :3].T @ r[e.target].T @ r[e.source])
                               for e in edges])  # fmt: skip

    best = least_squares(turned, np.zeros(15), xtol=1e-12, ftol=1e-12)
    ours = (weights * found.turned**2).sum()
    assert 2.0 * best.cost <= ours <= 2.0 * best.cost * 1.002

    def shifted(free):
        places = np.concatenate((np.zeros((1, 3)), free.reshape(5, 3)))
        r = found.poses[:, :3, :3]
        return np.concatenate([np.sqrt(e.weight) * (r[e.target].T @ (places[e.source] - places[e.target])
                                                    - e.pose[:3, 3]) for e in edges])  # fmt: skip

    best = least_squares(shifted, np.zeros(15), xtol=1e-12)
    np.testing.assert_allclose(found.poses[1:, :3, 3], best.x.reshape(5, 3), atol=1e-6)


def test_spreading_halves_the_drift_of_a_chain():
    """Round a full circle of steps with independent errors the joint poses are nearer the truth than the chain's."""
    rng = np.random.default_rng(3)
    chain, joint = [], []
    for _ in range(8):
        poses = np.linalg.inv(motions(rng, 1)[0]) @ motions(rng, 8)
        poses = np.linalg.inv(poses[0]) @ poses
        pairs = [(k + 1, k) for k in range(7)]
        edges = edges_of(poses, [*pairs, (0, 7)], motions(rng, 8, 0.02, 0.01))
        for kept, errors in ((edges[:-1], chain), (edges, joint)):
            found = joint_registration(8, kept).poses
            errors.append(np.linalg.norm(to_vectors(np.swapaxes(poses[:, :3, :3], 1, 2) @ found[:, :3, :3]), axis=1))
    assert np.sqrt(np.mean(np.square(joint))) < 0.75 * np.sqrt(np.mean(np.square(chain)))


def test_views_that_cannot_be_placed():
    poses = np.tile(np.eye(4), (3, 1, 1))
    with pytest.raises(MirrorScanError, match="view 3 is registered with no other"):
        joint_registration(3, edges_of(poses, [(1, 0)]))
    for bad in (Edge(0, 0, np.eye(4)), Edge(0, 3, np.eye(4)), Edge(0, 1, np.full((4, 4), np.nan)),
                Edge(0, 1, np.eye(4), 0.0)):  # fmt: skip
        with pytest.raises(MirrorScanError, match="leave it out"):
            joint_registration(3, [bad])
