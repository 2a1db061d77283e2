"""Meshes that the tests of several modules take; those who import it are skipped without trimesh."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st
from mirror_scan.core.mesh import Mesh

trimesh = pytest.importorskip("trimesh")
seeds = st.integers(0, 2**32 - 1)


def coloured(vertices, triangles, rng) -> Mesh:
    return Mesh(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(triangles, dtype=np.int32),
        rng.integers(0, 256, (len(vertices), 3)).astype(np.uint8),
        rng.integers(-1, 3, len(vertices)).astype(np.int8),
        rng.integers(0, 3, len(triangles)).astype(np.int8),
    )


def soup(seed: int) -> Mesh:
    """Oriented 2-manifold pieces with random triangles missing, numbered at random; some vertices are never used."""
    rng = np.random.default_rng(seed)
    parts = [
        trimesh.creation.icosphere(subdivisions=1),
        trimesh.creation.torus(1.0, 0.3, major_sections=8, minor_sections=5),
        trimesh.creation.box(),
    ]
    whole = trimesh.util.concatenate([parts[i] for i in rng.integers(0, 3, rng.integers(1, 4))])
    faces = whole.faces[rng.random(len(whole.faces)) > rng.choice([0.0, 0.1, 0.5])]
    number = rng.permutation(len(whole.vertices))
    vertices = np.empty_like(whole.vertices)
    vertices[number] = whole.vertices + rng.normal(size=whole.vertices.shape)
    return coloured(vertices, rng.permutation(number[faces]), rng)


def shape_of(mesh: Mesh) -> np.ndarray:
    """What the mesh looks like, however its vertices are numbered: corners with colour and view, and each kind."""
    t = mesh.triangles
    corners = np.concatenate((mesh.vertices[t], mesh.colors[t], mesh.view[t][..., None]), axis=2).reshape(len(t), -1)
    return np.column_stack((corners, mesh.kind))


def ours(mesh) -> Mesh:
    return Mesh(np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32))


def sphere(radius=1.0, centre=(0, 0, 0), level=5):
    mesh = trimesh.creation.icosphere(level, radius)
    mesh.apply_translation(centre)
    return mesh


def lopsided():
    """A closed body without symmetry, about as large as a person."""
    vertices = sphere(0.5, level=4).vertices.copy()
    vertices[:, 2] *= 1.7
    vertices += 0.05 * np.sin(7 * vertices[:, [1, 2, 0]])
    return trimesh.Trimesh(vertices, sphere(level=4).faces, process=False)


def coloured_sphere(subdivisions: int = 2) -> Mesh:
    shape = trimesh.creation.icosphere(subdivisions)
    rng = np.random.default_rng(1)
    return Mesh(
        np.array(shape.vertices),
        np.array(shape.faces, dtype=np.int32),
        colors=rng.integers(0, 256, (len(shape.vertices), 3), dtype=np.uint8),
        view=rng.integers(-1, 4, len(shape.vertices), dtype=np.int8),
        kind=rng.integers(0, 3, len(shape.faces), dtype=np.int8),
    )
