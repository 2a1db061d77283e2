"""What a command says, and how far it is."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from typing import TYPE_CHECKING, TextIO

from ..errors import OutputError
from ..numeric.kernel_warnings import kernel_warnings

if TYPE_CHECKING:
    from ..pipeline import Reconstruction
    from ..pipeline.reconstruction import Progress

_PLAIN = {
    "“": '"',
    "”": '"',
    "‘": "'",
    "’": "'",
    "–": "-",
    "—": "-",
    "−": "-",
    "×": "x",
    "…": "...",
    "›": ">",
    "·": "-",
}

_bars: list = []  # the progress bar that is shown, if one is
_heard: ContextVar[list[str] | None] = ContextVar("heard", default=None)  # where complaints go, if not to stderr


def summary_line(result: Reconstruction) -> str:
    """Size and soundness of the avatar, in one line."""
    mesh = result.report["mesh"]
    closed = "watertight" if mesh["watertight"] else "NOT watertight"
    return (
        f"avatar: {mesh['height_m']:.2f} m tall, {mesh['volume_l']:.1f} l, {mesh['vertices']} vertices, "
        f"{mesh['triangles']} triangles, {closed}"
    )


def distance_lines(distances: dict) -> Iterator[str]:
    """The figures of :func:`.surface_distance.evaluate` as a table."""
    yield "distances in mm        mean     95 %      max"
    for title, key in (("mesh to truth", "accuracy"), ("truth to mesh", "complete")):
        mean, p95, largest = (distances[f"{key}_{column}"] for column in ("mean", "p95", "max"))
        yield f"{title:<18}{mean:9.2f}{p95:9.2f}{largest:9.2f}"
    closed = "watertight" if distances["watertight"] else f"{distances['boundary_edges']} open edges"
    pieces = f"{distances['components']} component{'' if distances['components'] == 1 else 's'}"
    yield f"mesh: {distances['vertices']} vertices, {distances['faces']} faces, {pieces}, {closed}"
    yield (
        f"{distances['nonmanifold_edges']} non-manifold edges, "
        f"{distances['self_intersecting_faces']} faces that intersect others"
    )
    if distances["volume_error_pct"] is not None:
        yield f"volume {distances['volume_error_pct']:+.1f} %"
    yield f"measured after moving the mesh {distances['icp_shift_mm']:.1f} mm to where it fits best"


def say(text: str) -> None:
    """One line on stdout."""
    for bar in _bars:
        bar.clear()
    show(f"{text}\n", sys.stdout)


@contextlib.contextmanager
def complaints_heard() -> Iterator[list[str]]:
    """What :func:`complain` is given meanwhile in this thread, in place of being shown: lines as it would show them."""
    lines: list[str] = []
    before = _heard.set(lines)
    try:
        yield lines
    finally:
        _heard.reset(before)


def complain(kind: str, text: str) -> None:
    """One line on stderr, whatever line breaks the text has."""
    heard = _heard.get()
    if heard is not None:
        heard.append(f"{kind}: {' '.join(text.split())}")
        return
    for bar in _bars:
        bar.clear()  # it draws itself again below the line
    show(f"{kind}: {' '.join(text.split())}\n", sys.stderr)


def show(text: str, stream: TextIO | None) -> None:
    """Write what the stream's encoding has; nothing where there is no stream.

    Raises
    ------
    BrokenPipeError
        When its reader has gone away.
    OutputError
        When it cannot be written to for another reason, as a file on a full disk.
    """
    if stream is None:  # started without one, as services and programs without a console are
        return
    try:
        stream.write(spelled(text, stream))
        stream.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        stream_name = getattr(stream, "name", "the terminal")
        raise OutputError(
            "{stream}: cannot be written: {reason}", stream=stream_name, reason=error.strerror or error
        ) from error


def spelled(text: str, stream: TextIO) -> str:
    """The text in characters that the stream's encoding has: quotes and dashes as ASCII has them, else ``?``."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    try:
        text.encode(encoding)
        return text
    except UnicodeEncodeError:
        return "".join(_in_encoding(character, encoding) for character in text)
    except LookupError:  # a stream of somebody's own
        return text


def _in_encoding(character: str, encoding: str) -> str:
    for spelling in (character, _PLAIN.get(character, "?")):
        try:
            spelling.encode(encoding)
            return spelling
        except UnicodeEncodeError:
            pass
    return "?"


@contextlib.contextmanager
def progress_bar(quiet: bool) -> Iterator[Progress | None]:
    """A progress bar on a terminal; None elsewhere, or where tqdm is not (Blender's own Python)."""
    stream = sys.stderr
    if quiet or stream is None or not stream.isatty() or os.environ.get("TERM") == "dumb":
        yield None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield None
        return
    form = "{desc:<36.36}|{bar}| {percentage:3.0f} %  {elapsed}"
    with tqdm(total=100, leave=False, bar_format=form, file=stream) as bar:

        def advance(fraction: float, message: str) -> None:
            bar.set_description_str(spelled(message, stream), refresh=False)
            bar.n = 100 * min(max(fraction, 0.0), 1.0)
            bar.refresh()

        _bars.append(bar)
        try:
            yield advance
        finally:
            _bars.remove(bar)


def kernels_reported() -> contextlib.AbstractContextManager[None]:
    """Have what goes wrong with the cache of compiled code said as a warning of the command."""
    return kernel_warnings(lambda record: complain("warning", record.getMessage()))


def duration(seconds: float) -> str:
    """How long something takes, in words."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"


def advance(progress: Progress | None, fraction: float, message: str) -> None:
    """Report progress, where there is a progress bar."""
    if progress:
        progress(fraction, message)


def stage_of(progress: Progress | None, start: float, end: float) -> Progress | None:
    """``progress`` for a stage that is only part of the whole."""
    if progress is None:
        return None
    return lambda fraction, message: progress(start + (end - start) * fraction, message)
