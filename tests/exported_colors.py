"""What an exported file shows of the capture's colours, looked at in Blender; shared by bpy and the window run."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np

MODES = ("CAPTURE", "VIEW", "KIND")
"""Of *Colour By*."""

IMPORTERS = {
    "glb": "import_scene.gltf", "gltf": "import_scene.gltf", "fbx": "import_scene.fbx", "obj": "wm.obj_import",
    "usdc": "wm.usd_import", "ply": "wm.ply_import", "abc": "wm.alembic_import",
}  # fmt: skip
BY_IMAGE = ("fbx", "obj", "usdc")
"""Formats whose material shows colours by an image only."""


def import_mesh(bpy, path: Path):
    """The one mesh of a file, brought into the scene that is open."""
    before = set(bpy.data.objects)
    kind = path.suffix[1:]
    if kind == "blend":
        with bpy.data.libraries.load(str(path)) as (there, here):
            here.objects = there.objects
        bpy.context.scene.collection.objects.link(here.objects[0])
        return here.objects[0]
    module, name = IMPORTERS[kind].split(".")
    options = {"forward_axis": "Y", "up_axis": "Z"} if kind == "ply" else {}
    getattr(getattr(bpy.ops, module), name)(filepath=str(path), **options)
    bpy.context.view_layer.update()
    (found,) = [item for item in set(bpy.data.objects) - before if item.type == "MESH"]
    return found


def corners_of(item):
    """Where the corners of a mesh's faces stand in the world (C, 3), and their vertices (C,)."""
    data = item.data
    points = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", points.ravel())
    vertex = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", vertex)
    matrix = np.array(item.matrix_world)
    return (points @ matrix[:3, :3].T + matrix[:3, 3])[vertex], vertex


def truth_at(mesh, places):
    """The capture's colours (N, 3) at places (N, 3)."""
    distance = np.linalg.norm(places[:, None] - mesh.vertices[None], axis=2)
    assert distance.min(axis=1).max() < 1e-4
    return mesh.colors[distance.argmin(axis=1)]


def stored_colors(item):
    """The one colour attribute of a mesh at the corners of its faces, sRGB bytes."""
    (attribute,) = item.data.color_attributes
    rgba = np.empty((len(attribute.data), 4), np.float32)
    attribute.data.foreach_get("color_srgb", rgba.ravel())
    colors = np.rint(rgba[:, :3] * 255)
    return colors if attribute.domain == "CORNER" else colors[corners_of(item)[1]]


def image_shown(item):
    """The image that a mesh's material has for its colour, sRGB bytes (H, W, 3), the upper row first; or None."""
    tree = item.active_material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    node = shader.inputs["Base Color"].links[0].from_node
    if node.type != "TEX_IMAGE":
        return None
    pixels = np.empty(len(node.image.pixels), np.float32)
    node.image.pixels.foreach_get(pixels)
    width, height = node.image.size
    return np.rint(pixels.reshape(height, width, -1)[::-1, :, :3] * 255)


def texels_shown(item):
    """What that image has at the corners of the faces."""
    image = image_shown(item)
    uv = np.empty((len(item.data.loops), 2), np.float32)
    item.data.uv_layers.active.uv.foreach_get("vector", uv.ravel())
    height, width = image.shape[:2]
    column, row = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    assert (
        np.abs(column - np.rint(column)).max() < 0.01 and np.abs(row - np.rint(row)).max() < 0.01
    )  # middles of texels
    return image[np.rint(row).astype(int), np.rint(column).astype(int)]


def colors_in_3mf(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the triangles (T, 3, 3) [mm] and their colours (T, 3, 3) of a 3MF with a palette."""
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    points = np.array(re.findall(r'<vertex x="([^"]+)" y="([^"]+)" z="([^"]+)"', model), float)
    palette = np.array([list(bytes.fromhex(word[:6])) for word in re.findall(r'color="#(\w+)"', model)])
    table = re.findall(r'<triangle v1="(\d+)" v2="(\d+)" v3="(\d+)" .*?p1="(\d+)" p2="(\d+)" p3="(\d+)"', model)
    table = np.array(table, int)
    return points[table[:, :3]], palette[table[:, 3:]]


def check_colors(bpy, path: Path, mesh) -> None:
    """The file shows the capture's colours bit for bit: as its colours, and by the image of its material where it has
    one."""
    if path.suffix == ".3mf":
        places, colors = colors_in_3mf(path)
        np.testing.assert_array_equal(colors.reshape(-1, 3), truth_at(mesh, places.reshape(-1, 3) / 1000))
        return
    item = import_mesh(bpy, path)
    truth = truth_at(mesh, corners_of(item)[0])
    np.testing.assert_array_equal(stored_colors(item), truth)
    if path.suffix[1:] in BY_IMAGE:
        np.testing.assert_array_equal(texels_shown(item), truth)
    elif path.suffix in (".glb", ".gltf", ".blend"):  # the others have no materials
        tree = item.active_material.node_tree
        shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        node = shader.inputs["Base Color"].links[0].from_node
        assert node.type == "VERTEX_COLOR" and node.layer_name in ("", item.data.color_attributes[0].name)
