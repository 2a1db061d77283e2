"""A report of a problem tells versions, errors and numbers, and nothing that names a person, a place or a file."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("bpy")

SECRET = ("jane", "doe", "secret", "scan.mkv", "hall", "/home", "C:\\")


def said(bpy) -> str:
    from mirror_scan.mirror_scan_addon.scene.problem_report import problem_report

    return problem_report(bpy.context)


@pytest.fixture
def nothing_went_wrong():
    from mirror_scan.mirror_scan_addon.background import last_problem

    last_problem._last.clear()
    yield
    last_problem._last.clear()


def test_it_tells_versions_and_that_nothing_went_wrong(bpy, nothing_went_wrong):
    import numba
    import numpy

    lines = said(bpy).splitlines()
    assert lines[0].startswith("Mirror Scan 0.") or lines[0].startswith("Mirror Scan 1.")
    assert bpy.app.version_string in lines[1]
    assert numpy.__version__ in lines[2] and numba.__version__ in lines[2]
    assert "  none in this session" in lines and "  none in this scene" in lines


def test_the_last_error_is_told_without_names(bpy, nothing_went_wrong):
    with pytest.raises(RuntimeError):
        bpy.ops.mirror_scan.load_capture(filepath="/home/jane doe/secret/scan.mkv")
    text = said(bpy)
    assert "CaptureError: …: there is no such file or folder" in text
    assert "core/capture/reader_choice.py:" in text  # where it was raised
    assert not [word for word in SECRET if word in text]


@pytest.mark.parametrize(
    "error, told",
    [
        (FileNotFoundError(2, "No such file", "/home/jane"), "FileNotFoundError ENOENT"),
        (PermissionError(13, "Permission denied", "C:\\Users\\jane doe\\scan.mkv"), "PermissionError EACCES"),
        (MemoryError(), "MemoryError"),
        (ValueError("/home/jane: secret"), "ValueError"),
        (RuntimeError('x:\n File "/home/jane/x/core/mesh/bvh.py", line 7, in look\nsecret'), "core/mesh/bvh.py:7 look"),
        (RuntimeError('File "C:\\Users\\jane doe\\core\\mesh\\bvh.py", line 7, in look'), "core/mesh/bvh.py:7 look"),
    ],
)  # fmt: skip
def test_other_errors_are_told_by_kind_and_place(bpy, nothing_went_wrong, error, told):
    from mirror_scan.mirror_scan_addon.background import last_problem

    last_problem.remember(error)
    assert told in said(bpy) and not [word for word in SECRET if word in said(bpy)]


def test_messages_keep_their_numbers_and_nothing_else():
    from mirror_scan.core.errors import CaptureError, MirrorError, Notice
    from mirror_scan.mirror_scan_addon.background.last_problem import describe, without_names

    inner = Notice("{name}: is {size:.1f} mm off", name="jane's hall", size=3.25)
    error = MirrorError("{path}: {share:.0%} of {why}", path="/home/jane/scan.mkv", share=0.5, why=inner)
    assert describe(error)[0] == "MirrorError: …: 50% of …: is 3.2 mm off"
    assert without_names("a sentence that nobody listed, by jane") == ""
    assert describe(CaptureError("secret words of jane"))[0] == "CaptureError"
    assert describe(CaptureError("/home/jane doe/scan.mkv: is empty; copy or record it again"))[0] == (
        "CaptureError: …: is empty; copy or record it again"
    )


def test_the_numbers_of_the_last_report_are_told(bpy, capsule, nothing_went_wrong):
    from mirror_scan.core.errors import Notice
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    warning = Notice("{name}: moved by {apart:.0f} mm", name="hall", apart=31.4)
    report = {
        "camera_to_avatar": [[1.0] * 4] * 4, "sensor": "jane's own",
        "mirrors": [{"name": "hall", "point": [1, 2, 3], "residual_mm": 0.8125, "refined": True, "source": "picked"}],
        "views": [{"name": "secret", "pixels": 777, "depth_m": [1.5, 2.5], "noise_mm": None}],
        "mesh": {"vertices": 1234, "watertight": True}, "texture": {"view_shares": {"hall": 0.25}, "size": 1024},
        "skeleton": {"joints": {"Hips": [0, 0, 1]}, "confidence": {"Hips": 0.75}},
        "measurements": {"chest": {"value_mm": 999.0}}, "jane doe": 5, "warnings": [warning],
    }  # fmt: skip
    create_avatar(capsule, name="Jane", collection=bpy.context.collection, report=report)
    text = said(bpy)
    flat = " ".join(text.split())  # lines are broken where the dialog ends
    for told in ("mirrors[0]: residual_mm 0.8125, refined True", "views[0]: pixels 777, depth_m 1.5 2.5",
                 "mesh: vertices 1234, watertight True", "view_shares[0] 0.25", "skeleton.confidence: Hips 0.75",
                 "warning: …: moved by 31 mm"):  # fmt: skip
        assert told in flat, told
    assert not [word for word in (*SECRET, "Jane", "999", "own", "joints") if word in text]
    assert max(map(len, text.splitlines())) <= 100


def test_it_is_copied_as_it_is_shown(bpy, monkeypatch, nothing_went_wrong):
    from mirror_scan.mirror_scan_addon.scene import problem_report

    monkeypatch.setattr(problem_report, "versions", lambda: ["versions"])
    assert bpy.ops.mirror_scan.report_problem() == {"FINISHED"}
    # the bpy module has no clipboard; tests/blender looks at that of a window
    if bpy.context.window_manager.clipboard:
        assert bpy.context.window_manager.clipboard == said(bpy)


def test_a_damaged_report_is_told_as_far_as_it_goes(bpy, capsule, nothing_went_wrong):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    avatar = create_avatar(capsule, name="Jane", collection=bpy.context.collection, report={})
    damaged = ("[1, 2", json.dumps([1]), json.dumps({"mesh": 7, "views": 3, "warnings": [4], "timings_ms": []}))
    for kept in damaged:
        avatar["mirror_scan_report"] = kept
        assert "Last avatar's report:" in said(bpy)
