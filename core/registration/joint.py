"""Many views registered jointly: the error of their pairwise registrations is spread round the cycles of their graph.

Sharp, Lee and Wehe, "Multiview registration of 3D scenes by minimizing error between coordinate frames", IEEE
Transactions on Pattern Analysis and Machine Intelligence 26(8), 2004. Only the relative poses count, no points.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import from_vectors, to_vectors

_CLOSED = 1e-8  # rad: a cycle that turns by less is closed
_ROUNDS = 1000  # some five times as many as views are needed


@dataclass(frozen=True)
class Edge:
    """A pairwise registration.

    Parameters
    ----------
    source, target : int
        Views, from 0.
    pose : np.ndarray [shape=(4, 4)]
        Rigid: the frame of the source → that of the target.
    weight : float
        How much its correction costs, relative to others.
    """

    source: int
    target: int
    pose: np.ndarray
    weight: float = 1.0


@dataclass(frozen=True)
class JointPoses:
    """Poses of all views that fit together.

    Parameters
    ----------
    poses : np.ndarray [shape=(N, 4, 4)]
        Rigid: each view's frame → that of the first view.
    turned : np.ndarray [shape=(E,)]
        By how much each edge's rotation was corrected [rad].
    shifted : np.ndarray [shape=(E,)]
        By how much its translation was [m].
    """

    poses: np.ndarray
    turned: np.ndarray
    shifted: np.ndarray


def closed_cycle(motions: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Motions round one cycle, corrected as little as closes it: the closed form of Sharp, Lee and Wehe, section 4.

    The rotations of the cycle multiply to one about an axis a by an angle θ. Each edge takes the share of -θ about a
    that falls to it, carried into its own frame; no other rotations that close the cycle have a smaller weighted sum
    of squared angles, as angles on a sphere add up to θ at least. Then the same with what the translations leave over.

    Parameters
    ----------
    motions : np.ndarray [shape=(n, 4, 4)]
        Rigid; motion k takes view k + 1 to view k, and the last one the first view to the last.
    weights : np.ndarray [shape=(n,)], optional
        What a correction of each costs; 1 by default.

    Returns
    -------
    np.ndarray [shape=(n, 4, 4)]
        Their product is the identity.
    """
    motions = np.array(motions, dtype=np.float64)
    share = np.ones(len(motions)) if weights is None else 1.0 / np.asarray(weights, dtype=np.float64)
    share = share / share.sum()
    motions[:, :3, :3], _ = _closed_rotations(motions[:, :3, :3], share)
    before, gap = np.eye(3), np.zeros(3)
    to_start = []
    for motion in motions:
        to_start.append(before)
        gap = gap + before @ motion[:3, 3]
        before = before @ motion[:3, :3]
    for k, back in enumerate(to_start):
        motions[k, :3, 3] -= share[k] * (back.T @ gap)
    return motions


def _closed_rotations(rotations: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, float]:
    """Rotations (n, 3, 3) round a cycle, each corrected by its share (n,) of what the cycle turned; and that [rad]."""
    through = np.empty_like(rotations)
    product = np.eye(3)
    for k, rotation in enumerate(rotations):
        product = product @ rotation
        through[k] = product
    gap = to_vectors(product)
    closed = rotations @ np.swapaxes(through, -1, -2) @ from_vectors(-share[:, None] * gap) @ through
    # What rounding leaves of no rotation grows from cycle to cycle: a step to the nearest one (Higham 1986).
    closed = 1.5 * closed - 0.5 * closed @ np.swapaxes(closed, -1, -2) @ closed
    return closed, float(np.linalg.norm(gap))


def joint_registration(views: int, edges: Sequence[Edge]) -> JointPoses:
    """Poses of all views from their pairwise registrations.

    Rotations first: cycle after cycle is closed by the closed form until all are. Then translations: of the linear
    equations that are left the weighted least squares. A view's own frame decides what a rotation and a shift are:
    let its origin lie in the middle of what the view shows.

    Parameters
    ----------
    views : int
        How many there are.
    edges : sequence of Edge
        At most one a pair of views.

    Raises
    ------
    MirrorScanError
        When an edge is none, views are not connected by edges, or the cycles do not close.

    Notes
    -----
    O(rounds · cycles · length); on a ring of N views some 5 N rounds: .2 s for 8, 3 s for 36.
    """
    for edge in edges:
        there = (0 <= edge.source < views) and (0 <= edge.target < views) and edge.source != edge.target
        if not there or not np.isfinite(edge.pose).all() or not edge.weight > 0:
            raise MirrorScanError(
                "joint registration: between the views {source} and {target} of {views} there is no registration of "
                "two views with a finite pose and a positive weight; leave it out",
                source=edge.source, target=edge.target, views=views,
            )  # fmt: skip
    order, parents = _spanning_tree(views, edges)
    rotations = np.array([edge.pose[:3, :3] for edge in edges]).reshape(-1, 3, 3)
    cost = np.array([edge.weight for edge in edges])
    cycles = _cycles(edges, parents)
    for _ in range(_ROUNDS):
        worst = 0.0
        for at, forward in cycles:
            share = (1.0 / cost[at]) / (1.0 / cost[at]).sum()
            closed, gap = _closed_rotations(_oriented(rotations[at], forward), share)
            rotations[at] = _oriented(closed, forward)
            worst = max(worst, gap)
        if worst < _CLOSED:
            break
    else:
        raise MirrorScanError(
            "joint registration: the views' pairwise registrations contradict each other; check the order of the "
            "captures, and leave out one that shows something else"
        )
    poses = np.tile(np.eye(4), (views, 1, 1))
    for view in order[1:]:
        parent, number = parents[view]
        step = rotations[number] if edges[number].source == view else rotations[number].T
        poses[view, :3, :3] = poses[parent, :3, :3] @ step
    poses[:, :3, 3] = _places(poses[:, :3, :3], edges, cost)
    return JointPoses(poses, *_corrections(poses, edges))


