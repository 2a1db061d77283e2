"""Meshes and materials from arrays and back."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import bpy
import numpy as np

from ...core.errors import OutputError
from ...core.mesh import Mesh
from ..language.texts import say
from .report_text import set_report
from .scan_records import TEXTURED

DERIVED = {"VIEW": "View Colors", "KIND": "Kind Colors"}
"""Colour attributes that are made for showing and removed again, by mode."""


def shown_mode(avatar: bpy.types.Object) -> str:
    """What the colours of a mesh object say now, as a mode; "" when they are none of ours."""
    from . import avatar_objects

    name = avatar.data.color_attributes.active_color_name
    return next((mode for mode, known in ({"CAPTURE": avatar_objects.COLOR} | DERIVED).items() if known == name), "")


COLOR, VIEW, KIND = "Color", "view", "kind"  # attribute names
MATERIAL_TAG = "mirror_scan_material"  # custom property: the attribute our material shows
OWNER = "mirror_scan_owner"
"""Custom property of an avatar and of its materials: the scan that they are of, see :data:`.scan_collections.KEY`."""

log = logging.getLogger(__name__)


def create_avatar(
    mesh: Mesh,
    name: str = "Avatar",
    collection: bpy.types.Collection | None = None,
    report: dict | None = None,
    unit: float = 1.0,
    owner: str = "",
) -> bpy.types.Object:
    """A Blender object from a mesh, smooth shaded, with a material that shows its colours.

    Colours become the point attribute ``Color`` (sRGB bytes, exact), ``view`` an integer point attribute and ``kind``
    an integer face attribute. Faces no Blender mesh may have (a vertex used twice, the same face twice) are
    dropped, and a warning is logged.

    Parameters
    ----------
    mesh : Mesh
        In metres, as it shall appear.
    name : str
        Of object and mesh; Blender adds a number when it is taken.
    collection : bpy.types.Collection, optional
        Where to link the object; by default it is linked nowhere.
    report : dict, optional
        Kept with the object as JSON text, see :func:`.report_text.avatar_report`.
    unit : float
        Metres in a Blender unit, see :func:`.units.metres_per_unit`.
    owner : str
        The scan whose it is: its materials are its own, under its name. "" shares one with all that have none.

    Raises
    ------
    OutputError
        When the arrays do not make a mesh. Nothing is left in the file then.
    """
    _check(mesh)
    with discard_on_error() as made:
        data = bpy.data.meshes.new(name)
        made.append(data)
        _fill(data, mesh, unit)
        known_materials = set(bpy.data.materials)
        material = avatar_material(COLOR if mesh.colors is not None else "", owner, name)
        if material not in known_materials:
            made.append(material)
        data.materials.append(material)
        avatar = bpy.data.objects.new(name, data)
        made.append(avatar)
        if owner:
            avatar[OWNER] = owner
        if report is not None:
            set_report(avatar, report)
        if collection is not None:
            collection.objects.link(avatar)
    return avatar


def refine(avatar: bpy.types.Object, mesh: Mesh, unit: float) -> None:
    """Give an object a finer mesh of the same surface; its materials, report and custom properties stay."""
    _check(mesh)
    with discard_on_error() as made:
        data = bpy.data.meshes.new(avatar.data.name)
        made.append(data)
        _fill(data, mesh, unit)
    replace_mesh(avatar, data)


def replace_mesh(avatar: bpy.types.Object, data: bpy.types.Mesh) -> None:
    """Give an object the mesh ``data`` with the materials and the name of its old one, which goes when it is unused."""
    old = avatar.data
    data.materials.clear()
    for material in old.materials:
        data.materials.append(material)
    avatar.data = data
    if not old.users:
        name = old.name
        bpy.data.meshes.remove(old)
        data.name = name


def avatar_material(attribute: str, owner: str = "", name: str = "Avatar") -> bpy.types.Material:
    """The material that shows a colour attribute (plain grey for "") of a scan's avatar: the file's own one if it has
    it, else a new one, named after the avatar where it is of a scan.

    Found by tags, not by name, so that what a user changed in it survives the next build.
    """
    for material in bpy.data.materials:
        if (
            material.get(MATERIAL_TAG) == attribute and material.get(OWNER, "") == owner
            and material.library is None and TEXTURED not in material
        ):  # fmt: skip
            return material
    with discard_on_error() as made:
        name = name if owner else "Avatar"
        if owner and attribute in DERIVED.values():
            name = f"{name} {attribute}"
        material = new_material(name, attribute, "ShaderNodeVertexColor" if attribute else "", made)
        if owner:
            material[OWNER] = owner
        if attribute:
            material.node_tree.nodes.active.layer_name = attribute
    return material


def new_material(name: str, attribute: str, source: str, made: list[bpy.types.ID]) -> bpy.types.Material:
    """A matt material of ours, tagged as showing ``attribute``, whose colour is that of a new, active node of the type
    ``source`` (plain grey for ""); put into ``made`` as well."""
    material = bpy.data.materials.new(name)
    made.append(material)
    material[MATERIAL_TAG] = attribute
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.8
    shader.inputs["Specular IOR Level"].default_value = 0.2
    tree.links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    if source:
        color = tree.nodes.new(source)
        color.location = (-320, 0)
        tree.links.new(color.outputs["Color"], shader.inputs["Base Color"])
        tree.nodes.active = color
    return material


def size_of(avatar: bpy.types.Object, unit: float) -> np.ndarray:
    """(3,) Metres in the world along the object's own axes for one of its own units; never 0."""
    return unit * np.maximum(np.abs(np.array(avatar.matrix_world.to_scale())), 1e-9)


