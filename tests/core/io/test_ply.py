"""PLY: everything comes back, any layout is read, and what lies or is damaged is refused."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from meshes import coloured_sphere
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io import read_mesh, write_mesh
from writers import GOOD, make_ply


def test_ply_keeps_everything(tmp_path):
    mesh = coloured_sphere()
    write_mesh(tmp_path / "a.ply", mesh)
    back = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.vertices, mesh.vertices.astype(np.float32))
    for name in ("triangles", "colors", "view", "kind"):
        np.testing.assert_array_equal(getattr(back, name), getattr(mesh, name))
        assert getattr(back, name).dtype == getattr(mesh, name).dtype


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    layout=st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]),
    count_type=st.sampled_from(["uchar", "char", "ushort", "int", "uint"]),
    index_type=st.sampled_from(["uchar", "short", "int", "uint"]),
    coordinate_type=st.sampled_from(["char", "ushort", "float", "double"]),
    sides=st.lists(st.integers(0, 7), max_size=6),
)
@example("binary_little_endian", "uchar", "int", "float", [4, 4, 4])
def test_any_ply_layout_reads_as_fans(tmp_path, layout, count_type, index_type, coordinate_type, sides):
    polygons = [list(range(n)) for n in sides]
    (tmp_path / "a.ply").write_bytes(make_ply(layout, count_type, index_type, coordinate_type, polygons))
    mesh = read_mesh(tmp_path / "a.ply")
    fans = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    kinds = [row % 3 for row, p in enumerate(polygons) for _ in range(1, len(p) - 1)]
    assert [tuple(t) for t in mesh.triangles] == fans
    if polygons:
        assert mesh.kind.tolist() == kinds
    steps = np.arange(len(mesh.vertices))
    np.testing.assert_array_equal(mesh.vertices, np.stack((steps, steps**2, 0 * steps), axis=1))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, len(GOOD) - 1), value=st.integers(0, 255), cut=st.integers(0, len(GOOD)))
def test_no_damage_to_a_ply_escapes_as_another_error(tmp_path, place, value, cut):
    damaged = bytearray(GOOD)
    damaged[place] = value
    (tmp_path / "a.ply").write_bytes(damaged[: max(cut, len(GOOD) // 2)])
    try:
        mesh = read_mesh(tmp_path / "a.ply")
    except CaptureError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert not mesh.triangles.size or 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.vertices)
