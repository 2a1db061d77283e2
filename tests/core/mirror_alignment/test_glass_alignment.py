"""Bowed and thick mirrors: found where they are, and never where a camera only warps depth or a frame projects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.depth.sensor_recognition import measures_time, measuring_principle
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.mirror_alignment.glass_alignment import BowSettings, _along, align_bows, thick_glass
from mirror_scan.core.mirrors.curved_glass import behind_front, flattened
from mirror_scan.core.mirrors.mirror import moved, plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings, place_mirror
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.mirror_placement import align_mirrors, first_mirrors
from mirror_scan.core.simulation.scene import default_rig
from traced_rig import fused, trace


def rig(sensor="azure_kinect", frame_depth=0.0, **changes):
    return default_rig(sensor, frames=4, frame_depth=frame_depth, **changes)


def placed(traced, settings=MirrorSettings()):
    image = fused(traced)
    return [place_mirror(image, picks, settings) for picks in traced.capture.mirrors], image


def smooth_warp(intrinsics, size: float, seed: int) -> np.ndarray:
    """A smooth relative error of depth, root mean square ``size``."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(-1, 1, intrinsics.width), np.linspace(-1, 1, intrinsics.height))
    warp = np.zeros(u.shape)
    for i, j in np.ndindex(3, 3):
        across, upright = (np.pi / 2 * (x + rng.uniform(-1, 1)) for x in (u, v))
        warp += rng.normal() * np.cos(i * across) * np.cos(j * upright)
    return size * (warp - warp.mean()) / warp.std()


@pytest.mark.parametrize("unknown", range(5))
def test_readings_move_as_their_derivatives_say(unknown):
    """With slopes, shift, sag and thickness, in any direction; against small steps of each."""
    glass = plane_mirror("right", np.array((0.9, 0.1, 3.0)), np.array((-0.64, 0.1, -0.77)))
    glass = replace(glass, rectangle=np.array(((-0.4, 0.4), (-0.9, 0.9))))
    rng = np.random.default_rng(unknown)
    shown = np.array((1.5, 0.0, 4.5)) + rng.uniform(-0.4, 0.4, (50, 3))
    along = rng.normal(size=(50, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    size, steps = 1e-5, np.eye(5)[unknown, :3]
    ends = []
    for sign in (-0.5, 0.5) if unknown < 4 else (0.0, 1.0):  # no glass is thinner than thin
        other = moved(glass, sign * size * steps)
        if unknown == 3:
            other = replace(other, sag=sign * size)
        if unknown == 4:
            other = behind_front(other, sign * size)
        ends.append(reflect(flattened(shown, other, True), other))
    expected = np.einsum("nc,nc->n", (ends[1] - ends[0]) / size, along)
    np.testing.assert_allclose(_along(glass, shown, along, True)[:, unknown], expected, rtol=0.01, atol=0.01)


@pytest.mark.parametrize("sags", [(0.002, -0.002), (-0.003, 0.0015)])
def test_a_bow_that_is_seen_twice_is_fitted(person, sags):
    traced = trace(person, rig(), sags)
    frames, image = placed(traced)
    mirrors, notes = align_bows(image, frames)
    assert len(notes) == 2 and all("bowed" in str(note) for note in notes)
    np.testing.assert_allclose([m.sag for m in mirrors], sags, atol=5e-4)
    before, after = traced.displacement(frames), traced.displacement(mirrors)
    for m, old, new in zip(mirrors, before, after, strict=True):
        assert old > 0.002 and new < 0.0011 and m.moved_by == ("bow",) and m.sag_error < 5e-4
    assert align_bows(image, frames, BowSettings(use=False)) == (frames, ())


@pytest.mark.parametrize("sensor", ["ideal", "azure_kinect", "kinect_v1", "realsense_d455"])
def test_no_flat_mirror_is_bowed(person, sensor):
    traced = trace(person, rig(sensor), (0.0, 0.0))
    frames, image = placed(traced)
    mirrors, notes = align_bows(image, frames)
    assert notes == () and all(m.sag == 0.0 for m in mirrors)


@pytest.mark.parametrize("seed", range(4))
def test_a_warp_of_the_camera_is_no_bow(person, seed):
    """It bends frames as a bow does, but not what they show."""
    level = rig()
    traced = trace(person, level, (0.0, 0.0), warp=smooth_warp(level.intrinsics, 8e-4, seed))
    frames, image = placed(traced)
    mirrors, notes = align_bows(image, frames)
    assert notes == () and all(m.sag == 0.0 for m in mirrors)


def test_a_bow_that_nothing_confirms_is_part_of_the_error(person):
    traced = trace(person, rig(), (0.002, -0.002))
    frames, image = placed(traced)
    hidden = image.depth.copy()
    hidden[traced.kind != 2] = 0.0  # the frames only
    mirrors, notes = align_bows(image.with_depth(hidden), frames)
    assert notes == () and all(m.sag == 0.0 and 0.0008 < m.sag_error < 0.0024 for m in mirrors)
    for m, true in zip(mirrors, traced.displacement(frames), strict=True):
        body = traced.real[(traced.view > 0) & (traced.kind == 1)]
        assert 0.5 * true < m.displacement(body) < 2.5 * true


def aligned(capture, image, settings):
    first = first_mirrors(capture.mirrors, image.depth, capture, settings)
    return align_mirrors(first, image, capture, settings, measuring_principle(capture, settings.depth))


def test_thick_glass_is_told_from_a_frame_that_projects(person):
    thick = trace(person, rig(), (0.0, 0.0), thickness=0.005)
    assert measures_time(thick.capture, DepthSettings()) is True
    frames, image = placed(thick)
    assert min(thick.displacement(frames)) > 0.012
    assert thick_glass(image, frames).thickness == pytest.approx(0.005, abs=0.002)
    mirrors, notes = aligned(thick.capture, image, Settings())
    assert sum("mm thick" in str(note) for note in notes) == 2
    assert max(thick.displacement(mirrors)) < 0.005
    known = replace(Settings(), mirror=MirrorSettings(glass_thickness=0.005))
    mirrors, notes = aligned(thick.capture, image, known)
    assert max(thick.displacement(mirrors)) < 0.0015 and not notes
    for frame_depth in (0.0, 0.006):
        thin = trace(person, rig(frame_depth=frame_depth), (0.0, 0.0))
        frames, image = placed(thin)
        assert thick_glass(image, frames).thickness is None
        if not frame_depth:
            assert not thick_glass(image, frames).behind
