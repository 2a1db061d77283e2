"""Blender's bridge in a process of its own: run as ``python -m benchmarks.bridge PATCHES.npz RESULT.npz``.

bpy brings its own versions of libraries that the other peers bring too, and its tools can crash or take for ever on
what a scan hands them; neither must end the run. The result holds the time of the call [ms].
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mirror_scan.core.mesh import Mesh

TIME_LIMIT = 60.0
NO_BLENDER = 77
"""Exit code where bpy is installed but cannot be imported, as without the libraries it needs from the system."""
ROOT = Path(__file__).resolve().parents[1]


def blender_bridge(patches: Mesh) -> tuple[Mesh, float] | str | None:
    """The mesh that Blender makes of the patches and the time of the call [ms]; in words why it makes none; None where
    there is no Blender to ask."""
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "patches.npz", Path(folder) / "result.npz"
        np.savez(given, vertices=patches.vertices, triangles=patches.triangles, view=patches.view)
        command = [sys.executable, "-m", "benchmarks.bridge", str(given), str(made)]
        try:
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=TIME_LIMIT)
        except subprocess.TimeoutExpired:
            return f"stopped after {TIME_LIMIT:.0f} s"
        if done.returncode == NO_BLENDER:
            return None
        if done.returncode != 0:
            last = done.stderr.strip().splitlines()
            return f"exit code {done.returncode}" + (f": {last[-1]}" if last else "")
        with np.load(made) as arrays:
            return Mesh(arrays["vertices"], arrays["triangles"]), float(arrays["milliseconds"])


def main(given: str, made: str) -> None:
    try:
        import bpy  # noqa: F401  registers bmesh and mathutils in the bpy module
        from mirror_scan.mirror_scan_addon.bridging import bridge_and_fill, facing_runs
    except ImportError:
        sys.exit(NO_BLENDER)

    with np.load(given) as arrays:
        patches = Mesh(arrays["vertices"], arrays["triangles"], view=arrays["view"])
    pairs = facing_runs(patches)  # a user's selecting takes minutes; the tools alone are timed
    start = time.perf_counter()
    mesh = bridge_and_fill(patches, pairs)
    spent = 1000.0 * (time.perf_counter() - start)
    np.savez(made, vertices=mesh.vertices, triangles=mesh.triangles, milliseconds=spent)


if __name__ == "__main__":
    main(*sys.argv[1:])