def _oriented(rotations: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3), those that are passed against their direction inverted."""
    return np.where(forward[:, None, None], rotations, np.swapaxes(rotations, -1, -2))


def _spanning_tree(views: int, edges: Sequence[Edge]) -> tuple[list[int], dict[int, tuple[int, int]]]:
    """Views in the order in which they are reached from the first, and each one's parent and the edge to it."""
    order, parents = [0], {0: (-1, -1)}
    waiting = deque([0])
    while waiting:
        here = waiting.popleft()
        for number, edge in enumerate(edges):
            ends = (edge.source, edge.target)
            other = ends[1 - ends.index(here)] if here in ends else here
            if other not in parents:
                parents[other] = (here, number)
                order.append(other)
                waiting.append(other)
    if len(order) < views:
        lost = min(set(range(views)) - set(order))
        raise MirrorScanError(
            "joint registration: view {lost} is registered with no other; take it nearer to its neighbours",
            lost=lost + 1,
        )
    return order, parents


def _cycles(edges: Sequence[Edge], parents: dict[int, tuple[int, int]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """A basis: for each edge outside the tree the edges round its cycle, and whether each leads back to the last one.

    “Forward” is an edge whose source is passed after its target: its pose takes the next view to this one.
    """

    def to_root(view: int) -> list[int]:
        way = [view]
        while parents[way[-1]][0] >= 0:
            way.append(parents[way[-1]][0])
        return way

    tree = {number for _, number in parents.values()}
    found = []
    for number, edge in enumerate(edges):
        if number in tree:
            continue
        up, down = to_root(edge.source), to_root(edge.target)
        while len(up) > 1 and len(down) > 1 and up[-2] == down[-2]:
            up.pop()
            down.pop()
        # from the target over the edge to the source, and along the tree back
        walked = up + down[-2::-1]
        steps = [(number, True)]
        for here, there in zip(walked, walked[1:], strict=False):
            child = here if parents[here][0] == there else there
            at = parents[child][1]
            steps.append((at, edges[at].target == here))
        found.append((np.array([at for at, _ in steps]), np.array([forward for _, forward in steps])))
    return found


def _places(rotations: np.ndarray, edges: Sequence[Edge], cost: np.ndarray) -> np.ndarray:
    """Where each view's origin lies (N, 3), the first at 0: weighted least squares over the edges' translations.

    An edge's error has one length in any frame, so that the squares are those of the corrections.
    """
    rows = np.zeros((len(edges), len(rotations)))
    wanted = np.zeros((len(edges), 3))
    for k, edge in enumerate(edges):
        rows[k, edge.source], rows[k, edge.target] = 1.0, -1.0
        wanted[k] = rotations[edge.target] @ edge.pose[:3, 3]
    root = np.sqrt(cost)[:, None]
    places = np.zeros((len(rotations), 3))
    if len(edges):
        places[1:] = np.linalg.lstsq(root * rows[:, 1:], root * wanted, rcond=None)[0]
    return places


def _corrections(poses: np.ndarray, edges: Sequence[Edge]) -> tuple[np.ndarray, np.ndarray]:
    """By how much each edge turned (E,) [rad] and shifted (E,) [m]."""
    turned, shifted = np.zeros(len(edges)), np.zeros(len(edges))
    for k, edge in enumerate(edges):
        now = np.linalg.inv(poses[edge.target]) @ poses[edge.source]
        turned[k] = np.linalg.norm(to_vectors(edge.pose[:3, :3].T @ now[:3, :3]))
        shifted[k] = np.linalg.norm(now[:3, 3] - edge.pose[:3, 3])
    return turned, shifted
