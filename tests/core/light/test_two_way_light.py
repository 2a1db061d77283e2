"""Light that comes two ways in a virtual rig: undone where it is, and nothing touched where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera.noise_models import SENSORS
from mirror_scan.core.depth.sensor_recognition import measures_time, measuring_principle
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.light.two_way_light import LightSettings, shows_two_way_light, undo_two_way_light, without_spoiled
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.pipeline.scan import Clock, scan_steps, unlearnt_light

MULTIPATH = ("multipath",)


def undone(seen, settings=None, phase=True):
    if not shows_two_way_light(seen.image, seen.views, seen.mirrors):
        return None
    return undo_two_way_light(
        seen.image, seen.views, seen.mirrors, seen.views.floor_noise, settings or LightSettings(), phase
    )  # fmt: skip


@pytest.mark.parametrize("frequencies, settings, phase", [
    ((200.0, 180.0, 90.0), LightSettings(), True),
    ((200.0, 180.0, 90.0), LightSettings(frequencies=(200.0, 180.0, 90.0)), True),
    ((165.0, 140.0, 60.0), LightSettings(), False),
])  # fmt: skip
def test_errors_fall_by_half(seen, frequencies, settings, phase):
    """The camera's frequencies are given, or learnt from the floor; what it measures is known, or its readings say."""
    one = seen("azure_kinect", MULTIPATH, frequencies)
    light = undone(one, settings, phase)
    assert light is not None and light.response is not None
    inside = one.inside()
    kept = inside & ~light.spoiled
    moved = kept & (np.abs(light.depth - one.image.depth) > 0.001)
    assert kept.sum() > 0.9 * inside.sum() and moved.sum() > 100
    before, after = (one.error(depth, moved) for depth in (one.image.depth, light.depth))
    assert after < 0.5 * before, (before, after)
    assert one.error(light.depth, kept) < 0.6 * one.error(one.image.depth, inside)
    assert 0.05 < light.lit_twice_share < 0.5 and 0.05 < light.corrected_share <= light.lit_twice_share
    cleared = without_spoiled(one.views, light.spoiled)
    assert (cleared.labels[light.spoiled] == -1).all() and (cleared.seen[light.spoiled] == -1).all()
    np.testing.assert_array_equal(cleared.labels[~light.spoiled], one.views.labels[~light.spoiled])


@pytest.mark.parametrize("sensor", ["azure_kinect", "femto_bolt", "kinect_v2", "kinect_v1", "realsense_d455", "ideal"])
@pytest.mark.parametrize("phase", [True, False])
def test_light_that_comes_one_way_is_left_alone(seen, sensor, phase):
    """A Kinect v1 loses what its pattern reaches twice; nothing else of it is wrong."""
    if sensor == "kinect_v1" and phase:
        pytest.skip("nobody says so of it")
    assert undone(seen(sensor), phase=phase) is None


@pytest.mark.parametrize("degrees", [1.0, -1.0])
def test_planes_that_are_a_degree_off_do_not_look_like_such_light(seen, degrees):
    one = seen("azure_kinect")
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    for turn in (np.array(((c, 0, s), (0, 1, 0), (-s, 0, c))), np.array(((1, 0, 0), (0, c, -s), (0, s, c)))):
        turned = [replace(m, normal=turn @ m.normal, basis=turn @ m.basis) for m in one.mirrors]
        assert not shows_two_way_light(one.image, one.views, turned)


def test_without_mirrors_there_is_none(seen):
    one = seen("azure_kinect", MULTIPATH, (200.0, 180.0, 90.0))
    assert shows_two_way_light(one.image, one.views, one.mirrors)
    assert not shows_two_way_light(one.image, one.views, [])


def test_settings_that_mean_nothing_are_refused():
    for wrong in ({"two_ways": "maybe"}, {"frequencies": (0.0,)}, {"frequencies": (1e8,)}, {"frequencies": (np.nan,)}):
        with pytest.raises(MirrorScanError, match=r"^light: "):
            LightSettings(**wrong)


