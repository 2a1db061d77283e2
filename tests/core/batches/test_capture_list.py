"""Captures are found in files, folders and patterns, each once."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from mirror_scan.core.batches import content_digest, find_captures, open_batch_folder, settings_digest, surroundings
from mirror_scan.core.errors import CaptureError


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Folders and recordings with names of all sorts; readers look only at their beginnings."""
    for name in ("scan 10", "scan 9", "deep/er/ملف", ".hidden/scan"):
        (tmp_path / name / "depth").mkdir(parents=True)
    (tmp_path / "deep" / "one.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "deep" / "not.bag").write_bytes(b"else")
    (tmp_path / "notes.txt").write_text("x")
    open_batch_folder(tmp_path / "results")
    (tmp_path / "results" / "scan" / "depth").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def named(*paths):
    return [(one.path.as_posix(), one.error is None) for one in find_captures(paths)]


def test_a_folder_is_searched_in_the_order_of_names(place):
    assert named(".") == [("deep/er/ملف", True), ("deep/one.bag", True), ("scan 9", True), ("scan 10", True)]


def test_each_capture_counts_once_and_a_named_file_is_never_passed_over(place):
    assert named("scan 9", place / "scan 9", "scan*", "notes.txt") == [
        ("scan 9", True), ("scan 10", True), ("notes.txt", True),
    ]  # fmt: skip
    assert named("**/*.bag") == [("deep/one.bag", True)]
    os.symlink(place, place / "deep" / "circle")
    assert len(named(".")) == 4


def test_links_in_circles_and_results_are_passed_over(place):
    for name, target in (("loop", "loop"), ("up", ".."), ("here", ".")):
        os.symlink(target, place / "deep" / name)
    (place / "poses").mkdir()
    (place / "poses" / "poses.json").write_text("{}")
    (place / "results" / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    (place / "links").mkdir()
    os.symlink(place / "poses", place / "links" / "linked")
    assert named("deep") == [("deep/er/ملف", True), ("deep/one.bag", True)]
    assert named("links", "**/*.bag", "results*") == [
        ("links/linked", True), ("deep/one.bag", True), ("results*", False),
    ]  # fmt: skip
    (place / "scan 9" / "depth" / "0.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    assert named("scan*/**") == [("scan 9", True), ("scan 10", True)], "an image of a capture is no other capture"
    (place / "deep" / "failed.mkv").touch()
    assert named("deep")[-2:] == [("deep/failed.mkv", False), ("deep/one.bag", True)]
    (place / "scan 9" / "batch.json").write_text('{"format": "of another program"}')
    assert ("scan 9", True) in named(".")


def test_what_names_nothing_is_said(place):
    (place / "empty").mkdir()
    found = find_captures(["empty", "*.oni", "nowhere"])
    assert [bool(one.error) for one in found] == [True, True, False]
    assert "no capture was found" in str(found[0].error) and "fits this pattern" in str(found[1].error)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may read everything")
def test_a_folder_that_cannot_be_read_is_one_error(place):
    (place / "deep").chmod(0)
    try:
        assert [one.path for one in find_captures(["."]) if one.error] == [Path("deep")]
    finally:
        (place / "deep").chmod(0o755)


def test_content_is_what_counts(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name / "depth").mkdir(parents=True)
        (tmp_path / name / "depth" / "0.png").write_bytes(b"0" * 3_000_000)
        (tmp_path / name / "intrinsic.json").write_text("{}")
    first = content_digest(tmp_path / "a")
    assert first[1] == 3_000_002 and content_digest(tmp_path / "b") == first
    (tmp_path / "b" / ".DS_Store").write_bytes(b"x")
    assert content_digest(tmp_path / "b") == first
    (tmp_path / "b" / "depth" / "0.png").rename(tmp_path / "b" / "depth" / "1.png")
    assert content_digest(tmp_path / "b")[0] != first[0]
    assert surroundings(tmp_path / "a") == []
    (tmp_path / "a" / "intrinsic.json").unlink()
    assert "a" in surroundings(tmp_path / "a"), "without intrinsics, the name may say which camera it was"
    with pytest.raises(CaptureError, match="nowhere: cannot be read"):
        content_digest(tmp_path / "nowhere")


def test_what_lies_elsewhere_and_is_read_counts_and_nothing_else(tmp_path):
    data, linked, posed, images = (tmp_path / name for name in ("data", "linked", "posed", "images"))
    for folder in (data, linked, posed, images):
        folder.mkdir()
    (data / "0.png").write_bytes(b"0")
    (linked / "depth").symlink_to(data)
    (linked / "circle").symlink_to(linked)
    before = content_digest(linked)
    (data / "0.png").write_bytes(b"1")
    assert content_digest(linked)[0] != before[0] and before[1] == 1, "a linked folder counts, once"

    pose = [[float(i == j) for j in range(4)] for i in range(4)]
    (posed / "poses.json").write_text(json.dumps({"cameras": [{"capture": "../data", "camera_to_world": pose}]}))
    before = surroundings(posed)
    (data / "0.png").write_bytes(b"2")
    assert surroundings(posed) != before, "so does a capture that poses.json names elsewhere"

    for name in ("1_depth.pclzf", "1.xml", "a_depth.png", "a_color.png", "intrinsic.json"):
        (images / name).write_bytes(b"0")
    for name, belongs in (("1_depth.pclzf", {"1.xml"}), ("a_depth.png", {"a_color.png", "intrinsic.json"})):
        for other in ("1.xml", "a_color.png", "intrinsic.json", "new.png"):
            before = surroundings(images / name)
            (images / other).write_bytes(other.encode())
            changed = surroundings(images / name) != before
            assert changed == (other in belongs) or other == "intrinsic.json", f"{other} beside {name}"
            (images / other).write_bytes(b"0")


def test_settings_count_files_by_content(tmp_path):
    rig = tmp_path / "rig.json"
    rig.write_text("1")
    one = settings_digest({"rig": rig, "texture": 1024, "subject": (1.0, 2.0)})
    moved = rig.rename(tmp_path / "other.json")
    assert settings_digest({"subject": (1.0, 2.0), "texture": 1024, "rig": moved}) == one
    moved.write_text("2")
    assert settings_digest({"rig": moved, "texture": 1024, "subject": (1.0, 2.0)}) != one
