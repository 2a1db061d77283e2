"""The command line, one parser for ``mirror-scan …`` and ``blender --command mirror_scan …``.

Heavy modules are imported inside the commands, so that ``--help`` answers at once.
"""

from .parser import CAMERAS, SENSORS, build_parser
from .program import main

__all__ = ["CAMERAS", "SENSORS", "build_parser", "main"]
