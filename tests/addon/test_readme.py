"""The script in the README does what the README says, line for line; only the places are others."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]


def script() -> str:
    """The first block of Python in the chapter on Blender."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    chapter = text[text.index("\n## In Blender\n") :]
    return re.search(r"```python\n(.*?)```", chapter, re.DOTALL).group(1)


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Path:
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate, write_simulation

    folder = tmp_path_factory.mktemp("readme") / "my_scan"
    write_simulation(simulate(mannequin(), default_rig(sensor="azure_kinect", mirrors=2, frames=4, seed=3)), folder)
    (folder / "mirrors.json").unlink()  # they are found
    return folder


def test_the_script_of_the_readme_runs(capture, tmp_path):
    code = script()
    assert len(code.splitlines()) <= 12
    code = code.replace("/path/to/my_scan", str(capture)).replace("/path/to/", f"{tmp_path}/")
    start = f"import runpy; runpy.run_path({str(ROOT / 'tests' / 'conftest.py')!r})\n"
    start += "import bpy, mirror_scan; mirror_scan.register()\n"
    # The bpy 4.5 module waits for ever where a parallel kernel and the glTF exporter ran; see conftest.py.
    end = "\nimport os, sys\nif bpy.app.version < (5, 0, 0):\n    sys.stdout.flush()\n    os._exit(0)\n"
    done = subprocess.run(
        [sys.executable, "-c", start + code + end], capture_output=True, text=True, timeout=300, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"its frame is flat to \d+\.\d mm", done.stdout)) == 2, done.stdout
    height = float(re.search(r"^my_scan: (\d\.\d\d) m tall", done.stdout, re.MULTILINE).group(1))
    assert 1.6 < height < 2.0
    for name in ("avatar.glb", "avatar.blend"):
        assert (tmp_path / name).stat().st_size > 100_000
