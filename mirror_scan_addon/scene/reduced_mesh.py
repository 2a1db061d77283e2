"""An avatar's object with fewer triangles or with quads: what lies on its mesh is handed on to the new one."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import bpy
import numpy as np

from ...core.errors import OutputError
from ...core.mesh import Mesh, Texture
from ...core.mesh.triangle_mesh import barycentric
from ..language.texts import say
from . import avatar_objects
from .blender_files import reason_of

if TYPE_CHECKING:
    from ...core.decimation import Reduced


class _Place(NamedTuple):
    """Where new vertices lie on the old mesh: three of its vertices (N, 3), and their shares (N, 3)."""

    corners: np.ndarray
    shares: np.ndarray


class _Carried(NamedTuple):
    """What the old mesh carries beside its surface: vertex groups, colours by name, properties and the name shown."""

    groups: list[tuple[str, bool]]
    members: tuple[np.ndarray, np.ndarray, np.ndarray]  # vertex, group, weight
    colors: dict[str, tuple[str, np.ndarray]]
    properties: dict[str, object]
    shown: str


def read_with_texture(avatar: bpy.types.Object, size: np.ndarray) -> tuple[Mesh, Texture | None]:
    """The object's mesh with the colours of the capture, whatever is shown, and its active UV map, if any [m].

    ``size`` (3,): metres in one of its units. The texture has the places only.

    Raises
    ------
    OutputError
        When it has no faces.
    """
    mesh = avatar_objects.read_surface(avatar, size)
    data = avatar.data
    stored = data.color_attributes.get(avatar_objects.COLOR)
    colors = mesh.colors
    if stored is not None and stored.domain == "POINT":
        colors = np.rint(np.clip(_color_values(stored)[:, :3], 0, 1) * 255).astype(np.uint8)
    mesh = Mesh(mesh.vertices, mesh.triangles, colors, mesh.view, mesh.kind)
    layer = data.uv_layers.active
    if layer is None:
        return mesh, None
    uv = np.empty((len(data.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.ravel())
    loops = np.empty((len(mesh.triangles), 3), np.int32)
    data.loop_triangles.foreach_get("loops", loops.ravel())
    return mesh, Texture(uv[loops], np.zeros((1, 1, 3), np.uint8), np.zeros(len(loops), np.int32))


def put_triangles(avatar: bpy.types.Object, reduced: Reduced, size: np.ndarray) -> None:
    """Give the object the reduced mesh of :func:`read_with_texture`'s, with all that the old one carries.

    Vertex groups, modifiers, materials, the active UV map, colours and custom properties stay; its shape keys must be
    none.
    """
    old = avatar.data
    carried = _carried(avatar)
    polygon = np.empty(len(old.loop_triangles), np.int32)
    old.loop_triangles.foreach_get("polygon_index", polygon)
    materials = np.empty(len(old.polygons), np.int32)
    old.polygons.foreach_get("material_index", materials)
    layer = old.uv_layers.active.name if old.uv_layers.active is not None else ""
    mesh = reduced.mesh
    avatar_objects.refine(avatar, Mesh(mesh.vertices / size, mesh.triangles, mesh.colors, mesh.view, mesh.kind), 1.0)
    data = avatar.data
    data.polygons.foreach_set("material_index", materials[polygon[reduced.origin]])
    if reduced.texture is not None:
        made = data.uv_layers.new(name=layer, do_init=False)
        made.uv.foreach_set("vector", np.ascontiguousarray(reduced.texture.uv, np.float32).ravel())
    _put(avatar, carried, _Place(*reduced.footpoints[:2]))


def quad_remesh(avatar: bpy.types.Object, faces: int, guide: Mesh) -> None:
    """Give the object a mesh of about ``faces`` quads by Blender's QuadriFlow (Huang et al. 2018).

    Vertex groups, colours and custom properties are taken from the nearest place of the old surface. UV maps have no
    meaning on the new one and go.

    Parameters
    ----------
    avatar : bpy.types.Object
        A closed mesh in the context's view layer, without shape keys.
    faces : int
    guide : Mesh
        The surface to be covered, in the object's own units; fewer triangles take less time.

    Raises
    ------
    OutputError
        When Blender refuses the mesh.
    """
    from mathutils import bvhtree

    source = avatar_objects.read_surface(avatar, np.ones(3))
    carried = _carried(avatar)
    with avatar_objects.discard_on_error() as made:
        helper = avatar_objects.create_avatar(guide, "Quads", bpy.context.scene.collection)
        made += [helper, helper.data]
        bpy.context.view_layer.update()
        _quadriflow(helper, avatar.name, faces)
    data = helper.data
    bpy.data.objects.remove(helper)
    for name in [attribute.name for attribute in data.color_attributes]:
        data.color_attributes.remove(data.color_attributes[name])
    points = np.empty((len(data.vertices), 3), np.float32)
    data.attributes["position"].data.foreach_get("vector", points.ravel())
    tree = bvhtree.BVHTree.FromPolygons(source.vertices.tolist(), source.triangles.tolist(), all_triangles=True)
    found = [tree.find_nearest(point) for point in points.tolist()]
    corners = source.triangles[[index for _, _, index, _ in found]]
    shares = _shares(np.array([place for place, _, _, _ in found]), source.vertices[corners])
    avatar_objects.replace_mesh(avatar, data)
    _put(avatar, carried, _Place(corners, shares))


def _quadriflow(helper: bpy.types.Object, name: str, faces: int) -> None:
    with bpy.context.temp_override(object=helper, active_object=helper, selected_objects=[helper]):
        try:
            done = bpy.ops.object.quadriflow_remesh(mode="FACES", target_faces=faces, seed=0)
        except RuntimeError as error:
            text = say("{name}: Blender cannot make quads of it: {reason}")
            raise OutputError(text.format(name=name, reason=reason_of(str(error))), code="avatar") from error
    if done != {"FINISHED"} or not any(len(polygon.vertices) == 4 for polygon in helper.data.polygons):
        raise OutputError(
            say("{name}: Blender made no quads of it; check that it is closed").format(name=name), code="avatar"
        )


def _shares(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Shares (N, 3), sum 1 and none negative, of triangles' corners (N, 3, 3) at points (N, 3) on them."""
    shares = np.clip(barycentric(points, corners), 0, 1)
    return shares / shares.sum(axis=1, keepdims=True)


