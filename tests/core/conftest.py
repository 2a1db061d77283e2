"""Virtual captures and what becomes of them, made once and shared by the core tests."""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for naive.py: tests/ is no package

FRAMES = {"ideal": 1, "kinect_v1": 8, "azure_kinect": 4, "realsense_d455": 4}


@pytest.fixture(scope="session")
def person():
    """A mannequin, coarse enough to be made quickly."""
    from mirror_scan.core.simulation.mannequin import mannequin

    return mannequin(resolution=0.012)


@pytest.fixture(scope="session")
def simulated(person):
    """sensor name -> Simulation of the person before the default rig."""
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate

    return functools.cache(lambda sensor: simulate(person, default_rig(sensor, frames=FRAMES[sensor])))


@pytest.fixture(scope="session")
def reconstructed(simulated):
    """sensor name -> Reconstruction of that simulation."""
    from mirror_scan.core.pipeline import reconstruct

    return functools.cache(lambda sensor: reconstruct(simulated(sensor).capture))


@pytest.fixture(scope="session")
def blind_maps():
    """View maps of a camera that reads nothing: they forbid no bridge."""
    from mirror_scan.core.views.view_maps import NOTHING_SEEN

    return NOTHING_SEEN
