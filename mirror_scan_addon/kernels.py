"""numba made ready inside Blender, before the first module of core that has kernels is imported."""

from __future__ import annotations

import os
import tempfile

import bpy

from .. import __package__ as ROOT_PACKAGE
from ..core.errors import MirrorScanError


def prepare_kernels() -> None:
    """Import numba and point its cache of compiled code at the extension's user folder, unless one is set already.

    numba's default is ``__pycache__`` inside the extension, which an update removes and which may be read-only; with no
    writable place at all, importing a cached kernel fails. Takes 0.2 s the first time, nothing after that.

    Raises
    ------
    MirrorScanError
        When numba is not there, which means that the extension was installed without its wheels.
    """
    try:
        import numba
    except ImportError as error:
        raise MirrorScanError(
            f"The Python package numba cannot be imported ({error}); install Mirror Scan from the zip made for your "
            "platform and this Blender version, or put numba into this Python"
        ) from error
    if numba.config.CACHE_DIR:
        return
    try:
        folder = bpy.utils.extension_path_user(ROOT_PACKAGE, path="numba_cache", create=True)
    except ValueError:
        return  # Installed by pip: numba's own choice is right there.
    except OSError:
        folder = ""
    if not folder or not os.access(folder, os.W_OK):
        # Private and new in each session: the price is compiling again, never code that somebody else put there.
        folder = tempfile.mkdtemp(prefix="mirror_scan_numba_")
    numba.config.CACHE_DIR = folder
