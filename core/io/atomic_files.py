"""Files and folders that appear under their name only when they are complete."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..errors import OutputError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Name of a temporary file beside ``path`` that takes its place when the block ends well.

    The temporary name keeps the suffix, for writers that go by it. When the block raises, ``path`` keeps what it
    held and the temporary file is removed. A symbolic link stays a link: the file it names is replaced.

    Raises
    ------
    OutputError
        When the folder is missing or cannot be written to, ``path`` is not a regular file, the disk is full, or what
        was written is empty.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OutputError(f"{path}: is not a regular file; give the name of a file to write")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: the folder {target.parent} does not exist; create it first")
    temporary = target.with_name(f".{target.stem[:20]}.{secrets.token_hex(6)}{target.suffix}")  # names hold 255 bytes
    try:
        temporary.touch(exist_ok=False)  # fails here with a clear message rather than somewhere within a writer
        temporary.unlink()
        yield temporary
        if not temporary.is_file():
            raise OutputError(f"{path}: its writer made no file")
        if not temporary.stat().st_size:
            raise OutputError(f"{path}: its writer made an empty file")
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}; choose another folder") from error
    finally:
        temporary.unlink(missing_ok=True)


def final_stem(path: str | os.PathLike) -> str:
    """The stem of a file, also of one that :func:`replacing` still has under a temporary name."""
    stem = Path(path).stem
    found = re.fullmatch(r"\.(.+)\.[0-9a-f]{12}", stem)
    return found.group(1) if found else stem


@contextlib.contextmanager
def replacing_with_companions(path: str | os.PathLike) -> Iterator[Path]:
    """As :func:`replacing`, for a writer that makes files beside its own: images, materials.

    The name that is given lies in a folder of its own. What stands there in the end goes beside ``path``, the
    companions first, so that ``path`` appears only when all it names is there.
    """
    path = Path(path)
    with replacing(path) as main, tempfile.TemporaryDirectory(prefix=f".{path.stem[:20]}.", dir=main.parent) as folder:
        inner = Path(folder) / path.name
        yield inner
        for companion in sorted(file for file in Path(folder).rglob("*") if file.is_file() and file != inner):
            target = main.parent / companion.relative_to(folder)
            target.parent.mkdir(exist_ok=True)
            os.replace(companion, target)
        if inner.is_file():
            os.replace(inner, main)


def free_folder(folder: str | os.PathLike, replace: bool = False) -> Path:
    """Where :func:`fresh_folder` would make a folder; so that what cannot be is told before long work.

    Raises
    ------
    OutputError
        When ``folder`` exists already and holds something that may not be replaced, or its parent is missing.
    """
    target = Path(os.path.realpath(folder))
    if target.exists() and (not target.is_dir() or (not replace and any(target.iterdir()))):
        raise OutputError(f"{folder}: exists already; choose another name")
    if not target.parent.is_dir():
        raise OutputError(f"{folder}: the folder {target.parent} does not exist; create it first")
    return target


@contextlib.contextmanager
def fresh_folder(folder: str | os.PathLike, replace: bool = False) -> Iterator[Path]:
    """Name of a folder to make and fill that takes the name ``folder`` when the block ends well.

    When the block raises, what it made is removed and ``folder`` keeps what it held.

    Parameters
    ----------
    folder : path
        Must not exist, or be empty.
    replace : bool
        A folder that holds something is replaced.

    Raises
    ------
    OutputError
        When ``folder`` exists already, its parent is missing, or it cannot be written.
    """
    target = free_folder(folder, replace)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as temporary:
            fresh, stale = Path(temporary) / "new", Path(temporary) / "old"
            yield fresh
            if target.exists():
                os.replace(target, stale)
            try:
                os.replace(fresh, target)
            except OSError:
                if stale.exists():
                    os.replace(stale, target)
                raise
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}; choose another folder") from error
