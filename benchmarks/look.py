"""The avatar worth looking at, part by part: texture, fewer triangles and print, measurements, cloth.

``python -m benchmarks --only look [--quick]``; each part is a module of its own, ``look_texture`` and so on.
"""

from __future__ import annotations

from . import look_cloth, look_measures, look_reduction, look_texture
from .results import Result


def run(quick: bool = False) -> Result:
    """All parts; quick: fewer bodies."""
    parts = [module.tables(quick) for module in (look_texture, look_reduction, look_measures, look_cloth)]
    return Result([t for part in parts for t in part.tables], [f for part in parts for f in part.findings])
