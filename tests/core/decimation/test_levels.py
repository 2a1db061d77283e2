"""Fewer triangles: the surface stays, closed and sound, and what lies on it stays in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.decimation import decimate, levels, levels_of_detail
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh, Texture
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.mesh.surface_distance import surface_distance


def torus(around=120, across=60, big=0.3, small=0.1):
    """A closed surface with a hole through it, and its angles (V, 2) in turns."""
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * i.ravel() / around, 2 * np.pi * j.ravel() / across
    ring = big + small * np.cos(b)
    vertices = np.column_stack((ring * np.cos(a), ring * np.sin(a), small * np.sin(b)))

    def at(i, j):
        return (i % around) * across + j % across

    i, j = i.ravel(), j.ravel()
    quads = np.column_stack((at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)))
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]])).astype(np.int32)
    quad = np.concatenate((np.column_stack((i, j)),) * 2)
    steps = np.array((((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1))))
    corners = quad[:, None] + np.repeat(steps, len(i), axis=0)
    colors = np.column_stack((127 + 127 * np.cos(a), 127 + 127 * np.sin(a), 127 + 0 * a)).astype(np.uint8)
    kind = np.zeros(len(triangles), np.int8)
    kind[quad[:, 0] < around // 2] = 2
    mesh = Mesh(vertices, triangles, colors, (a > np.pi).astype(np.int8), kind)
    return mesh, corners / (around, across)


def charts(turns, pieces=4):
    """The torus unrolled and cut into ``pieces`` bands, each an island of its own; u v from the turns."""
    island = np.minimum((turns[:, :, 0].mean(axis=1) * pieces).astype(np.int32), pieces - 1)
    uv = turns * (0.9, 0.8) + 0.02
    uv[:, :, 0] += 0.02 * island[:, None]
    return Texture(uv.astype(np.float32), np.zeros((256, 256, 3), np.uint8), island)


def texture_turns(texture):
    """Turns (T, 3, 2) that the places in the texture of :func:`charts` mean."""
    uv = texture.uv.astype(float)
    uv[:, :, 0] -= 0.02 * texture.island[:, None]
    return (uv - 0.02) / (0.9, 0.8)


def turned_over(texture):
    one, other = np.moveaxis(texture.uv[:, 1:].astype(float) - texture.uv[:, :1], 1, 0)
    return int((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0] <= 0).sum())


def test_the_surface_stays_closed_sound_and_where_it_was():
    mesh, _ = torus()
    less = decimate(mesh, 1200)
    assert len(less.mesh.triangles) in (1199, 1200) and not less.notes
    report, before = mesh_report(less.mesh), mesh_report(mesh)
    assert report["watertight"] and report["manifold"] and report["components"] == 1
    assert report["euler_characteristic"] == before["euler_characteristic"] == 0
    assert report["self_intersections"] == 0
    assert report["volume_m3"] == pytest.approx(before["volume_m3"], rel=0.01)
    assert max(surface_distance(less.mesh, mesh).mean, surface_distance(mesh, less.mesh).mean) < 0.0007


def test_it_is_no_worse_than_meshlab(tmp_path):
    pymeshlab = pytest.importorskip("pymeshlab")
    mesh, _ = torus()
    theirs = pymeshlab.MeshSet()
    theirs.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.triangles))
    theirs.meshing_decimation_quadric_edge_collapse(targetfacenum=1200, preservetopology=True)
    theirs.save_current_mesh(str(tmp_path / "theirs.ply"))
    theirs = read_mesh(tmp_path / "theirs.ply")
    ours = decimate(mesh, 1200).mesh
    for apart in (lambda a: surface_distance(a, mesh).mean, lambda a: surface_distance(mesh, a).mean):
        assert apart(ours) < 1.05 * apart(theirs)


def test_a_texture_stays_in_place_and_its_seams_stay_closed():
    mesh, turns = torus()
    texture = charts(turns)
    less = decimate(mesh, 1500, texture)
    assert len(less.mesh.triangles) in (1499, 1500) and less.texture.image is texture.image
    assert turned_over(less.texture) == turned_over(texture) == 0
    # where the texture says that a corner lies, in space: the same for both sides of each seam
    a, b = np.moveaxis(2 * np.pi * texture_turns(less.texture), 2, 0)
    ring = 0.3 + 0.1 * np.cos(b)
    said = np.stack((ring * np.cos(a), ring * np.sin(a), 0.1 * np.sin(b)), axis=2)
    away = np.linalg.norm(said - less.mesh.vertices[less.mesh.triangles], axis=2)
    assert away.mean() < 0.001 and away.max() < 0.005
    # corners of a vertex within an island are one
    key = less.mesh.triangles.astype(np.int64) * 100 + less.texture.island[:, None]
    _, inverse = np.unique(key.ravel(), return_inverse=True)
    places = less.texture.uv.reshape(-1, 2)
    for axis in range(2):
        low, high = np.full(inverse.max() + 1, np.inf), np.full(inverse.max() + 1, -np.inf)
        np.minimum.at(low, inverse, places[:, axis])
        np.maximum.at(high, inverse, places[:, axis])
        assert (high - low).max() < 0.9  # the unrolled torus meets itself a whole turn apart, within its bands
    assert set(np.unique(less.texture.island)) == set(range(4))
    # each island covers in the texture what it covered
    for island in range(4):
        assert covered(less.texture, island) == pytest.approx(covered(texture, island), rel=0.01)


def covered(texture, island):
    one, other = np.moveaxis((texture.uv[:, 1:].astype(float) - texture.uv[:, :1])[texture.island == island], 1, 0)
    return 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum()


def test_weights_colors_view_and_kind_are_those_of_the_place():
    mesh, _ = torus()
    share = (0.5 + 0.5 * mesh.vertices[:, 0] / 0.4).astype(np.float32)
    index = np.tile(np.uint8((3, 7, 0, 0)), (len(mesh.vertices), 1))
    weights = SkinWeights(index, np.column_stack((share, 1 - share, 0 * share, 0 * share)))
    less = decimate(mesh, 1200, None, weights)
    kept = np.where(less.weights.index == 3, less.weights.weight, 0).sum(axis=1)
    np.testing.assert_allclose(less.weights.weight.sum(axis=1), 1, atol=1e-6)
    assert (np.diff(less.weights.weight, axis=1) <= 0).all()
    assert np.abs(kept - (0.5 + 0.5 * less.mesh.vertices[:, 0] / 0.4)).max() < 0.01
    angle = np.arctan2(less.mesh.vertices[:, 1], less.mesh.vertices[:, 0])
    said = np.arctan2(less.mesh.colors[:, 1] - 127.0, less.mesh.colors[:, 0] - 127.0)
    assert np.abs(np.angle(np.exp(1j * (said - angle)))).mean() < 0.03
    surely = np.abs(np.sin(angle)) > 0.2
    np.testing.assert_array_equal(less.mesh.view[surely], (angle < 0)[surely])
    middle = less.mesh.vertices[less.mesh.triangles].mean(axis=1)
    surely = np.abs(middle[:, 1]) > 0.06
    np.testing.assert_array_equal(less.mesh.kind[surely] == 2, (middle[:, 1] > 0)[surely])


def test_surface_that_nearly_touches_does_not_come_to_run_through_itself(monkeypatch):
    """Two balls a tenth of a millimetre apart: without another round they cross."""
    one = trimesh.creation.icosphere(5, 0.1)
    other = one.copy()
    other.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)))
    other.apply_translation((0.2001, 0, 0))
    both = trimesh.util.concatenate([one, other])
    mesh = Mesh(np.array(both.vertices), np.array(both.faces, np.int32))
    less = decimate(mesh, 800).mesh
    assert len(less.triangles) == 800 and len(self_intersections(less.vertices, less.triangles)) == 0
    monkeypatch.setattr(levels, "_ROUNDS", 1)
    less = decimate(mesh, 800).mesh
    assert len(self_intersections(less.vertices, less.triangles)) > 0


def test_levels_are_one_pass_and_each_as_asked():
    mesh, _ = torus()
    found = levels_of_detail(mesh, (500, 4000, 10**6, 1500))
    assert [len(level.mesh.triangles) for level in found] == [500, 4000, len(mesh.triangles), 1500]
    assert found[2].mesh is mesh
    alone = decimate(mesh, 1500)
    np.testing.assert_array_equal(found[3].mesh.vertices, alone.mesh.vertices)
    distances = [surface_distance(found[k].mesh, mesh).mean for k in (1, 3, 0)]
    assert distances == sorted(distances)


def test_an_open_mesh_keeps_its_boundary():
    grid = np.stack(np.meshgrid(np.arange(41), np.arange(31), indexing="ij"), axis=-1).reshape(-1, 2)
    at = np.arange(41 * 31).reshape(41, 31)
    quads = np.stack((at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]), axis=-1).reshape(-1, 4)
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]])).astype(np.int32)
    mesh = Mesh(np.column_stack((grid / 100.0, np.zeros(len(grid)))), triangles)
    less = decimate(mesh, 100).mesh
    assert len(less.triangles) <= 100
    np.testing.assert_allclose(np.ptp(less.vertices, axis=0), (0.4, 0.3, 0), atol=1e-12)
    assert mesh_report(less)["area_m2"] == pytest.approx(0.12, rel=1e-3)


def test_what_cannot_be_reached_is_said():
    """A texture of one island a triangle leaves nothing to collapse."""
    mesh, turns = torus(24, 12)
    texture = replace(charts(turns), island=np.arange(len(mesh.triangles), dtype=np.int32))
    less = decimate(mesh, 200, texture)
    assert len(less.mesh.triangles) == len(mesh.triangles)
    (note,) = less.notes
    assert f"to {len(mesh.triangles)} triangles but not to 200" in note


@pytest.mark.parametrize("change, said", [
    ({"triangles": 99}, "99 triangles are too few"),
    ({"texture": Texture(np.zeros((1, 3, 2), np.float32), np.zeros((2, 2, 3), np.uint8), np.zeros(1, np.int32))},
     "texture is of 1 triangles"),
    ({"weights": SkinWeights(np.zeros((1, 4), np.uint8), np.ones((1, 4), np.float32))}, "weights are of 1 vertices"),
    ({"mesh": Mesh(np.full((3, 3), np.nan), np.int32([[0, 1, 2]]))}, "not a finite number"),
    ({"mesh": Mesh(np.zeros((2, 3)), np.int32([[0, 1, 2]]))}, "does not exist"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(change, said):
    mesh, _ = torus(24, 12)
    with pytest.raises(MirrorScanError, match=said):
        decimate(**{"mesh": mesh, "triangles": 200} | change)


def test_what_else_lies_on_vertices_can_be_looked_up():
    mesh, _ = torus()
    less = decimate(mesh, 1200)
    np.testing.assert_allclose(less.footpoints.shares.sum(axis=1), 1)
    there = (less.footpoints.shares[:, :, None] * mesh.vertices[less.footpoints.corners]).sum(axis=1)
    assert np.linalg.norm(there - less.mesh.vertices, axis=1).max() < 0.003
    np.testing.assert_array_equal(less.mesh.kind, mesh.kind[less.origin])
