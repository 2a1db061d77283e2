"""Poses of several cameras that saw one scene: ``poses.json``, and the captures it names."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import CaptureError
from ..io.json_files import text_of
from .capture import Capture, ReadOptions
from .frames import FrameChoice
from .reader_choice import open_capture

POSES_FILE = "poses.json"


def check_pose(pose: np.ndarray, name: str) -> np.ndarray:
    """The pose as float64 (4, 4), its rotation made exact.

    Raises
    ------
    CaptureError
        When it is not a rigid motion.
    """
    pose = np.array(pose, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise CaptureError(f"{name}: a pose is a 4×4 matrix of finite numbers whose last row is 0 0 0 1")
    left, scale, right = np.linalg.svd(pose[:3, :3])
    if np.abs(scale - 1).max() > 1e-2 or np.linalg.det(pose[:3, :3]) < 0:
        raise CaptureError(
            f"{name}: its pose is not a rigid motion: the upper left 3×3 part must be a rotation, without scale or "
            "reflection; give metres, and camera axes x right, y down, z forward"
        )
    pose[:3, :3] = left @ right
    return pose


def read_poses(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Poses by the captures' names, in the file's order.

    The file: ``{"cameras": [{"capture": NAME, "camera_to_world": [[…] × 4]}, …]}``; NAME is a path relative to it.

    Raises
    ------
    CaptureError
        When it cannot be read or does not hold that.
    """
    path = Path(path)
    try:
        content = json.loads(text_of(path.read_bytes(), "strict"))
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise CaptureError(f"{path}: is not JSON: {error}") from error
    cameras = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(cameras, list) or not cameras:
        raise CaptureError(f'{path}: holds no list "cameras" of {{"capture": …, "camera_to_world": 4×4}}')
    poses: dict[str, np.ndarray] = {}
    for k, camera in enumerate(cameras):
        name = camera.get("capture") if isinstance(camera, dict) else None
        if not isinstance(name, str) or not name:
            raise CaptureError(f'{path}: camera {k + 1} has no "capture", the name of its recording')
        if name in poses:
            raise CaptureError(f"{path}: {name} is listed twice; give each capture one pose")
        try:
            matrix = np.array(camera.get("camera_to_world"), dtype=np.float64)
        except (TypeError, ValueError):
            matrix = np.zeros(0)
        poses[name] = check_pose(matrix, f"{path}: {name}")
    return poses


def holds_poses(path: str | os.PathLike) -> bool:
    """Whether ``path`` is a folder of several captures with their poses."""
    return (Path(path) / POSES_FILE).is_file()


def open_posed_captures(
    paths: Sequence[str | os.PathLike],
    poses: str | os.PathLike | None = None,
    frames: FrameChoice = None,
    options: ReadOptions | None = None,
) -> tuple[list[Capture], list[np.ndarray]]:
    """Captures of several cameras and the pose of each.

    Parameters
    ----------
    paths : sequence of path
        The captures; or one folder that holds ``poses.json`` and, beside it, the captures that it names.
    poses : path, optional
        File of :func:`read_poses`; its captures are matched with ``paths`` by their file or folder name.
    frames, options
        As in :func:`.reader_choice.open_capture`, for all captures alike.

    Raises
    ------
    CaptureError
        When a capture has no pose, or one of both cannot be read.
    """
    if poses is None:
        if len(paths) != 1 or not holds_poses(paths[0]):
            raise CaptureError(
                f"{len(paths)} captures were given without their cameras' poses; add --poses FILE, or give one folder "
                f"that holds them and {POSES_FILE}"
            )
        poses = Path(paths[0]) / POSES_FILE
        paths = []
    known = read_poses(poses)
    if not paths:
        chosen = {name: Path(poses).parent / name for name in known}
    else:
        by_name = {Path(name).name: name for name in known}
        if len(by_name) < len(known):
            raise CaptureError(f"{poses}: two captures have the same file name; give each its own")
        chosen = {}
        for path in map(Path, paths):
            name = by_name.get(path.name) or by_name.get(path.resolve().name)
            if name is None:
                raise CaptureError(f"{path}: {poses} holds no pose for it, only for {', '.join(known)}")
            chosen[name] = path
    captures = [replace(open_capture(path, frames, options), name=name) for name, path in chosen.items()]
    return captures, [known[name] for name in chosen]