# --- which camera -------------------------------------------------------------------------------------------------


def captured(seen, name="azure_kinect", **changes):
    """A capture of light that comes two ways, named as another camera's."""
    return replace(seen("azure_kinect", MULTIPATH, (200.0, 180.0, 90.0)).simulation.capture, sensor=name, **changes)


def test_option_then_file_then_evidence_says_how_a_camera_measures(seen):
    def told(capture, sensor="auto", said=False):
        one = measuring_principle(capture, DepthSettings(sensor=sensor), said)
        return one.measures, one.by

    named = captured(seen, sensor_from="format")
    assert told(named) == ("phase", "format")
    assert told(named, "kinect_v1") == ("angles", "option")
    assert told(captured(seen, "realsense_d435")) == ("angles", "file")
    assert told(captured(seen, "realsense_d435"), said=True) == ("phase", "option")
    assert told(captured(seen, "phone")) == ("pulses", "file")
    assert told(captured(seen, "phone"), "azure_kinect") == ("phase", "option")
    assert told(captured(seen, "unknown")) == ("unknown", "nobody")
    assert told(named, "unknown") == ("unknown", "nobody"), "what the file says does not count"
    of_size = np.full((1, 576, 640), 2.0, np.float32)
    lens = replace(named.intrinsics, width=640, height=576)
    assert told(replace(named, sensor="unknown", depth=of_size, intrinsics=lens)) == ("phase", "size")
    steps = seen("kinect_v1", share=1.0).simulation.capture
    assert told(steps) == ("angles", "steps") and measures_time(steps, DepthSettings()) is False
    assert told(steps, said=True) == ("phase", "option")


@pytest.mark.parametrize("sensor", [*(name for name, model in SENSORS.items() if not model.phase), "phone"])
def test_cameras_that_do_not_measure_phase_are_never_corrected(seen, sensor):
    """Not even where their readings look like it; unless somebody says that it is another camera."""
    capture = captured(seen, sensor)

    def lit_twice(settings):
        steps = scan_steps(capture, capture.mirrors, settings, Clock(), (0.0, 1.0))
        try:
            while True:
                next(steps)
        except StopIteration as done:
            return done.value.lit_twice

    assert lit_twice(Settings()) is None
    if sensor == "phone":
        assert lit_twice(Settings(light=LightSettings("on"))) is not None


def test_the_report_says_what_was_done_and_who_decided(seen):
    capture = captured(seen, "unknown")
    done = reconstruct(capture)
    assert done.report["cameras"] == [{"sensor": "unknown", "measures": "phase", "by": "readings"}]
    optics = done.report["optics"]
    assert 0.05 < optics["lit_twice_share"] < 0.5 and optics["corrected_share"] > 0.05
    assert not any("is left out" in str(text) for text in done.warnings)
    off = reconstruct(capture, settings=Settings(light=LightSettings("off")))
    assert off.report["optics"] is None and off.report["cameras"][0]["by"] == "nobody"


def test_what_is_left_out_for_want_of_a_response_is_warned_of(seen):
    """Without a floor nothing says what the camera makes of such light; with one, and where little is lost, no word."""
    one = seen("azure_kinect", MULTIPATH, (200.0, 180.0, 90.0))
    blind = replace(one, views=replace(one.views, floor=None))
    light = undone(blind)
    assert light is not None and light.response is None and light.corrected_share == 0.0
    notice = unlearnt_light(light, blind.views)
    assert notice is not None and "frequencies" in notice and "floor" in notice
    assert unlearnt_light(undone(one), one.views) is None
    assert unlearnt_light(undone(blind, LightSettings(frequencies=(200.0, 180.0, 90.0))), blind.views) is None
    few = np.zeros_like(light.spoiled)
    assert unlearnt_light(replace(light, spoiled=few), blind.views) is None
