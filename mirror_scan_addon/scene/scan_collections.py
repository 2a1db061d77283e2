"""Where what belongs to a scan stands in a scene: in *Mirror Scan* ▸ the capture's name ▸ avatar, points and rig.

Collections are known by a custom property, not by name: a user may rename them, and move them about in the scene.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from .scan_records import SOURCE

PART = "mirror_scan_part"
"""Custom property of a collection of ours: which it is."""
KEY = "mirror_scan_key"
"""Custom property of a scan's collection: its capture, by path, or by name when it has no file."""
ROOT, SCAN, AVATAR, POINTS, RIG, VERSIONS = "root", "scan", "avatar", "points", "rig", "versions"
TITLES = {AVATAR: "Avatar", POINTS: "Points", RIG: "Rig", VERSIONS: "Versions"}
"""How the collections in a scan's are named, after its name."""
_LONGEST = 40  # letters of a capture's name: Blender's names have 63 bytes, and more is added to it


def capture_name(path: str) -> str:
    """What a capture at an absolute path is called: the folder's name, or the file's without its ending."""
    place = Path(path)
    return place.resolve().name if place.is_dir() else place.stem


def scan_of(scene: bpy.types.Scene, path: str, name: str) -> bpy.types.Collection:
    """The collection of the scan of a capture, made if there is none, with the scene's *Mirror Scan* around it.

    Parameters
    ----------
    scene : bpy.types.Scene
        Can be changed.
    path : str
        Of the capture, absolute; "" when it has no file.
    name : str
        Of the capture.
    """
    found = find_scan(scene, path, name)
    if found is not None:
        return found
    scan = _made(_free_name(name[:_LONGEST].strip() or "Scan"), SCAN, root_of(scene))
    scan[KEY] = _plain(path) or name
    return scan


def root_of(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The scene's collection *Mirror Scan*, made if there is none."""
    found = next(_ours(scene, ROOT), None)
    return _made("Mirror Scan", ROOT, scene.collection) if found is None else found


def find_scan(scene: bpy.types.Scene, path: str, name: str) -> bpy.types.Collection | None:
    """The collection of the scan of a capture, also of one that was moved on the disk; None when there is none."""
    scans, path = list(_ours(scene, SCAN)), _plain(path)
    found = next((scan for scan in scans if scan.get(KEY) == (path or name)), None)
    if found is None and path:
        found = next((scan for scan in scans if _was_moved(str(scan.get(KEY, "")), path)), None)
        if found is not None:
            found[KEY] = path
    return found


def _plain(path: str) -> str:
    """A path without what makes no difference, such as a slash at its end; "" stays as it is."""
    return str(Path(path)) if path else ""


def _was_moved(old: str, new: str) -> bool:
    """Whether a capture is the one of another path that is not there any more."""
    return old != new and Path(old).name == Path(new).name and Path(old).is_absolute() and not Path(old).exists()


def part_of(scan: bpy.types.Collection, part: str) -> bpy.types.Collection:
    """A scan's collection for ``part``, made if there is none."""
    found = next((child for child in scan.children if child.get(PART) == part and child.is_editable), None)
    return found or _made(f"{scan.name} {TITLES[part]}", part, scan)


def scan_around(item: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The scan whose collection an object stands in; None for one that stands elsewhere."""
    return next((scan for scan in _ours(scene, SCAN) if item.name in scan.all_objects), None)


def is_version(item: bpy.types.Object) -> bool:
    """Whether an avatar is one of those that were kept when it was built again."""
    return any(collection.get(PART) == VERSIONS for collection in item.users_collection)


def move_to(item: bpy.types.Object, collection: bpy.types.Collection) -> None:
    """Have an object stand in one collection and in no other."""
    for other in item.users_collection:
        if other != collection:
            other.objects.unlink(item)
    if item.name not in collection.objects:
        collection.objects.link(item)


def show_in_layer(collection: bpy.types.Collection, layer: bpy.types.ViewLayer) -> None:
    """Have a view layer include and show a collection: who makes something wants to see it, and bones can be made in
    what is shown only."""
    for item in _way_to(layer.layer_collection, collection):
        if item.exclude:
            item.exclude = False
        item.hide_viewport = False
        if item.collection.hide_viewport and item.collection.is_editable:
            item.collection.hide_viewport = False


def tidy(scene: bpy.types.Scene) -> None:
    """Remove collections of ours in which nothing stands any more; a user's that stand in them keep them."""
    for part in (*TITLES, SCAN, ROOT):
        for found in list(_ours(scene, part)):
            if not len(found.objects) and not len(found.children):
                bpy.data.collections.remove(found)


def sources_match(item: bpy.types.Object, source: dict) -> bool:
    """Whether an avatar was built from the capture that ``source`` names, see :func:`.capture_source.keep_source`."""
    import json

    try:
        kept = json.loads(item.get(SOURCE, ""))
        path, name = str(kept["path"]), str(kept.get("name", ""))
    except (AttributeError, KeyError, TypeError, ValueError):  # of an older version, or edited into nonsense
        return False
    if path and source["path"]:
        return Path(path) == Path(source["path"]) or _was_moved(path, source["path"])
    return bool(name) and name == source["name"]


def _ours(scene: bpy.types.Scene, part: str):
    """The scene's collections of ours that are ``part``, and can be changed."""
    for found in scene.collection.children_recursive:
        if found.get(PART) == part and found.is_editable:
            yield found


def _made(name: str, part: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    made = bpy.data.collections.new(name)
    made[PART] = part
    parent.children.link(made)
    return made


def _free_name(name: str) -> str:
    """A name that neither a collection nor an object has, numbered if need be: both bear a scan's."""
    taken = {block.name for blocks in (bpy.data.collections, bpy.data.objects) for block in blocks}
    free, number = name, 1
    while free in taken:
        number += 1
        free = f"{name} {number}"
    return free


def _way_to(layer: bpy.types.LayerCollection, wanted: bpy.types.Collection) -> list[bpy.types.LayerCollection]:
    """The layer collections from the outermost to that of ``wanted``; none when it is not there."""
    if layer.collection == wanted:
        return [layer]
    for child in layer.children:
        found = _way_to(child, wanted)
        if found:
            return [layer, *found]
    return []
