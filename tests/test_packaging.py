"""What the wheel holds."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_every_subpackage_is_in_the_wheel():
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    there = {"mirror_scan"} | {
        "mirror_scan." + ".".join(init.parent.relative_to(ROOT).parts)
        for top in ("core", "mirror_scan_addon")
        for init in (ROOT / top).rglob("__init__.py")
    }
    assert listed == there
