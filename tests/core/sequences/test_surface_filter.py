"""Surfaces that flicker become steady, wherever they go: on a body whose motion is known."""

from __future__ import annotations

import numpy as np
import trimesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.sequences import SurfaceFilter, SurfaceFilterSettings

NOISE = 0.003  # m


def body(place, lumps):
    """An egg that goes sideways and leans, with ``lumps`` (V,) along its normals [m]."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    normals = ball.vertices / (0.2, 0.3, 0.5)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lean = trimesh.transformations.rotation_matrix(0.04 * place, (0, 1, 0))[:3, :3]
    vertices = (ball.vertices * (0.2, 0.3, 0.5) + lumps[:, None] * normals) @ lean.T + (0.03 * place, 0.01 * place, 0.0)
    return Mesh(vertices, ball.faces.astype(np.int32), np.full((len(vertices), 3), 100 + place, np.uint8))


def sequence(count, scale):
    """The egg with other lumps, each some centimetres wide, in every frame; and the egg without."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    rng = np.random.default_rng(0)
    frames, truths = [], []
    for place in range(count):
        lumps = rng.standard_normal(len(ball.vertices))
        for _ in range(2):
            lumps = np.array([lumps[near].mean() for near in ball.vertex_neighbors])
        frames.append(body(place, scale * lumps / lumps.std()))
        truths.append(body(place, np.zeros(len(ball.vertices))))
    return frames, truths


def test_flicker_falls_and_nothing_lags():
    frames, truths = sequence(6, NOISE)
    steady = SurfaceFilter(SurfaceFilterSettings())
    made = [steady.next(frame) for frame in frames]
    off = [
        [
            np.linalg.norm(mesh.vertices - truth.vertices, axis=1).mean()
            for mesh, truth in zip(some, truths, strict=True)
        ]
        for some in (frames, made)
    ]
    assert np.mean(off[1][3:]) < 0.8 * np.mean(off[0][3:])
    for frame, mesh in zip(frames, made, strict=True):
        np.testing.assert_array_equal(mesh.triangles, frame.triangles)
    changes = [
        np.median([
            np.linalg.norm((b.vertices - y.vertices) - (a.vertices - x.vertices), axis=1)
            for a, b, x, y in zip(some[3:], some[4:], truths[3:], truths[4:], strict=False)
        ])
        for some in (frames, made)
    ]  # fmt: skip
    assert changes[1] < 0.65 * changes[0]


def test_what_is_somewhere_else_is_left_alone():
    frames, _ = sequence(2, 0.0)
    steady = SurfaceFilter()
    steady.next(frames[0])
    away = Mesh(frames[1].vertices + 1.0, frames[1].triangles, frames[1].colors)
    np.testing.assert_array_equal(steady.next(away).vertices, away.vertices)
    assert SurfaceFilter(SurfaceFilterSettings(use=False)).next(away) is away


def test_no_triangle_turns_over():
    from mirror_scan.core.mesh.normals import triangle_normals
    from mirror_scan.core.sequences.surface_filter import _unfolded

    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    triangles = ball.faces.astype(np.int32)
    moved = ball.vertices + 0.006 * np.random.default_rng(0).standard_normal(ball.vertices.shape)
    first = triangle_normals(ball.vertices, triangles)
    assert (np.einsum("ti,ti->t", triangle_normals(moved, triangles), first) <= 0).any()
    made, back = _unfolded(ball.vertices, moved, triangles)
    assert (np.einsum("ti,ti->t", triangle_normals(made, triangles), first) > 0).all()
    np.testing.assert_array_equal(made, np.where(back[:, None], ball.vertices, moved))
    assert back.mean() < 0.9
