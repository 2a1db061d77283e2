"""STL as other programs spell it."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mirror_scan.core.io import read_mesh

CORNERS = np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), float)
TRIANGLES = CORNERS[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]]


def facets(triangles):
    return "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x:g} {y:g} {z:g}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in triangles
    )


def binary(header=b"made by a test", attribute=0, count=None):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), attribute) for t in TRIANGLES)
    return header.ljust(80)[:80] + struct.pack("<I", len(TRIANGLES) if count is None else count) + rows


PLAIN = f"solid a\n{facets(TRIANGLES)}endsolid a"
SPELLINGS = {
    "ascii, without a last line end": PLAIN.encode(),
    "line ends of Windows": PLAIN.replace("\n", "\r\n").encode(),
    "capitals": PLAIN.upper().encode(),
    "capitals here and there": PLAIN.replace("solid", "Solid").replace("vertex", "Vertex").encode(),
    "byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "blanks before": b"\n  " + PLAIN.encode(),
    "no indentation": PLAIN.replace("  ", "").replace("\n ", "\n").encode(),
    "no name": PLAIN.replace("solid a", "solid").encode(),
    "a name with the file's own words": PLAIN.replace("solid a", "solid my vertex and facet normals").encode(),
    "a name that is long": PLAIN.replace("solid a", "solid " + 300 * "long name ").encode(),
    "several solids": "".join(f"solid {i}\n{facets(TRIANGLES[i : i + 1])}endsolid {i}\n" for i in range(4)).encode(),
    "one line": " ".join(PLAIN.split()).encode(),
    "exponents": PLAIN.replace("vertex 1 0 0", "vertex 1.000000e+00 0.0E0 -0.0").encode(),
    "UTF-16": PLAIN.encode("utf-16"),
    "binary": binary(),
    "binary that begins with solid": binary(b"solid made by a test"),
    "binary that promises facets": binary(b"solid facet normal"),
    "binary with colours": binary(b"COLOR=\xff\x80\x00\xff", attribute=0x7FFF),
    "binary and more behind": binary() + b"\0\0\0",
    "binary that begins with zeros": binary(bytes(80)),
}


@pytest.mark.parametrize("case", SPELLINGS)
def test_spellings_of_one_tetrahedron(tmp_path, case):
    (tmp_path / "a.stl").write_bytes(SPELLINGS[case])
    mesh = read_mesh(tmp_path / "a.stl")
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], TRIANGLES)
    assert len(mesh.vertices) == 4
