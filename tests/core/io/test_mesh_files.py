"""Mesh files: against trimesh, against themselves, and against files that lie."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from meshes import coloured_sphere
from mirror_scan.core.errors import CaptureError, OutputError
from mirror_scan.core.io import read_mesh, write_mesh
from mirror_scan.core.io.atomic_files import replacing
from mirror_scan.core.mesh import Mesh
from writers import GOOD, make_ply


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl"])
def test_trimesh_reads_what_we_write_and_we_read_what_it_writes(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    mesh = coloured_sphere()
    write_mesh(tmp_path / f"ours{suffix}", mesh)
    theirs = trimesh.load(tmp_path / f"ours{suffix}", force="mesh", process=suffix == ".stl")
    assert theirs.is_watertight and theirs.is_winding_consistent
    unit = 0.001 if suffix == ".stl" else 1.0  # printing programs take an STL's numbers for millimetres
    np.testing.assert_allclose(unit * theirs.triangles, mesh.vertices[mesh.triangles], atol=1e-6)
    if suffix != ".stl":
        np.testing.assert_array_equal(theirs.visual.vertex_colors[:, :3], mesh.colors)

    ours = read_mesh(tmp_path / f"ours{suffix}")
    np.testing.assert_allclose(ours.vertices[ours.triangles], mesh.vertices[mesh.triangles], atol=1e-6)
    trimesh.Trimesh(mesh.vertices, mesh.triangles, vertex_colors=mesh.colors, process=False).export(
        tmp_path / f"theirs{suffix}"
    )
    back = read_mesh(tmp_path / f"theirs{suffix}")
    np.testing.assert_allclose(back.vertices[back.triangles], mesh.vertices[mesh.triangles], atol=1e-6)
    assert len(back.vertices) == len(mesh.vertices)
    if suffix != ".stl":
        np.testing.assert_array_equal(back.colors, mesh.colors)


def test_ascii_stl_and_ascii_ply_of_trimesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((1, 2, 3))
    box.export(tmp_path / "a.stl", file_type="stl_ascii")
    box.export(tmp_path / "a.ply", encoding="ascii")
    for name in ("a.stl", "a.ply"):
        back = read_mesh(tmp_path / name)
        assert len(back.vertices) == 8
        np.testing.assert_allclose(back.vertices[back.triangles], box.triangles, atol=1e-6)


ASCII = make_ply("ascii", "int", "int", "float", [[0, 1, 2]])
LIES = {
    "empty": (".ply", b"", "does not begin"),
    "no end": (".ply", GOOD[:100], "end_header"),
    "cut body": (".ply", GOOD[:-1], "too short|ends within"),
    "huge count": (".ply", GOOD.replace(b"face 2", b"face 900000000000000000"), "too short"),
    "huge vertex count": (".ply", GOOD.replace(b"vertex 4", b"vertex 99999999999"), "too short"),
    "negative count": (".ply", GOOD.replace(b"face 2", b"face -2"), "not understood"),
    "elements of nothing": (
        ".ply", b"ply\nformat ascii 1.0\nelement vertex 999999999\nend_header\n", "no properties"
    ),
    "list in floats": (".ply", GOOD.replace(b"list uchar int", b"list float int"), "counted"),
    "unknown type": (".ply", GOOD.replace(b"float quality", b"quad quality"), "not understood"),
    "same name twice": (".ply", GOOD.replace(b"float y", b"float x"), "one name"),
    "no z": (".ply", GOOD.replace(b"float z", b"float w"), "no property z"),
    "index out of range": (".ply", ASCII.replace(b"0 1 2", b"0 1 9"), "outside"),
    "fractional words": (".ply", ASCII + b"word", "not a number"),
    "list longer than file": (".ply", ASCII.replace(b"3\n0 1 2", b"1e18 0 1 2"), "longer"),
    "not finite": (".ply", ASCII.replace(b"2 4 0", b"2 nan 0"), "finite"),
    "obj without z": (".obj", b"v 1 2\nf 1 1 1\n", "three coordinates"),
    "obj words": (".obj", b"v a b c\n", "not a number"),
    "obj index": (".obj", b"v 0 0 0\nf 1 2 3\n", "outside"),
    "obj index 0": (".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "outside"),
    "obj of nothing": (".obj", b"# nothing\n", "no vertices"),
    "stl count": (".stl", b" " * 80 + struct.pack("<I", 4_000_000_000) + b" " * 50, "no STL"),
    "stl cut": (".stl", b" " * 80, "no STL"),
    "stl ascii cut": (".stl", b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0", "truncated"),
    "stl too large": (".stl", b"solid a\nfacet normal 0 0 1\nouter loop\n" + 3 * b"vertex 0 1e99 0\n", "finite"),
    "suffix": (".xyz", b"", "unknown mesh format"),
}  # fmt: skip


@pytest.mark.parametrize("case", LIES)
def test_meshes_that_lie_are_refused(tmp_path, case):
    suffix, content, words = LIES[case]
    (tmp_path / f"a{suffix}").write_bytes(content)
    with pytest.raises(CaptureError, match=words) as caught:
        read_mesh(tmp_path / f"a{suffix}")
    assert f"a{suffix}" in str(caught.value)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text("old")
    broken = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(OutputError, match="1 of 3"):
        write_mesh(path, broken)
    with pytest.raises(ZeroDivisionError), replacing(path) as temporary:
        temporary.write_text("half")
        _ = 1 / 0
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]
    with pytest.raises(OutputError, match="does not exist"):
        write_mesh(tmp_path / "nowhere" / "a.ply", coloured_sphere())
    (tmp_path / "b.ply").mkdir()
    with pytest.raises(OutputError, match="not a regular file"):
        write_mesh(tmp_path / "b.ply", coloured_sphere())


TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
NOTHING = np.empty((0, 3))


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl"])
@pytest.mark.parametrize(
    "mesh, words",
    [
        (Mesh(NOTHING, NOTHING.astype(np.int32)), "no vertices"),
        (Mesh(np.eye(3), np.array([[0, 1, 3]], np.int32)), "does not exist"),
        (Mesh(np.eye(3), np.array([[0, 1, -1]], np.int32)), "does not exist"),
        (Mesh(np.eye(3) * np.nan, TRIANGLE.triangles), "not finite"),
        (Mesh(np.eye(3) * 1e39, TRIANGLE.triangles), "not finite"),
    ],
)
def test_a_good_file_is_not_replaced_by_a_bad_mesh(tmp_path, suffix, mesh, words):
    path = tmp_path / f"a{suffix}"
    write_mesh(path, TRIANGLE)
    before = path.read_bytes()
    with pytest.raises(OutputError, match=words):
        write_mesh(path, mesh)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_points_alone_are_a_file_where_the_format_has_points(tmp_path):
    points = Mesh(np.eye(3), NOTHING.astype(np.int32))
    for suffix in (".ply", ".obj"):
        write_mesh(tmp_path / f"a{suffix}", points)
        assert len(read_mesh(tmp_path / f"a{suffix}").vertices) == 3
    write_mesh(tmp_path / "a.stl", TRIANGLE)
    before = (tmp_path / "a.stl").read_bytes()
    with pytest.raises(OutputError, match="no triangles"):
        write_mesh(tmp_path / "a.stl", points)
    assert (tmp_path / "a.stl").read_bytes() == before
