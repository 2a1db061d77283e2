"""The zips as Blender takes them: built and validated by Blender's own tool, read as reviewers do, installed, used."""

from __future__ import annotations

import ast
import importlib.util
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
from tried_blenders import newer_than_tried

bpy = pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = Path(bpy.utils.system_resource("SCRIPTS"))


def load_builder():
    spec = importlib.util.spec_from_file_location("build_extension", ROOT / "tools" / "extension.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


builder = load_builder()


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """The zip without wheels, by the tool in this bpy module."""
    newer = bool(newer_than_tried(bpy.app.version))  # said in the header of the run
    folder, tool = tmp_path_factory.mktemp("extension"), builder.find_tool(None)
    (path,) = builder.build([], [], folder, tool, any_blender=newer)
    return path


@pytest.fixture(scope="module")
def manifest() -> dict:
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def sources(package) -> dict[str, ast.Module]:
    """Python files of the zip, parsed."""
    with zipfile.ZipFile(package) as archive:
        return {
            name: ast.parse(archive.read(name).decode("utf-8"), name)
            for name in archive.namelist()
            if name.endswith(".py")
        }


def names_in(path: Path) -> set[str]:
    with zipfile.ZipFile(path) as archive:
        return {name for name in archive.namelist() if not name.endswith("/")}


def test_it_holds_what_runs_and_nothing_else(package, manifest, tmp_path):
    assert package.name == f"mirror_scan-{manifest['version']}.zip"
    allowed = re.compile(
        r"(core|mirror_scan_addon)/.*\.py|mirror_scan_addon/(signatures|messages)\.json|core/(avatar/(joints/body_template|weight_fields)|batches/small_capture)\.npz|__init__\.py|blender_manifest\.toml|LICENSE|mirror_scan_addon/help/(\w+\.html|images/\w+\.(png|gif|svg))"
    )
    names = names_in(package)
    assert [name for name in names if not allowed.fullmatch(name)] == []
    with zipfile.ZipFile(package) as archive:
        listed = json.loads(archive.read("mirror_scan_addon/messages.json"))
    assert listed == runpy.run_path(str(ROOT / "tools" / "messages.py"))["messages"]()
    # A checkout that is built as it stands gives the same, but for help: the manifest's patterns leave out the rest.
    builder._run([*builder.find_tool(None), "build", "--source-dir", str(ROOT), "--output-dir", str(tmp_path)])
    assert names_in(tmp_path / package.name) == {name for name in names if not name.startswith(builder.HELP)}


def test_help_pages_lead_somewhere(package):
    """Every link and picture of every page is in the zip; nothing comes from a network, no mark-up is left over."""
    with zipfile.ZipFile(package) as archive:
        pages = {name: archive.read(name).decode() for name in names_in(package) if name.endswith(".html")}
    for name, text in pages.items():
        for target in re.findall(r'(?:href|src)="([^"]*)"', text):
            file, _, anchor = target.partition("#")
            if re.match("https?:", file):
                assert 'href="' + target in text, f"{name} loads {target}"
                continue
            there = f"{builder.HELP}/{file}" if file else name
            assert there in names_in(package), f"{name}: {target}"
            assert not anchor or f'id="{anchor}"' in pages[there], f"{name}: {target}"
        said = re.sub(r"<pre>.*?</pre>|<code>.*?</code>|<style>.*?</style>|<[^>]*>", "", text, flags=re.DOTALL)
        assert "](" not in said and "**" not in said and "```" not in said, name
        assert not re.search(r"^(#|\|)", said, re.MULTILINE), name
    from mirror_scan.mirror_scan_addon.operators.help import PAGES

    assert {f"{builder.HELP}/{page}.html" for page, *_ in PAGES} <= set(pages)


def test_what_a_page_cannot_show_is_an_error(tmp_path):
    pages = runpy.run_path(str(ROOT / "tools" / "pages.py"))
    shown = list(
        pages["blocks"](["# A `b` *c*", "", "- one", "  two", "- `|` [x](y)", "", "1 < 2"], lambda target: target)
    )
    assert "".join(shown) == (
        '<h1 id="a-b-c">A <code>b</code> <em>c</em></h1><ul><li>one\ntwo</li><li><code>|</code> <a href="y">x</a></li>'
        "</ul><p>1 &lt; 2</p>"
    )
    for wrong in (["```", "x"], ["<div>"], ["| a | b |", "| - | - |", "| 1 |"]):
        with pytest.raises(pages["PageError"]):
            list(pages["blocks"](wrong, lambda target: target))


def test_pins_are_whole(manifest):
    """A hash for each wheel: two packages, three platforms, three Pythons."""
    text = builder.PINS.read_text(encoding="utf-8")
    assert sorted(builder.pins()) == ["llvmlite", "numba"]
    hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})\b", text)
    assert len(hashes) == len(set(hashes)) == 2 * 3 * 3
    assert sorted(manifest["platforms"]) == sorted(builder.PLATFORMS)


