"""Light by several ways: decoding against closed forms, the rig's sum of paths against a ball whose paths are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.multipath import LIGHT, by_phase, by_pulse, decode, paths, phasors, ray_lengths
from mirror_scan.core.simulation.optics import IDEAL, TRIPLES, Optics, real
from mirror_scan.core.simulation.rays import BODY, lit, look
from mirror_scan.core.simulation.scene import FramedMirror, default_rig
from mirror_scan.core.simulation.sensors import SENSORS, find_sensor
from mirror_scan.core.simulation.simulate import simulate


def small(rig):
    return replace(rig, intrinsics=rig.intrinsics.scaled(rig.intrinsics.width // 2, rig.intrinsics.height // 2))


@pytest.mark.parametrize("frequencies", [*TRIPLES, (137.0, 61.0), (20.0,)])
def test_one_path_is_read_exactly(frequencies):
    z = np.linspace(0.3, 7.2, 5001)
    distance, spread = decode(phasors(np.full((5001, 1), 0.3), 2.0 * z[:, None], frequencies), frequencies)
    np.testing.assert_allclose(distance, z, atol=1e-9)
    assert spread.max() < 1e-9


@pytest.mark.parametrize("ratio", [0.025, 0.1, 0.3, 0.9])
def test_two_paths_of_one_frequency(ratio):
    """The phase is that of 1 + q exp(iδ); at most asin(q), which is asin(q) / 2π of c / 2f."""
    f = 50.0
    period = LIGHT / (2e6 * f)
    own, other = 1.5, np.linspace(1.5, 4.5, 20001)
    lengths = np.column_stack((np.full_like(other, 2 * own), own + other))
    strength = np.broadcast_to((1.0, ratio), lengths.shape)
    off = decode(phasors(strength, lengths, (f,)), (f,))[0] - own
    delta = 2 * np.pi * f * 1e6 * (other - own) / LIGHT
    expected = np.arctan2(ratio * np.sin(delta), 1 + ratio * np.cos(delta)) / (2 * np.pi) * period
    np.testing.assert_allclose(off, expected, atol=1e-9)
    assert np.abs(off).max() == pytest.approx(np.arcsin(ratio) / (2 * np.pi) * period, rel=1e-4)


def test_the_figures_of_two_hundred_megahertz():
    bound = np.arcsin([0.025, 0.1]) / (2 * np.pi) * LIGHT / 400e6
    np.testing.assert_allclose(bound, (0.003, 0.012), atol=2e-4)


def test_frequencies_that_disagree():
    """Two paths of nearly equal strength: no set of wrap numbers agrees within 4 cm."""
    own = np.linspace(2.0, 3.0, 301)
    lengths = np.column_stack((2 * own, 2 * own + 1.0))
    _, spread = decode(phasors(np.array([[1.0, 0.97]]), lengths, TRIPLES[0]), TRIPLES[0])
    assert (spread > 0.04).all()


def test_paths_of_the_rig():
    """Strengths and lengths at a wall that one mirror lights, computed by hand."""
    mirror = FramedMirror("m", (0.0, 2.0, 1.0), (0.3, -1.0, 0.0), width=1.0, height=1.2, reflectivity=0.8)
    rig = replace(
        default_rig("azure_kinect", mirrors=[]), mirrors=(mirror,), camera=(0.4, -2.0, 1.1), tilt_deg=0.0,
        intrinsics=Intrinsics(120, 90, 80.0, 80.0, 59.5, 44.5), room=(-3.0, 3.0, -4.0, 3.0, 2.6),
    )  # fmt: skip
    far = mannequin(resolution=0.02).transformed(np.array([[1, 0, 0, 50.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    sight, bvh = look(far, rig)
    light = lit(sight, bvh, rig, 0.0)
    at = (light[..., 1] > 0) & (sight.view == 0)
    assert at.sum() > 20
    ways = paths(sight, light, rig, at)
    eye, point = np.array(rig.camera), sight.point[at]
    normal = mirror.axes[2]
    virtual = eye - 2 * ((eye - np.array(mirror.centre)) @ normal) * normal
    away = virtual - point
    length = np.linalg.norm(away, axis=1)
    cosine = (away * sight.normal[at]).sum(1) / length
    np.testing.assert_allclose(ways.source[:, 1], length, rtol=1e-12)
    np.testing.assert_allclose(ways.strength[:, 1], 0.8 * cosine / length**2, rtol=1e-3)  # seen 0.5 mm off
    assert (ways.strength[:, 0] == 0).all(), "the view's own light is in the last column"
    back = np.linalg.norm(point - eye, axis=1)
    np.testing.assert_allclose(ways.back, back, rtol=1e-12)
    np.testing.assert_allclose(ways.source[:, 2], back, rtol=1e-12)
    own = np.abs(((eye - point) * sight.normal[at]).sum(1)) / back**3
    np.testing.assert_allclose(ways.own, own, rtol=1e-5)
    np.testing.assert_allclose(sight.depth[at] * ray_lengths(rig.intrinsics)[at], back, rtol=1e-12)


@pytest.mark.parametrize("sensor", SENSORS)
def test_only_what_is_lit_twice_changes(sensor):
    body = mannequin(resolution=0.02)
    rig = replace(small(default_rig(sensor, frames=1, seed=2)), optics=Optics(multipath=True))
    if find_sensor(sensor).principle not in ("phase", "pulse"):
        plain = simulate(body, replace(rig, optics=IDEAL))
        assert np.array_equal(simulate(body, rig).capture.depth, plain.capture.depth)
        return
    sight, bvh = look(body, rig)
    light = lit(sight, bvh, rig, 0.0)
    others = light.sum(-1) - np.take_along_axis(light, sight.view[..., None].astype(int), -1)[..., 0]
    once = (others == 0) & (sight.bounces <= 1)
    person = (sight.object == BODY) & (sight.view > 0)
    for read in (by_phase(sight, light, rig, rig.optics), by_pulse(sight, light, rig, 0.15)):
        assert np.array_equal(read[once], sight.depth[once])
        assert (np.abs(read - sight.depth)[person & ~once] > 0.02).mean() > 0.1


def test_pulses_that_merge_and_pulses_that_do_not():
    """Off by less than half the difference of the ways where they merge, by nothing or by all of it where not."""
    rig = default_rig("phone_dtof", frames=1)
    sight, bvh = look(mannequin(resolution=0.02), rig)
    light = lit(sight, bvh, rig, 0.0)
    at = (light > 0).sum(-1) == 2
    at &= (sight.view == 0) & (light[..., 0] > 0)
    ways = paths(sight, light, rig, at)
    half = np.where(ways.strength[:, 1:3] > 0, (ways.source[:, 1:3] - ways.back[:, None]) / 2, 0.0).sum(1)
    other = ways.strength[:, 1:3].sum(1)
    long = ray_lengths(rig.intrinsics)[at]
    for width in (0.01, 10.0):
        off = (by_pulse(sight, light, rig, width)[at] - sight.depth[at]) * long
        merged = half * other / (other + ways.own)
        expected = np.where(np.abs(half) <= width, merged, np.where(other > ways.own, half, 0.0))
        np.testing.assert_allclose(off, expected, atol=1e-9)
        assert (np.abs(off) <= np.abs(half) + 1e-9).all() and np.ptp(off) > 0.01


def test_stronger_mirrors_spoil_more():
    body, lost = mannequin(resolution=0.02), []
    for reflectivity in (0.05, 0.5, 0.95):
        rig = small(default_rig("azure_kinect", frames=1, optics=Optics(multipath=True)))
        rig = replace(rig, mirrors=tuple(replace(m, reflectivity=reflectivity) for m in rig.mirrors))
        made = simulate(body, rig)
        direct = made.truth.labels == 0
        error = np.abs(made.capture.depth[0] - made.truth.sight.depth)[direct]
        lost.append((error > 0.012).mean())
    assert lost[0] < lost[1] < lost[2]


def test_what_is_refused():
    for wrong in ({"frequencies": ()}, {"frequencies": (np.nan,)}, {"frequencies": (0.0, 80.0)}, {"disagreement": 0.0}):
        with pytest.raises(MirrorScanError, match="optics: "):
            Optics(**wrong)
    with pytest.raises(MirrorScanError, match="reflectivity"):
        FramedMirror("m", (0, 1, 1), (0, -1, 0), reflectivity=1.2)
    assert real("ideal") == IDEAL and real("azure_kinect", (50.0, 40.0)).frequencies == (50.0, 40.0)
