"""The benchmarks' own geometry and corpus: closed forms, and that a seed is a seed."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from meshes import ours, sphere
from mirror_scan.benchmarks import corpus, generated, guard, isolated, optics, real, seams  # noqa: E402
from mirror_scan.core.camera import project  # noqa: E402
from mirror_scan.core.mesh import SEAM, SURFACE, Mesh  # noqa: E402
from mirror_scan.core.mesh.normals import triangle_normals  # noqa: E402
from mirror_scan.core.simulation.mannequin import Figure, mannequin  # noqa: E402
from mirror_scan.core.simulation.props import together  # noqa: E402

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
    body = generated.body_of(recipe)
    assert np.ptp(body.vertices[:, 2]) == pytest.approx(recipe.height)
    assert np.array_equal(body.vertices, generated.body_of(recipe).vertices)


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


def _grid(width: float, height: float, centre: tuple[float, float, float], step: float = 0.005) -> Mesh:
    """An upright sheet across the Y axis."""
    x, z = np.arange(0.0, width + 1e-9, step), np.arange(0.0, height + 1e-9, step)
    at = np.arange(len(x) * len(z)).reshape(len(x), len(z))
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    triangles = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)
    points = np.array([(u - width / 2, 0.0, v - height / 2) for u in x for v in z]) + centre
    return Mesh(points, triangles)


def test_a_flap_is_what_stands_outside_over_an_area():
    """Beside a ball of 20 cm: sheets outside it count by size and distance, the ball and sheets within it do not."""
    ball = ours(sphere(0.2))
    assert not len(optics.flaps(ball, ball))
    swollen = Mesh(ball.vertices * (1 + 0.012 / 0.2), ball.triangles)
    assert not len(optics.flaps(swollen, ball)), "12 mm off is no flap"
    assert optics.flaps(Mesh(ball.vertices * (1 + 0.02 / 0.2), ball.triangles), ball) == pytest.approx(
        4 * np.pi * 0.22**2, rel=0.01
    )
    large, small = _grid(0.03, 0.04, (0, -0.3, 0)), _grid(0.02, 0.02, (0, 0.3, 0))
    within = _grid(0.1, 0.1, (0, 0.02, 0))
    assert optics.flaps(together(*[ball, large, small, within]), ball) == pytest.approx([0.0012])
    two = together(*[ball, _grid(0.02, 0.02, (0, -0.3, 0)), _grid(0.02, 0.02, (0, -0.33, 0))])
    assert not len(optics.flaps(two, ball)), "two of 4 cm2 that do not touch"
    assert optics.flaps(together(*[_grid(0.05, 0.05, (0, -0.3, 0)), large]), ball) == pytest.approx([0.0025, 0.0012])


@pytest.mark.parametrize("pose", ({}, {"arm_angle_deg": 72.0}, {"arm_angle_deg": 35.0, "arm_forward_deg": 60.0}))
def test_parts_of_the_body_are_where_they_should_be(pose):
    body = mannequin(1.7, Figure(**pose), resolution=0.012)
    parts = optics.region_masks(body)
    at = body.vertices[body.triangles].mean(axis=1)
    area = np.linalg.norm(triangle_normals(body.vertices, body.triangles), axis=1) / 2
    assert parts[optics.WHOLE].all()
    for one, other in ((optics.FACE, optics.HAIR), (optics.FACE, optics.HANDS), (optics.FEET, optics.HANDS)):
        assert not (parts[one] & parts[other]).any()
    face, hair, hands, feet = (at[parts[name]] for name in (optics.FACE, optics.HAIR, optics.HANDS, optics.FEET))
    assert face[:, 1].max() < hair[:, 1].max() and face[:, 2].min() > 1.4 and np.abs(face[:, 0]).max() < 0.12
    assert hair[:, 2].max() == pytest.approx(1.7, abs=0.01) and hair[:, 1].max() > 0.03
    assert feet[:, 2].max() < 0.1
    for side in (hands[hands[:, 0] > 0], hands[hands[:, 0] < 0]):
        assert np.linalg.norm(np.ptp(side, axis=0)) < 0.3 and len(side) > 50
    assert 0.04 < area[parts[optics.HANDS]].sum() < 0.14
    # the arms' ends: nothing of the arms lies farther out than the hands do
    arms = np.abs(at[:, 0]) > np.abs(hands[:, 0]).max() - 1e-9
    assert parts[optics.HANDS][arms].any()


def test_triples_differ_and_tell_distances_apart():
    rng = np.random.default_rng(5)
    triples = [optics.draw_triple(rng) for _ in range(20)]
    assert len(set(triples)) == 20
    for triple in triples:
        period = 149.896229 / np.array(triple)
        for other in np.arange(0.3, 8.5, 0.01):
            assert np.abs(other - period * np.rint(other / period)).max() > 0.03, triple
    assert optics.draw(3)[1] == optics.draw(3)[1] != optics.draw(4)[1]
    rig = optics.draw(3)[0].rig
    assert optics.with_column(rig, triples[0], "ideal") is rig
    real = optics.with_column(rig, triples[0], "real").optics
    assert real.multipath and real.frequencies == triples[0] and not real.warp and real.skin == (0.0, 0.0)


def _rounds(rng: np.random.Generator, slower: dict[str, float]) -> list[list[dict[str, float]]]:
    """Eight processes' rounds: each process is some per cent off for life, each round some more, a few much."""
    stages = {"depth": 0.03, "views": 0.045, "zippering": 0.03, "closing": 0.06}
    found = []
    for _ in range(8):
        process = {stage: seconds * rng.lognormal(0.0, 0.012) for stage, seconds in stages.items()}
        found.append(
            [
                {
                    stage: seconds * slower.get(stage, 1.0) * rng.lognormal(0.0, 0.03) * (1 + (rng.random() < 0.1))
                    for stage, seconds in process.items()
                }
                for _ in range(8)
            ]
        )
    return found


def test_the_guard_names_the_slower_stage_and_no_other():
    rng = np.random.default_rng(5)
    right = clean = 0
    for _ in range(60):
        verdicts = guard.judge(_rounds(rng, {"closing": 1.14}), _rounds(rng, {}))
        slower = [v.stage for v in verdicts if v.slower]
        right += "closing" in slower and set(slower) <= {"closing", "whole job"}
        clean += not any(v.slower for v in guard.judge(_rounds(rng, {}), _rounds(rng, {})))
    assert right >= 57 and clean >= 57
    with pytest.raises(ValueError, match="two pairs"):
        guard.judge(_rounds(rng, {})[:1], _rounds(rng, {})[:1])
