"""The README's script for many captures does what the README says."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate, write_simulation

ROOT = Path(__file__).resolve().parents[3]


def test_the_script_of_the_readme(tmp_path):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(import multiprocessing\n.*?)```", text, re.DOTALL)
    scans = tmp_path / "my_scans"
    scans.mkdir()
    rig = default_rig(sensor="azure_kinect", mirrors=2, frames=1, seed=1)
    write_simulation(simulate(mannequin(), rig), scans / "a")
    shutil.copytree(scans / "a", scans / "b")
    (scans / "b" / "intrinsic.json").unlink()
    start = f"import runpy\n\nrunpy.run_path({str(ROOT / 'tests' / 'conftest.py')!r})\n"
    (tmp_path / "many.py").write_text(start + code, encoding="utf-8")
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "many.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}, capture_output=True,
        text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0 and not done.stderr, done.stderr
    first, second = done.stdout.splitlines()
    assert re.fullmatch(r"my_scans.a: 1\.\d\d m tall", first)
    assert second.startswith(str(Path("my_scans/b"))) and "intrinsic" in second
    assert (scans / "a.ply").is_file()
