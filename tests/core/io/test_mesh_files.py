"""Mesh and image files: against trimesh, against themselves, and against files that lie."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mirror_scan.core.errors import CaptureError, OutputError
from mirror_scan.core.io import read_mesh, write_mesh
from mirror_scan.core.io.atomic_files import replacing
from mirror_scan.core.io.images import read_image, write_png
from mirror_scan.core.mesh import Mesh


def sphere(subdivisions: int = 2) -> Mesh:
    trimesh = pytest.importorskip("trimesh")
    shape = trimesh.creation.icosphere(subdivisions)
    rng = np.random.default_rng(1)
    return Mesh(
        np.array(shape.vertices),
        np.array(shape.faces, dtype=np.int32),
        colors=rng.integers(0, 256, (len(shape.vertices), 3), dtype=np.uint8),
        view=rng.integers(-1, 4, len(shape.vertices), dtype=np.int8),
        kind=rng.integers(0, 3, len(shape.faces), dtype=np.int8),
    )


def test_ply_keeps_everything(tmp_path):
    mesh = sphere()
    write_mesh(tmp_path / "a.ply", mesh)
    back = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.vertices, mesh.vertices.astype(np.float32))
    for name in ("triangles", "colors", "view", "kind"):
        np.testing.assert_array_equal(getattr(back, name), getattr(mesh, name))
        assert getattr(back, name).dtype == getattr(mesh, name).dtype


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl"])
def test_trimesh_reads_what_we_write_and_we_read_what_it_writes(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    mesh = sphere()
    write_mesh(tmp_path / f"ours{suffix}", mesh)
    theirs = trimesh.load(tmp_path / f"ours{suffix}", force="mesh", process=suffix == ".stl")
    assert theirs.is_watertight and theirs.is_winding_consistent
    np.testing.assert_allclose(theirs.triangles, mesh.vertices[mesh.triangles], atol=1e-6)
    if suffix != ".stl":
        np.testing.assert_array_equal(theirs.visual.vertex_colors[:, :3], mesh.colors)

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


PLY_TYPES = dict(zip("char uchar short ushort int uint float double".split(), "bBhHiIfd", strict=True))


def make_ply(layout: str, count_type: str, index_type: str, coordinate_type: str, polygons: list[list[int]]) -> bytes:
    """A PLY by Python's own struct: a ring of vertices, an element nobody knows, faces with values around the list."""
    ring = max(3, *map(len, polygons)) if polygons else 3
    order = ">" if layout == "binary_big_endian" else "<"
    header = f"""ply
format {layout} 1.0
comment made by hand
element camera 2
property float focal
property list uchar short codes
element vertex {ring}
property uchar flag
property {coordinate_type} x
property {coordinate_type} y
property {coordinate_type} z
element face {len(polygons)}
property float quality
property list {count_type} {index_type} vertex_index
property uchar kind
end_header
"""
    body = []

    def put(kind, *values):
        if layout == "ascii":
            body.append((" ".join(map(str, values)) + "\n").encode())
        else:
            body.append(struct.pack(order + PLY_TYPES[kind] * len(values), *values))

    for i in range(2):
        put("float", 1.5)
        put("uchar", i)
        put("short", *range(-i, 0))
    for i in range(ring):
        put("uchar", 7)
        put(coordinate_type, i, i * i, 0)
    for i, polygon in enumerate(polygons):
        put("float", 0.5)
        put(count_type, len(polygon))
        put(index_type, *polygon)
        put("uchar", i % 3)
    return header.encode() + b"".join(body)


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


def test_obj_with_everything_obj_allows(tmp_path):
    (tmp_path / "a.obj").write_text(
        "mtllib x.mtl\no one\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nvt 0 0\nvn 0 0 1\n"
        "f 1/1/1 2//1 3/1\nv 0 1 0\nusemtl m\nf -4 -2 \\\n-1\nf 1 2 3 4\nl 1 2\n"
    )
    mesh = read_mesh(tmp_path / "a.obj")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]
    assert mesh.colors is None


ASCII = make_ply("ascii", "int", "int", "float", [[0, 1, 2]])
GOOD = make_ply("binary_little_endian", "uchar", "int", "float", [[0, 1, 2], [0, 1, 2, 3]])
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
    "suffix": (".xyz", b"", "unknown mesh format"),
}  # fmt: skip


@pytest.mark.parametrize("case", LIES)
def test_meshes_that_lie_are_refused(tmp_path, case):
    suffix, content, words = LIES[case]
    (tmp_path / f"a{suffix}").write_bytes(content)
    with pytest.raises(CaptureError, match=words) as caught:
        read_mesh(tmp_path / f"a{suffix}")
    assert f"a{suffix}" in str(caught.value)


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
        write_mesh(tmp_path / "nowhere" / "a.ply", sphere())
    (tmp_path / "b.ply").mkdir()
    with pytest.raises(OutputError, match="not a regular file"):
        write_mesh(tmp_path / "b.ply", sphere())


def test_replacing_follows_links_and_keeps_permissions(tmp_path):
    (tmp_path / "real.ply").write_text("old")
    (tmp_path / "real.ply").chmod(0o640)
    (tmp_path / "link.ply").symlink_to("real.ply")
    with replacing(tmp_path / "link.ply") as temporary:
        assert temporary.suffix == ".ply"
        temporary.write_text("new")
    assert (tmp_path / "link.ply").is_symlink()
    assert (tmp_path / "real.ply").read_text() == "new"
    assert (tmp_path / "real.ply").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("dtype, shape", [(np.uint16, (5, 7)), (np.uint8, (5, 7)), (np.uint8, (5, 7, 3))])
def test_png_round_trip(tmp_path, dtype, shape):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    write_png(tmp_path / "a.png", image)
    back = read_image(tmp_path / "a.png")
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, image)


def test_png_damage_is_named_and_nothing_is_printed(tmp_path, capfd):
    path = tmp_path / "a.png"
    write_png(path, np.random.default_rng(0).integers(0, 65536, (48, 64), dtype=np.uint16))
    good = path.read_bytes()
    huge = bytearray(good)
    huge[16:24] = struct.pack(">II", 2**31 - 1, 2**31 - 1)
    huge[29:33] = struct.pack(">I", zlib.crc32(huge[12:29]))
    for content, words in (
        (good[: len(good) // 2], "truncated"),
        (good[:8], "truncated"),
        (good[:2000] + bytes([good[2000] ^ 1]) + good[2001:], "damaged"),
        (b"", "not a PNG"),
        (bytes(huge), "."),
    ):
        path.write_bytes(content)
        with pytest.raises(CaptureError, match=words):
            read_image(path)
    assert capfd.readouterr() == ("", "")
