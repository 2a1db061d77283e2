"""Blender's Bridge Edge Loops and Fill Holes on our patches, in a process of its own."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.mesh import Mesh

from .isolated import Worker
from .machine import installed, milliseconds

BLENDER = "Blender bridge + fill"
_worker = Worker()


def blender_bridge(patches: Mesh) -> tuple[Mesh, float] | None:
    """What Blender makes of patches separated by ``view``, and the time of its tools alone [ms].

    None where bpy is not installed or cannot be imported, as without the libraries it needs from the system. Raises
    :class:`.isolated.PeerFailed`.
    """
    if not installed("bpy"):
        return None
    return _worker.call(_bridge, patches.vertices, patches.triangles, patches.view)


def _bridge(vertices: np.ndarray, triangles: np.ndarray, view: np.ndarray) -> tuple[Mesh, float] | None:
    try:
        import bpy  # noqa: F401  registers bmesh and mathutils in the bpy module
        from mirror_scan.mirror_scan_addon.bridge_edge_loops import bridge_and_fill, facing_runs
    except ImportError:
        return None
    patches = Mesh(vertices, triangles, view=view)
    pairs = facing_runs(patches)  # a user's selecting takes minutes; the tools alone are timed
    spent, mesh = milliseconds(lambda: bridge_and_fill(patches, pairs))
    return mesh, spent
