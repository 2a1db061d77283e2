"""The folder that a batch writes to: a folder a capture, which appears only when all that belongs in it is there.

What a capture's folder was made of stands in its ``record.json``, so that nothing is ever made twice, and nothing that
is not a batch's is ever replaced.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shutil
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

from ..errors import OutputError
from ..io.atomic_files import replacing

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MARKER = "batch.json"
_FORMAT = "mirror-scan batch"
RECORD = "record.json"
UNFINISHED = ".unfinished"
OURS = ("summary.csv", "summary.html", "workers.log")
"""Files of a batch beside its results; no result's folder has such a name."""
_LONGEST = 120  # bytes of a folder's name; file systems take 255, and numbers may be added
_RESERVED = re.compile(r"(con|conin\$|conout\$|prn|aux|nul|(com|lpt)[\d¹²³])(\..*)?", re.IGNORECASE)  # on Windows


@dataclass(frozen=True)
class Finished:
    """The record of a result.

    Parameters
    ----------
    key : str
        Digest of what it was made of: content, settings, program.
    source : str
        Absolute path of the capture, with the frames taken of it, where not all were.
    files : dict of str to int
        Names of the result's files, and their sizes [bytes].
    figures : dict
        What the summary shows of it.
    folder : str
        Name of its folder; not in the record, which may have been renamed.
    """

    key: str
    source: str
    files: dict[str, int]
    figures: dict[str, Any] = field(default_factory=dict)
    folder: str = ""


def is_batch_folder(folder: Path) -> bool:
    """Whether a batch was written there."""
    try:
        with open(folder / MARKER, encoding="utf-8") as file:
            marker = json.loads(file.read(1000))
    except (OSError, ValueError):
        return False
    return isinstance(marker, dict) and marker.get("format") == _FORMAT


def open_batch_folder(folder: str | os.PathLike) -> BatchFolder:
    """A folder for a batch's results: a new one, an empty one, or that of an earlier batch.

    Raises
    ------
    OutputError
        When it holds anything else, another batch writes to it, or it cannot be made or written to.
    """
    folder = Path(folder)
    try:
        if folder.exists() and not is_batch_folder(folder) and (not folder.is_dir() or any(folder.iterdir())):
            raise OutputError(
                "{folder}: exists and is not the folder of an earlier batch; choose another name", folder=folder
            )
        folder.mkdir(parents=True, exist_ok=True)
        if not is_batch_folder(folder):
            with replacing(folder / MARKER) as temporary:
                _write(temporary, f'{{"format": "{_FORMAT}", "version": 1}}\n'.encode("ascii"))
        lock = _locked(folder)
        shutil.rmtree(folder / UNFINISHED, ignore_errors=True)  # of a batch that was ended by force
        (folder / UNFINISHED).mkdir(exist_ok=True)  # so that what cannot be written to is known before the work
    except OSError as error:
        reason = error.strerror or error
        raise OutputError("{folder}: cannot be written to: {reason}", folder=folder, reason=reason) from error
    return BatchFolder(folder, lock)


def _locked(folder: Path) -> IO[bytes]:
    """The marker, which no other batch can lock until it is closed, or this process ends, however it ends."""
    file = open(folder / MARKER, "r+b")
    try:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt

            file.seek(1 << 20)  # beyond its end, so that it can still be read
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]  # only Windows has it
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
            file.close()
            raise OutputError(
                "{folder}: another batch is writing to it; wait until it has ended, or choose another folder",
                folder=folder,
            ) from error
        # else a network disk without locks
    return file