def test_a_newer_blender_is_noticed_and_tried(manifest, package, tmp_path, capsys):
    limit = tuple(map(int, manifest["blender_version_max"].split(".")))
    assert newer_than_tried((limit[0], limit[1] - 1, 99)) == ""
    assert manifest["blender_version_max"] in newer_than_tried(limit)
    (free,) = builder.build([], [], tmp_path, builder.find_tool(None), any_blender=True)
    with zipfile.ZipFile(free) as archive:
        loose = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert "blender_version_max" not in loose and loose["blender_version_min"] == manifest["blender_version_min"]


def test_no_wheel_is_kept_in_git():
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    listed = subprocess.run(["git", "ls-files", "*.whl", "wheels", "dist"], cwd=ROOT, capture_output=True, text=True)
    assert listed.stdout == ""
    ignored = subprocess.run(["git", "check-ignore", "wheels/a.whl", "dist/a.zip"], cwd=ROOT, capture_output=True)
    assert ignored.returncode == 0


def test_manifest_agrees_with_the_pip_package(manifest):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert manifest["version"] == project["version"] and manifest["id"] == project["name"]
    assert manifest["license"] == [f"SPDX:{project['license']}"]


class TestReviewRules:
    """What reviewers of extensions.blender.org ask for, as far as a machine can see it."""

    def test_manifest(self, manifest, package):
        tags = runpy.run_path(str(SCRIPTS / "modules" / "_bpy_internal" / "extensions" / "tags.py"))
        assert set(manifest["tags"]) <= tags["addons"]
        assert set(manifest["permissions"]) == {"files", "network"}
        assert "blender" not in (manifest["name"] + manifest["tagline"]).lower()
        known = {
            "schema_version", "id", "version", "name", "tagline", "maintainer", "type", "tags", "website", "platforms",
            "blender_version_min", "blender_version_max", "license", "copyright", "permissions", "wheels", "build",
        }  # fmt: skip
        assert set(manifest) <= known  # Blender does not mind a misspelt key
        with zipfile.ZipFile(package) as archive:
            assert "GNU GENERAL PUBLIC LICENSE" in archive.read("LICENSE").decode()[:200]

    def test_imports(self, sources):
        """Relative among ourselves; nothing that Blender lacks, reaches the network, or starts threads by itself."""
        ours = {
            "bpy", "bmesh", "bpy_extras", "bl_ui", "bl_operators", "addon_utils", "gpu", "gpu_extras", "blf",
            "mathutils", "rna_prop_ui", "numpy", "numba", "llvmlite", "OpenImageIO", "tqdm", "matplotlib",
        }  # fmt: skip
        never = {"socket", "urllib", "http", "ftplib", "ssl", "webbrowser", "pip", "ensurepip", "ctypes", "marshal"}
        for name, imported in self._imports(sources):
            top = imported.split(".")[0]
            # Readers may ask for a camera's own library, batches for Dask, films for PyAV, if the user has it.
            if not name.startswith(("core/capture/", "core/cluster/")) and name != "core/sequences/video.py":
                assert top in ours or top in sys.stdlib_module_names, f"{name} imports {imported}"
            # A tracker's datagrams, when the user asks for them; numpy's number of threads, which numpy does not say.
            asked = {("core/motion/live_stream.py", "socket"), ("core/numeric/blas_threads.py", "ctypes")}
            # which spells names of files, and reaches no network
            spelling = imported == "urllib.parse" or imported.startswith("urllib.parse.")
            assert top not in never or (name, top) in asked or spelling, f"{name} imports {imported}"
            if top in {"threading", "_thread", "concurrent", "multiprocessing"}:
                # where they end before the call returns, or no second process can be had; a lock starts none, and a
                # batch reads ahead; mirrors are looked for beside a running camera, in the second process; and a signal
                # is for the main thread only
                assert name in {
                    "core/numeric/threads.py", "mirror_scan_addon/background/job_operators.py",
                    "core/numeric/kernels.py", "core/numeric/blas_threads.py", "core/sequences/sequence.py",
                    "core/cluster/task_runner.py", "core/cli/batch.py",
                    "core/capture/decoding/file_indices.py", "core/guidance/live_scene.py", "core/cli/program.py",
                }, f"{name} imports {imported}"  # fmt: skip

    def test_nothing_reaches_into_python_or_the_extension_folder(self, sources):
        for name, tree in sources.items():
            for node in ast.walk(tree):
                where = f"{name}:{getattr(node, 'lineno', 0)}"
                if isinstance(node, ast.Name):
                    assert node.id not in {"__file__", "eval", "exec", "compile"}, where
                if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                    # The second process gets Blender's path; Blender's own is never touched.
                    alien = (node.value.id, node.attr) in {("sys", "path"), ("site", "addsitedir")}
                    assert not alien or name in {
                        "mirror_scan_addon/background/worker.py", "mirror_scan_addon/background/second_process.py",
                    }, where  # fmt: skip
                if isinstance(node, ast.Assign):
                    targets = [ast.unparse(target) for target in node.targets]
                    alien = any(target.startswith("sys.modules") for target in targets)
                    assert not alien or name == "mirror_scan_addon/background/worker.py", where
                    assert "bl_info" not in targets, where

    def test_name_does_not_stand_for_the_extension(self, sources):
        logs_and_translations = {
            "logging.getLogger", "bpy.app.translations.register", "bpy.app.translations.unregister",
        }  # fmt: skip
        for name, tree in sources.items():
            allowed = {
                id(argument)
                for node in ast.walk(tree)
                if isinstance(node, ast.Call) and ast.unparse(node.func) in logs_and_translations
                for argument in node.args
            }
            for node in ast.walk(tree):
                if isinstance(node, ast.Name) and node.id == "__name__":
                    assert id(node) in allowed, f"{name}:{node.lineno}"

    def test_files_are_written_where_the_user_said(self, sources):
        """Only modules that go through ``files.replacing`` or a temporary folder write; one fills a given one, and one
        numba's cache, whose place the add-on gives."""
        for name, tree in sources.items():
            imported = {
                alias.name for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom) for alias in n.names
            }
            if imported & {"replacing", "tempfile"} or name.startswith("core/experiments/") or name in {
                "core/io/atomic_files.py", "core/capture/rgbd_writer.py", "core/simulation/simulate.py",
                "mirror_scan_addon/background/worker.py", "mirror_scan_addon/background/kernel_compilation.py",
                "core/numeric/kernels.py", "core/sequences/video.py",
            }:  # fmt: skip
                continue
            for node in ast.walk(tree):
                if not isinstance(node, ast.Call):
                    continue
                called = ast.unparse(node.func).split(".")[-1]
                assert called not in {"write_text", "write_bytes", "savez", "savetxt", "tofile"}, (
                    f"{name}:{node.lineno}"
                )
                if called == "open":
                    mode = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant)]
                    mode += [k.value.value for k in node.keywords if k.arg == "mode"]
                    assert not set("wax+") & set("".join(mode)), f"{name}:{node.lineno}"

    def test_nothing_is_printed_but_by_commands(self, sources):
        for name, tree in sources.items():
            if name in {"core/cli/terminal.py", "mirror_scan_addon/command.py", "mirror_scan_addon/worker.py"}:
                continue
            for node in ast.walk(tree):
                if isinstance(node, ast.Call):
                    assert ast.unparse(node.func) != "print", f"{name}:{node.lineno}"

    def test_labels_are_in_title_case(self, sources):
        small = {"a", "an", "and", "as", "at", "by", "for", "from", "in", "of", "on", "or", "the", "to", "with"}
        for name, tree in sources.items():
            for node in ast.walk(tree):
                if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)):
                    continue
                if [ast.unparse(target) for target in node.targets] == ["bl_label"]:
                    words = node.value.value.split()
                    lower = [w for w in words if w[0].islower() and w not in small]
                    assert words and words[0][0].isupper() and not lower, f"{name}:{node.lineno} {node.value.value}"

    @staticmethod
    def _imports(sources):
        for name, tree in sources.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.Import):
                    yield from ((name, alias.name) for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    yield name, node.module


INSTALL = """
import json, os, sys
import bpy, addon_utils
import numpy as np

said = {}
addon_utils.enable("bl_pkg")
said["install"] = sorted(bpy.ops.extensions.package_install_files(
    filepath=PACKAGE, repo="user_default", enable_on_install=True))
name = "bl_ext.user_default.mirror_scan"
said["enabled"] = addon_utils.check(name)[1]
said["numba at start"] = "numba" in sys.modules

def answer():
    try:
        return str(bpy.ops.mirror_scan.build_avatar(filepath="/missing/capture"))
    except RuntimeError as error:
        return str(error)

sys.modules["numba"] = None  # as when its wheel is not there
said["no wheel"] = answer()
del sys.modules["numba"]
said["missing"] = answer()
import numba
said["cache"] = numba.config.CACHE_DIR
said["writable"] = os.access(numba.config.CACHE_DIR, os.W_OK)
from bl_ext.user_default.mirror_scan.core.mesh import Mesh
from bl_ext.user_default.mirror_scan.mirror_scan_addon.scene import avatar_objects
mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
said["object"] = avatar_objects.create_avatar(mesh, collection=bpy.context.collection).name
said["top level"] = sorted({"core", "mirror_scan", "mirror_scan_addon"} & sys.modules.keys())
said["warnings"] = [str(item) for item in addon_utils._extensions_warnings_get().get(name, [])]
addon_utils.disable(name, default_set=True)
said["left"] = dir(bpy.ops.mirror_scan)
print("\\n" + json.dumps(said))
"""


def install(package: Path, home: Path, before: str = "") -> dict:
    home.mkdir(exist_ok=True)
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment.update(BLENDER_USER_RESOURCES=str(home), HOME=str(home), XDG_CONFIG_HOME=str(home))
    done = subprocess.run(
        [sys.executable, "-c", f"PACKAGE = {str(package)!r}\n{before}\n{INSTALL}"],
        capture_output=True, text=True, timeout=120, env=environment, cwd=home,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])


