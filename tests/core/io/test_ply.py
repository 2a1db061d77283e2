"""PLY: everything comes back, any layout is read, and what lies or is damaged is refused."""

from __future__ import annotations

import numpy as np
import pytest
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


HEADER = """ply
format ascii 1.0
comment made by a test
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
"""
BODY = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
PLAIN = HEADER + BODY
SPELLINGS = {
    "plain": PLAIN,
    "without a last line end": PLAIN.rstrip(),
    "line ends of Windows": PLAIN.replace("\n", "\r\n"),
    "line ends of old Macs": PLAIN.replace("\n", "\r"),
    "byte order mark": "\ufeff" + PLAIN,
    "vertex_index": PLAIN.replace("vertex_indices", "vertex_index"),
    "a name of its own": PLAIN.replace("vertex_indices", "indices"),
    "doubles and other types": PLAIN.replace("float", "double").replace("uchar int", "int64 uint64"),
    "blanks and comments": PLAIN.replace("element face", "comment\n\ncomment a b\nobj_info c\nelement   face"),
    "capitals": PLAIN.replace("vertex_indices", "Vertex_Indices"),
    "edges and materials": PLAIN.replace("end_header", "element edge 1\nproperty int a\nend_header") + "0\n",
    "faces first": PLAIN.replace(HEADER, "\n".join([*HEADER.split("\n")[:3], *HEADER.split("\n")[7:9],
                                                    *HEADER.split("\n")[3:7], "end_header\n"]))
    .replace(BODY, "\n".join(BODY.split("\n")[4:8] + BODY.split("\n")[:4]) + "\n"),
    "colours and normals": PLAIN.replace("property float z\n", "property float z\nproperty float nx\n").replace(
        BODY, "".join(line + " 0.5\n" if line.count(" ") == 2 else line + "\n" for line in BODY.splitlines())),
    "strips": HEADER.replace("face 4", "tristrips 1") + BODY[: BODY.index("3 0 2 1")] + "9 0 2 1 3 -1 2 0 3 -1",
    "strips that turn": HEADER.replace("face 4", "tristrips 1") + BODY[: BODY.index("3 0 2 1")] + "6 0 2 1 3 0 2",
}  # fmt: skip


@pytest.mark.parametrize("case", SPELLINGS)
def test_spellings_of_one_tetrahedron(tmp_path, case):
    (tmp_path / "a.ply").write_bytes(SPELLINGS[case].encode())
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    turned = [tuple(np.roll(t, -int(np.argmin(t)))) for t in mesh.triangles.tolist()]
    expected = {(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)}
    assert set(turned) <= expected and len(turned) == (3 if case == "strips" else 4)


def test_binary_strips(tmp_path):
    """As Stanford's range scans have them: one list, -1 between the strips."""
    header = HEADER.replace("ascii", "binary_little_endian").replace("face 4", "tristrips 1").replace("uchar", "int")
    points = np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), "<f4").tobytes()
    strip = np.array((8, 0, 2, 1, 3, 0, 2, -1, -1), "<i4").tobytes()
    (tmp_path / "a.ply").write_bytes(header.encode() + points + strip)
    triangles = read_mesh(tmp_path / "a.ply").triangles
    assert triangles.tolist() == [[0, 2, 1], [1, 2, 3], [1, 3, 0], [0, 3, 2]]
    (tmp_path / "a.ply").write_bytes(header.encode() + points + strip.replace(b"\3\0\0\0", b"\4\0\0\0"))
    with pytest.raises(CaptureError, match="outside 0…3"):
        read_mesh(tmp_path / "a.ply")
