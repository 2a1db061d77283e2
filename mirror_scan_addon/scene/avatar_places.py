"""The avatar of a scan in its scene: built again it takes the place of the one before, and the next person stands
beside the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from . import avatar_objects, cloth, report_text, scan_collections, tape_curves
from .avatar_objects import COLOR, MATERIAL_TAG, OWNER
from .avatar_texture import material_of, remove_unused
from .scan_collections import AVATAR, KEY, VERSIONS
from .scan_records import REPORT, RESTS_OTHERWISE, armature_of

if TYPE_CHECKING:
    from ...core.mesh import Mesh

GAP = 0.3
"""Between two persons [m]."""
_RIG_SIZE = 2.5
"""How far from the person on either axis points belong to the rig; farther away are the room's walls [m]."""
_MOST_POINTS = 20_000
"""How many points are asked where they stand."""


def avatar_from(scene: bpy.types.Scene, source: dict) -> bpy.types.Object | None:
    """The avatar in the scene that was built from the capture ``source`` names; the active one if there are several."""
    found = [item for item in _avatars(scene) if scan_collections.sources_match(item, source)]
    active = scene.view_layers[0].objects.active if scene.view_layers else None
    return active if active in found else next(iter(found), None)


def put_avatar(
    scene: bpy.types.Scene, source: dict, mesh: Mesh, report: dict, unit: float, keep: bool = False
) -> bpy.types.Object:
    """An avatar of a capture in its scan's collection, in place of the one that is there.

    The object stays where it is one: its name, place, modifiers and what hangs on it. Its skeleton, garments, tapes and
    texture go, for they fit the old mesh.

    Parameters
    ----------
    scene : bpy.types.Scene
    source : dict
        ``path`` (absolute, or "") and ``name`` of the capture.
    mesh : Mesh
        Avatar frame [m].
    report : dict
    unit : float
        Metres in a Blender unit.
    keep : bool
        The avatar that is there stays as a version, hidden, and the new one is another object.
    """
    scan = scan_collections.scan_of(scene, source["path"], source["name"])
    home = scan_collections.part_of(scan, AVATAR)
    old = avatar_from(scene, source)
    if old is not None and not keep:
        _rebuild(old, mesh, report, unit)
        made = old
    else:
        name, place = scan.name, None
        if old is not None:
            name, place = old.name, old.matrix_world.copy()
            _keep_version(old, scan)
        others = _avatars(scene, linked=True)
        scene.view_layers[0].update()  # where they stand
        made = avatar_objects.create_avatar(mesh, name, home, report, unit, owner=str(scan[KEY]))
        if place is None:
            made.location.x = _free_place(*_bounds([made]), others, GAP / unit)
        else:
            made.matrix_world = place
    for layer in scene.view_layers:
        if made.name not in layer.objects:
            scan_collections.show_in_layer(home, layer)
    scan_collections.tidy(scene)
    return made


def pose_of(avatar: bpy.types.Object, scene: bpy.types.Scene, unit: float) -> np.ndarray:
    """(4, 4) rigid, where an avatar stands: avatar frame → world [m]; its scale is left out."""
    scene.view_layers[0].update()
    place, turn, _ = avatar.matrix_world.decompose()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.array(turn.to_matrix()), unit * np.array(place)
    return pose


