"""Live View: a recording played as a camera, what is drawn, and the avatar that is made of the burst."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture
def picture():
    from mirror_scan.core.errors import Notice
    from mirror_scan.mirror_scan_addon.tasks.live_frames import LivePicture

    step = {"code": "step", "text": Notice("step {way}", way="20 cm to your left").parts(), "severity": "warning",
            "where": "left", "arrow": [[0.0, 0.0, 2.0], [0.2, 0.0, 2.0]]}  # fmt: skip
    note = step | {"code": "leaning", "severity": "note", "arrow": None}
    corners = [[0.0, 0.0, 3.0], [0.5, 0.0, 3.0], [0.5, 1.0, 3.0], [0.0, 1.0, 3.0]]
    points = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    return LivePicture(7, points, np.full((500, 3), 9, np.uint8), np.eye(4), [{"name": "left", "corners": corners}],
                       [step, note], "advising", 3.0, 0.0, 0.0)  # fmt: skip


def test_frames_go_from_the_second_process_to_the_window_and_only_the_newest_counts(picture, tmp_path):
    from dataclasses import replace

    from mirror_scan.mirror_scan_addon.tasks.live_frames import newest_picture, write_picture

    assert newest_picture(str(tmp_path)) is None and newest_picture(str(tmp_path / "none")) is None
    for number in range(3, 9):
        write_picture(str(tmp_path), replace(picture, number=number))
    assert len(list(tmp_path.iterdir())) <= 3  # nobody read
    read = newest_picture(str(tmp_path))
    assert read.number == 8 and np.array_equal(read.points, picture.points) and read.advices == picture.advices
    assert newest_picture(str(tmp_path), 8) is None and not list(tmp_path.iterdir())


def test_what_is_written_and_drawn_follows_the_shutter(addon, picture):
    from dataclasses import replace

    from mirror_scan.mirror_scan_addon.interface import live_picture

    texts = [text for text, _ in live_picture.lines_of(picture)]
    assert texts[0] == "Step 20 cm to your left" and not picture.well
    well = replace(picture, advices=picture.advices[1:])
    assert live_picture.lines_of(well)[0] == ("All is well", live_picture.GOOD)
    counting = live_picture.lines_of(replace(well, state="counting down", left_s=1.2))
    assert counting == [("All is well, hold still: 2", live_picture.GOOD)]
    (line,) = live_picture.lines_of(replace(well, state="burst", share=0.5, moved_m=0.004))
    assert "50%" in line[0] and "4 mm" in line[0]
    again = [text for text, _ in live_picture.lines_of(replace(well, state="counting down", left_s=2.0, retaken=1))]
    assert len(again) == 2 and "taken again" in again[1]
    ends = np.array(live_picture.arrow_segments(*picture.advices[0]["arrow"]))
    assert ends.shape == (6, 3) and np.allclose(ends[:3], [[0, 0, 2], [0.2, 0, 2], [0.2, 0, 2]])
    assert np.allclose(np.linalg.norm(ends[3] - ends[2]), np.linalg.norm(ends[5] - ends[4]))
    assert live_picture.arrow_segments((1, 1, 1), (1, 1, 1)) == []
    live_picture.show(picture)
    assert live_picture.shown() is picture
    live_picture.show(None)
    assert live_picture.shown() is None


def test_advice_is_written_on_as_many_lines_as_it_needs(addon):
    from mirror_scan.mirror_scan_addon.language.texts import wrapped

    assert wrapped("step back and turn round", 10, len) == ["step back", "and turn", "round"]
    assert wrapped("unbreakably long", 5, len) == ["unbreakably", "long"] and wrapped("", 5, len) == [""]


def test_what_stands_in_the_way_is_said(bpy, tmp_path):
    with pytest.raises(RuntimeError, match="No recording is chosen"):
        bpy.ops.mirror_scan.live_view(source="playback")
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.mirror_scan.live_view(source="playback", filepath=str(tmp_path / "nowhere"))
    assert not bpy.data.objects
    with pytest.raises(RuntimeError, match="Object Mode"):
        mesh = bpy.data.objects.new("m", bpy.data.meshes.new("m"))
        bpy.context.collection.objects.link(mesh)
        bpy.context.view_layer.objects.active = mesh
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mirror_scan.live_view(source="playback", filepath=str(tmp_path))
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_burst_that_cannot_be_made_an_avatar_is_an_error_that_says_where_the_burst_is(bpy, tmp_path):
    from types import SimpleNamespace

    from mirror_scan.mirror_scan_addon.operators.live_view import MIRRORSCAN_OT_live_view

    said = []
    operator = SimpleNamespace(make_avatar=False, _asked=False, report=lambda kind, text: said.append((kind, text)))
    MIRRORSCAN_OT_live_view.finish(operator, bpy.context, bpy.context.scene, str(tmp_path / "gone"))
    (first, second) = said
    assert first[0] == {"INFO"} and str(tmp_path / "gone") in first[1]
    assert second[0] == {"ERROR"} and "gone" in second[1] and "Traceback" not in second[1]


def test_what_is_to_be_ignored_are_kinds_of_advice(bpy):
    from mirror_scan.core.guidance.advice import KINDS
    from mirror_scan.mirror_scan_addon.operators.live_view import IGNORED

    asked = bpy.ops.mirror_scan.live_view.get_rna_type().properties["ignore"]
    assert {item.identifier for item in asked.enum_items} == set(IGNORED)
    assert {kind for kinds in IGNORED.values() for kind in kinds} <= set(KINDS)


@pytest.mark.slow
def test_a_recording_becomes_an_avatar(bpy, tmp_path):
    """Nothing is left over but the burst, the points and the avatar."""
    from mirror_scan.benchmarks.shutter_scripts import Approach, Moment, person, small_rig
    from mirror_scan.mirror_scan_addon.interface import live_picture

    approach = Approach("stands well", [Moment((person(),), 32, small_rig())])
    recording = approach.write(tmp_path / "recording")
    capture = tmp_path / "burst"
    done = bpy.ops.mirror_scan.live_view(
        source="playback", filepath=str(recording), folder=str(capture), countdown=0.5, frames=8, rate=10.0, fast=True
    )
    assert done == {"FINISHED"} and live_picture.shown() is None
    assert len(list((capture / "depth").glob("*.png"))) == 8
    assert json.loads((capture / "intrinsic.json").read_text())["sensor"] == "azure_kinect"
    avatars = [item for item in bpy.data.objects if item.type == "MESH" and len(item.data.polygons)]
    assert len(avatars) == 1 and 1.6 < avatars[0].dimensions.z < 1.8
    shutil.rmtree(capture)
