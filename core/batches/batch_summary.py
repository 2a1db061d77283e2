"""What became of each capture of a batch, as a table for programs (CSV) and a page for people (HTML)."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ..io.atomic_files import replacing

CSV_NAME, HTML_NAME = "summary.csv", "summary.html"
STATES = {"made": "made now", "kept": "made before", "failed": "failed", "left": "not reached"}
"""What can have become of a capture, and how the page says so."""
FIGURES = {
    "height_m": ("height", "{:.2f} m"),
    "volume_l": ("volume", "{:.1f} l"),
    "triangles": ("triangles", "{:,}"),
    "watertight": ("watertight", "{}"),
    "warnings": ("warnings", "{}"),
    "seconds": ("time", "{:.1f} s"),
    "memory_mb": ("memory", "{:.0f} MB"),
    "bytes_in": ("read", "{:,}"),
    "bytes_out": ("written", "{:,}"),
}
"""Columns of figures: their headings and formats on the page. Bytes stand only in the CSV."""
_ON_PAGE = tuple(name for name in FIGURES if not name.startswith("bytes"))


@dataclass(frozen=True)
class Row:
    """One capture of the summary.

    Parameters
    ----------
    capture : str
        As the user named it, with the frames taken of it, where not all were.
    state : str
        One of :data:`STATES`.
    folder : str
        Of its result, within the batch's; "" without.
    files : sequence of str
        Of its result.
    figures : dict
        Values of :data:`FIGURES`; may lack some.
    said : sequence of str
        Why it failed, or the warnings.
    picture : Path or None
        A PNG, read as the page is written.
    """

    capture: str
    state: str
    folder: str = ""
    files: Sequence[str] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)
    said: Sequence[str] = ()
    picture: Path | None = None


def write_summary(folder: Path, rows: Sequence[Row]) -> tuple[Path, Path]:
    """Write ``summary.csv`` and ``summary.html`` into ``folder``; an earlier one is replaced when the new is complete.

    The page needs no other file but the results that it links to: pictures lie in it.

    Raises
    ------
    OutputError
        When one cannot be written.
    """
    table, page = folder / CSV_NAME, folder / HTML_NAME
    try:
        with replacing(table) as temporary:
            # Spreadsheets need the mark at the start to read it as UTF-8.
            temporary.write_bytes(csv_text(rows).encode("utf-8-sig", "backslashreplace"))
    finally:  # a spreadsheet that has the table open keeps it on Windows, but not the page
        with replacing(page) as temporary, open(temporary, "wb") as file:
            for text in html_lines(rows):  # pictures of ten thousands are more than memory should hold
                file.write(f"{text}\n".encode("utf-8", "backslashreplace"))
    return table, page


def csv_text(rows: Sequence[Row]) -> str:
    """The table; a cell that a spreadsheet would take for a formula begins with an apostrophe."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(("capture", "state", "folder", *FIGURES, "said"))
    for row in rows:
        figures = ["" if row.figures.get(name) is None else row.figures[name] for name in FIGURES]
        writer.writerow([_cell(v) for v in (row.capture, row.state, row.folder, *figures, " | ".join(row.said))])
    return out.getvalue()


def _cell(value: object) -> object:
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r") else value


_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1d2733; background: #fff; margin: 2rem auto; max-width: 76rem;
  padding: 0 1rem }
h1 { font-size: 1.5rem; margin: 0 0 .3rem }
p { margin: 0 0 1.2rem; color: #4a5866 }
table { border-collapse: collapse; width: 100% }
th { text-align: left; font-weight: 600; border-bottom: 2px solid #1d2733; padding: .4rem .6rem; white-space: nowrap }
td { border-bottom: 1px solid #d5dde5; padding: .5rem .6rem; vertical-align: top }
td.figure, th.figure { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
td.name { overflow-wrap: anywhere; min-width: 12rem }
tr.failed td { background: #fdf0ee }
tr.left td { color: #7a8ea3 }
.state { font-weight: 600; white-space: nowrap }
.failed .state { color: #b3261e }
.made .state, .kept .state { color: #1b6e3c }
.said { color: #4a5866; font-size: .87rem; margin: .25rem 0 0; padding: 0; list-style: none }
.failed .said { color: #7d1b15 }
img { display: block; border-radius: 4px }
a { color: #0b57a4 }
"""


def html_lines(rows: Sequence[Row]) -> Iterator[str]:
    """The page."""
    headings = "".join(f'<th class="figure">{escape(FIGURES[name][0])}</th>' for name in _ON_PAGE)
    title = f"{len(rows)} capture{'' if len(rows) == 1 else 's'}"
    yield '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width">'
    yield f"<title>Mirror Scan: {title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>"
    yield f"<h1>{title}</h1>\n<p>{escape(counts_line(rows))}</p>"
    yield f"<table>\n<thead><tr><th></th><th>capture</th><th></th>{headings}</tr></thead>\n<tbody>"
    yield from map(_html_row, rows)
    yield "</tbody>\n</table>\n</body>\n</html>"


def counts_line(rows: Sequence[Row]) -> str:
    """How many of each state there are, as a sentence."""
    counts = {words: sum(row.state == state for row in rows) for state, words in STATES.items()}
    return ", ".join(f"{count} {words}" for words, count in counts.items() if count) or "nothing to do"


def _html_row(row: Row) -> str:
    picture = ""
    if row.picture is not None and row.picture.is_file():
        data = base64.b64encode(row.picture.read_bytes()).decode("ascii")
        picture = f'<img alt="front and back" src="data:image/png;base64,{data}">'
    return "".join(
        (
            f'<tr class="{row.state}"><td>{picture}</td><td class="name">{escape(row.capture)}',
            "".join(_said(row)),
            f'</td><td><span class="state">{escape(STATES[row.state])}</span><br>{_links(row)}</td>',
            *(f'<td class="figure">{escape(_figure(name, row.figures.get(name)))}</td>' for name in _ON_PAGE),
            "</tr>",
        )
    )


def _said(row: Row) -> Iterator[str]:
    if row.said:
        yield '<ul class="said">'
        yield from (f"<li>{escape(text)}</li>" for text in row.said)
        yield "</ul>"


def _links(row: Row) -> str:
    place = quote(row.folder.encode("utf-8", "surrogateescape"))
    return "<br>".join(f'<a href="{place}/{quote(name)}">{escape(name)}</a>' for name in row.files)


def _figure(name: str, value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return FIGURES[name][1].format(value)
