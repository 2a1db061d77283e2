"""OBJ with everything that OBJ allows."""

from __future__ import annotations

from mirror_scan.core.io import read_mesh


def test_obj_with_everything_obj_allows(tmp_path):
    (tmp_path / "a.obj").write_text(
        "mtllib x.mtl\no one\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nvt 0 0\nvn 0 0 1\n"
        "f 1/1/1 2//1 3/1\nv 0 1 0\nusemtl m\nf -4 -2 \\\n-1\nf 1 2 3 4\nl 1 2\n"
    )
    mesh = read_mesh(tmp_path / "a.obj")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]
    assert mesh.colors is None
