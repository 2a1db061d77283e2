"""Names of a sequence's files: a mesh a frame, numbered, and the report beside them."""

from __future__ import annotations

from pathlib import Path

from ..errors import CaptureError

REPORT = "sequence.json"
MESH_FORMATS = (".ply", ".glb")
_DIGITS = 6


def frame_name(place: int, suffix: str) -> str:
    """Name of a frame's file; sorted by name, files are in the order of time."""
    return f"frame_{place:0{_DIGITS}d}{suffix}"


def frame_files(folder: Path) -> list[Path]:
    """The files of a sequence's frames in the order of time; of two formats the first of :data:`MESH_FORMATS`.

    Raises
    ------
    CaptureError
        There is none.
    """
    for suffix in MESH_FORMATS:
        found = sorted(folder.glob(f"frame_*{suffix}"))
        if found:
            return found
    raise CaptureError(
        "{folder}: holds no frames of a sequence, such as {name}; make them with “mirror-scan sequence”",
        folder=folder,
        name=frame_name(0, MESH_FORMATS[0]),
    )


def frame_place(file: Path) -> int:
    """The number in the name of a frame's file.

    Raises
    ------
    CaptureError
        There is none.
    """
    number = file.stem.removeprefix("frame_")
    if not (number.isascii() and number.isdigit()):
        raise CaptureError(
            "{file}: is not named as a frame of a sequence, such as {name}; rename it",
            file=file, name=frame_name(0, file.suffix),
        )  # fmt: skip
    return int(number)
