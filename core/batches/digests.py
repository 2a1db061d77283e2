"""What a capture and settings are, as digests: a result made of the same of both need not be made again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from ..capture.camera_poses import POSES_FILE, holds_poses, read_poses
from ..capture.folders.rgbd_folder import COLOR_INTRINSIC_NAME, INTRINSIC_NAMES, sensor_named
from ..capture.single_files.pclzf import companions
from ..capture.single_files.single_image import color_beside
from ..errors import CaptureError
from .capture_list import RECORDINGS

_BLOCK = 1 << 20
_ALONE = tuple(suffix for suffix in RECORDINGS if suffix != ".pclzf")
"""Recordings whose readers look at nothing beside them."""
_NAMED = ("depth.txt", "intrinsics.txt")
"""Files of data sets whose folders are named after the camera."""


def content_digest(path: str | os.PathLike) -> tuple[str, int]:
    """SHA-256 of a file, or of the files of a folder and their places in it, and how many bytes that is.

    Files are read a megabyte at a time. Names and times of the file or folder itself do not count, and neither do
    hidden files; what links lead to counts as if it lay there. About 1 s a gigabyte, the disk aside.

    Raises
    ------
    CaptureError
        When something cannot be read.
    """
    path = Path(path)
    try:
        if not path.is_dir():
            digest, size = _file_digest(path)
            return digest.hex(), size
        whole, total = hashlib.sha256(), 0
        for file in sorted(_files(path)):
            digest, size = _file_digest(file)
            name = file.relative_to(path).as_posix().encode("utf-8", "surrogateescape")
            whole.update(len(name).to_bytes(8, "big") + name + digest)
            total += size
        return whole.hexdigest(), total
    except OSError as error:
        reason = error.strerror or error
        raise CaptureError("{path}: cannot be read: {reason}", path=error.filename or path, reason=reason) from error


def settings_digest(settings: Mapping[str, object]) -> str:
    """SHA-256 of settings. A path among them counts as the content of its file.

    Parameters
    ----------
    settings : mapping of str to object
        What JSON can hold, and paths.

    Raises
    ------
    CaptureError
        When a file cannot be read.
    """
    return hashlib.sha256(json.dumps(settings_by_content(settings), sort_keys=True).encode()).hexdigest()


def settings_by_content(settings: Mapping[str, object]) -> dict[str, object]:
    """The settings, with ``{"content": SHA-256}`` in place of each path: that of the file, as of now.

    Raises
    ------
    CaptureError
        When a file cannot be read.
    """
    return {
        name: {"content": content_digest(value)[0]} if isinstance(value, Path) else value
        for name, value in settings.items()
    }


def _file_digest(path: Path) -> tuple[bytes, int]:
    digest, size = hashlib.sha256(), 0
    with open(path, "rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
            size += len(block)
    return digest.digest(), size


def _files(folder: Path, within: tuple[str, ...] = ()) -> Iterator[Path]:
    """All files within ``folder``, and in what links in it lead to; ``within``: the folders that it was reached by."""
    real = os.path.realpath(folder)
    if real in within:  # a link that leads in a circle
        return
    for entry in os.scandir(folder):
        if entry.name.startswith("."):
            continue
        path = folder / entry.name
        if os.path.isdir(path):
            yield from _files(path, (*within, real))
        elif os.path.isfile(path):
            yield path


def surroundings(path: Path) -> list:
    """What readers look at beside a capture's own bytes, for :func:`settings_digest`.

    Names: that of a data set's folder says which camera took it. Files: a lone image may have its lens and its colour
    beside it, and ``poses.json`` may name captures outside its folder.

    Raises
    ------
    CaptureError
        When a file cannot be read.
    """
    if os.path.isdir(path):
        real = path.resolve()
        found: list = []
        if holds_poses(path):
            captures = [path / name for name in read_poses(path / POSES_FILE)]
            found = [content_digest(one)[0] for one in captures if not one.resolve().is_relative_to(real)]
        lens = any((path / name).is_file() for name in INTRINSIC_NAMES)
        if lens and not any((path / name).is_file() for name in _NAMED):
            return found
        sensors = (sensor_named(part) for part in reversed(real.parts))
        return [*found, real.name, next((sensor for sensor in sensors if sensor != "unknown"), "unknown")]
    if path.suffix.lower() in _ALONE:
        return []
    beside = [*companions(path), *(path.with_name(name) for name in (*INTRINSIC_NAMES, COLOR_INTRINSIC_NAME))]
    color = color_beside(path)
    if color is not None:
        beside.append(color)
    return [[file.name, content_digest(file)[0]] for file in beside if os.path.isfile(file)]
