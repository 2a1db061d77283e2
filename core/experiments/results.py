"""How every experiment keeps its results: a table as CSV, a plot where matplotlib is there."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ..errors import OutputError
from ..files import replacing


def write_csv(path: Path, rows: Iterable[Sequence]) -> None:
    """Write rows of cells, the first the headings; raises :class:`OutputError`."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_bytes(path, lambda target: target.write_text(text.getvalue(), encoding="utf-8"))


def write_bytes(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary file that takes the place of ``path``."""
    try:
        with replacing(path) as temporary:
            write(temporary)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def plot(path: Path, size: tuple[float, float], panels: int, draw: Callable) -> str:
    """``draw(*axes)`` into a PNG of so many inches; returns why there is none, empty when there is."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return f"without {path.name}: matplotlib is missing; “pip install matplotlib”"
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    draw(*figure.subplots(1, panels, squeeze=False)[0])
    write_bytes(path, lambda target: figure.savefig(target, format="png", dpi=150))
    return ""
