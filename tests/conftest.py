"""Make ``mirror_scan`` importable from the checkout when it is not installed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

if importlib.util.find_spec("mirror_scan") is None:
    spec = importlib.util.spec_from_file_location(
        "mirror_scan", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["mirror_scan"] = module
    spec.loader.exec_module(module)
