"""The Blender side of Mirror Scan: everything that touches bpy.

Importing this package imports nothing: :mod:`.command` must work in a Python that has no bpy, and Blender's start must
not wait for what only a pressed button needs. numba is first imported inside an operator's job (:mod:`.numba_setup`).
"""

from __future__ import annotations

import atexit
from types import ModuleType


def _modules() -> tuple[ModuleType, ...]:
    """Modules with something to register, in the order of their needs."""
    from . import command, operators
    from .background import getting_ready, job_operators, second_process
    from .interface import menus, overlay, panels, preferences, rig_overlay
    from .language import texts
    from .scene import live_rig, live_subject, properties

    base = texts, properties, preferences, second_process, getting_ready, job_operators
    return *base, live_subject, live_rig, operators, overlay, rig_overlay, panels, menus, command


def register() -> None:
    """Add properties, operators, panels and the command-line command; on failure what was added is taken out again."""
    import bpy

    done: list[ModuleType] = []
    try:
        for module in _modules():
            module.register()
            done.append(module)
    except Exception:
        for module in reversed(done):
            module.unregister()
        raise
    if bpy.app.module:
        # A script that ends with classes or commands still registered hangs or crashes the bpy 4.5 module.
        atexit.register(unregister)


def unregister() -> None:
    """Take out what :func:`register` added, last first; what is under way is cancelled."""
    import bpy

    from .background import job_operators

    atexit.unregister(unregister)
    job_operators.cancel_all(bpy.context)
    for module in reversed(_modules()):
        module.unregister()
