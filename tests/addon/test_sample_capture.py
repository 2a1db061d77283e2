"""The sample: taken once, kept in the extension's folder, there at once the next time, and good for an avatar."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def home(tmp_path_factory, addon):
    """Where the sample is kept, in place of the user's folder."""
    import bpy
    from mirror_scan.mirror_scan_addon.operators import sample_capture

    folder = tmp_path_factory.mktemp("user")
    kept = bpy.utils.extension_path_user
    bpy.utils.extension_path_user = lambda package, path="", create=False: str(folder)
    sample_capture.sample_folder.cache_clear()
    yield folder
    bpy.utils.extension_path_user = kept
    sample_capture.sample_folder.cache_clear()


def test_the_sample_is_taken_once_and_kept(bpy, home, monkeypatch):
    from mirror_scan.mirror_scan_addon import tasks

    assert bpy.ops.mirror_scan.sample_capture() == {"FINISHED"}
    settings = bpy.context.scene.mirror_scan
    assert Path(settings.capture_path) == home / "Sample Capture" and (home / "Sample Capture" / "depth").is_dir()
    assert len(settings.mirrors) == 2 and len(settings.cloud.data.vertices) > 100_000
    assert sorted(path.name for path in home.iterdir()) == ["Sample Capture"]  # nothing unfinished

    def never(folder):
        raise AssertionError("it is there already")

    monkeypatch.setattr(tasks, "sample_steps", never)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert bpy.ops.mirror_scan.sample_capture() == {"FINISHED"}
    assert len(bpy.context.scene.mirror_scan.mirrors) == 2


@pytest.mark.slow
def test_an_avatar_can_be_made_of_the_sample(bpy, home):
    assert bpy.ops.mirror_scan.sample_capture() == {"FINISHED"}
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    from mirror_scan.mirror_scan_addon.scene.report_text import avatar_report

    mesh = avatar_report(bpy.context.object)["mesh"]
    assert mesh["watertight"] and 1.6 < mesh["height_m"] < 1.8  # the mannequin is 1.70 m


def test_what_fails_leaves_no_sample(bpy, home, monkeypatch):
    from mirror_scan.core.errors import OutputError
    from mirror_scan.core.simulation import simulate
    from mirror_scan.mirror_scan_addon.operators import sample_capture

    folder = home / "other"
    monkeypatch.setattr(sample_capture, "sample_folder", lambda: str(folder))

    def full(simulation, target):
        Path(target).mkdir(parents=True)
        raise OutputError("there is no room on this disk")

    monkeypatch.setattr(simulate, "simulate", lambda *arguments: None)
    monkeypatch.setattr(simulate, "write_simulation", full)
    with pytest.raises(RuntimeError, match="no room"):
        bpy.ops.mirror_scan.sample_capture()
    assert not folder.exists() and not bpy.context.scene.mirror_scan.capture_path
