"""3MF files, read with zipfile and ElementTree as the specification says."""

from __future__ import annotations

import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
from meshes import coloured_sphere
from mirror_scan.core.errors import OutputError
from mirror_scan.core.io import write_mesh
from mirror_scan.core.io.images import read_image
from mirror_scan.core.io.three_mf import write_3mf
from mirror_scan.core.mesh import Mesh, Texture

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
MATERIAL = "{http://schemas.microsoft.com/3dmanufacturing/material/2015/02}"


def model_of(path):
    """The package and its model, found by the relationship of the root."""
    package = zipfile.ZipFile(path)
    assert package.testzip() is None
    types = ElementTree.fromstring(package.read("[Content_Types].xml"))
    known = {entry.get("Extension") for entry in types}
    assert {name.rsplit(".", 1)[1] for name in package.namelist() if name != "[Content_Types].xml"} <= known
    (root,) = ElementTree.fromstring(package.read("_rels/.rels"))
    return package, ElementTree.fromstring(package.read(root.get("Target").lstrip("/")))


def numbers(elements, *names):
    return np.array([[float(element.get(name)) for name in names] for element in elements])


def test_a_3mf_is_in_millimetres_and_holds_the_colours(tmp_path):
    mesh = coloured_sphere()
    write_mesh(tmp_path / "a.3mf", mesh)
    _, model = model_of(tmp_path / "a.3mf")
    assert model.get("unit") == "millimeter"
    vertices = numbers(model.iter(f"{CORE}vertex"), "x", "y", "z")
    np.testing.assert_allclose(vertices, 1000 * mesh.vertices, atol=1e-5)
    triangles = list(model.iter(f"{CORE}triangle"))
    np.testing.assert_array_equal(numbers(triangles, "v1", "v2", "v3"), mesh.triangles)
    (group,) = model.iter(f"{MATERIAL}colorgroup")
    palette = np.array([list(bytes.fromhex(color.get("color")[1:])) for color in group])
    at = numbers(triangles, "p1", "p2", "p3").astype(int)
    np.testing.assert_array_equal(palette[at], mesh.colors[mesh.triangles])
    assert {triangle.get("pid") for triangle in triangles} == {group.get("id")}
    (item,) = model.iter(f"{CORE}item")
    assert item.get("objectid") == model.find(f".//{CORE}object").get("id")


def test_a_texture_goes_in_as_png_with_its_places(tmp_path):
    mesh = coloured_sphere()
    rng = np.random.default_rng(3)
    image = rng.integers(0, 255, (32, 32, 3), np.uint8)
    places = rng.random((len(mesh.triangles), 3, 2)).astype(np.float32)
    write_3mf(tmp_path / "a.3mf", mesh, Texture(places, image, np.zeros(len(places), np.int32)))
    package, model = model_of(tmp_path / "a.3mf")
    (texture,) = model.iter(f"{MATERIAL}texture2d")
    (group,) = model.iter(f"{MATERIAL}texture2dgroup")
    assert group.get("texid") == texture.get("id")
    (relation,) = ElementTree.fromstring(package.read("3D/_rels/3dmodel.model.rels"))
    assert relation.get("Target") == texture.get("path") and relation.get("Type").endswith("/3dtexture")
    table = numbers(group, "u", "v")
    at = numbers(model.iter(f"{CORE}triangle"), "p1", "p2", "p3").astype(int)
    np.testing.assert_allclose(table[at], places, atol=1e-6)
    (tmp_path / "t.png").write_bytes(package.read(texture.get("path").lstrip("/")))
    np.testing.assert_array_equal(read_image(tmp_path / "t.png"), image)


def test_the_same_mesh_gives_the_same_file(tmp_path):
    for name in ("a.3mf", "b.3mf"):
        write_mesh(tmp_path / name, coloured_sphere())
    assert (tmp_path / "a.3mf").read_bytes() == (tmp_path / "b.3mf").read_bytes()


@pytest.mark.parametrize("flaw, said", [
    (lambda m: Mesh(m.vertices, m.triangles[:0]), "no triangles"),
    (lambda m: Mesh(m.vertices, m.triangles + 1), "does not exist"),
    (lambda m: Mesh(m.vertices * np.nan, m.triangles), "finite"),
])  # fmt: skip
def test_what_cannot_be_printed_is_refused(tmp_path, flaw, said):
    with pytest.raises(OutputError, match=said):
        write_3mf(tmp_path / "a.3mf", flaw(coloured_sphere()))
    assert not list(tmp_path.iterdir())
    texture = Texture(np.zeros((1, 3, 2), np.float32), np.zeros((2, 2, 3), np.uint8), np.zeros(1, np.int32))
    with pytest.raises(OutputError, match="of 1 triangles"):
        write_3mf(tmp_path / "a.3mf", coloured_sphere(), texture)
