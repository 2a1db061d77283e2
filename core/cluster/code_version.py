"""Which program this is, to the last character of its code."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files
from pathlib import Path


@cache
def program_version() -> str:
    """Digest of the code of core: results of two programs with the same version are the same. About 30 ms, once."""
    root = Path(str(files(__package__))).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]