def test_it_installs_and_works(package, tmp_path):
    home = tmp_path / "user"
    said = install(package, home)
    assert said["install"] == ["FINISHED"] and said["enabled"] is True
    assert said["numba at start"] is False
    assert said["no wheel"].startswith("Error: ") and "numba cannot be imported" in said["no wheel"]
    assert re.search(r"zip made for your platform.*: mirror_scan-[\d.]+-\w+?(-python3\.14)?\.zip", said["no wheel"])
    assert said["missing"].startswith("Error: ") and "there is no such file" in said["missing"]
    assert Path(said["cache"]).is_relative_to(home) and Path(said["cache"]).name == "numba_cache"
    assert said["object"] == "Avatar"
    assert said["top level"] == [] and said["warnings"] == [] and said["left"] == []


def test_without_a_place_for_the_cache_it_works_all_the_same(package, tmp_path):
    """As root no folder is read-only, so the place is taken by a file."""
    home = tmp_path / "user"
    blocked = home / "extensions" / ".user" / "user_default" / "mirror_scan"
    blocked.mkdir(parents=True)
    (blocked / "numba_cache").write_text("")
    said = install(package, home)
    assert said["missing"].startswith("Error: ") and "there is no such file" in said["missing"]
    assert not Path(said["cache"]).is_relative_to(home) and said["writable"]
