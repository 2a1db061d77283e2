"""Blender's bridge, the peer: it closes what its user could close, on the runs that face each other."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.mesh import Mesh  # noqa: E402
from mirror_scan.core.mesh.triangle_mesh import merge  # noqa: E402
from mirror_scan.mirror_scan_addon.bridge_edge_loops import bridge_and_fill, facing_runs  # noqa: E402

pytest.importorskip("bpy")


def half_tube(begin: float, view: int, columns: int) -> Mesh:
    """Half an upright tube, 1 m high, radius 0.2 m, from the angle ``begin`` over 170°."""
    angle, z = np.radians(begin) + np.linspace(0, np.radians(170), columns), np.linspace(0, 1, 41)
    points = np.stack(np.broadcast_arrays(0.2 * np.cos(angle), 0.2 * np.sin(angle), z[:, None]), axis=-1)
    at = np.arange(points.shape[0] * columns).reshape(-1, columns)
    a, b, c, d = (x.ravel() for x in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)
    count = at.size
    return Mesh(points.reshape(-1, 3), faces, None, np.full(count, view, np.int8), np.zeros(len(faces), np.int8))


def test_two_halves_become_one_closed_tube():
    patches = merge([half_tube(5, 0, 40), half_tube(185, 1, 25)])
    pairs = facing_runs(patches, reach=0.1)
    assert len(pairs) == 2, "two gaps of 10°"
    for a, b in pairs:
        assert {patches.view[a].tolist()[0], patches.view[b].tolist()[0]} == {0, 1}
        assert min(np.ptp(patches.vertices[run, 2]) for run in (a, b)) > 0.9
    made = bridge_and_fill(patches, pairs)
    body = trimesh.Trimesh(made.vertices, made.triangles, process=False)
    assert body.is_watertight and body.is_winding_consistent and body.body_count == 1
    assert body.volume == pytest.approx(np.pi * 0.2**2, rel=0.01)
