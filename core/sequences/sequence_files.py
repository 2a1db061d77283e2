"""The files of a sequence: a mesh a frame under numbered names, and ``sequence.json``: what became of each."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from ..avatar.avatar_file import Avatar, read_body, write_avatar
from ..errors import OutputError
from ..io import write_mesh
from ..io.atomic_files import replacing
from ..io.frame_files import MESH_FORMATS, REPORT, frame_name
from ..mesh import Mesh
from .sequence import BRIDGED, LOST, MADE, SequenceFrame

FORMAT, VERSION = "mirror-scan sequence", 1

_NEWER = ("content", "beside")  # of what a sequence is made of: reports of before do not say it
_IN_WORDS = {
    "recording": "name of the recording", "bytes": "content of the recording", "content": "content of the recording",
    "beside": "files beside the recording", "numbers": "numbers of the frames", "--formats": "--format",
}  # fmt: skip
_REPORT_S = 5.0  # the report is written at most so often while frames come [s]


class SequenceFolder:
    """Writes a sequence into a folder, frame by frame; whatever happens, what stands there is whole.

    Parameters
    ----------
    folder : Path
        Made when it is missing.
    formats : sequence of str
        Of :data:`MESH_FORMATS`.
    facts : dict
        Of the recording, the rig and the settings: what a sequence must have in common to be gone on with.
    resume : bool
        Go on with a sequence that is there, made of the same by the same settings.

    Attributes
    ----------
    kept : dict
        Of a sequence that is gone on with: what its report said of the rig.

    Raises
    ------
    OutputError
        The folder holds something else, or a sequence that is not to be gone on with.
    """

    def __init__(self, folder: Path, formats: Sequence[str], facts: dict, resume: bool = False) -> None:
        for suffix in formats:
            if suffix not in MESH_FORMATS:
                raise OutputError(f"{folder}: frames are written as {', '.join(MESH_FORMATS)}, not as {suffix}")
        self.folder, self._formats, self._facts = folder, tuple(formats), facts
        self._rows: dict[int, dict] = {}
        self._reported = float("-inf")
        self.kept: dict = {}
        self._begin(resume)

    def _begin(self, resume: bool) -> None:
        there = sorted(self.folder.iterdir()) if self.folder.is_dir() else []
        if self.folder.exists() and not self.folder.is_dir():
            raise OutputError(f"{self.folder}: is no folder; give the name of a folder to make")
        if there and not resume:
            raise OutputError(
                f"{self.folder}: holds {there[0].name} already; choose another folder, or go on (--resume)"
            )
        if there:
            self._go_on()
        self._is_new = not self.folder.exists()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot be made a folder: {error.strerror or error}") from error

    def _go_on(self) -> None:
        path = self.folder / REPORT
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            rows = {int(row["place"]): row for row in content["frames"] if row["state"] in (MADE, BRIDGED, LOST)}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(f"{path}: is no report of a sequence to go on with; choose another folder") from error
        other = _differing(content.get("made_of"), json.loads(json.dumps(self._facts)))
        if other:
            raise OutputError(
                "{path}: this sequence was made of another recording, or with other settings ({names}); choose "
                "another folder",
                path=path, names=", ".join(other),
            )  # fmt: skip
        self.kept = {"rig": content["rig"]} if "rig" in content else {}
        self._rows = {place: row for place, row in rows.items() if self._is_whole(row)}

    def _is_whole(self, row: dict) -> bool:
        names = [frame_name(int(row["place"]), suffix) for suffix in self._formats]
        if row.get("again"):  # it may be made now
            return False
        return row["state"] == LOST or all((self.folder / name).is_file() for name in names)

    def first_reason(self) -> str:
        """Why the first of the frames that have no mesh of their own was not made; empty where all were."""
        return next((row["reason"] for _, row in sorted(self._rows.items()) if row.get("reason")), "")

    def has(self, place: int) -> bool:
        """Whether a frame is there already."""
        return place in self._rows

    def places(self, bridged: bool = False) -> list[int]:
        """Frames that were made, in order; with ``bridged`` those that hold another's mesh, too."""
        states = (MADE, BRIDGED) if bridged else (MADE,)
        return [place for place, row in sorted(self._rows.items()) if row["state"] in states]

    def mesh_if_any(self, place: int) -> Mesh | None:
        """The mesh of a frame, as it was written; None of one that was lost."""
        return None if self._rows[place]["state"] == LOST else self.mesh(place)

    def mesh(self, place: int) -> Mesh:
        """The mesh of a frame, as it was written."""
        return read_body(self.folder / frame_name(place, self._formats[0]))

    def add(self, frame: SequenceFrame, extra: dict | None = None) -> None:
        """Write a frame, and every few seconds the report: who is ended by force can be gone on with.

        ``extra``: what the report says beside the frames, so far.
        """
        for suffix in self._formats:
            path = self.folder / frame_name(frame.place, suffix)
            if frame.mesh is None:
                path.unlink(missing_ok=True)
                continue
            with replacing(path) as temporary:
                write_frame(temporary, frame.mesh)
        self._rows[frame.place] = row_of(frame)
        if time.monotonic() - self._reported > _REPORT_S:
            self._report(extra or {})

    def finish(self, extra: dict) -> dict:
        """Write ``sequence.json``; what was done up to here is in it. Returns its content.

        Where no frame was done nothing is left behind.
        """
        if self._rows:
            return self._report(extra)
        if self._is_new and not any(self.folder.iterdir()):
            self.folder.rmdir()
        return report_of(self._facts, [], extra)

    def _report(self, extra: dict) -> dict:
        content = report_of(self._facts, [self._rows[place] for place in sorted(self._rows)], extra)
        with replacing(self.folder / REPORT) as temporary:
            temporary.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        self._reported = time.monotonic()
        return content


