"""The command line with Blender's formats, and without Blender."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def capture(monkeypatch, reconstruction, tmp_path):
    """A folder whose reading and reconstruction are stood in for: these tests are about writing."""
    import mirror_scan.core.capture as capture
    import mirror_scan.core.pipeline as pipeline
    from mirror_scan.core.camera import Intrinsics

    empty = capture.Capture(np.zeros((1, 4, 4), np.float32), None, Intrinsics(4, 4, 4.0, 4.0, 1.5, 1.5))
    monkeypatch.setattr(capture, "open_capture", lambda *_, **__: empty)
    monkeypatch.setattr(pipeline, "reconstruct", lambda *_, **__: reconstruction, raising=False)
    folder = tmp_path / "capture"
    folder.mkdir()
    return folder


def test_all_formats_in_one_go(bpy, capture, tmp_path, reconstruction):
    from mirror_scan.mirror_scan_addon.command import main

    names = [f"a.{suffix}" for suffix in ("ply", "blend", "GLB", "fbx")]
    outputs = [argument for name in names for argument in ("-o", str(tmp_path / name))]
    assert main(["reconstruct", str(capture), *outputs, "--report", str(tmp_path / "report.json"), "--quiet"]) == 0
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted([*names, "capture", "report.json"])
    assert json.loads((tmp_path / "report.json").read_text())["mesh"] == reconstruction.report["mesh"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    avatar = bpy.data.objects["Avatar"]
    positions = np.empty(3 * len(avatar.data.vertices), dtype=np.float32)
    avatar.data.attributes["position"].data.foreach_get("vector", positions)
    np.testing.assert_array_equal(positions.reshape(-1, 3), reconstruction.mesh.vertices.astype(np.float32))


def test_quiet_is_quiet(bpy, capture, tmp_path, capfd):
    """Exporters print; who asked for silence gets it."""
    from mirror_scan.mirror_scan_addon.command import main

    outputs = [argument for suffix in ("blend", "glb", "fbx") for argument in ("-o", str(tmp_path / f"a.{suffix}"))]
    capfd.readouterr()
    assert main(["reconstruct", str(capture), *outputs, "--quiet"]) == 0
    assert tuple(capfd.readouterr()) == ("", "")


def test_blender_command_has_the_same_parser(bpy, capsys):
    from mirror_scan.mirror_scan_addon.command import blender_main

    assert blender_main(["--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: blender --command mirror_scan")
    assert blender_main(["reconstruct"]) == 2
    assert blender_main(["reconstruct", "/missing", "-o", "x.blend"]) == 1
    assert "error: " in capsys.readouterr().err


def without_bpy(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    code = f"""
import runpy, sys
sys.modules["bpy"] = None
runpy.run_path({str(ROOT / "tests" / "conftest.py")!r})
from mirror_scan.mirror_scan_addon.command import main
sys.exit(main({list(arguments)!r}))
"""
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120, env=dict(os.environ)
    )


def test_a_python_without_bpy_is_told_which_have_it(tmp_path):
    done = without_bpy(tmp_path, "reconstruct", "capture", "-o", "avatar.blend")
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("error: ")
    assert ".blend" in done.stderr and "bpy" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_message_names_versions_where_there_is_none(monkeypatch):
    from mirror_scan.core.errors import OutputError
    from mirror_scan.mirror_scan_addon.command import BlenderWriters

    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.setattr(sys, "version_info", (3, 12, 1))
    with pytest.raises(OutputError, match=r"no bpy for this Python 3\.12, only for Python 3\.11 .* and Python 3\.13"):
        BlenderWriters()[".blend"]
    monkeypatch.setattr(sys, "version_info", (3, 13, 0))
    with pytest.raises(OutputError, match="pip install bpy"):
        BlenderWriters()[".blend"]


def test_without_numba_blender_says_what_to_install(bpy, monkeypatch, capsys):
    from mirror_scan.mirror_scan_addon.command import blender_main

    monkeypatch.setitem(sys.modules, "numba", None)
    assert blender_main(["inspect", "capture"]) == 1
    assert "numba cannot be imported" in capsys.readouterr().err
    assert blender_main(["--help"]) == 0
