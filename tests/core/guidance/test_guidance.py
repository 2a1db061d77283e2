"""Before the shutter: what is said of a scene, where to stand, and when the burst is taken; by the virtual rig."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.benchmarks.shutter_scripts import Approach, Moment, at, person, small_rig
from mirror_scan.core import cli
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.guidance import Advice, LiveScene, LiveSettings, Shutter, ShutterSettings, guide
from mirror_scan.core.guidance.advice import KINDS, NOTES, SteadyAdvice
from mirror_scan.core.guidance.live_scene import LiveFrame, joined, thinned_image, thinned_intrinsics
from mirror_scan.core.guidance.playback import CAMERAS
from mirror_scan.core.simulation.simulate import simulate

RIG = small_rig()
SYNCHRONOUS = LiveSettings(beside=False)


@pytest.fixture(scope="module")
def well():
    """A person who stands well, seen through mirrors that are known."""
    return simulate(person(), replace(RIG, frames=12)).capture


@pytest.fixture(scope="module")
def scene(well):
    scene = LiveScene(RIG.intrinsics, RIG.sensor, well.mirrors, SYNCHRONOUS)
    for k, depth in enumerate(well.depth):
        frame = scene.look(depth, well.color, 0.1 * k)
    assert {m.name for m in frame.mirrors} == {"left", "right"} and frame.advices == ()
    return scene


def test_a_search_adds_no_mirror_to_as_many_as_there_are(scene):
    left, right = sorted(scene.mirrors, key=lambda mirror: mirror.name)
    picture = replace(left, name="right", point=left.point + (0.0, 0.0, 0.5))
    assert joined([left], [left, right], 2) == ([left, right], False)
    assert joined([left, right], [left, picture], 2) == ([left, right], False)
    assert joined([picture], [left, right], 2) == ([left, right], True)  # it was none
    assert [one.name for one in joined([right], [picture], 2)[0]] == ["right", "right 2"]


def test_a_moved_camera_is_noticed_and_what_was_known_of_the_room_is_forgotten(well):
    scene = LiveScene(RIG.intrinsics, RIG.sensor, well.mirrors, replace(SYNCHRONOUS, place_every_s=0.2))
    for k in range(5):
        scene.look(well.depth[k], None, 0.1 * k)
    panned = simulate(person(), replace(RIG, pan_deg=RIG.pan_deg + 5.0, frames=12)).capture
    frames = [scene.look(depth, None, 0.5 + 0.1 * k) for k, depth in enumerate(panned.depth)]
    told = [{one.code for one in frame.advices if one.severity == "warning"} for frame in frames]
    assert any("camera_moved" in codes for codes in told) and scene.known == ()
    assert {m.name for m in frames[-1].mirrors} == {"left", "right"} and told[-1] == set()


def test_picks_where_no_mirror_is_end_nothing_but_have_the_mirrors_searched(well):
    chest = tuple(replace(one, frame_pixels=np.array(((160.0, 140.0),))) for one in well.mirrors)
    scene = LiveScene(RIG.intrinsics, RIG.sensor, chest, replace(SYNCHRONOUS, place_every_s=0.1))
    frames = [scene.look(well.depth[k % 12], None, 0.1 * k) for k in range(16)]
    assert [one.code for one in frames[5].advices] == ["mirrors_missing"] and frames[5].mirrors == ()
    assert {m.name for m in frames[-1].mirrors} == {"left", "right"} and scene.known == ()
    assert not [one for one in frames[-1].advices if one.severity == "warning"]


def looked_at(scene, body, seconds, count=6, props=()):
    """The last of some frames of a body, a while after those before."""
    for k, depth in enumerate(simulate(body, replace(RIG, frames=count), props).capture.depth):
        frame = scene.look(depth, None, seconds + 0.1 * k)
    return frame


def test_the_cloud_is_thinned_and_reflections_lie_on_the_person(scene, well):
    frame = scene.look(well.depth[0], well.color, 2.0)
    assert 10_000 < frame.image.depth.size < 30_000 and len(frame.points) == len(frame.colors) == len(frame.seen)
    assert set(np.unique(frame.seen[frame.subject])) == {0, 1, 2}
    body = person().transformed(np.linalg.inv(RIG.camera_to_avatar)).vertices
    low, high = body.min(axis=0) - 0.06, body.max(axis=0) + 0.06
    inside = ((frame.points[frame.subject] > low) & (frame.points[frame.subject] < high)).all(axis=1)
    assert inside.mean() > 0.99  # those that are reflected, too


@given(st.integers(1, 7), st.integers(20, 60), st.integers(20, 60))
@settings(max_examples=25, deadline=None)
def test_thinning_keeps_where_each_pixel_looks(step, width, height):
    camera = replace(RIG.intrinsics, width=width, height=height, cx=0.4 * width, cy=0.6 * height)
    v, u = np.mgrid[:height, :width]
    ray = np.stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy), axis=-1)
    small = thinned_intrinsics(camera, step)
    thin = thinned_image(ray, step)
    assert thin.shape[:2] == (small.height, small.width)
    v, u = np.mgrid[: small.height, : small.width]
    assert np.allclose(thin, np.stack(((u - small.cx) / small.fx, (v - small.cy) / small.fy), axis=-1))


@pytest.mark.parametrize(("x", "y"), [(0.75, 0.0), (0.0, -0.75)])
def test_who_stands_aside_is_told_a_step_after_which_nothing_is_wrong(scene, x, y):
    """The arrow and the words lead to the same place; there the same scene is good."""
    frame = looked_at(scene, at(person(), x, y), 10.0 if x else 20.0)
    (advice,) = [one for one in frame.advices if one.code == "step"]
    assert [one.code for one in frame.advices if one.severity == "warning"] in (["step"], ["moving", "step"])
    shift = RIG.camera_to_avatar[:3, :3] @ (advice.arrow.length * advice.arrow.direction)
    assert abs(shift[2]) < 0.05 and np.linalg.norm(shift[:2]) > 0.1
    words = ("to your right" if shift[0] < 0 else "to your left") if x else "away from the camera"
    said = {way: int(far) for far, way in re.findall(r"(\d+) cm (to your \w+|\w+ (?:from )?the camera)", advice.text)}
    assert abs(said[words] - 100 * max(abs(shift[:2]))) <= 3
    after = looked_at(scene, at(person(), x + shift[0], y + shift[1]), 15.0 if x else 25.0)
    assert [one for one in after.advices if one.severity == "warning"] == []


def test_arms_that_hang_are_to_go_out_by_as_much_as_is_said(scene):
    frame = looked_at(scene, person(arm_angle_deg=77.0), 40.0)
    (advice,) = [one for one in frame.advices if one.code == "arms_close"]
    sideways = RIG.camera_to_avatar[:3, :3] @ advice.arrow.direction
    assert abs(sideways[0]) > 0.99 and 0.1 < advice.arrow.length < 0.3 and advice.what == "arms"
    assert not [one for one in looked_at(scene, person(arm_angle_deg=50.0), 41.0).advices if one.code == "arms_close"]


def test_nobody_and_a_second_person(scene):
    empty = looked_at(scene, at(person(), 40.0, 0.0), 50.0)
    assert [one.code for one in empty.advices] == ["nobody"] and empty.views is None
    from mirror_scan.core.simulation.props import together

    both = looked_at(scene, together(person(), at(person(1.75, 70.0), -1.0, -0.5)), 52.0)
    assert "two_people" in {one.code for one in both.advices}


@given(st.lists(st.booleans(), min_size=4, max_size=40))
@settings(max_examples=60, deadline=None)
def test_steady_advice_comes_and_goes_within_its_time_and_a_single_frame_changes_nothing(frames):
    advice = Advice("step", "step aside")
    steady, shown = SteadyAdvice(0.45), []
    for k, said in enumerate(frames):
        shown.append(bool(steady.hear([advice] if said else [], 0.1 * k)))
    for k in range(4, len(frames)):
        last = frames[k - 3 : k + 1]
        if all(last) or not any(last):
            assert shown[k] is last[0]
        if frames[k - 4 : k + 1] == [True, True, False, True, True]:
            assert shown[k]


def made_up(seconds, views, *advices):
    return LiveFrame(seconds, RgbdImage(np.ones((144, 160), np.float32), thinned_intrinsics(RIG.intrinsics, 2)),
                     *(None,) * 4, views, (), advices)  # fmt: skip


def test_the_shutter_waits_for_warnings_counts_down_and_takes_a_burst_again_that_moved(scene, well):
    views = scene.look(well.depth[0], None, 60.0).views
    shutter = Shutter(RIG.intrinsics, ShutterSettings(well_s=0.3, countdown_s=0.5, frames=9, retakes=1))
    warning, note = Advice("step", "step"), Advice(NOTES[0], "so it is", severity="note")
    for k in range(10):
        assert shutter.advance(made_up(0.1 * k, views, warning), [warning]) == "advising"
    states = [shutter.advance(made_up(1 + 0.1 * k, views, note), [note]) for k in range(6)]
    assert states[0] == "well" and states[-1] == "counting down" and 0 < shutter.left_s < 0.5
    assert shutter.advance(made_up(1.6, views, warning), [warning]) == "advising"  # the countdown begins anew
    states = [shutter.advance(made_up(2 + 0.1 * k, views), []) for k in range(10)]
    assert states[-1] == "burst" and states.count("counting down") == 5
    for k in range(9):
        shutter.take(np.roll(well.depth[k], 3 * k, axis=1), well.color)  # sways by 9 cm and more
    assert shutter.state == "advising" and shutter.retaken == 1 and shutter.burst == []
    states = [shutter.advance(made_up(4 + 0.1 * k, views), []) for k in range(10)]
    assert states[-1] == "burst"
    for k in range(9):
        shutter.take(well.depth[k], well.color)
    assert shutter.state == "done" and shutter.warning is None and len(shutter.burst) == 9
    ignoring = Shutter(RIG.intrinsics, ShutterSettings(0.0, 0.0, ignore=("step",)))
    assert ignoring.advance(made_up(0.0, views, warning), [warning]) == "burst"
    assert set(NOTES) <= set(KINDS)


def test_a_recording_that_ends_too_early_says_the_last_advice(well):
    from mirror_scan.core.capture.live_camera import Stream

    stream = Stream(RIG.intrinsics, RIG.sensor, iter([(depth, None) for depth in well.depth[:7]]))
    scene = LiveScene(RIG.intrinsics, RIG.sensor, well.mirrors, SYNCHRONOUS)
    with pytest.raises(CaptureError, match="before all was well"):
        list(guide(stream, scene, Shutter(RIG.intrinsics), clock=lambda k: 0.1 * k))


def test_the_command_plays_a_recording_and_takes_the_burst_by_itself(tmp_path, capsys):
    """Mirrors found without a click; the burst is an RGB-D folder as any."""
    walking = [Moment((at(person(), x, -0.2),), 1, RIG) for x in (-1.0, -0.75, -0.5, -0.25)]
    Approach("walks in", [*walking, Moment((person(),), 34, RIG)]).write(tmp_path / "rec")
    out = tmp_path / "burst"
    options = ["--play", str(tmp_path / "rec"), "--fast", "--rate", "10", "--countdown", "0.5", "--burst", "8"]
    assert cli.main(["live", *options, "--capture-only", "-o", str(out)]) == 0
    said = capsys.readouterr()
    assert "mirrors found: left, right" in said.out and "hold still: the burst is taken" in said.out
    assert said.err == "" and len(said.out.splitlines()) < 25  # no flood
    capture = open_capture(out)
    assert len(capture.depth) == 8 and capture.sensor == "azure_kinect" and capture.color is not None
    assert cli.main(["live", *options, "--capture-only", "-o", str(out)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert cli.main(["live", *options, "--ignore", "hunger", "-o", str(tmp_path / "a.ply")]) == 1
    assert "no advice “hunger”" in capsys.readouterr().err
    assert not (tmp_path / "a_capture").exists()


def test_every_kind_of_advice_stands_in_the_documentation():
    page = (Path(__file__).parents[3] / "docs" / "live.md").read_text(encoding="utf-8")
    assert [kind for kind in KINDS if f"`{kind}`" not in page] == []


def test_a_recording_is_a_camera_like_any_other(tmp_path, well):
    Approach("", [Moment((person(),), 3, RIG)]).write(tmp_path / "rec")
    with CAMERAS["playback"](None, 1000.0, tmp_path / "rec", paced=False) as stream:
        frames = list(stream.frames)
    assert stream.intrinsics == RIG.intrinsics and stream.sensor == "azure_kinect" and len(frames) == 3
    assert frames[0][0].shape == well.depth.shape[1:] and frames[0][1].dtype == np.uint8
    with CAMERAS["playback"](None, 1e6, tmp_path / "rec") as stream:  # who is late misses frames
        assert 1 <= len(list(stream.frames)) <= 3
    with pytest.raises(CaptureError, match="no recording"), CAMERAS["playback"]():
        pass
