"""What runs through itself is smoothed apart, and what cannot be is cut out and closed again."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.closing.self_intersection_repair import untangle
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.submesh import triangle_components, vertex_fans


def body(vertices, faces, made) -> Mesh:
    kind = np.where(made[faces].any(axis=1), FILL, SURFACE).astype(np.int8)
    view = np.where(made, -1, 0).astype(np.int8)
    return Mesh(np.array(vertices, dtype=np.float64), np.array(faces, np.int32), None, view, kind)


def check_sound(mesh: Mesh):
    assert (twins(mesh.triangles, len(mesh.vertices)) >= 0).all()
    assert (vertex_fans(mesh.triangles, len(mesh.vertices)) == 1).all()
    assert triangle_components(mesh.triangles, len(mesh.vertices))[1] == 1
    assert len(mesh.kind) == len(mesh.triangles) and len(mesh.view) == len(mesh.vertices)
    assert not len(self_intersections(mesh.vertices, mesh.triangles))


def ball():
    return trimesh.creation.icosphere(subdivisions=5, radius=0.4)


def test_nothing_crosses_nothing_changes():
    whole = ball()
    mesh = body(whole.vertices, whole.faces, whole.vertices[:, 2] > 0.2)
    same, left = untangle(mesh)
    assert same is mesh and left == 0
    bare = body(whole.vertices, whole.faces, np.zeros(len(whole.vertices), np.bool_))
    assert untangle(bare) == (bare, 0)


def test_ruffles_are_smoothed():
    whole = ball()
    made = whole.vertices[:, 2] > 0.35
    vertices = np.array(whole.vertices)
    vertices[made] += 0.02 * np.random.default_rng(0).normal(size=(made.sum(), 3))
    mesh = body(vertices, whole.faces, made)
    assert len(self_intersections(mesh.vertices, mesh.triangles))
    out, left = untangle(mesh)
    assert left == 0
    check_sound(out)
    far = whole.vertices[:, 2] < 0.25
    kept = trimesh.Trimesh(out.vertices, out.triangles, process=False).nearest.on_surface(whole.vertices[far][::9])[1]
    assert kept.max() < 1e-9, "far from it nothing moves"


def test_a_dent_through_the_other_side_is_cut_out():
    """A thumb pushed through a ball's far wall: smoothing does not pull it out again."""
    whole = ball()
    aside = np.linalg.norm(whole.vertices[:, :2], axis=1)
    made = (whole.vertices[:, 2] > 0) & (aside < 0.15)
    vertices = np.array(whole.vertices)
    vertices[made, 2] -= 1.2 * (1 - (aside[made] / 0.15) ** 2)
    assert vertices[made, 2].min() < -0.45, "comes out below"
    mesh = body(vertices, whole.faces, made | ((whole.vertices[:, 2] < 0) & (aside < 0.2)))
    smoothed, left = untangle(mesh, cuts=0)
    assert left > 0 and len(smoothed.triangles) == len(mesh.triangles)
    out, left = untangle(mesh)
    assert left == 0
    check_sound(out)
    assert out.vertices[:, 2].min() > -0.41, "what had come out is gone"
    volume = trimesh.Trimesh(out.vertices, out.triangles, process=False).volume
    assert abs(volume / whole.volume - 1) < 0.2


def test_what_is_more_than_a_crumb_is_not_cut_off():
    """Two halves that only hang together by what crosses stay as they are, and it is said."""
    whole = ball()
    vertices = np.array(whole.vertices)
    waist = np.abs(vertices[:, 2]) < 0.1
    turn = np.pi * np.clip((vertices[:, 2] + 0.1) / 0.2, 0, 1)  # wrung like a towel
    x, y = vertices[:, 0].copy(), vertices[:, 1].copy()
    pinch = np.where(waist, 0.02, 1.0)
    vertices[:, 0] = pinch * (np.cos(turn) * x - np.sin(turn) * y)
    vertices[:, 1] = pinch * (np.sin(turn) * x + np.cos(turn) * y)
    made = np.abs(vertices[:, 2]) < 0.15
    mesh = body(vertices, whole.faces, made)
    out, left = untangle(mesh)
    assert np.ptp(out.vertices[:, 2]) > 0.75, "neither half was dropped"
    assert (twins(out.triangles, len(out.vertices)) >= 0).all() and left >= 0


@pytest.mark.parametrize("size", [0.02, 0.05])
def test_a_hand_is_not_cut_off_at_a_pinched_wrist(size):
    """It has fewer triangles than a crumb may have, but holds more: what crosses between it and the rest stays."""
    whole = trimesh.creation.icosphere(subdivisions=6, radius=0.4)
    turned = np.arccos(np.clip(whole.vertices[:, 2] / 0.4, -1, 1))
    arm, end = 0.44, 0.18  # angles from the pole: where the arm ends, and the wrist
    around = whole.vertices[:, :2] / np.maximum(np.linalg.norm(whole.vertices[:, :2], axis=1), 1e-9)[:, None]
    vertices = np.array(whole.vertices)
    wrist, hand = (turned < arm) & (turned >= end), turned < end
    along = (arm - turned[wrist]) / (arm - end)
    vertices[wrist, :2] = 0.03 * np.cos(2 * np.pi * along)[:, None] * around[wrist]
    vertices[wrist, 2] = 0.35 + 0.1 * along
    polar = np.pi * turned[hand] / end
    vertices[hand, :2] = size * np.sin(polar)[:, None] * around[hand]
    vertices[hand, 2] = 0.45 + size * (1 + np.cos(polar))
    mesh = body(vertices, whole.faces, wrist)
    assert hand[mesh.triangles].all(axis=1).sum() < 0.02 * len(mesh.triangles), "no larger than a crumb"
    out, left = untangle(mesh)
    assert left > 0, "what crosses stays"
    shown = vertices[hand & (vertices[:, 2] > 0.45 + 0.5 * size)][::9]
    away = trimesh.Trimesh(out.vertices, out.triangles, process=False).nearest.on_surface(shown)[1]
    assert away.max() < 1e-9, "the hand is where it was"
    assert (twins(out.triangles, len(out.vertices)) >= 0).all()
    assert triangle_components(out.triangles, len(out.vertices))[1] == 1


def test_what_is_all_double_is_not_cut_away():
    """Both sides of a flat sheet lie in each other: no triangle is sound, and none is taken out."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, 0.4, 30), np.linspace(0, 0.4, 30)))
    at = np.arange(900).reshape(30, 30)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    front = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))
    # the back has vertices of its own inside, and shares those of the rim
    back = np.where(np.isin(at, at[1:-1, 1:-1]), at + 900, at).ravel()[front[:, ::-1]]
    flat = np.column_stack((x, y, np.zeros(900)))
    mesh = body(np.concatenate((flat, flat)), np.concatenate((front, back)), np.arange(1800) >= 900)
    out, left = untangle(mesh)
    assert len(out.triangles) == len(mesh.triangles) and left > 0


def test_crossings_far_apart_take_little_memory():
    """Two dented balls 200 m from each other: what is near is looked up in as many cells as memory has room for."""
    vertices, faces = np.array(ball().vertices), ball().faces
    made = np.hypot(vertices[:, 0], vertices[:, 1]) < 0.05
    vertices[made & (vertices[:, 2] > 0), 2] -= 0.85
    both = np.concatenate((vertices, vertices + (200, 200, 200)))
    out, left = untangle(body(both, np.concatenate((faces, faces + len(vertices))), np.concatenate((made, made))))
    assert (twins(out.triangles, len(out.vertices)) >= 0).all() and left == 0
