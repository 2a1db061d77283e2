"""Poses of cameras as a calibration board gives them: corners found with an error, board by board, pair by pair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import Intrinsics, project
from ..numeric.rotations import frames, from_vectors, to_vectors, unit
from ..registration.joint import Edge, joint_registration

CORNERS = (9, 6)
SQUARE = 0.08
"""A board of A1 size: inner corners, and the side of a square [m]."""

PLACEMENTS = 20
"""Boards held up for each pair of cameras, turned to both."""

CORNER_NOISE = 0.15
"""Standard deviation of a corner in the infrared image [px]; Zhang 2000 leaves .1 to .3 px."""

_AROUND = 0.3  # m: boards are held up within so much of the subject's middle, each way
_TILT = 0.35  # rad: and turned by about so much


def board_calibrated(
    poses: Sequence[np.ndarray],
    intrinsics: Intrinsics,
    middle: np.ndarray,
    rng: np.random.Generator,
    noise: float = CORNER_NOISE,
) -> np.ndarray:
    """The poses that a calibration with a board finds.

    Each pair of cameras sees boards held up between them. From the corners each camera computes where the board is,
    wrong by what the least squares of its corners' errors come to (to first order); the two together say how the
    cameras stand, the mean over the boards counts, and all pairs are registered jointly.

    Parameters
    ----------
    poses : sequence of np.ndarray [shape=(4, 4)]
        The true ones: each camera's frame → a common one.
    intrinsics : Intrinsics
        Of all cameras; they are known well.
    middle : np.ndarray [shape=(3,)]
        Where the subject will stand, common frame [m].
    rng : np.random.Generator
    noise : float
        Of a corner [px].

    Returns
    -------
    np.ndarray [shape=(N, 4, 4)]
        The first is the true one.
    """
    edges = []
    offset = np.eye(4)
    offset[:3, 3] = middle
    for one in range(len(poses)):
        for other in range(one + 1, len(poses)):
            errors = []
            for board in _boards(poses[one][:3, 3], poses[other][:3, 3], middle, rng):
                gap = _error(poses[one], board, intrinsics, noise, rng)
                gap -= _error(poses[other], board, intrinsics, noise, rng)
                gap[3:] += np.cross(gap[:3], middle - board[:3, 3])  # about the subject's middle
                errors.append(gap)
            error = np.mean(errors, axis=0)
            wrong = np.eye(4)
            wrong[:3, :3], wrong[:3, 3] = from_vectors(error[:3]), error[3:]
            edges.append(Edge(other, one, wrong))
    found = joint_registration(len(poses), edges).poses
    to_first = [offset @ pose @ np.linalg.inv(offset) @ true for pose, true in zip(found, poses, strict=True)]
    return np.array(to_first)


def _boards(one: np.ndarray, other: np.ndarray, middle: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Poses (4, 4) of boards held up so that both cameras see them, common frame."""
    boards = []
    for _ in range(PLACEMENTS):
        place = middle + rng.uniform(-_AROUND, _AROUND, 3)
        facing = unit(unit(one - place) + unit(other - place))
        board = np.eye(4)
        upright = frames(-facing, np.array([0.0, 0.0, -1.0]))
        tilted = from_vectors(_TILT * rng.standard_normal(3)) @ upright
        board[:3, :3] = np.column_stack((tilted[:, 2], tilted[:, 1], -tilted[:, 0]))
        board[:3, 3] = place
        boards.append(board)
    return boards


def _error(
    camera: np.ndarray, board: np.ndarray, intrinsics: Intrinsics, noise: float, rng: np.random.Generator
) -> np.ndarray:
    """How wrong a camera has a board: rotation vector [rad] and shift [m] (6,), common frame, about the board."""
    across, down = (SQUARE * (np.arange(count) - (count - 1) / 2) for count in CORNERS)
    x, y = (grid.ravel() for grid in np.meshgrid(across, down))
    corners = np.column_stack((x, y, np.zeros_like(x))) @ board[:3, :3].T
    to_camera = np.linalg.inv(camera)

    def seen(motion: np.ndarray) -> np.ndarray:
        points = corners @ from_vectors(motion[:3]).T + motion[3:] + board[:3, 3]
        return project(points @ to_camera[:3, :3].T + to_camera[:3, 3], intrinsics).ravel()

    step = 1e-5
    slope = np.column_stack([(seen(step * axis) - seen(-step * axis)) / (2 * step) for axis in np.eye(6)])
    return np.linalg.lstsq(slope, noise * rng.standard_normal(len(slope)), rcond=None)[0]


def pose_errors(found: Sequence[np.ndarray], true: Sequence[np.ndarray], middle: np.ndarray) -> tuple[float, float]:
    """How wrong poses are but for a common motion [m], [degrees]: the largest, shifts at ``middle`` (3,).

    All are compared as they stand to the first.
    """
    shifts, turns = [0.0], [0.0]
    for pose, right in zip(found[1:], true[1:], strict=True):
        now = true[0] @ np.linalg.inv(found[0]) @ pose @ np.linalg.inv(right)
        shifts.append(float(np.linalg.norm(now[:3, :3] @ middle + now[:3, 3] - middle)))
        turns.append(float(np.degrees(np.linalg.norm(to_vectors(now[:3, :3])))))
    return max(shifts), max(turns)
