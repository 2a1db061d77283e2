"""A virtual person between two mirrors, seen by a small camera, and how far its readings are from the truth."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import Simulation, simulate
from mirror_scan.core.subject.subject_search import find_subject
from mirror_scan.core.subject.subject_views import Views


@dataclass(frozen=True)
class Seen:
    """A snapshot as far as its views, and its truth."""

    simulation: Simulation
    image: RgbdImage
    mirrors: list
    views: Views

    def inside(self) -> np.ndarray:
        """Readings (H, W) of the person whose neighbours are of the same surface: no edges, no flying pixels."""
        labels, true = self.simulation.truth.labels, self.simulation.truth.sight.depth
        inside = (self.views.labels >= 0) & (self.views.labels == labels) & (self.image.depth > 0)
        for down, right in np.ndindex(3, 3):
            move = (down - 1, right - 1)
            inside &= np.roll(labels, move, (0, 1)) == labels
            inside &= np.abs(np.roll(true, move, (0, 1)) - true) < 0.03
            inside &= np.roll(self.image.depth, move, (0, 1)) > 0
        return inside

    def error(self, depth: np.ndarray, where: np.ndarray) -> float:
        """Root mean square of ``depth`` less the truth [m]."""
        return float(np.sqrt(((depth - self.simulation.truth.sight.depth)[where] ** 2).mean()))


@pytest.fixture(scope="session")
def seen(person):
    """(sensor, effects, frequencies, seed, share of its resolution) -> Seen."""

    @functools.cache
    def take(sensor, effects=(), frequencies=None, seed=3, share=0.75) -> Seen:
        rig = default_rig(sensor, frames=8, seed=seed)
        size = int(share * rig.intrinsics.width), int(share * rig.intrinsics.height)
        rig = replace(rig, intrinsics=rig.intrinsics.scaled(*size))
        simulation = simulate(person, with_real_optics(rig, frequencies, effects) if effects else rig)
        image = RgbdImage(one_depth_map(simulation.capture)[0], rig.intrinsics)
        mirrors = [place_mirror(image, picks) for picks in simulation.capture.mirrors]
        return Seen(simulation, image, mirrors, find_subject(image, mirrors))

    return take
