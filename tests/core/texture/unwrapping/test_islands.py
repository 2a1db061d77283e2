"""Islands: disks that lie flat, apart from one another, with lengths as on the skin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.avatar.skin_weights import skinned_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.texture.unwrapping.flattening import crosses_itself, flatten, flipped
from mirror_scan.core.texture.unwrapping.islands import find_islands, flipped_count, is_disk, unwrap
from standing_body import standing_body

trimesh = pytest.importorskip("trimesh")


def ours(mesh) -> Mesh:
    return Mesh(np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32))


def times_covered(uv: np.ndarray, seed: int, count: int = 3000) -> np.ndarray:
    """In how many triangles (N,) some random places of the triangles lie, by comparing each with all."""
    rng = np.random.default_rng(seed)
    uv = uv.astype(np.float64)
    chosen = rng.integers(0, len(uv), count)
    places = np.einsum("nk,nkc->nc", rng.dirichlet((1, 1, 1), count), uv[chosen])
    times = np.zeros(count, int)
    for triangle in uv:
        inside = np.ones(count, bool)
        for k in range(3):
            a, b = triangle[k], triangle[(k + 1) % 3]
            inside &= (b[0] - a[0]) * (places[:, 1] - a[1]) - (b[1] - a[1]) * (places[:, 0] - a[0]) > 1e-9
        times += inside
    return times


def check(mesh: Mesh, uv: np.ndarray, island: np.ndarray, seed: int = 0) -> None:
    assert flipped_count(uv) == 0
    assert 0 <= uv.min() and uv.max() <= 1
    assert (times_covered(uv, seed) <= 1).all(), "triangles lie on one another"
    for k in range(int(island.max()) + 1):
        assert is_disk(mesh.triangles[island == k], len(mesh.vertices))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_any_manifold_is_laid_flat(seed):
    """Spheres, tori and boxes, crumpled and with holes."""
    rng = np.random.default_rng(seed)
    parts = [
        trimesh.creation.icosphere(subdivisions=2),
        trimesh.creation.torus(1.0, 0.4, major_sections=12, minor_sections=8),
        trimesh.creation.box(),
        trimesh.creation.cylinder(0.3, 3.0, sections=9),
    ]
    whole = trimesh.util.concatenate([parts[k] for k in rng.integers(0, 4, rng.integers(1, 3))])
    vertices = whole.vertices + rng.normal(0, rng.choice((0.0, 0.02, 0.2)), whole.vertices.shape)
    faces = whole.faces[rng.random(len(whole.faces)) > rng.choice((0.0, 0.1))]
    mesh = Mesh(vertices, rng.permutation(np.array(faces, np.int32)))
    check(mesh, *unwrap(mesh, None, 0.002), seed % 1000)


def test_a_body_is_cut_along_its_bones_into_few_islands():
    body, skeleton = standing_body(resolution=0.02)
    mesh, weights = skinned_mesh(body, skeleton)
    uv, island = unwrap(mesh, weights, 0.002)
    check(mesh, uv, island)
    assert island.max() < 40
    corners, flat = mesh.vertices[mesh.triangles], uv.astype(np.float64)
    skin = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert area.sum() > 0.55, "of the image is used"
    # one texel is about as large everywhere
    ratio = area / area.sum() / (skin / skin.sum())
    order = ratio.argsort()
    middle = np.searchsorted(np.cumsum(skin[order]), np.array((0.05, 0.95)) * skin.sum())
    low, high = ratio[order][middle]
    assert 0.75 < low and high < 1.3


def test_things_without_a_skeleton_are_cut_by_the_side_they_face():
    box = ours(trimesh.creation.box((1.0, 2.0, 3.0)).subdivide().subdivide())
    island = find_islands(box)
    normal = np.cross(*(box.vertices[box.triangles[:, k]] - box.vertices[box.triangles[:, 0]] for k in (1, 2)))
    side = np.abs(normal).argmax(axis=1) * 2 + (normal.sum(axis=1) > 0)
    assert len({(a, b) for a, b in zip(island.tolist(), side.tolist(), strict=True)}) == 6


def test_what_can_be_unrolled_keeps_its_lengths():
    """Part of a cone, whose sides are curved one way only."""
    around, along = np.meshgrid(np.linspace(0, 2.2, 25), np.linspace(0.4, 1.0, 15))
    cone = np.stack((along * np.cos(around), along * np.sin(around), 0.8 * along), axis=-1).reshape(-1, 3)
    at = np.arange(15 * 25).reshape(15, 25)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
    triangles = np.concatenate((np.stack((a, c, b), 1), np.stack((a, d, c), 1))).astype(np.int32)
    flat = flatten(cone, triangles)
    assert flat is not None and not flipped(flat, triangles).any() and not crosses_itself(flat, triangles)
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    length, laid = (np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (cone, flat))
    np.testing.assert_allclose(laid, length, rtol=0.01)


def test_a_closed_bag_is_cut_before_it_is_laid_flat():
    """A ball with a pinhole is a disk, but none that fits a plane."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    mesh = Mesh(np.array(ball.vertices), np.array(ball.faces[1:], np.int32))
    assert is_disk(mesh.triangles, len(mesh.vertices))
    uv, island = unwrap(mesh, None, 0.002)
    check(mesh, uv, island)
    assert island.max() > 0
