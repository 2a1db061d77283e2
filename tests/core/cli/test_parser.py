"""The words of the command line: usage, help without heavy imports, every sensor."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from mirror_scan.core import cli

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["reconstruct"], ["reconstruct", "a"], ["simulate", "a", "--frames", "0"],
                  ["simulate", "a", "--mirrors", "x"], ["reconstruct", "a", "-o", "a.ply", "--frame", "world"]]
)  # fmt: skip
def test_usage_is_2(capsys, arguments):
    assert cli.main(arguments) == 2
    assert "usage: mirror-scan" in capsys.readouterr().err


def test_help_answers_without_heavy_imports():
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r}); import conftest\n"
        "from mirror_scan.core import cli\n"
        "assert cli.main(['--help']) == 0 and cli.main(['reconstruct', '--help']) == 0\n"
        "heavy = {'numpy', 'numba', 'OpenImageIO', 'tqdm', 'bpy'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "from mirror_scan.core import capture\nfrom mirror_scan.core.io import images\n"
        "assert 'numba' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=60)


def test_every_sensor_can_be_asked_for():
    from mirror_scan.core.simulation.sensors import SENSORS

    assert set(cli.SENSORS) == set(SENSORS)


def test_every_effect_can_be_asked_for():
    from mirror_scan.core.cli.parser import EFFECTS
    from mirror_scan.core.simulation import optics

    assert tuple(optics.EFFECTS) == EFFECTS
