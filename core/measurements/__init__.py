"""Measures of a scanned body, as a tape would run, with bounds of their errors."""

from .measurement_table import measurement_summary, write_measurements
from .measurements import ISO_NAMES, Measurement, Measurements, measure
from .uncertainty import Uncertainty, ViewError, view_errors

__all__ = [
    "ISO_NAMES",
    "Measurement",
    "Measurements",
    "Uncertainty",
    "ViewError",
    "measure",
    "measurement_summary",
    "view_errors",
    "write_measurements",
]
