"""Measurements as a table of comma-separated values."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

from ..io.atomic_files import replacing
from .measurements import Measurements

COLUMNS = ("name", "iso_8559_1_name", "mm", "error_mm")


def measurement_summary(measurements: Measurements) -> dict[str, dict]:
    """What ``report.json`` holds: {name: {"mm", "error_mm", "iso_name"}}, plain Python values."""
    return {
        name: {"mm": round(one.mm, 1), "error_mm": round(one.error_mm, 1), "iso_name": one.iso_name}
        for name, one in measurements.items()
    }


def measurement_rows(measurements: Measurements) -> list[tuple[str, str, str, str]]:
    """One row a measure: name, ISO 8559-1 name, value and 95 % bound in tenths of a millimetre."""
    return [(name, one.iso_name, f"{one.mm:.1f}", f"{one.error_mm:.1f}") for name, one in measurements.items()]


def write_measurements(path: str | os.PathLike, measurements: Measurements) -> None:
    """Write a CSV file (RFC 4180) of ``COLUMNS`` and one row a measure; it appears only when it is complete.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(COLUMNS)
    table.writerows(measurement_rows(measurements))
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(text.getvalue().encode("utf-8"))
