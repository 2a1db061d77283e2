"""The zip as Blender takes it: built and validated by Blender's own tool, installed, used; one fresh process."""

from __future__ import annotations

import json
import os
import re
import runpy
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = Path(bpy.utils.system_resource("SCRIPTS"))


def blender_ext(*arguments: str) -> subprocess.CompletedProcess:
    tool = SCRIPTS / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run([sys.executable, "-S", str(tool), *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("extension")
    blender_ext("build", "--source-dir", str(ROOT), "--output-dir", str(folder))
    (path,) = folder.iterdir()
    return path


def test_blender_validates_it(package):
    tags = SCRIPTS / "modules" / "_bpy_internal" / "extensions" / "tags.py"
    namespace = runpy.run_path(str(tags))
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert set(manifest["tags"]) <= namespace["addons"]
    blender_ext("validate", str(package))
    assert package.name == f"mirror_scan-{manifest['version']}.zip"


def test_it_holds_what_runs_and_nothing_else(package):
    names = [name for name in zipfile.ZipFile(package).namelist() if not name.endswith("/")]
    allowed = re.compile(r"(core|mirror_scan_addon)/.*\.py|__init__\.py|blender_manifest\.toml|LICENSE|wheels/.*\.whl")
    assert [name for name in names if not allowed.fullmatch(name)] == []
    for package_folder in ("core", "mirror_scan_addon"):
        sources = {path.relative_to(ROOT).as_posix() for path in (ROOT / package_folder).rglob("*.py")}
        assert sources <= set(names)


def test_manifest_agrees_with_the_pip_package():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert manifest["version"] == project["version"] and manifest["id"] == project["name"]
    assert manifest["license"] == [f"SPDX:{project['license']}"]


INSTALL = """
import json, sys
import bpy, addon_utils
import numpy as np

said = {}
addon_utils.enable("bl_pkg")
said["install"] = sorted(bpy.ops.extensions.package_install_files(
    filepath=PACKAGE, repo="user_default", enable_on_install=True))
name = "bl_ext.user_default.mirror_scan"
said["enabled"] = addon_utils.check(name)[1]
said["numba at start"] = "numba" in sys.modules
try:
    bpy.ops.mirror_scan.build_avatar(filepath="/missing/capture")
except RuntimeError as error:
    said["missing"] = str(error)
import numba
said["cache"] = numba.config.CACHE_DIR
from bl_ext.user_default.mirror_scan.core.mesh import Mesh
from bl_ext.user_default.mirror_scan.mirror_scan_addon import scene
mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
said["object"] = scene.create_avatar(mesh, collection=bpy.context.collection).name
said["top level"] = sorted({"core", "mirror_scan", "mirror_scan_addon"} & sys.modules.keys())
said["warnings"] = [str(item) for item in addon_utils._extensions_warnings_get().get(name, [])]
addon_utils.disable(name, default_set=True)
said["left"] = dir(bpy.ops.mirror_scan)
print("\\n" + json.dumps(said))
"""


def test_it_installs_and_works(package, tmp_path):
    home = tmp_path / "user"
    home.mkdir()
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment.update(BLENDER_USER_RESOURCES=str(home), HOME=str(home), XDG_CONFIG_HOME=str(home))
    done = subprocess.run(
        [sys.executable, "-c", f"PACKAGE = {str(package)!r}\n{INSTALL}"],
        capture_output=True, text=True, timeout=120, env=environment, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads(done.stdout.strip().splitlines()[-1])
    assert said["install"] == ["FINISHED"] and said["enabled"] is True
    assert said["numba at start"] is False
    assert said["missing"].startswith("Error: ") and "there is no such file" in said["missing"]
    assert Path(said["cache"]).is_relative_to(home) and Path(said["cache"]).name == "numba_cache"
    assert said["object"] == "Avatar"
    assert said["top level"] == [] and said["warnings"] == [] and said["left"] == []
