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
                  ["simulate", "a", "--mirrors", "x"], ["reconstruct", "a", "-o", "a.ply", "--frame", "world"],
                  *(["reconstruct", "a", "-o", "a.ply", *words] for words in (
                      ["--glass-thickness", "26"], ["--glass-thickness", "-1"], ["--glass-offset", "thick"],
                      ["--glass-offset", "nan"], ["--two-way-light", "maybe"], ["--frequencies", "80,0"],
                      ["--frequencies", "80,x"], ["--bow", "2"]))]
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
    from mirror_scan.core.cli.argument_types import EFFECTS
    from mirror_scan.core.simulation import optics

    assert tuple(optics.EFFECTS) == EFFECTS


def test_the_turntable_turns_as_the_experiment_has_it():
    from mirror_scan.core.cli.parser import build_parser
    from mirror_scan.core.experiments import turntable

    asked = build_parser("mirror-scan").parse_args(["experiment", "turntable"])
    assert asked.sways == tuple(1e3 * sway for sway in turntable.SWAYS) and asked.scans == turntable.SCANS


def test_glass_and_light_reach_the_settings():
    from mirror_scan.core.cli.commands import glass_of, settings_of
    from mirror_scan.core.cli.parser import build_parser
    from mirror_scan.core.pipeline import Settings

    def parsed(*words):
        return build_parser("mirror-scan").parse_args(list(words))

    plain = ("reconstruct", "a", "-o", "a.ply")
    assert settings_of(parsed(*plain)) == settings_of(parsed("inspect", "a")) == Settings()
    chosen = settings_of(
        parsed(*plain, "--glass-offset", "12", "--glass-thickness", "5", "--bow", "off", "--two-way-light", "on",
               "--frequencies", "100,80,16")
    )  # fmt: skip
    assert chosen.mirror.glass_offset == 0.012 and chosen.mirror.glass_thickness == 0.005 and not chosen.bow.use
    assert chosen.light.two_ways == "on" and chosen.light.frequencies == (100.0, 80.0, 16.0)
    assert settings_of(parsed(*plain, "--two-way-light", "off")).light.two_ways == "off"
    assert glass_of(parsed("calibrate", "a", "-o", "r.json", "--glass-thickness", "4")).glass_thickness == 0.004
