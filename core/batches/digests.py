"""What a capture and settings are, as digests: a result made of the same of both need not be made again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

from ..capture.folders.rgbd_folder import INTRINSIC_NAMES, sensor_named
from ..errors import CaptureError
from .capture_list import RECORDINGS

_BLOCK = 1 << 20


def content_digest(path: str | os.PathLike) -> tuple[str, int]:
    """SHA-256 of a file, or of the files of a folder and their places in it, and how many bytes that is.

    Files are read a megabyte at a time. Names and times of the file or folder itself do not count, and neither do
    hidden files. About 1 s a gigabyte, the disk aside.

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
            digest, size = _file_digest(path / file)
            name = file.as_posix().encode("utf-8", "surrogateescape")
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
    plain = {
        name: {"content": content_digest(value)[0]} if isinstance(value, Path) else value
        for name, value in settings.items()
    }
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def _file_digest(path: Path) -> tuple[bytes, int]:
    digest, size = hashlib.sha256(), 0
    with open(path, "rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
            size += len(block)
    return digest.digest(), size


def _files(folder: Path) -> list[Path]:
    """All files within ``folder``, relative to it."""

    def stop(error: OSError) -> None:
        raise error

    found = []
    for place, folders, files in os.walk(folder, onerror=stop):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(place, name).relative_to(folder) for name in files if not name.startswith(".")]
    return found


def surroundings(path: Path) -> list:
    """What readers look at beside a capture's own bytes, for :func:`settings_digest`: names, or files next to it.

    The name of a folder says which camera took it where no file within does; a lone image may have its lens and its
    colour beside it.
    """
    if path.is_dir():
        if any((path / name).is_file() for name in INTRINSIC_NAMES):
            return []
        return [path.resolve().name, *(sensor_named(part) for part in path.resolve().parts)]
    if path.suffix.lower() in RECORDINGS:
        return []
    try:
        beside = [(entry.name, entry.stat()) for entry in os.scandir(path.parent) if entry.is_file()]
    except OSError as error:
        reason = error.strerror or error
        raise CaptureError("{path}: cannot be read: {reason}", path=path.parent, reason=reason) from error
    return sorted([name, status.st_size, status.st_mtime_ns] for name, status in beside)
