"""Train the tables that skin weights come from: ``core/avatar/weight_fields.npz``.

    python tools/train_weight_fields.py MAKEHUMAN_FOLDER [--people 150] [--seed 2] [-o FILE]

Draws people of MakeHuman's shape space (:mod:`makehuman` says which files the folder needs), bare and clothed, in many
poses, with Mixamo's weights, and fits multinomial logistic regression: the log-likelihood of each bone is a smooth
table over the bone's own axes (:mod:`mirror_scan.core.avatar.weight_fields`). No body of the tests takes part.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from makehuman import BODY, MakeHuman
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, posed_skeleton, skinned
from mirror_scan.core.avatar.skeleton import BONES, OTHER_SIDE, PARENTS, Skeleton
from mirror_scan.core.avatar.skin_weights import LIMBS
from mirror_scan.core.avatar.weight_fields import TABLES, bone_coordinates
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.numeric.rotations import from_vectors, shortest_turn
from scipy import sparse
from scipy.optimize import minimize
from train_body_template import covered, outfit

FILE = Path(__file__).resolve().parents[1] / "core" / "avatar" / "weight_fields.npz"
SHAPE = (5, 10, 8)
"""Nodes of a table: across the bone to the side, along it, across it to the front."""
POINTS = 1200
"""Of each person."""
JOINT_ERROR = 0.003
"""Joints of a scan miss the true ones by about so much [m]."""
BENDING, SIZE = 1e-6, 1e-7
"""How much tables are kept smooth, and near 0."""
CLOTHED = 0.3
_TABLE_OF = np.array([TABLES.index(bone if bone in TABLES else OTHER_SIDE[bone]) for bone in range(len(BONES))])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--people", type=int, default=150)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("-o", dest="file", type=Path, default=FILE)
    options = parser.parse_args()
    space, rng = MakeHuman(options.folder), np.random.default_rng(options.seed)
    drawn = [posed_points(space, rng) for _ in range(options.people)]
    coordinates, weights = (np.concatenate(rows) for rows in zip(*drawn, strict=True))
    low, high = spans(coordinates, weights)
    values = fitted(coordinates, weights, low, high)
    np.savez_compressed(
        options.file, low=low.astype(np.float32), high=high.astype(np.float32), values=values.astype(np.float16)
    )
    print(f"{options.file}: {options.file.stat().st_size / 1000:.0f} kB")


def posed_points(space: MakeHuman, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where points of somebody in some pose lie in all tables (POINTS, 22, 3), and their weights (POINTS, 22)."""
    person = space.draw(rng)
    skin = person.vertices[:BODY].copy()
    normals = vertex_normals(skin, space.triangles)
    corners = skin[space.triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    share = np.bincount(space.triangles.ravel(), np.repeat(areas, 3), BODY)
    if rng.random() < CLOTHED:
        moved = np.zeros(BODY)
        for piece, reach in outfit(space, rng):
            moved = np.maximum(moved, covered(space, person, normals, piece, reach))
        skin += moved[:, None] * normals
    skeleton = Skeleton(person.joints, person.ends, np.ones(len(BONES)))
    pose = random_pose(skeleton, rng)
    chosen = rng.choice(BODY, POINTS, replace=False, p=share / share.sum())
    weights = space.weights[chosen]
    order = np.argsort(-weights, axis=1)[:, :8]
    exact = SkinWeights(order, np.take_along_axis(weights, order, axis=1))
    points = skinned(skin[chosen], exact, bone_matrices(skeleton, pose))
    there = posed_skeleton(skeleton, pose)
    missed = Skeleton(
        there.joints + rng.normal(0.0, JOINT_ERROR, there.joints.shape),
        there.ends + rng.normal(0.0, JOINT_ERROR, there.ends.shape), there.confidence,
    )  # fmt: skip
    return bone_coordinates(points, missed), weights


def random_pose(skeleton: Skeleton, rng: np.random.Generator) -> Pose:
    """Arms from hanging to raised, everything else a little."""
    local = {name: small_turn(rng, angle) for name, angle in {
        "Spine1": 0.08, "Neck": 0.12, "Head": 0.12, "LeftShoulder": 0.06, "RightShoulder": 0.06, "LeftForeArm": 0.3,
        "RightForeArm": 0.3, "LeftHand": 0.15, "RightHand": 0.15, "LeftUpLeg": 0.12, "RightUpLeg": 0.12,
        "LeftLeg": 0.1, "RightLeg": 0.1, "LeftFoot": 0.1, "RightFoot": 0.1,
    }.items()}  # fmt: skip
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        joints = skeleton.joints
        arm = joints[BONES.index(f"{side}ForeArm")] - joints[BONES.index(f"{side}Arm")]
        down, ahead = np.radians((rng.triangular(-60, 45, 85), rng.uniform(-15, 45)))
        wanted = np.array([sign * np.cos(down) * np.cos(ahead), -np.cos(down) * np.sin(ahead), -np.sin(down)])
        local[f"{side}Arm"] = shortest_turn(arm, wanted)
    rotations = np.tile(np.eye(3), (len(BONES), 1, 1))
    for bone, (name, parent) in enumerate(zip(BONES, PARENTS, strict=True)):
        rotations[bone] = (rotations[parent] if parent >= 0 else np.eye(3)) @ local.get(name, np.eye(3))
    return Pose(rotations, np.zeros(3))


def small_turn(rng: np.random.Generator, angle: float) -> np.ndarray:
    """A rotation (3, 3) by about ``angle`` [rad]."""
    return from_vectors(rng.normal(0.0, angle / np.sqrt(3.0), 3))


def spans(coordinates: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What each table spans, low and high (14, 3): where the bone holds something, and a quarter more."""
    low, high = np.empty((len(TABLES), 3)), np.empty((len(TABLES), 3))
    for table, bone in enumerate(TABLES):
        held = np.concatenate([coordinates[weights[:, b] > 0.02, b] for b in {bone, OTHER_SIDE[bone]}])
        low[table], high[table] = np.quantile(held, (0.002, 0.998), axis=0)
        margin = 0.25 * (high[table] - low[table])
        low[table] -= margin
        high[table] += margin
        if OTHER_SIDE[bone] == bone:  # left and right are alike
            low[table, 0] = 0.0
    return low, high


def fitted(coordinates: np.ndarray, weights: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Log-likelihoods at the tables' nodes (14, *SHAPE)."""
    count, bones = weights.shape
    held = weights @ np.eye(LIMBS.max() + 1)[LIMBS]
    # a limb's bones are asked about on that limb, and on the trunk, where it begins
    asked = (held[:, LIMBS] > 1e-4) | (LIMBS == 0) | (held[:, :1] > 0.5)
    truth = np.where(asked, weights, 0.0)
    truth /= truth.sum(axis=1, keepdims=True)
    shut = np.where(asked, 0.0, -1e3)
    nodes = int(np.prod(SHAPE))
    look_up = interpolation(coordinates, low, high)
    bending = sparse.block_diag([bending_of_table()] * len(TABLES)).tocsr()
    bending = bending.T @ bending

    def cost(values: np.ndarray) -> tuple[float, np.ndarray]:
        hold = (look_up @ values).reshape(count, bones) + shut
        hold -= hold.max(axis=1, keepdims=True)
        shares = np.exp(hold)
        total = shares.sum(axis=1, keepdims=True)
        entropy = -(truth * (hold - np.log(total))).sum() / count
        bent = bending @ values
        slope = look_up.T @ ((shares / total - truth) / count).ravel()
        penalty = BENDING * values @ bent + SIZE * values @ values
        return entropy + penalty, slope + 2 * BENDING * bent + 2 * SIZE * values

    found = minimize(cost, np.zeros(len(TABLES) * nodes), jac=True, method="L-BFGS-B",
                     options={"maxiter": 250, "maxcor": 30, "ftol": 1e-12, "gtol": 1e-9})  # fmt: skip
    least = -(truth * np.log(np.maximum(truth, 1e-12))).sum() / count
    print(f"cross entropy {found.fun:.4f} after {found.nit} steps, {least:.4f} at least")
    return found.x.reshape(len(TABLES), *SHAPE)


def interpolation(coordinates: np.ndarray, low: np.ndarray, high: np.ndarray) -> sparse.csr_matrix:
    """Trilinear look-up of all points and bones in all tables, as a matrix."""
    steps = np.array(SHAPE) - 1
    place = np.clip((coordinates - low[_TABLE_OF]) / (high - low)[_TABLE_OF], 0.0, 1.0) * steps
    cell = np.minimum(place.astype(int), steps - 1)
    share = place - cell
    columns, values = [], []
    for corner in np.ndindex(2, 2, 2):
        at = cell + corner
        columns.append(np.ravel_multi_index(tuple(np.moveaxis(at, -1, 0)), SHAPE))
        values.append(np.where(corner, share, 1.0 - share).prod(axis=-1))
    column = np.stack(columns, axis=-1) + (_TABLE_OF * int(np.prod(SHAPE)))[:, None]
    rows = np.repeat(np.arange(coordinates.shape[0] * len(BONES)), 8)
    shape = (coordinates.shape[0] * len(BONES), len(TABLES) * int(np.prod(SHAPE)))
    return sparse.csr_matrix((np.stack(values, axis=-1).ravel(), (rows, column.ravel())), shape=shape)


def bending_of_table() -> sparse.csr_matrix:
    """Second differences of a table along its three axes, as a matrix."""
    number = np.arange(np.prod(SHAPE)).reshape(SHAPE)
    rows = []
    for axis in range(3):
        line = np.moveaxis(number, axis, 0)
        rows.append(np.stack((line[:-2], line[1:-1], line[2:]), axis=-1).reshape(-1, 3))
    triples = np.concatenate(rows)
    at = np.repeat(np.arange(len(triples)), 3)
    values = np.tile([1.0, -2.0, 1.0], len(triples))
    return sparse.csr_matrix((values, (at, triples.ravel())), shape=(len(triples), number.size))


if __name__ == "__main__":
    main()