def _differing(before: object, now: dict) -> list[str]:
    """What differs between what a sequence was made of and what it would be now, in words.

    Content of the recording and of files, which reports of before do not say, is passed over there.
    """
    if not isinstance(before, dict):
        return ["all of it"]
    names = [name for name in now if before.get(name) != now[name] and not (name in _NEWER and name not in before)]
    options, given = before.get("options"), now.get("options")
    if "options" in names and isinstance(options, dict) and isinstance(given, dict):
        changed = [name for name in sorted({*options, *given}) if not _is_same(options.get(name), given.get(name))]
        names += [f"--{name.replace('_', '-')}" for name in changed]
        names.remove("options")
    return list(dict.fromkeys(_IN_WORDS.get(name, name) for name in names))


def _is_same(before: object, now: object) -> bool:
    """Whether an option is what it was; reports of before have a file's path where now its content is."""
    return before == now or (isinstance(now, dict) and isinstance(before, str) and before != "None")


def write_frame(path: Path, mesh: Mesh) -> None:
    """A mesh as .ply or .glb, by the suffix."""
    if path.suffix == ".glb":
        write_avatar(path, Avatar(mesh))
    else:
        write_mesh(path, mesh)


def row_of(frame: SequenceFrame) -> dict:
    """What the report says of a frame."""
    row: dict = {"place": frame.place, "number": frame.number, "state": frame.state}
    if frame.reason:
        row["reason"] = str(frame.reason)
    if frame.again:
        row["again"] = True
    row |= {"steadied_share": round(frame.steadied, 4), "seconds": round(frame.seconds, 3)}
    if frame.report is not None:
        mesh = frame.report["mesh"]
        row |= {key: mesh[key] for key in ("vertices", "triangles", "watertight", "manifold", "volume_l", "height_m")}
    return row


def report_of(facts: dict, rows: Sequence[dict], extra: dict) -> dict:
    """The content of ``sequence.json``."""
    counts = {state: sum(row["state"] == state for row in rows) for state in ("made", "bridged", "lost")}
    seconds = [row["seconds"] for row in rows if row["state"] == MADE]
    return {
        "format": FORMAT, "version": VERSION, "made_of": facts, "counts": counts,
        "seconds_a_frame": round(sum(seconds) / len(seconds), 3) if seconds else None,
        **extra, "frames": list(rows),
    }  # fmt: skip
