"""Which captures files, folders and patterns name: :func:`find_captures`."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from ..capture import is_capture
from ..capture.camera_poses import holds_poses
from ..errors import CaptureError, MirrorScanError
from .batch_folder import is_batch_folder

RECORDINGS = (".mkv", ".bag", ".db3", ".oni", ".r3d", ".npz", ".pcd", ".pclzf", ".ply")
"""Files that are looked at in folders; lone images there are parts of captures, or no captures, as a rule."""


class Found(NamedTuple):
    """A capture, or why there is none at ``path``."""

    path: Path
    error: MirrorScanError | None = None


def find_captures(paths: Iterable[str | os.PathLike]) -> list[Found]:
    """The captures that ``paths`` name, each once, in the order given; those of a folder in the order of their names.

    A file is a capture, and so is a folder that a reader recognises, or that holds several cameras' captures and their
    poses. Any other folder is searched, with what it holds, for such folders and for recordings; hidden folders and the
    results of batches are passed over. Text with ``*``, ``?`` or ``[`` is a pattern unless a file has that name;
    ``**`` stands for folders of any depth.

    Parameters
    ----------
    paths : iterable of path
        Need not exist: what is wrong with one becomes its ``error``.
    """
    found: dict[str, Found] = {}
    for given in paths:
        text = os.fspath(given)
        for one in _named(text):
            found.setdefault(os.path.realpath(one.path), one)
    return list(found.values())


def _named(text: str) -> Iterator[Found]:
    path = Path(text)
    if not os.path.lexists(text) and glob.has_magic(text):
        yield from _fitting(text)
    elif not os.path.isdir(text):
        yield Found(path)
    else:
        inside = list(_within(path))
        yield from inside or [
            Found(path, CaptureError("{path}: no capture was found in this folder or those within it", path=path))
        ]


def _fitting(pattern: str) -> Iterator[Found]:
    """What fits a pattern and is a capture; not what is part of one that fits, or of a batch's results."""
    matches = sorted(dict.fromkeys(_matches(pattern)), key=_natural)
    if not matches:
        yield Found(Path(pattern), CaptureError("{path}: no file or folder fits this pattern", path=pattern))
        return
    of_batches = cache(is_batch_folder)
    found: set[Path] = set()
    for match in map(Path, matches):
        if not found.isdisjoint(match.parents) or any(map(of_batches, (match, *match.parents))):
            continue
        for one in _within(match) if os.path.isdir(match) else _recording(match, any_file=True):
            found.add(one.path)
            yield one
    if not found:
        yield Found(Path(pattern), CaptureError("{path}: nothing that fits this pattern is a capture", path=pattern))


def _matches(pattern: str) -> list[str]:
    """What fits a pattern. As in a search, ``**`` passes over hidden folders and does not follow links."""
    parts = Path(pattern).parts
    if "**" not in parts:
        return glob.glob(pattern)
    at = parts.index("**")
    found: list[str] = []
    for head in glob.glob(os.path.join(*parts[:at])) if at else ["."]:
        for place, folders, files in os.walk(head):
            folders[:] = [name for name in folders if not name.startswith(".")]
            if parts[at + 1 :]:
                found += _matches(os.path.join(glob.escape(place), *parts[at + 1 :]))
            else:
                found += [place, *(os.path.join(place, name) for name in files)]
    return found


def _within(folder: Path) -> Iterator[Found]:
    """The folder itself, or what it holds."""
    try:
        if _is_folder_capture(folder):
            yield Found(folder)
            return
        entries = sorted(os.scandir(folder), key=lambda entry: _natural(entry.name))
    except OSError as error:
        yield _unreadable(folder, error)
        return
    for entry in entries:
        path = folder / entry.name
        if not os.path.isdir(path):
            yield from _recording(path)
        elif entry.name.startswith(".") or is_batch_folder(path):
            continue
        elif not (entry.is_symlink() or getattr(entry, "is_junction", bool)()):  # before Python 3.12 there is no second
            yield from _within(path)
        else:  # a link to a folder: taken, but not searched, since it may lead in a circle
            try:
                yield from [Found(path)] if _is_folder_capture(path) else []
            except OSError as error:
                yield _unreadable(path, error)


def _is_folder_capture(folder: Path) -> bool:
    return holds_poses(folder) or is_capture(folder)


def _recording(path: Path, any_file: bool = False) -> Iterator[Found]:
    if path.name.startswith(".") or not (any_file or path.suffix.lower() in RECORDINGS):
        return
    try:
        if is_capture(path):
            yield Found(path)
        elif path.suffix.lower() in RECORDINGS and os.path.isfile(path) and not path.stat().st_size:
            yield Found(path, CaptureError("{path}: is empty; copy or record it again", path=path))
    except OSError as error:
        yield _unreadable(path, error)


def _unreadable(path: Path, error: OSError) -> Found:
    reason = error.strerror or error
    return Found(path, CaptureError("{path}: cannot be read: {reason}", path=path, reason=reason))


def _natural(name: str) -> list[tuple[int, str]]:
    """``scan 10`` comes after ``scan 9``."""
    return [(int(part), "") if part.isdecimal() else (-1, part.casefold()) for part in re.split(r"(\d+)", name)]


def small_capture() -> Path:
    """A capture that comes with the program, small enough to be made into an avatar in no time."""
    return Path(str(resources.files(__package__))) / "small_capture.npz"
