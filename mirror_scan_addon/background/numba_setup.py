"""Sets up numba inside Blender, before the first module of core with kernels is imported."""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import sys

import bpy

from ...core.errors import MirrorScanError, Notice
from ...core.numeric.kernel_warnings import kernel_warnings
from ..extension_root import ROOT_PACKAGE, own_version
from ..language.texts import say

warnings: list[Notice] = []
"""What is wrong with the cache of compiled code; the next operator that ends a job reports it."""


def listening() -> contextlib.AbstractContextManager[None]:
    """Have what this process finds wrong with the cache of compiled code go to :data:`warnings`."""
    return kernel_warnings(lambda record: warnings.append(record.args[0]))


def prepare_kernels() -> None:
    """Import numba and point its cache of compiled code at :func:`cache_folder`, unless it has one already.

    Takes 0.2 to 1 s the first time, nothing after that.

    Raises
    ------
    MirrorScanError
        When numba is not there, which means that the extension was installed without its wheels.
    """
    try:
        import numba
    except ImportError as error:
        raise MirrorScanError(no_numba_text(error), code="program") from error
    if not numba.config.CACHE_DIR:
        numba.config.CACHE_DIR = cache_folder()


def no_numba_text(error: ImportError) -> str:
    """What to do when numba cannot be imported: which zip of Mirror Scan fits."""
    fitting = fitting_zip()
    if not fitting:
        text = say(
            "The Python package numba cannot be imported ({error}), and there is no zip of Mirror Scan for Python "
            "{python} on {platform}; use a Blender of blender.org, or put numba into this Python"
        )
    else:
        text = say(
            "The Python package numba cannot be imported ({error}); install the zip made for your platform and this "
            "Blender, which has Python {python}: {zip}"
        )
    return text.format(error=error, zip=fitting, python=_python(), platform=_platform() or sys.platform)


ZIP_OF = {"3.11": "", "3.13": "", "3.14": "-python3.14"}
"""Python → end of the name of the zip with wheels for it, as ``tools/extension.py`` builds them."""


def fitting_zip() -> str:
    """Name of the zip that fits this Blender; "" when there is none."""
    ending, platform = ZIP_OF.get(_python()), _platform()
    return f"mirror_scan-{own_version()}-{platform}{ending}.zip" if ending is not None and platform else ""


def _python() -> str:
    return f"{sys.version_info[0]}.{sys.version_info[1]}"


def _platform() -> str:
    """As names of zips have it; "" for one that there are no zips for."""
    import platform

    known = {("win32", "amd64"): "windows_x64", ("linux", "x86_64"): "linux_x64", ("darwin", "arm64"): "macos_arm64"}
    return known.get((sys.platform, platform.machine().lower()), "")


def cache_folder() -> str:
    """Where compiled kernels are kept: the extension's user folder; "" leaves it to numba.

    numba's default is ``__pycache__`` inside the extension, which an update removes and which may be read-only; with no
    writable place at all, importing a cached kernel fails.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return ""  # numba reads this variable itself
    return _extension_folder()


def compiling_text() -> str:
    """The message shown while kernels are compiled."""
    if _extension_folder.cache_info().currsize and _is_temporary(_extension_folder()):
        return say("Compiling for this session")
    return say("Compiling for this computer, once")


@functools.cache
def _extension_folder() -> str:
    try:
        folder = bpy.utils.extension_path_user(ROOT_PACKAGE, path="numba_cache", create=True)
    except ValueError:
        return ""  # installed by pip: numba's own choice is right there
    except OSError as error:
        folder, reason = "", str(error)
    else:
        reason = f"{folder} cannot be written to"
        if folder and os.path.isdir(folder) and os.access(folder, os.W_OK):
            return folder
    import logging  # these take tens of milliseconds, which Blender's start must not wait for
    import shutil
    import tempfile

    # Private and new in each session: the price is compiling again, never code that somebody else put there.
    temporary = tempfile.mkdtemp(prefix="mirror_scan_numba_")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    log = logging.getLogger(__name__)
    log.warning("Mirror Scan compiles again in each session, since it has nowhere to keep its cache: %s", reason)
    return temporary


def _is_temporary(folder: str) -> bool:
    return os.path.basename(folder).startswith("mirror_scan_numba_")
