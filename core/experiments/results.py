"""How every experiment keeps its results: a table as CSV, a picture, a plot where matplotlib is there."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from ..io.atomic_files import replacing
from ..io.images import write_png
from ..mesh import Mesh
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.surface_distance import SurfaceDistance

FIGURES = ("mean", "rms", "p95", "max")
"""Of a distance between surfaces: what the tables hold."""

NEAR_TO_FAR = ((40, 80, 210), (60, 175, 90), (240, 205, 60), (215, 40, 35))
"""Colours of a distance from none to the largest shown, 0..255."""


def distance_headings(*ways: str) -> list[str]:
    """Headings of :func:`distance_cells`."""
    return [f"{way}_{figure}_mm" for way in ways for figure in FIGURES]


def distance_cells(*distances: SurfaceDistance) -> list[str]:
    """The figures of distances between surfaces, in millimetres, as cells of a table."""
    return [f"{1e3 * getattr(distance, figure):.5f}" for distance in distances for figure in FIGURES]


def distance_colors(
    mesh: Mesh, reference: Mesh, full: float, stops: Sequence[tuple[int, int, int]] = NEAR_TO_FAR
) -> np.ndarray:
    """Colours (V, 3) uint8 of the vertices by their distance to ``reference``, the last for ``full`` [m] or more."""
    tree = build_bvh(
        np.ascontiguousarray(reference.vertices, np.float64), np.ascontiguousarray(reference.triangles, np.int32)
    )
    share = np.clip(closest_point(tree, mesh.vertices)[0] / full, 0.0, 1.0)
    at = np.linspace(0, 1, len(stops))
    return np.column_stack([np.interp(share, at, channel) for channel in np.array(stops, np.float64).T]).astype(
        np.uint8
    )


def keep(
    folder: Path, rows: Iterable[Sequence], picture: np.ndarray, draw: Callable, panels: int, size: tuple[float, float]
) -> tuple[list[Path], str]:
    """Write table.csv, result.png and, when matplotlib is there, plot.png into a folder that exists.

    Parameters
    ----------
    folder : Path
    rows : iterable of sequence
        The table's cells, the first the headings.
    picture : np.ndarray [shape=(H, W, 3), dtype=uint8]
    draw : callable
        ``draw(*axes)`` draws the plot's panels.
    panels : int
        How many there are, side by side.
    size : (float, float)
        Of the plot [inches].

    Returns
    -------
    paths : list of Path
    note : str
        Why there is no plot; empty when there is.

    Raises
    ------
    OutputError
        When a file cannot be written.
    """
    table, result, plot = (folder / name for name in ("table.csv", "result.png", "plot.png"))
    _write_csv(table, rows)
    write_png(result, picture)
    note = _plot(plot, size, panels, draw)
    return [table, result, *([] if note else [plot])], note


def _write_csv(path: Path, rows: Iterable[Sequence]) -> None:
    """Write rows of cells, the first the headings; raises :class:`OutputError`."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    with replacing(path) as target:
        target.write_text(text.getvalue(), encoding="utf-8")


def _plot(path: Path, size: tuple[float, float], panels: int, draw: Callable) -> str:
    """``draw(*axes)`` into a PNG of the given size [inch]; returns why there is none, or an empty text."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return f"without {path.name}: matplotlib is missing; “pip install matplotlib”"
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    draw(*figure.subplots(1, panels, squeeze=False)[0])
    with replacing(path) as target:
        figure.savefig(target, format="png", dpi=150)
    return ""
