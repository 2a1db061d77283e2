"""A clean Blender file for each test, the add-on registered once, and a small mesh that has everything."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for what is shared: tests/ is no package

_status = 0


def pytest_report_header(config):
    """A Blender that nobody has tried is no failure, but worth a line."""
    if importlib.util.find_spec("bpy") is None:
        return None
    import bpy
    from tried_blenders import newer_than_tried

    return newer_than_tried(bpy.app.version) or None


def pytest_sessionfinish(session, exitstatus):
    global _status
    _status = int(exitstatus)


def pytest_unconfigure(config):
    """The bpy 4.5 module waits for ever at the end of a process that ran a parallel kernel of numba and Blender's glTF
    exporter; eight lines without Mirror Scan do it too. So it is left without Python's farewell."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.version < (5, 0, 0):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_status)


@pytest.fixture(scope="session")
def addon():
    """The package, registered in the bpy module."""
    pytest.importorskip("bpy")
    import mirror_scan

    mirror_scan.register()
    yield mirror_scan
    mirror_scan.unregister()


@pytest.fixture(scope="session")
def compiled():
    """The kernels of a build in numba's cache, compiled by other processes: compiling leaves memory taken."""
    tool = Path(__file__).resolve().parents[2] / "tools" / "compile_kernels.py"
    subprocess.run([sys.executable, str(tool)], check=True, stdout=subprocess.DEVNULL)


@pytest.fixture
def bpy(addon):
    """bpy with an empty factory file."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy


@pytest.fixture(scope="session")
def capsule():
    """A closed capsule 1.70 m tall on z = 0, with all colour values, views and kinds."""
    return _make_capsule(48, 32)


@pytest.fixture(scope="session")
def capsule_10k():
    return _make_capsule(120, 80)


@pytest.fixture(scope="session")
def capsule_60k():
    return _make_capsule(300, 200)


def _make_capsule(around: int, along: int):
    from capsules import capsule
    from mirror_scan.core.mesh import Mesh

    return Mesh(*capsule(around, along))


@pytest.fixture
def reconstruction(capsule):
    from mirror_scan.core.pipeline import Reconstruction

    report = {
        "mirrors": [{"name": "left", "residual_mm": 0.8}],
        "mesh": {"vertices": len(capsule.vertices), "watertight": True, "height_m": 1.7, "volume_l": 200.0},
        "timings_ms": {"mirrors": 10.0, "closing": 20.0},
        "warnings": [],
    }
    return Reconstruction(capsule, "avatar", np.eye(4), report)


@pytest.fixture(scope="session")
def scan(tmp_path_factory):
    """Capture folder of the mannequin, and its true height [m]."""
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate, write_simulation

    folder = tmp_path_factory.mktemp("scan") / "capture"
    person = mannequin()
    write_simulation(simulate(person, default_rig(sensor="azure_kinect", mirrors=2, frames=4, seed=3)), folder)
    return folder, float(np.ptp(person.vertices[:, 2]))


@pytest.fixture
def loaded(bpy, scan):
    """The capture loaded into an empty scene; the object that holds its points."""
    assert bpy.ops.mirror_scan.load_capture(filepath=str(scan[0])) == {"FINISHED"}
    return bpy.context.scene.mirror_scan.cloud
