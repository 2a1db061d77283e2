"""The benchmarks' own geometry and corpus: closed forms, and that a seed is a seed."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.benchmarks import corpus, generated, isolated, real, seams  # noqa: E402
from mirror_scan.core.camera import project  # noqa: E402
from mirror_scan.core.mesh import SEAM, SURFACE, Mesh  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))


def test_the_corpus_is_wide_and_the_same_each_time():
    recipes = list(generated.recipes())
    assert len(recipes) >= 60 and recipes == list(generated.recipes())
    assert next(generated.recipes((17,))) == recipes[17]
    for kind, least in ((lambda r: r.rig.sensor, 4), (lambda r: r.mirrors, 3), (lambda r: r.pose, 4),
                        (lambda r: r.rig.frames, 4), (lambda r: (r.rig.sensor, r.mirrors), 12)):  # fmt: skip
        assert len(Counter(map(kind, recipes))) >= least
    assert {r.rig.interference for r in recipes} == {None, True, False}
    assert {recipes[n].rig.sensor for n in generated.QUICK} == set(generated.SENSORS)
    assert {recipes[n].mirrors for n in generated.QUICK} == {1, 2, 3}


def test_every_body_fits_into_its_picture():
    for recipe in generated.recipes():
        rig = recipe.rig
        to_camera = np.linalg.inv(rig.camera_to_avatar)
        ends = np.array([(0.0, -0.15, 0.0), (0.0, -0.1, recipe.height)])
        rows = project(ends @ to_camera[:3, :3].T + to_camera[:3, 3], rig.intrinsics)[:, 1]
        assert 0 < rows.min() and rows.max() < rig.intrinsics.height, recipe


def test_mannequins_of_a_recipe_are_closed_and_as_tall_as_told():
    recipe = next(r for r in generated.recipes() if r.pose == "a step")
    body = generated._body(recipe)
    assert np.ptp(body.vertices[:, 2]) == pytest.approx(recipe.height)
    assert np.array_equal(body.vertices, generated._body(recipe).vertices)


def test_control_points_lie_where_tangents_meet():
    """Over a quarter circle both tangents meet in the corner of the square around it."""
    start, end = np.array([[1.0, 0, 0]]), np.array([[0.0, 1, 0]])
    up, right = np.array([[0.0, 2, 0]]), np.array([[3.0, 0, 0]])
    assert seams.control_points(start, up, end, right) == pytest.approx(np.array([[1.0, 1, 0]]))
    # parallel: the rung's middle; pointing away from each other: not followed backwards
    assert seams.control_points(start, up, end, -up) == pytest.approx((start + end) / 2)
    assert seams.control_points(start, -up, end, -right) == pytest.approx((start + end) / 2)


def test_bezier_strips_bulge_as_the_curve_does():
    one = np.array([[1.0, 0, 0]])
    strips = seams.Strips(one, one + (0, 0, 0.1), np.array([[0.0, 1, 0]]), *(np.array([d]) for d in
                          ((0.0, 1, 0), (0.0, 1, 0), (1.0, 0, 0))))  # fmt: skip
    at = np.array([0.0, 0.5, 1.0])
    curve = seams.bezier(strips, np.zeros(3, int), np.zeros(3), at)
    assert curve == pytest.approx(np.array([[1.0, 0, 0], [0.75, 0.75, 0], [0.0, 1, 0]]))
    assert strips.width == pytest.approx(np.sqrt(2.01))


def test_scene_numbers():
    assert corpus.scene_numbers("0-3,7") == (0, 1, 2, 3, 7)
    with pytest.raises(Exception, match="numbered"):
        corpus.scene_numbers("99")


def test_a_crash_or_a_hang_is_told_and_outlived():
    worker = isolated.Worker()
    try:
        assert worker.call(len, "four") == 4
        with pytest.raises(isolated.PeerFailed, match="code 3"):
            worker.call(os._exit, 3)
        assert worker.call(abs, -2) == 2, "another process answers"
        with pytest.raises(isolated.PeerFailed, match="ZeroDivisionError"):
            worker.call(divmod, 1, 0)
        with pytest.raises(isolated.PeerFailed, match="stopped"):
            worker.call(time.sleep, 60, limit=0.2)
        assert worker.call(abs, -3) == 3
    finally:
        worker.stop()


def test_luminance_of_a_seam_beside_its_surroundings():
    v, u = np.mgrid[:60, :60]
    corners = np.stack((0.002 * u, 0.002 * v, 0 * u), axis=-1).reshape(-1, 3).astype(float)
    a = (60 * v + u)[:-1, :-1].ravel()
    triangles = np.concatenate((np.column_stack((a, a + 1, a + 61)), np.column_stack((a, a + 61, a + 60))))
    strip = np.isin(u.ravel()[triangles].min(axis=1), (29, 30))
    level = np.where(np.abs(u - 30) <= 1, 130, 100).ravel()
    mesh = Mesh(corners, triangles.astype(np.int32), np.repeat(level[:, None], 3, axis=1).astype(np.uint8),
                None, np.where(strip, SEAM, SURFACE).astype(np.int8))  # fmt: skip
    own, beside, ratio, near, bright = real.luminance(mesh, SEAM)
    np.testing.assert_allclose((own, beside, ratio, near, bright), (130, 100, 1.3, 0, 0), atol=1e-6)


def test_real_captures_that_are_absent_are_skipped(tmp_path, capsys):
    assert real.run() == real.run(tmp_path) and not real.run(tmp_path).tables
    said = capsys.readouterr().err
    assert "--captures" in said and all(name in said for name in (real.PERSON, real.ROOMS, "projeto-ovni"))
