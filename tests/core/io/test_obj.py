"""OBJ with everything that OBJ allows, as other programs spell it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.errors import OutputError
from mirror_scan.core.io import read_mesh, write_mesh
from textured import colors_at, textured_ball


def test_obj_with_everything_obj_allows(tmp_path):
    (tmp_path / "a.obj").write_text(
        "mtllib x.mtl\no one\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nvt 0 0\nvn 0 0 1\n"
        "f 1/1/1 2//1 3/1\nv 0 1 0\nusemtl m\nf -4 -2 \\\n-1\nf 1 2 3 4\nl 1 2\n"
    )
    mesh = read_mesh(tmp_path / "a.obj")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]
    assert mesh.colors is None


VERTICES, FACES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n", "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4"
PLAIN = VERTICES + FACES
SPELLINGS = {
    "plain, without a last line end": PLAIN,
    "byte order mark": "\ufeff" + PLAIN,
    "leading blanks": PLAIN.replace("v ", "  v ").replace("f ", "\t f "),
    "tabs": PLAIN.replace(" ", "\t"),
    "many blanks": PLAIN.replace(" ", "   ") + "   \n\n\n",
    "line ends of Windows": PLAIN.replace("\n", "\r\n"),
    "line ends of old Macs": PLAIN.replace("\n", "\r"),
    "comments": "# a\n" + PLAIN.replace("\n", " # v 9 9 9\n"),
    "lines that go on": PLAIN.replace("v 1 0 0", "v 1 \\\n0 0").replace("f 1 2 4", "f 1 2\\\r\n 4"),
    "texture and normals": VERTICES
    + "vt 0 0\nvn 0 0 1\n"
    + "f 1/1/1 3//1 2/1\nf 1/1 2/1 4/1\nf 2//1 3//1 4//1\nf 3 1 4",
    "from the end": VERTICES + "f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -2 -4 -1\n",
    "weights": PLAIN.replace("v 0 0 0", "v 0 0 0 1.0"),
    "exponents": PLAIN.replace("v 1 0 0", "v 1e0 0.0E+00 -0."),
    "faces first": FACES + "\n" + VERTICES,
    "groups": "mtllib a.mtl\no a\ng a b\ns off\nusemtl m\n" + PLAIN + "\nl 1 2\np 1\n",
    "an end of file of DOS": PLAIN + "\n\x1a",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("case", SPELLINGS)
def test_spellings_of_one_tetrahedron(tmp_path, case, encoding):
    (tmp_path / "a.obj").write_bytes(SPELLINGS[case].encode(encoding))
    mesh = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert mesh.triangles.tolist() == [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    assert mesh.colors is None


@pytest.mark.parametrize("colors", ["1 0.5 0", "255 128 0", "1.0 0.5 0.0 1.0"])
def test_colours_behind_the_coordinates(tmp_path, colors):
    (tmp_path / "a.obj").write_text("".join(f"v {i} {i * i} 0 {colors}\n" for i in range(3)) + "f 1 2 3\n")
    assert read_mesh(tmp_path / "a.obj").colors.tolist() == [[255, 128, 0]] * 3


def test_a_texture_stands_beside_the_file_and_lies_where_it_should(tmp_path):
    mesh, texture, colors = textured_ball()
    write_mesh(tmp_path / "the ball.obj", mesh, texture)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["the ball.mtl", "the ball.obj", "the ball.png"]
    shown = trimesh.load(tmp_path / "the ball.obj", process=False)
    image = np.asarray(shown.visual.material.image)
    place = {tuple(middle): k for k, middle in enumerate(mesh.vertices[mesh.triangles].mean(axis=1).round(4))}
    ours = [place[tuple(middle)] for middle in shown.vertices[shown.faces].mean(axis=1).round(4)]
    np.testing.assert_array_equal(colors_at(shown.visual.uv[shown.faces].mean(axis=1), image), colors[ours])
    plain = read_mesh(tmp_path / "the ball.obj")
    np.testing.assert_array_equal(plain.triangles, mesh.triangles)
    np.testing.assert_array_equal(plain.colors, mesh.colors)


def test_a_texture_of_another_mesh_is_refused(tmp_path):
    mesh, texture, _ = textured_ball()
    with pytest.raises(OutputError, match="texture is of 79 triangles, the mesh has 80"):
        write_mesh(tmp_path / "ball.obj", mesh, type(texture)(texture.uv[1:], texture.image, texture.island[1:]))
    assert not list(tmp_path.iterdir())
