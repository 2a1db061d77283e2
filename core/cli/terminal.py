"""What a command says, and how far it is."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..pipeline import Reconstruction
    from ..pipeline.reconstruction import Progress


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
    _print(text, sys.stdout)


def complain(kind: str, text: str) -> None:
    """One line on stderr, whatever line breaks the text has."""
    _print(f"{kind}: {' '.join(text.split())}", sys.stderr)


def _print(text: str, stream) -> None:
    """Print what the stream's encoding has, and ``?`` for the rest."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    print(text.encode(encoding, "replace").decode(encoding), file=stream, flush=True)


@contextlib.contextmanager
def progress_bar(quiet: bool) -> Iterator[Progress | None]:
    """A progress bar on a terminal; None elsewhere, or where tqdm is not (Blender's own Python)."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield None
        return
    with tqdm(total=100, leave=False, bar_format="{desc:<36.36}|{bar}| {percentage:3.0f} %  {elapsed}") as bar:

        def show(fraction: float, message: str) -> None:
            bar.set_description_str(message, refresh=False)
            bar.n = 100 * min(max(fraction, 0.0), 1.0)
            bar.refresh()

        yield show


def advance(progress: Progress | None, fraction: float, message: str) -> None:
    """Report progress, where there is a progress bar."""
    if progress:
        progress(fraction, message)


def stage_of(progress: Progress | None, start: float, end: float) -> Progress | None:
    """``progress`` for a stage that is only part of the whole."""
    if progress is None:
        return None
    return lambda fraction, message: progress(start + (end - start) * fraction, message)
