"""Files that appear under their name only when they are complete."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from .errors import OutputError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Name of a temporary file beside ``path`` that takes its place when the block ends well.

    The temporary name keeps the suffix, for writers that go by it. When the block raises, ``path`` keeps what it
    held and the temporary file is removed. A symbolic link stays a link: the file it names is replaced.

    Raises
    ------
    OutputError
        When the folder is missing or cannot be written to, ``path`` is not a regular file, or the disk is full.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OutputError(f"{path}: is not a regular file; give the name of a file to write")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: the folder {target.parent} does not exist; create it first")
    temporary = target.with_name(f".{target.stem[:100]}.{secrets.token_hex(6)}{target.suffix}")
    try:
        temporary.touch(exist_ok=False)  # asked here, where it can be told in words, not somewhere within a writer
        temporary.unlink()
        yield temporary
        if not temporary.is_file():
            raise OutputError(f"{path}: its writer made no file")
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
