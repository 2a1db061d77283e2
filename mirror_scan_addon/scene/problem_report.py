"""What a report of a problem says: versions, the numbers of the last avatar's report, the last error.

No pictures, no paths and no names: neither of files nor of people, objects, mirrors or cameras. Measurements of the
body and places in the room are left out too.
"""

from __future__ import annotations

import re
import sys

import bpy

from ..background import last_problem
from ..extension_root import own_version
from . import report_text

LEFT_OUT = ("measurements", "joints", "point", "normal", "covariance", "camera_to_avatar", "problems", "notices")
"""What of a report is about the body or the room, or too long to read."""

NAMED = ("view_shares", "gains", "shifts")
"""What of a report goes by names that are the user's: they are counted instead."""

COLUMNS = 100  # of a line, so that the dialog shows all of it

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_UNTOLD = ("name", "between", "sensor", "by")


def problem_report(context: bpy.types.Context) -> str:
    """The whole text, English, in lines that the dialog shows whole."""
    import textwrap

    errors = last_problem.last() or ["none in this session"]
    lines = [*versions(), "", "Last error:", *(f"  {line}" for line in errors), "", "Last avatar's report:"]
    report = last_report(context)
    if report is None:
        lines.append("  none in this scene")
    else:
        lines += [f"  {line}" for line in figures(report)]
        warnings = [warning for warning in report.get("warnings", ()) if isinstance(warning, str)]
        lines += [f"  warning: {last_problem.without_names(warning) or 'not one of ours'}" for warning in warnings]
    broken = (textwrap.wrap(line, COLUMNS, subsequent_indent="    ") or [""] for line in lines)
    return "\n".join(line for part in broken for line in part)


def versions() -> list[str]:
    """Versions of what takes part; numba's without importing it."""
    import platform

    import numpy

    python = ".".join(map(str, sys.version_info[:3]))
    return [
        f"Mirror Scan {own_version()}",
        f"Blender {bpy.app.version_string}{' (without a window)' if bpy.app.background else ''}",
        f"Python {python}, numpy {numpy.__version__}, numba {_numba_version()}",
        f"{platform.system()} {platform.release()}, {platform.machine()}",
    ]


def _numba_version() -> str:
    import importlib.metadata

    try:
        return importlib.metadata.version("numba")
    except importlib.metadata.PackageNotFoundError:
        return "is missing"


def last_report(context: bpy.types.Context) -> dict | None:
    """The report of the active avatar, else of the scene's newest one; None where there is none."""
    newest_first = sorted(context.scene.objects, key=lambda item: item.session_uid, reverse=True)
    for item in (context.object, *newest_first):
        report = report_text.avatar_report(item)
        if report is not None:
            return report
    return None


def figures(report: dict) -> list[str]:
    """The numbers of a report, those of one place in it in a line, as ``views[1]: noise_mm 0.83, frames 6``."""
    places: dict[str, list[str]] = {}
    for key, value in _figures(report, ""):
        place, _, name = key.rpartition(".")
        places.setdefault(place, []).append(f"{name} {value}")
    return [f"{place}: {', '.join(values)}" if place else ", ".join(values) for place, values in places.items()]


def _figures(value: object, key: str):
    if isinstance(value, bool | int):
        yield key, str(value)
    elif isinstance(value, float):
        yield key, f"{value:.4g}"
    elif isinstance(value, list) and value and all(isinstance(item, int | float) for item in value):
        yield key, " ".join(f"{item:.4g}" for item in value)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _figures(item, f"{key}[{number}]")
    elif isinstance(value, dict):
        counted = key.rpartition(".")[2] in NAMED
        for number, (name, item) in enumerate(value.items()):
            if counted:
                yield from _figures(item, f"{key}[{number}]")
            elif name not in (*LEFT_OUT, *_UNTOLD) and _WORD.fullmatch(name):
                yield from _figures(item, f"{key}.{name}" if key else name)
