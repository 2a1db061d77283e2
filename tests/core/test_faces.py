"""What Blender's window imports of core must not bring numba, whose import takes a second."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FACES = ("errors", "camera", "mesh", "io", "capture", "mirrors", "preview.palette")
"""Packages whose ``__init__`` hands on plain data and readers, and modules that the add-on imports as it starts."""


@pytest.mark.parametrize("name", FACES)
def test_a_face_brings_no_numba(name):
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r}); import conftest\n"
        "sys.modules['numba'] = None  # to import it fails, and says where\n"
        f"import mirror_scan.core.{name}"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_mesh_and_a_mirror_are_made_and_cross_processes_without_numba():
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r}); import conftest\n"
        "sys.modules['numba'] = None\n"
        "import numpy as np, pickle\n"
        "from mirror_scan.core.mesh import Mesh\n"
        "from mirror_scan.core.mirrors import Mirror\n"
        "mesh = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))\n"
        "mirror = Mirror('left', np.zeros(3), np.eye(3)[2], np.eye(3), 0.0, 0)\n"
        "assert (pickle.loads(pickle.dumps(mesh)).triangles == mesh.triangles).all()\n"
        "assert pickle.loads(pickle.dumps(mirror)).name == 'left'\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
