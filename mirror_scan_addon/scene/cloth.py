"""Garments as objects of a scene: skin, cloth with pins, and the collider that the cloth falls on.

Cloth falls on a coarse copy of the avatar, which costs a fraction of the time. What that copy lacks of the true skin is
made up for afterwards: the last modifier keeps every vertex of the cloth a little outside the avatar itself.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ...core.avatar.garment import Garment
from ...core.avatar.pose import SkinWeights
from ...core.avatar.skeleton import BONES
from ...core.errors import OutputError
from ..language.texts import say
from . import avatar_objects
from .armature import read_weights, set_weights
from .scan_records import armature_of
from .units import metres_per_unit

GARMENT, COLLIDER = "mirror_scan_garment", "mirror_scan_collider"  # custom properties of the objects
PINNED = "Pinned"
"""The vertex group that holds cloth."""

HELD, FREE = 0.03, 0.07
"""So far around the edge that a garment hangs on it is pinned, and from there on free [m]."""

_COLLIDER_TRIANGLES = 6000
_DISTANCE, _SKIN_GAP = 0.005, 0.0045  # of cloth from the collider, and from the skin itself at the end [m]
_PASSES = 3
_MASS = 0.2  # of a vertex [kg]
_STIFFNESS, _SHEAR, _BENDING = 20.0, 5.0, 0.5
_FRICTION = 1.0
_QUALITY, _COLLISION_QUALITY = 6, 3  # steps a frame


def add_garment(
    avatar: bpy.types.Object, garment: Garment, collection: bpy.types.Collection, unit: float = 1.0
) -> bpy.types.Object:
    """A garment as a mesh object, which the avatar's armature moves.

    Parameters
    ----------
    avatar : bpy.types.Object
        A mesh with an armature; the garment is named after it.
    garment : Garment
        In the avatar's frame [m].
    collection : bpy.types.Collection
    unit : float
        Metres in a unit of the avatar.
    """
    made = avatar_objects.create_avatar(garment.mesh, f"{avatar.name} {garment.name}", collection, unit=unit)
    if garment.uv is not None:
        layer = made.data.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", np.ascontiguousarray(garment.uv, np.float32).ravel())
    wear(made, avatar, garment.weights, garment.pinned)
    made[GARMENT] = {"name": garment.name, "tight": garment.tight}
    made.parent = armature_of(avatar)
    made.matrix_parent_inverse.identity()
    made.matrix_basis.identity()
    return made


def wear(garment: bpy.types.Object, avatar: bpy.types.Object, weights: SkinWeights, pinned: np.ndarray | None) -> None:
    """Have the avatar's armature move a garment's vertices by ``weights``; ``pinned`` (V,) becomes a vertex group."""
    set_weights(garment, weights)
    bones = armature_of(avatar)
    own = next((modifier for modifier in garment.modifiers if modifier.type == "ARMATURE"), None)
    if own is None:
        own = garment.modifiers.new("Armature", "ARMATURE")
        garment.modifiers.move(len(garment.modifiers) - 1, 0)
    own.object = bones
    if pinned is not None:
        old = garment.vertex_groups.get(PINNED)
        if old is not None:
            garment.vertex_groups.remove(old)
        group = garment.vertex_groups.new(name=PINNED)
        for vertex in np.flatnonzero(pinned > 0).tolist():
            group.add((vertex,), float(pinned[vertex]), "REPLACE")


def make_cloth(
    garment: bpy.types.Object, avatar: bpy.types.Object, scene: bpy.types.Scene, pins: str = PINNED
) -> bpy.types.Modifier:
    """Have a garment fall as cloth in the scene's range of frames, held by the vertex group ``pins``."""
    metre = 1.0 / metres_per_unit(scene)
    cloth = next((modifier for modifier in garment.modifiers if modifier.type == "CLOTH"), None)
    cloth = cloth or garment.modifiers.new("Cloth", "CLOTH")
    settings, collisions = cloth.settings, cloth.collision_settings
    settings.quality, settings.mass, settings.air_damping = _QUALITY, _MASS, 1.0
    settings.tension_stiffness = settings.compression_stiffness = _STIFFNESS
    settings.shear_stiffness, settings.bending_stiffness = _SHEAR, _BENDING
    settings.tension_damping = settings.compression_damping = settings.shear_damping = 5.0
    settings.vertex_group_mass, settings.pin_stiffness = pins, 1.0
    collisions.use_collision, collisions.collision_quality = True, _COLLISION_QUALITY
    collisions.distance_min = _DISTANCE * metre
    collisions.friction = _FRICTION
    collisions.use_self_collision = False
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = scene.frame_start, scene.frame_end
    keep_off_skin(garment, avatar, metre)
    return cloth