def even_size_of(avatar: bpy.types.Object, unit: float) -> np.ndarray:
    """:func:`size_of` an object whose axes are scaled alike.

    Raises
    ------
    OutputError
        When they are not.
    """
    size = size_of(avatar, unit)
    if size.max() > 1.01 * size.min():
        text = say("{name} is scaled unevenly; apply its scale first (Ctrl A)")
        raise OutputError(text.format(name=avatar.name), code="scaled")
    return size


def read_surface(avatar: bpy.types.Object, size: np.ndarray) -> Mesh:
    """A mesh object's arrays along its own axes, as they are stored: polygons cut into triangles, no modifiers.

    ``size`` (3,) are metres in one unit of each axis, see :func:`size_of`.

    Raises
    ------
    OutputError
        When it has no faces.
    """
    surface = surface_of(avatar.data, size)
    if not len(surface.triangles):
        raise OutputError(say("{name}: has no faces").format(name=avatar.name), code="avatar")
    return surface


def surface_of(data: bpy.types.Mesh, size: np.ndarray) -> Mesh:
    """The arrays of a mesh, as :func:`read_surface`; it may have no faces."""
    data.calc_loop_triangles()
    count = len(data.loop_triangles)
    vertices = np.empty((len(data.vertices), 3), np.float32)
    data.attributes["position"].data.foreach_get("vector", vertices.ravel())
    triangles = np.empty((count, 3), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    polygon = np.empty(count, np.int32)
    data.loop_triangles.foreach_get("polygon_index", polygon)
    kind, view = integers(data, KIND, "FACE"), integers(data, VIEW, "POINT")
    kind = None if kind is None else kind[polygon]
    return Mesh(vertices.astype(np.float64) * size, triangles, active_colors(data), view, kind)


def check_finite(item: bpy.types.Object, vertices: np.ndarray) -> None:
    """Refuse a mesh that is somewhere nowhere.

    Raises
    ------
    OutputError
    """
    if not (np.abs(vertices) < 1e30).all():  # false for NaN too; Blender turns infinity into its largest number
        text = say("{name}: the position of a vertex or of the object is not a valid number; remove or move it first")
        raise OutputError(text.format(name=item.name), code="avatar")


def active_colors(data: bpy.types.Mesh, but: str = "") -> np.ndarray | None:
    """sRGB (V, 3) uint8 of the mesh's active colour attribute, when it has one by vertex; ``but`` is never meant."""
    attribute = data.color_attributes.active_color
    if attribute is not None and attribute.name == but:
        attribute = next((other for other in data.color_attributes if other.name != but), None)
    if attribute is None or attribute.domain != "POINT" or len(attribute.data) != len(data.vertices):
        return None
    rgba = np.empty((len(data.vertices), 4), np.float32)
    attribute.data.foreach_get("color_srgb", rgba.ravel())
    return np.rint(np.clip(rgba[:, :3], 0, 1) * 255).astype(np.uint8)


def integers(data: bpy.types.Mesh, name: str, domain: str) -> np.ndarray | None:
    """An attribute of whole numbers (N,) int8, or None when the mesh has none of that name there."""
    attribute = data.attributes.get(name)
    if attribute is None or attribute.domain != domain or attribute.data_type not in ("INT8", "INT"):
        return None
    values = np.empty(len(attribute.data), np.int32)
    attribute.data.foreach_get("value", values)
    return values.astype(np.int8)


def set_colors(data: bpy.types.Mesh, name: str, colors: np.ndarray, domain: str) -> None:
    """A colour attribute of sRGB bytes (N, 3), made or filled again."""
    attribute = data.attributes.get(name)
    if attribute is not None and (attribute.domain, attribute.data_type) != (domain, "BYTE_COLOR"):
        data.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = data.color_attributes.new(name, "BYTE_COLOR", domain)
    rgba = np.ones((len(colors), 4), np.float32)
    np.divide(colors, 255, out=rgba[:, :3], casting="unsafe")
    attribute.data.foreach_set("color_srgb", rgba.ravel())


def show_colors(avatar: bpy.types.Object, name: str) -> None:
    """Have the viewport, exporters and our material show a colour attribute of the mesh."""
    data = avatar.data
    data.color_attributes.active_color_name = name
    index = data.color_attributes.find(name)
    data.color_attributes.render_color_index = index
    textured = data.get(TEXTURED) if name == COLOR else None
    for slot in avatar.material_slots:
        if slot.material is not None and slot.material.get(MATERIAL_TAG) is not None:
            slot.material = textured or avatar_material(name, avatar.get(OWNER, ""), avatar.name)
    data.update_tag()


def set_picture(item: bpy.types.ID, picture: np.ndarray) -> None:
    """Give a data-block the picture (H, W, 3) uint8 that Blender's browsers show of it."""
    rgba = np.ones((*picture.shape[:2], 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255.0)  # Blender's pictures begin below
    preview = item.preview_ensure()
    preview.image_size = picture.shape[1::-1]
    preview.image_pixels_float.foreach_set(rgba.ravel())


def object_of(uid: int) -> bpy.types.Object | None:
    """The object with that ``session_uid``; undo and deletion make references to objects invalid, not this number."""
    return next((item for item in bpy.data.objects if item.session_uid == uid), None)


def avatar_of(uid: int) -> bpy.types.Object:
    """The avatar with that ``session_uid``, to which the result of a job goes.

    Raises
    ------
    OutputError
        When it was deleted meanwhile.
    """
    avatar = object_of(uid)
    if avatar is None:
        raise OutputError(say("The avatar no longer exists"), code="avatar")
    return avatar


def select_only(context: bpy.types.Context, target: bpy.types.Object) -> None:
    """Make ``target`` the one selected and the active object, unless its collection is not in the view layer."""
    layer = context.view_layer
    layer.update()  # a view layer does not know an object before this
    if target.name not in layer.objects:
        return
    for selected in list(layer.objects.selected):
        selected.select_set(False, view_layer=layer)
    target.select_set(True, view_layer=layer)
    layer.objects.active = target


@contextlib.contextmanager
def discard_on_error() -> Iterator[list[bpy.types.ID]]:
    """A list to put new data-blocks in: when the block raises they are removed again, last first."""
    made: list[bpy.types.ID] = []
    try:
        yield made
    except BaseException:
        bpy.data.batch_remove(made)
        raise


def _check(mesh: Mesh) -> None:
    """Refuse what Blender would crash on or silently change beyond recognition."""
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        text = say("mesh: vertices must be (V, 3) and triangles (T, 3), got {vertices} and {triangles}")
        raise OutputError(text.format(vertices=vertices.shape, triangles=triangles.shape), code="avatar")
    if len(vertices) == 0 or len(triangles) == 0:
        raise OutputError(say("mesh: has no triangles, so there is nothing to show"), code="avatar")
    if not (np.abs(vertices) < np.finfo(np.float32).max).all():  # false for NaN too
        raise OutputError(say("mesh: some vertex coordinates are not finite numbers"), code="avatar")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        text = say("mesh: a triangle refers to a vertex that does not exist (there are {count})")
        raise OutputError(text.format(count=len(vertices)), code="avatar")
    for label, values, shape in (
        ("colors", mesh.colors, (len(vertices), 3)),
        ("view", mesh.view, (len(vertices),)),
        ("kind", mesh.kind, (len(triangles),)),
    ):
        if values is not None and np.shape(values) != shape:
            text = say("mesh: {label} must have the shape {shape}, not {found}")
            raise OutputError(text.format(label=label, shape=shape, found=np.shape(values)), code="avatar")


def fill_mesh(data: bpy.types.Mesh, mesh: Mesh, unit: float = 1.0) -> None:
    """Give a mesh data-block another mesh's vertices, faces and colours; its materials and name stay.

    Raises
    ------
    OutputError
        When the arrays do not make a mesh; the data-block is as it was then.
    """
    _check(mesh)
    data.clear_geometry()
    _fill(data, mesh, unit)


def _fill(data: bpy.types.Mesh, mesh: Mesh, unit: float) -> None:
    """Arrays into an empty mesh data-block by ``foreach_set``, then validate."""
    n_vertices, n_triangles = len(mesh.vertices), len(mesh.triangles)
    data.vertices.add(n_vertices)
    vertices = np.ravel(mesh.vertices) if unit == 1.0 else np.ravel(mesh.vertices) / unit
    data.attributes["position"].data.foreach_set("vector", vertices.astype(np.float32))
    data.loops.add(3 * n_triangles)
    data.polygons.add(n_triangles)
    # The matching integer type lets Blender copy the block instead of converting item by item.
    data.polygons.foreach_set("loop_start", np.arange(0, 3 * n_triangles, 3, dtype=np.int32))
    data.attributes[".corner_vert"].data.foreach_set("value", np.ravel(mesh.triangles).astype(np.int32))
    for label, domain, values in ((VIEW, "POINT", mesh.view), (KIND, "FACE", mesh.kind)):
        if values is not None:
            attribute = data.attributes.new(label, "INT8", domain)
            attribute.data.foreach_set("value", np.ascontiguousarray(values, dtype=np.int8))
    if mesh.colors is not None:
        rgba = np.ones((n_vertices, 4), dtype=np.float32)
        np.divide(mesh.colors, 255, out=rgba[:, :3], casting="unsafe")
        attribute = data.color_attributes.new(COLOR, "BYTE_COLOR", "POINT")
        attribute.data.foreach_set("color_srgb", rgba.ravel())
        data.color_attributes.active_color = attribute
        data.color_attributes.render_color_index = data.color_attributes.active_color_index
    if _has_impossible_faces(mesh):
        data.validate()
        log.warning(
            "%s: Blender removed %d faces that were degenerate or doubled", data.name, n_triangles - len(data.polygons)
        )
    data.update(calc_edges=True)


def _has_impossible_faces(mesh: Mesh) -> bool:
    """Whether a triangle names a vertex twice, or two triangles are the same.

    With what :func:`_check` refuses, these are all that Blender's ``validate()`` looks for in a mesh of triangles;
    asking ourselves takes 6 ms for 120 000 triangles instead of 30 to 60.
    """
    i, j, k = np.asarray(mesh.triangles, dtype=np.int64).T
    a, c = np.minimum(np.minimum(i, j), k), np.maximum(np.maximum(i, j), k)
    b = i + j + k - a - c
    if ((a == b) | (b == c)).any():
        return True
    n = len(mesh.vertices)
    if n > 1_000_000:  # too many for three indices in one int64
        _, ab = np.unique(a * n + b, return_inverse=True)
        key = np.sort(ab * n + c)
    else:
        key = np.sort((a * n + b) * n + c)
    return bool((key[1:] == key[:-1]).any())
