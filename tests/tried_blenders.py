"""Whether a Blender is newer than any that the manifest knows of: said, and tried all the same."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

MANIFEST = Path(__file__).resolve().parents[1] / "blender_manifest.toml"


def newer_than_tried(version: Sequence[int]) -> str:
    """A notice for a Blender from ``blender_version_max`` on; "" for one that was tried."""
    limit = tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["blender_version_max"]
    if tuple(version[:3]) < tuple(map(int, limit.split("."))):
        return ""
    shown = ".".join(map(str, version[:3]))
    return f"notice: Blender {shown} is newer than any tried (blender_version_max is {limit}); raise it if all is well"
