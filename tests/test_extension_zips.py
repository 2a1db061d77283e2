"""Zips for each platform and Python, with stand-ins for the wheels: the tool's work, which needs no bpy but one."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("bpy")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]


def load_builder():
    spec = importlib.util.spec_from_file_location("build_extension_zips", ROOT / "tools" / "extension.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


builder = load_builder()


def wheels_in(path: Path) -> set[str]:
    with zipfile.ZipFile(path) as archive:
        return {name for name in archive.namelist() if name.startswith("wheels/") and not name.endswith("/")}


@pytest.mark.parametrize("by_blender", [True, False])
def test_each_platform_gets_its_wheels(tmp_path, by_blender):
    """With stand-ins for the wheels: by Blender's tool, and without it to the same effect."""
    suffixes = {
        "windows-x64": "win_amd64",
        "linux-x64": "manylinux_2_27_x86_64.manylinux_2_28_x86_64",
        "macos-arm64": "macosx_12_0_arm64",
    }
    wheels = []
    for package, version in builder.pins().items():
        for tag in ("cp311", "cp313"):
            for suffix in suffixes.values():
                wheels.append(tmp_path / f"{package}-{version}-{tag}-{tag}-{suffix}.whl")
                with zipfile.ZipFile(wheels[-1], "w") as archive:
                    archive.writestr("x.py", "")
    tool = builder.find_tool(None) if by_blender else None
    zips = builder.build(wheels, list(suffixes), tmp_path / "out", tool)
    assert len(zips) == 3
    for path in zips:
        (platform,) = [key for key in suffixes if key.replace("-", "_") in path.name]
        mine = {f"wheels/{wheel.name}" for wheel in wheels if wheel.name.endswith(suffixes[platform] + ".whl")}
        assert len(mine) == 4 and mine == wheels_in(path)
    with pytest.raises(builder.BuildError, match="not for this zip"):
        builder.build(wheels, ["linux-x64"], tmp_path, tool, "-python3.14")
    with pytest.raises(builder.BuildError, match="for cp313 it holds"):
        builder.build([w for w in wheels if "numba" not in w.name or "cp311" in w.name], ["linux-x64"], tmp_path, tool)


def stand_in_pip(monkeypatch, missing: str, said: str) -> None:
    """pip that finds every wheel but those for one Python, for which it says something."""
    run = subprocess.run

    def pip(command, **options):
        if "download" not in command:
            return run(command, **options)
        python, folder = command[command.index("--python-version") + 1], Path(command[-1])
        if python == missing:
            return subprocess.CompletedProcess(command, 1, "", said)
        tag = "cp" + python.replace(".", "")
        for name, version in builder.pins().items():
            with zipfile.ZipFile(folder / f"{name}-{version}-{tag}-{tag}-manylinux_2_28_x86_64.whl", "w") as archive:
                archive.writestr("x.py", "")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(builder.subprocess, "run", pip)


NO_WHEEL = "ERROR: Could not find a version (from versions: none)\nERROR: No matching distribution found for llvmlite"


def test_each_python_gets_the_zip_that_the_message_names(tmp_path, monkeypatch, capsys):
    """The names that Blender shows when numba cannot be imported are those of the zips."""
    from mirror_scan.mirror_scan_addon.background import numba_setup

    stand_in_pip(monkeypatch, "", "")
    arguments = ["--platform", "linux-x64", "--wheels", str(tmp_path / "w"), "--output", str(tmp_path / "out")]
    assert builder.main(arguments) == 0
    monkeypatch.setattr(numba_setup.sys, "platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    named = {}
    for version in ((3, 11), (3, 13), (3, 14)):
        monkeypatch.setattr(numba_setup.sys, "version_info", (*version, 0))
        named[version] = numba_setup.fitting_zip()
        assert named[version] in numba_setup.no_numba_text(ImportError("numba"))
        tags = builder._pythons_in(tmp_path / "out" / named[version])
        assert f"cp{version[0]}{version[1]}" in tags
    assert set(named.values()) == {path.name for path in (tmp_path / "out").glob("*.zip")}
    monkeypatch.setattr(numba_setup.sys, "version_info", (3, 15, 0))
    assert "there is no zip of Mirror Scan for Python 3.15" in numba_setup.no_numba_text(ImportError("numba"))


def test_a_zip_without_wheels_is_left_out_and_said(tmp_path, monkeypatch, capsys):
    arguments = ["--platform", "linux-x64", "--wheels", str(tmp_path / "w"), "--output", str(tmp_path / "out")]
    stand_in_pip(monkeypatch, "3.14", NO_WHEEL)
    assert builder.main(arguments) == 0
    assert len(list((tmp_path / "out").glob("*.zip"))) == 1
    said = capsys.readouterr().err
    assert "left out: the zip for linux-x64, Python 3.14" in said and "No matching distribution" in said
    with monkeypatch.context() as patch:  # a network that is down, or a wheel that was changed, is no such reason
        stand_in_pip(patch, "3.14", "WARNING: Retrying\n" + NO_WHEEL)
        assert builder.main(arguments) == 1
    stand_in_pip(monkeypatch, "3.13", NO_WHEEL)
    assert builder.main([*arguments[:2], "--wheels", str(tmp_path / "none"), "--output", str(tmp_path)]) == 1
    assert builder.main(["--python", "3.9"]) == 1