def keep_off_skin(garment: bpy.types.Object, avatar: bpy.types.Object, metre: float) -> None:
    """Last modifiers that bring vertices which are in the avatar, or nearly, to just outside it.

    Several times: what is moved out of a finger may come to lie in the hip. By smooth normals: by those of faces, a
    vertex far out beside a sharp edge would count as inside.
    """
    wraps = [modifier for modifier in garment.modifiers if modifier.type == "SHRINKWRAP" and modifier.target == avatar]
    while len(wraps) < _PASSES:
        wraps.append(garment.modifiers.new("Off the Skin", "SHRINKWRAP"))
    for wrap in wraps:
        wrap.target = avatar
        wrap.wrap_method, wrap.wrap_mode = "TARGET_PROJECT", "OUTSIDE"
        wrap.offset = _SKIN_GAP * metre


def collider_of(avatar: bpy.types.Object) -> bpy.types.Object | None:
    """The avatar's collider, when it has one."""
    bones = armature_of(avatar)
    for item in bones.children if bones is not None else ():
        if item.type == "MESH" and item.get(COLLIDER) and armature_of(item) == bones:
            return item
    return None


def add_collider(
    avatar: bpy.types.Object, collection: bpy.types.Collection, scene: bpy.types.Scene
) -> bpy.types.Object:
    """A coarse copy of the avatar that cloth falls on: moved by the same armature, hidden in renders.

    Forearms and hands are left out: where a skirt is worn over hands that hang at the hips, they would catch it and
    carry it along. The last modifiers of cloth keep it off their skin.

    The collection must be in a view layer of ``scene``.
    """
    copy = avatar.copy()
    copy.data = avatar.data.copy()
    copy.animation_data_clear()
    copy.modifiers.clear()
    collection.objects.link(copy)
    _cut_off_hands(copy)
    decimate = copy.modifiers.new("Decimate", "DECIMATE")
    decimate.ratio = min(1.0, _COLLIDER_TRIANGLES / max(len(copy.data.polygons), 1))
    layer = scene.view_layers[0]
    layer.update()
    graph = layer.depsgraph
    coarse = bpy.data.meshes.new_from_object(copy.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph)
    full, copy.data = copy.data, coarse
    bpy.data.meshes.remove(full)
    copy.modifiers.clear()
    copy.name = coarse.name = f"{avatar.name} Collider"
    coarse.materials.clear()
    for name in list(copy.keys()):
        if name.startswith("mirror_scan"):
            del copy[name]
    copy[COLLIDER] = True
    modifier = copy.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature_of(avatar)
    copy.modifiers.new("Collision", "COLLISION")
    collision = copy.collision
    metre = 1.0 / metres_per_unit(scene)
    collision.thickness_outer, collision.thickness_inner = _DISTANCE * metre, 0.02 * metre
    collision.cloth_friction, collision.damping = _FRICTION, 0.3
    copy.hide_render = True
    copy.display_type = "BOUNDS"
    copy.select_set(False, view_layer=layer)
    copy.hide_set(True, view_layer=layer)
    return copy


def _cut_off_hands(item: bpy.types.Object) -> None:
    """Delete the vertices of an avatar's mesh that forearms and hands hold most."""
    held = read_weights(item).index[:, 0]
    away = np.isin(held, [bone for bone, name in enumerate(BONES) if name.endswith(("ForeArm", "Hand"))])
    work = bmesh.new()
    work.from_mesh(item.data)
    bmesh.ops.delete(work, geom=[vertex for vertex in work.verts if away[vertex.index]], context="VERTS")
    work.to_mesh(item.data)
    work.free()


