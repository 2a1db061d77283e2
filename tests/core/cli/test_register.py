"""The paper's rivals and ``reconstruct --register`` from the command line: what is asked, found and refused."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import TETRAHEDRON, refused
from mirror_scan.core import cli
from mirror_scan.core.experiments import cameras, turntable
from mirror_scan.core.io import write_mesh
from mirror_scan.core.numeric.rotations import about_axis
from mirror_scan.core.registration import pairwise
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate, write_simulation


def test_what_does_not_go_together(capsys, tmp_path, monkeypatch):
    out = ["-o", tmp_path / "a.ply"]
    captures = [tmp_path / "one", tmp_path / "two"]
    refused(capsys, ["reconstruct", captures[0], "--register", *out], "give several")
    refused(capsys, ["reconstruct", *captures, "--register", "--poses", tmp_path / "p.json", *out], "leave out --poses")
    refused(capsys, ["reconstruct", *captures, "--step", "45", *out], "--register")
    monkeypatch.setattr(pairwise.importlib.util, "find_spec", lambda name: None)
    refused(capsys, ["reconstruct", *captures, "--register", *out], "pip install small_gicp")


def test_what_a_rival_is_asked_and_where_it_writes(capsys, tmp_path, monkeypatch):
    """The experiments run for minutes; here their results are at hand, of which none is an avatar."""
    asked = {}

    def turned(body, sensor, frames, seed, **wanted):
        asked.update(wanted, frames=frames)
        return [turntable.Row(way, 0.0, None, {}, fault="nobody") for way in (turntable.SNAPSHOT, turntable.TURNTABLE)]

    def joined(body, sensor, frames, seed, optics, progress):
        row = turntable.Row(cameras.MIRRORS, 0.0, None, {}, fault="nobody")
        return cameras.Outcome([cameras.Arrangement(row, "–", (2.0, 3.0), 0.1)], [])

    monkeypatch.setattr(turntable, "run", turned)
    monkeypatch.setattr(cameras, "run", joined)
    write_mesh(tmp_path / "body.ply", TETRAHEDRON)
    for name, own in (("turntable", ["--sway", "2.5,10", "--scans", "6"]), ("cameras", [])):
        folder = tmp_path / name
        assert cli.main(["experiment", name, str(tmp_path / "body.ply"), *own, "--frames", "3", "-o", str(folder)]) == 0
        assert "no avatar: nobody" in capsys.readouterr().out
        assert "nobody" in (folder / "table.csv").read_text() and (folder / "result.png").is_file()
    assert (asked["sways"], asked["scans"], asked["frames"]) == ([0.0025, 0.01], 6, 3)


@pytest.mark.slow
def test_a_turn_of_the_plate_from_files(person, capsys, tmp_path):
    if all(importlib.util.find_spec(name) is None for name in pairwise.BACKENDS):
        pytest.skip("neither small_gicp nor open3d is installed")
    rig, folders = default_rig("azure_kinect", mirrors=0, frames=1), []
    for number in range(6):
        turn = np.eye(4)
        turn[:3, :3] = about_axis(2, np.radians(60.0 * number))
        folders.append(tmp_path / f"scan{number}")
        write_simulation(simulate(person.transformed(turn), replace(rig, seed=number)), folders[-1])
    report = tmp_path / "report.json"
    arguments = ["reconstruct", *folders, "--register", "-o", tmp_path / "a.ply", "--report", report]
    assert cli.main([str(a) for a in arguments]) == 0
    assert "6 captures registered: residual" in capsys.readouterr().out
    found = json.loads(report.read_text())
    assert found["mesh"]["watertight"] and len(found["views"]) == 6
    registration = found["registration"]
    assert registration["residual_mm"] < 4.0 and registration["angles_deg"][1] == 60.0
    assert max(pair["corrected_mm"] for pair in registration["pairs"]) < 10.0
    assert np.shape(registration["camera_to_first"]) == (6, 4, 4)