class BatchFolder:
    """Results of a batch, by what they were made of and by where their captures lie; of :func:`open_batch_folder`."""

    def __init__(self, folder: Path, lock: IO[bytes]) -> None:
        self.path, self._lock = folder, lock
        self._by_key: dict[str, Finished] = {}
        self._by_source: dict[str, Finished] = {}
        self._taken = dict.fromkeys(OURS, "")  # name, as file systems compare it, → source
        for name in sorted(os.listdir(folder)):
            self._taken[_compared(name)] = ""
            found = read_record(folder / name)
            if found is not None:
                self._enter(found)

    def __iter__(self) -> Iterator[Finished]:
        return iter(self._by_source.values())

    def finished(self, key: str, source: str) -> Finished | None:
        """The result with that key: of ``source`` itself where it has one, else of the same content elsewhere."""
        own = self._by_source.get(source)
        return own if own is not None and own.key == key else self._by_key.get(key)

    def name_for(self, source: str, wanted: str) -> str:
        """Name of the folder of a capture's result: the one it has, or ``wanted``, made fit and different from all."""
        if source in self._by_source:
            return self._by_source[source].folder
        name = fit_name(wanted)
        number, chosen = 1, name
        while self._taken.get(_compared(chosen), source) != source:
            number += 1
            chosen = f"{name}_{number}"
        self._taken[_compared(chosen)] = source
        return chosen

    def keep(self, name: str, finished: Finished, files: Mapping[str, bytes]) -> Finished:
        """Write a result; its folder appears, or takes the place of this source's earlier one, when it is complete.

        Raises
        ------
        OutputError
            When it cannot be written, or ``name`` is not this source's.
        """
        finished = Finished(finished.key, finished.source, {n: len(d) for n, d in files.items()}, finished.figures)
        target = self.path / name
        earlier = read_record(target)
        if target.exists() and (earlier is None or earlier.source != finished.source):
            raise OutputError("{folder}: exists already; move it away or choose another folder", folder=target)
        temporary = self.path / UNFINISHED / secrets.token_hex(8)
        try:
            (temporary / "new").mkdir(parents=True)
            for file, data in files.items():
                _write(temporary / "new" / file, data)
            record = asdict(finished)
            del record["folder"]
            text = json.dumps(record, indent=1)  # escaped: a name need not be UTF-8
            _write(temporary / "new" / RECORD, f"{text}\n".encode("ascii"))
            if target.exists():
                os.replace(target, temporary / "old")
            try:
                os.replace(temporary / "new", target)
            except OSError:
                if (temporary / "old").exists():
                    os.replace(temporary / "old", target)
                raise
        except OSError as error:
            reason = error.strerror or error
            raise OutputError("{folder}: cannot be written: {reason}", folder=target, reason=reason) from error
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        return self._enter(Finished(finished.key, finished.source, finished.files, finished.figures, name))

    def files_of(self, finished: Finished) -> dict[str, bytes]:
        """The files of a result, to keep it once more under another name.

        Raises
        ------
        OutputError
            When one cannot be read.
        """
        try:
            return {name: (self.path / finished.folder / name).read_bytes() for name in finished.files}
        except OSError as error:
            reason = error.strerror or error
            raise OutputError("{path}: cannot be read: {reason}", path=error.filename, reason=reason) from error

    def close(self) -> None:
        """Remove what only a running batch needs, and let others write to the folder."""
        shutil.rmtree(self.path / UNFINISHED, ignore_errors=True)
        self._lock.close()

    def _enter(self, finished: Finished) -> Finished:
        earlier = self._by_source.get(finished.source)
        if earlier is not None and self._by_key.get(earlier.key) is earlier:
            del self._by_key[earlier.key]  # its folder holds something else now
        self._by_key.setdefault(finished.key, finished)
        self._by_source[finished.source] = finished
        self._taken[_compared(finished.folder)] = finished.source
        return finished


def _write(path: Path, data: bytes) -> None:
    """Write a file so that it is on the disk before its folder takes its name: a power cut leaves no empty files."""
    with open(path, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def read_record(folder: Path) -> Finished | None:
    """The record of a result; None where there is none, or a file of the result is missing or of another size."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        found = Finished(record["key"], record["source"], record["files"], record["figures"], folder.name)
        whole = all((folder / name).stat().st_size == size for name, size in found.files.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return found if whole else None


def fit_name(wanted: str) -> str:
    """A name that every file system takes: nothing but its letters, whatever their script, spaces and plain signs."""
    text = unicodedata.normalize("NFC", wanted.encode("utf-8", "replace").decode("utf-8"))
    text = "".join("_" if c in '<>:"/\\|?*' or not c.isprintable() else c for c in text)
    while len(text.encode()) > _LONGEST:
        text = text[:-1]
    text = text.strip(" .") or "capture"
    return f"_{text}" if _RESERVED.fullmatch(text) else text


def _compared(name: str) -> str:
    """Names that some file system takes for the same are the same."""
    return unicodedata.normalize("NFC", name).casefold()