def is_worn(item: bpy.types.Object) -> bool:
    """Whether an object is a garment of ours or a collider, not an avatar."""
    return bool(item.get(GARMENT) or item.get(COLLIDER))


def garments_of(avatar: bpy.types.Object) -> list[bpy.types.Object]:
    """The garments of ours that an avatar wears."""
    bones = armature_of(avatar)
    children = bones.children if bones is not None else ()
    return [item for item in children if item.type == "MESH" and item.get(GARMENT) and armature_of(item) == bones]


def read_garments(avatar: bpy.types.Object, unit: float = 1.0) -> list[Garment]:
    """The garments of ours that an avatar wears, at rest and in metres."""
    found = []
    for item in garments_of(avatar):
        notes = item[GARMENT]
        group = item.vertex_groups.get(PINNED)
        pinned = np.zeros(len(item.data.vertices), np.float32)
        if group is not None:
            for vertex in item.data.vertices:
                pinned[vertex.index] = next((m.weight for m in vertex.groups if m.group == group.index), 0.0)
        mesh = avatar_objects.read_surface(item, np.ones(3))
        there = np.array(in_avatar(item, avatar))
        mesh = replace(mesh, vertices=unit * (mesh.vertices @ there[:3, :3].T + there[:3, 3]))
        found.append(Garment(str(notes["name"]), mesh, read_weights(item), pinned, bool(notes["tight"]), _places(item)))
    return found


def _places(item: bpy.types.Object) -> np.ndarray | None:
    """Places (T, 3, 2) float32 of the corners in an image, by the active UV map."""
    layer = item.data.uv_layers.active
    if layer is None:
        return None
    uv = np.empty((len(item.data.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.ravel())
    loops = np.empty((len(item.data.loop_triangles), 3), np.int32)
    item.data.loop_triangles.foreach_get("loops", loops.ravel())
    return uv[loops]


def pose_cloth(garments: Sequence[int], scene: bpy.types.Scene) -> Generator[float, None, None]:
    """Let cloth fall through the scene's frames, a frame a step, and keep it; yields the share that is done.

    The scene stands at its first frame afterwards. ``garments`` are numbers of objects (``session_uid``): they may be
    deleted meanwhile.
    """
    first, last = scene.frame_start, scene.frame_end
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        yield (frame - first + 1) / (last - first + 1)
    for garment in filter(None, map(avatar_objects.object_of, garments)):
        for modifier in garment.modifiers:
            if modifier.type == "CLOTH":
                with bpy.context.temp_override(
                    scene=scene, active_object=garment, object=garment, point_cache=modifier.point_cache
                ):
                    bpy.ops.ptcache.bake_from_cache()
    scene.frame_set(first)


def in_avatar(item: bpy.types.Object, avatar: bpy.types.Object) -> Matrix:
    """From an object's axes to the avatar's."""
    return avatar.matrix_world.inverted() @ item.matrix_world


def hang_on(item: bpy.types.Object, avatar: bpy.types.Object) -> None:
    """Make an object a child of the avatar's armature; it stays where it is."""
    bones = armature_of(avatar)
    placed = item.matrix_world.copy()
    item.parent, item.parent_type = bones, "OBJECT"
    item.matrix_parent_inverse = bones.matrix_world.inverted()
    item.matrix_world = placed


def remove(items: list[bpy.types.Object]) -> None:
    """Take objects and their meshes out of the file again."""
    meshes = [item.data for item in items if item.type == "MESH"]
    bpy.data.batch_remove(items)
    bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])


def check_motion(scene: bpy.types.Scene) -> None:
    """Refuse to bake cloth over no time.

    Raises
    ------
    OutputError
    """
    if scene.frame_end <= scene.frame_start:
        raise OutputError(
            say("The scene has only one frame; set its first and last frame, or apply a motion first"), code="other"
        )
