"""The paper's experiments 5.1 and 5.2: against closed forms, other libraries, and what must hold whatever the noise."""

from __future__ import annotations

import csv

import numpy as np
import pytest
import trimesh
from mirror_scan.core import cli
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.experiments import distance, reflection
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.optics import real
from mirror_scan.core.simulation.simulate import simulate
from scipy.optimize import curve_fit


def test_an_ideal_camera_loses_nothing_in_a_perfect_mirror(person):
    rows = reflection.run(person, "ideal", 1, path=3.0, reflectance=1.0, samples=10_000)
    assert [r.way for r in rows] == ["raw", "cleaned"]
    for row in rows:
        assert abs(row.loss("vertices")) < 0.01 and abs(row.loss("triangles")) < 0.01
        assert row.apart.mean < 0.4e-3 and row.mirrored_truth.mean < 0.6e-3
        body = trimesh.Trimesh(row.mirrored.vertices, row.mirrored.triangles, process=False)
        outward = body.face_normals @ (0, 1, 0)  # towards the camera behind
        assert (outward > 0).mean() > 0.98, "a reflected patch must be wound anew"
        assert row.mirrored.vertices[:, 1].mean() > 0, "it is the back that is seen"


def test_both_cameras_are_at_one_place_by_the_mirror(person):
    beside, behind = reflection.rigs("ideal", 1, 0)
    mirror = beside.mirrors[0]
    normal = mirror.axes[2]
    camera = np.array(beside.camera)
    image = camera - 2 * ((camera - np.array(mirror.centre)) @ normal) * normal
    np.testing.assert_allclose(image, behind.camera, atol=1e-12)
    made = simulate(person, beside)
    assert (made.truth.labels == 1).sum() > 15000 and not (made.truth.labels == 0).any()


def test_a_kinect_and_the_paper(person):
    raw, cleaned = reflection.run(person, "kinect_v1", 10, samples=10_000)
    assert 1e-3 < raw.apart.mean < 4e-3  # the paper: 2.1 mm
    assert cleaned.apart.mean < 0.6 * raw.apart.mean
    assert cleaned.mirrored_truth.mean < 0.6 * raw.mirrored_truth.mean
    assert 0.01 < raw.loss("vertices") < 0.25
    dim = reflection.run(person, "kinect_v1", 2, reflectance=0.7, samples=1000)[0]
    assert dim.loss("vertices") > raw.loss("vertices") + 0.01


def test_a_real_mirror_costs_more(person):
    """Weak light loses vertices for a reason: more in the mirror than directly, more the less it gives back."""
    losses = []
    for reflectance in (0.85, 0.7, 0.5):
        made = reflection.run(person, "kinect_v1", 2, reflectance=reflectance, samples=1000, optics=real("kinect_v1"))
        losses.append(made[0].loss("vertices"))
    assert 0.02 < losses[0] < losses[1] < losses[2] < 0.5


def test_distance_costs_vertices_by_the_square(person):
    rows = distance.run(person, "kinect_v1", 10, distances=(3.0, 4.0, 5.0), samples=10_000)
    raw, cleaned = ([r for r in rows if r.way == way] for way in ("raw", "cleaned"))
    for mine in (raw, cleaned):
        assert mine[0].apart.mean < 1e-6
        assert [r.apart.mean for r in mine] == sorted(r.apart.mean for r in mine)
        assert [r.truth.mean for r in mine] == sorted(r.truth.mean for r in mine)
        counts = [len(r.mesh.vertices) for r in mine]
        np.testing.assert_allclose(np.divide(counts, counts[0]), [1, 9 / 16, 9 / 25], rtol=0.06)
    for a, b in zip(raw, cleaned, strict=True):
        assert b.truth.mean < 0.6 * a.truth.mean


def test_the_fit_is_that_of_scipy():
    d = np.array(distance.DISTANCES)
    n = np.array([22000, 15800, 12600, 9300, 8100])
    fit = distance.fit_counts(d, n)
    (a, b), _ = curve_fit(lambda x, a, b: a * np.exp(-b * x), d, n, p0=(1e5, 0.5))
    assert (fit.a, fit.b) == pytest.approx((a, b), rel=1e-6)
    assert fit.c == pytest.approx(curve_fit(lambda x, c: c / x**2, d, n)[0][0], rel=1e-6)
    exact = distance.fit_counts(d, 1e6 / d**2)
    assert exact.c == pytest.approx(1e6) and exact.square_r2 == pytest.approx(1) and exact.exponential_r2 < 1
    for distances, counts in (((3, 4), (2, 1)), ((3, 3, 3), (1, 1, 1)), ((3, 4, 5), (1, 0, 1))):
        with pytest.raises(MirrorScanError, match="fit"):
            distance.fit_counts(distances, counts)


def test_what_cannot_be(person):
    with pytest.raises(MirrorScanError, match="three distances"):
        distance.run(person, distances=(3.0, 3.0, 4.0))
    with pytest.raises(MirrorScanError, match="past the mirror"):
        reflection.run(person, path=1.0)
    far = Mesh(person.vertices + (50.0, 0, 0), person.triangles)
    with pytest.raises(MirrorScanError, match="sees nothing"):
        distance.run(far, "ideal", 1)


@pytest.mark.parametrize("name", ["reflection", "distance"])
def test_on_the_command_line(name, tmp_path, capsys):
    body = trimesh.creation.cylinder(radius=0.15, height=0.8, sections=48)
    body.export(tmp_path / "body.ply")
    words = ["experiment", name, str(tmp_path / "body.ply"), "-o", str(tmp_path / "out"), "--frames", "1"]
    words += ["--optics", "real"] if name == "reflection" else []
    assert cli.main(words) == 0
    said = capsys.readouterr().out
    assert "paper" in said and "plot.png" in said
    rows = list(csv.DictReader((tmp_path / "out" / "table.csv").read_text().splitlines()))
    assert {row["way"] for row in rows} == {"raw", "cleaned"}
    assert {"table.csv", "plot.png", "result.png"} == {path.name for path in (tmp_path / "out").iterdir()}