def _color_values(attribute: bpy.types.Attribute) -> np.ndarray:
    """sRGB and alpha (N, 4), 0 to 1, of a colour attribute."""
    values = np.empty((len(attribute.data), 4), np.float32)
    attribute.data.foreach_get("color_srgb", values.ravel())
    return values


def _carried(avatar: bpy.types.Object) -> _Carried:
    data = avatar.data
    members = [(v.index, member.group, member.weight) for v in data.vertices for member in v.groups]
    table = np.array(members, np.float64).reshape(-1, 3)
    colors = {
        attribute.name: (attribute.data_type, _color_values(attribute))
        for attribute in data.color_attributes
        if attribute.domain == "POINT" and attribute.name not in avatar_objects.DERIVED.values()
    }
    return _Carried(
        [(group.name, group.lock_weight) for group in avatar.vertex_groups],
        (table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2]),
        colors,
        {key: data[key] for key in data.keys()},  # noqa: SIM118  # an ID is no mapping
        data.color_attributes.active_color_name,
    )


def _put(avatar: bpy.types.Object, carried: _Carried, place: _Place) -> None:
    """What the old mesh carried, onto the object's new one."""
    data = avatar.data
    for key, value in carried.properties.items():
        data[key] = value
    for name, (kind, values) in carried.colors.items():
        if data.color_attributes.get(name) is None:  # our own colours are averaged already
            made = data.color_attributes.new(name, kind, "POINT")
            blended = np.einsum("nk,nkc->nc", place.shares, values[place.corners]).astype(np.float32)
            made.data.foreach_set("color_srgb", np.ascontiguousarray(blended).ravel())
    known = data.color_attributes
    wanted = carried.shown if carried.shown in known else avatar_objects.COLOR
    if wanted in known:
        avatar_objects.show_colors(avatar, wanted)
    _put_groups(avatar, carried, place)
    data.update()


def _put_groups(avatar: bpy.types.Object, carried: _Carried, place: _Place) -> None:
    """Vertex groups, interpolated: as many to a vertex as the old mesh has at most, the largest."""
    avatar.vertex_groups.clear()
    groups = []
    for name, locked in carried.groups:
        group = avatar.vertex_groups.new(name=name)
        group.lock_weight = locked
        groups.append(group)
    vertex, group, weight = carried.members
    if not len(vertex):
        return
    count, kinds = len(place.corners), len(groups)
    room = np.bincount(vertex)
    first = np.concatenate(([0], np.cumsum(np.bincount(vertex, minlength=int(place.corners.max()) + 1))))
    dense = np.zeros(count * kinds)
    for k in range(3):
        corner = place.corners[:, k]
        many = first[corner + 1] - first[corner]
        row = np.repeat(np.arange(count), many)
        at = np.repeat(first[corner] - np.cumsum(many) + many, many) + np.arange(many.sum())
        dense += np.bincount(row * kinds + group[at], np.repeat(place.shares[:, k], many) * weight[at], count * kinds)
    dense = dense.reshape(count, kinds)
    most = min(int(room.max()), kinds)
    total = dense.sum(axis=1)
    index = np.argsort(-dense, axis=1, kind="stable")[:, :most]
    kept = np.take_along_axis(dense, index, axis=1)
    kept *= (total / np.maximum(kept.sum(axis=1), 1e-12))[:, None]
    for row, column in np.argwhere(kept > 1e-4).tolist():
        groups[index[row, column]].add((row,), kept[row, column], "REPLACE")
