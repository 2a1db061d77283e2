"""Room for the person: objects that would hide it are hidden, and shown again; so is what belongs to the scan."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from .scan_records import RIG_TAG, armature_of

HIDDEN = "mirror_scan_hidden"
"""Custom property of an object that :func:`hide` has hidden."""

SOLID = {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "POINTCLOUD", "VOLUME", "GREASEPENCIL", "GPENCIL"}
"""Types of objects that something can stand behind."""

SHELL = 0.1  # of the person's size on each side, in which a floor or a wall hides nothing


def box_of(item: bpy.types.Object) -> tuple[list[float], list[float]]:
    """Least and greatest coordinates of an object in the world."""
    from mathutils import Vector

    corners = [item.matrix_world @ Vector(corner) for corner in item.bound_box]
    return [min(c[k] for c in corners) for k in range(3)], [max(c[k] for c in corners) for k in range(3)]


def in_the_way(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, person: bpy.types.Object) -> list[bpy.types.Object]:
    """Visible objects of the user's that reach into the space of ``person``, an avatar or a capture's points."""
    low, high = box_of(person)
    inner = [SHELL * (high[k] - low[k]) for k in range(3)]
    low, high = [low[k] + inner[k] for k in range(3)], [high[k] - inner[k] for k in range(3)]
    found = []
    for item in scene.objects:
        if item.type not in SOLID or item == person or not item.visible_get(view_layer=layer) or _is_ours(item):
            continue
        least, most = box_of(item)
        if all(least[k] < high[k] and most[k] > low[k] for k in range(3)):
            found.append(item)
    return found


def hide(items: Iterable[bpy.types.Object], layer: bpy.types.ViewLayer) -> int:
    """Hide objects, as H does, and remember them; how many. Undo shows them again."""
    count = 0
    for item in items:
        item.hide_set(True, view_layer=layer)
        if item.is_editable:
            item[HIDDEN] = True
        count += 1
    return count


def hidden(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """What :func:`hide` has hidden of a scene."""
    return [item for item in scene.objects if HIDDEN in item]


def show(items: Iterable[bpy.types.Object], layer: bpy.types.ViewLayer) -> None:
    """Undo :func:`hide`."""
    for item in items:
        if item.name in layer.objects:
            item.hide_set(False, view_layer=layer)
        del item[HIDDEN]


def show_setup(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, shown: bool) -> None:
    """Show or hide what belongs to the scan: the capture's points, its mirrors, and those of a virtual rig with their
    frames and room."""
    settings = scene.mirror_scan
    settings.show_cloud = settings.show_mirrors = shown
    for item in scene.objects:
        of_rig = item.mirror_scan.is_mirror or item.get(RIG_TAG) in ("frame", "room")
        if of_rig and item.name in layer.objects:
            item.hide_set(not shown, view_layer=layer)


def setup_shown(scene: bpy.types.Scene) -> bool:
    """Whether any of it is shown."""
    settings = scene.mirror_scan
    return settings.show_cloud or settings.show_mirrors


def _is_ours(item: bpy.types.Object) -> bool:
    """Whether an object was made by this add-on, or goes along with an avatar."""
    if any(name.startswith("mirror_scan_") and name != HIDDEN for name in item.keys()):
        return True
    if item.mirror_scan.is_mirror or armature_of(item) is not None:
        return True
    return any(name.startswith("mirror_scan_") for collection in item.users_collection for name in collection.keys())
