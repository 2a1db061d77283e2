"""Under which name and in which folder this extension is installed; Blender, pip and a checkout differ in both.

Everything that needs either asks here; only :mod:`.background.worker`, a script that stands outside every package, is
told both on its way in.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT_PACKAGE = __package__.rpartition(".")[0]
"""Such as ``bl_ext.user_default.mirror_scan``."""

ROOT_FOLDER = Path(sys.modules[ROOT_PACKAGE].__path__[0])
ADDON_FOLDER = Path(sys.modules[__package__].__path__[0])


def own_version() -> str:
    """Of the extension by its manifest, of the pip package by its metadata."""
    import tomllib

    try:
        with open(ROOT_FOLDER / "blender_manifest.toml", "rb") as file:
            return tomllib.load(file)["version"]
    except FileNotFoundError:
        import importlib.metadata

        return importlib.metadata.version("mirror_scan")