def place_of_points(
    scene: bpy.types.Scene, source: dict, points: np.ndarray, placement: np.ndarray, unit: float
) -> np.ndarray:
    """(4, 4) rigid, camera frame → world [m]: where a capture's points stand before an avatar is built of them.

    On the avatar that was built of this capture before; else with all of the rig beside the avatars that are there, as
    the next person is going to stand.

    Parameters
    ----------
    scene : bpy.types.Scene
    source : dict
        ``path`` and ``name`` of the capture.
    points : np.ndarray [shape=(N, 3)]
        Camera frame [m].
    placement : np.ndarray [shape=(4, 4)]
        Camera frame → avatar frame, as well as it is known.
    unit : float
        Metres in a Blender unit.
    """
    avatar = avatar_from(scene, source)
    if avatar is not None:
        known = report_text.avatar_report(avatar).get("camera_to_avatar")
        return pose_of(avatar, scene, unit) @ (placement if known is None else np.array(known))
    others = _avatars(scene, linked=True)
    if not others:
        return placement
    scene.view_layers[0].update()
    standing = points[:: len(points) // _MOST_POINTS + 1] @ placement[:3, :3].T + placement[:3, 3]
    near = standing[(np.abs(standing[:, :2]) < _RIG_SIZE).all(axis=1)]
    if not len(near):
        return placement
    low, high = near.min(axis=0) / unit, near.max(axis=0) / unit
    beside = np.eye(4)
    beside[0, 3] = unit * _free_place(low, high, others, GAP / unit)
    return beside @ placement


def _avatars(scene: bpy.types.Scene, linked: bool = False) -> list[bpy.types.Object]:
    """The scene's avatars; those that were kept as versions are left out, and those of other files unless ``linked``
    asks for them too."""
    return [
        item
        for item in scene.objects
        if item.type == "MESH"
        and REPORT in item
        and (linked or item.is_editable)
        and len(item.data.vertices)
        and not scan_collections.is_version(item)
    ]


def _rebuild(avatar: bpy.types.Object, mesh: Mesh, report: dict, unit: float) -> None:
    """Give an avatar a new mesh of its capture."""
    _take_off(avatar)
    textured = material_of(avatar.data)
    avatar_objects.refine(avatar, mesh, unit)
    report_text.set_report(avatar, report)
    avatar.pop(RESTS_OTHERWISE, None)
    if mesh.colors is not None:
        avatar_objects.show_colors(avatar, COLOR)
    for slot in avatar.material_slots:
        if slot.material is not None and mesh.colors is None and MATERIAL_TAG in slot.material:
            slot.material = avatar_objects.avatar_material("", avatar.get(OWNER, ""), avatar.name)
    if textured is not None:
        remove_unused(textured)


def _take_off(avatar: bpy.types.Object) -> None:
    """Remove an avatar's skeleton, its weights, what it wears and its tapes; it stays where it stands.

    What else hangs on the skeleton hangs on the avatar then. An armature that moves another mesh stays.
    """
    tape_curves.remove_tapes(avatar)
    bones = armature_of(avatar)
    if bones is None:
        return
    collider = cloth.collider_of(avatar)
    cloth.remove([*cloth.garments_of(avatar), *([collider] if collider is not None else [])])
    place = avatar.matrix_world.copy()
    for modifier in [found for found in avatar.modifiers if found.type == "ARMATURE" and found.object == bones]:
        avatar.modifiers.remove(modifier)
    for bone in bones.data.bones:
        group = avatar.vertex_groups.get(bone.name)
        if group is not None:
            avatar.vertex_groups.remove(group)
    if avatar.parent == bones:
        avatar.parent, avatar.parent_type, avatar.parent_bone = bones.parent, bones.parent_type, bones.parent_bone
        avatar.matrix_parent_inverse = bones.matrix_parent_inverse
    avatar.matrix_world = place
    if any(armature_of(item) == bones for item in bpy.data.objects if item.type == "MESH"):
        return
    for child in bones.children:
        stands = child.matrix_world.copy()
        child.parent = avatar
        child.matrix_world = stands
    data = bones.data
    bpy.data.objects.remove(bones)
    if not data.users:
        bpy.data.armatures.remove(data)


def _keep_version(avatar: bpy.types.Object, scan: bpy.types.Collection) -> None:
    """Put an avatar with all that hangs on it into the scan's collection of versions, which is hidden."""
    home = scan_collections.part_of(scan, VERSIONS)
    home.hide_viewport = home.hide_render = True
    bones = armature_of(avatar)
    kept = {avatar, *avatar.children_recursive, *([bones, *bones.children_recursive] if bones is not None else [])}
    name = avatar.name
    number = 1
    while f"{name} Version {number}" in bpy.data.objects:
        number += 1
    for item in kept:
        after = item.name.removeprefix(name) if item.name.startswith(name) else None
        scan_collections.move_to(item, home)
        if after is not None:
            item.name = f"{name} Version {number}{after}"
            if item.data is not None and item.data.name.startswith(name) and item.data.users == 1:
                item.data.name = item.name


def _free_place(low: np.ndarray, high: np.ndarray, others: list[bpy.types.Object], gap: float) -> float:
    """How far what reaches from ``low`` to ``high`` must move along x to stand beside others that take its place; 0
    when none do."""
    x = 0.0
    for left, right in sorted(
        (_bounds([item, *cloth.garments_of(item)]) for item in others), key=lambda box: box[0][0]
    ):
        apart = (low[1:] >= right[1:]).any() or (high[1:] <= left[1:]).any()
        if not apart and low[0] + x < right[0] + gap and high[0] + x + gap > left[0]:
            x = float(right[0] + gap - low[0])
    return x


def _bounds(items: list[bpy.types.Object]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates in the world of the meshes of objects, at rest."""
    corners = []
    for item in items:
        points = np.empty((len(item.data.vertices), 3), np.float32)
        item.data.attributes["position"].data.foreach_get("vector", points.ravel())
        if len(points):
            matrix = np.array(item.matrix_world)
            corners.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
