"""A virtual rig as objects of the scene: a camera, and flat objects that are marked as mirrors.

Objects are in Blender units of ``unit`` metres (:func:`.units.metres_per_unit`); what core gets and gives is in metres.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix

from ...core.errors import MirrorScanError
from ...core.mesh import Mesh
from ..language.texts import say
from .avatar_objects import discard_on_error
from .live_rig import person_of as rig_person
from .live_rig import planned_camera
from .report_text import mirror_label
from .scan_collections import root_of
from .scan_records import RIG_TAG
from .units import metres_per_unit

if TYPE_CHECKING:
    from ...core.camera import Intrinsics
    from ...core.simulation.scene import Rig


COLLECTION = "Mirror Scan Rig"
MATERIAL = "Mirror Scan Glass"
FRAME_MATERIAL, FRAME_COLOR = "Mirror Scan Frame", (0.16, 0.1, 0.06, 1.0)
BACKING = 0.02  # thickness of a mirror's board, as core's rig has it [m]
LEAST_HEIGHT, MOST_HEIGHT = 0.6, 2.6  # of a person [m]
COVERAGE = "Coverage"  # colour attribute of a body: what sees it
_FLIP = np.diag((1.0, -1.0, -1.0, 1.0))  # Blender's camera looks along -z with y up, core's along z with y down


def add_objects(scene: bpy.types.Scene, rig: Rig, place: tuple[float, float] = (0.0, 0.0)) -> list[bpy.types.Object]:
    """Camera and mirrors of a rig, in a collection of their own, around ``place`` (x, y) in Blender units.

    The camera becomes the scene's where that has none, or the camera of an earlier rig; one of the user's stays.
    """
    intrinsics, unit = rig.intrinsics, metres_per_unit(scene)
    with discard_on_error() as made:
        collection = bpy.data.collections.new(COLLECTION)
        made.append(collection)
        camera = bpy.data.objects.new("Depth Camera", bpy.data.cameras.new("Depth Camera"))
        made += [camera.data, camera]
        fit_lens(camera, intrinsics)
        camera.data.display_size = 0.12 / unit  # its filled triangle must not hide the person from behind it
        camera.data.clip_start, camera.data.clip_end = 0.1 / unit, 100.0 / unit
        around = Matrix.Translation((*place, 0.0))
        camera.matrix_world = around @ _in_units(Matrix((rig.camera_to_avatar @ _FLIP).tolist()), unit)
        objects = [camera]
        material = bpy.data.materials.get(MATERIAL)
        if rig.mirrors and (material is None or material.library is not None):
            material = bpy.data.materials.new(MATERIAL)
            made.append(material)
            material.metallic, material.roughness = 1.0, 0.02
            material.diffuse_color = (0.45, 0.7, 0.9, 1.0)  # in solid shading glass is bluish
            if bpy.app.version < (5, 0, 0):
                material.use_nodes = True
            for node in material.node_tree.nodes:
                if node.type == "BSDF_PRINCIPLED":
                    node.inputs["Metallic"].default_value, node.inputs["Roughness"].default_value = 1.0, 0.0
                    node.inputs["Base Color"].default_value = (0.84, 0.92, 0.96, 1.0)
        for mirror in rig.mirrors:
            w, h = mirror.width / 2 / unit, mirror.height / 2 / unit
            mesh = bpy.data.meshes.new(mirror_label(mirror.name))
            made.append(mesh)
            mesh.from_pydata([(-w, -h, 0), (w, -h, 0), (w, h, 0), (-w, h, 0)], [], [(0, 1, 2, 3)])
            mesh.materials.append(material)
            glass = bpy.data.objects.new(mirror_label(mirror.name), mesh)
            made.append(glass)
            axes = mirror.axes
            pose = Matrix.Translation(mirror.centre) @ Matrix(axes.T.tolist()).to_4x4()
            glass.matrix_world = around @ _in_units(pose, unit)
            glass.color = material.diffuse_color
            glass.mirror_scan.is_mirror = True
            glass.mirror_scan.frame_width = mirror.frame_width / unit
            glass.mirror_scan.frame_depth = mirror.frame_depth / unit
            glass[RIG_TAG] = "mirror"
            objects.append(glass)
        for item in objects:
            collection.objects.link(item)
        root_of(scene).children.link(collection)
        settings = scene.mirror_scan
        if scene.camera is None or scene.camera == settings.rig_camera:
            scene.camera = camera
        settings.rig_camera, settings.rig_sensor = camera, rig.sensor
        camera[RIG_TAG] = "camera"
        for glass in objects[1:]:
            add_frame(glass, collection)
    return objects


def fit_lens(camera: bpy.types.Object, intrinsics: Intrinsics) -> None:
    """Give a camera the field of view of a sensor."""
    camera.data.sensor_width = 36.0
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.lens = 36.0 * intrinsics.fx / intrinsics.width


def add_frame(glass: bpy.types.Object, collection: bpy.types.Collection) -> bpy.types.Object:
    """What is shown round the glass of a mirror: its moulding and its back, which move with it."""
    mesh = bpy.data.meshes.new("Frame")
    frame = bpy.data.objects.new("Frame", mesh)
    frame[RIG_TAG] = "frame"
    frame.parent = glass
    frame.hide_select = True
    frame.color = FRAME_COLOR
    material = bpy.data.materials.get(FRAME_MATERIAL)
    if material is None or material.library is not None:
        material = bpy.data.materials.new(FRAME_MATERIAL)
        material.diffuse_color = FRAME_COLOR
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED":
                node.inputs["Base Color"].default_value = FRAME_COLOR
    mesh.materials.append(material)
    collection.objects.link(frame)
    refresh_frame(glass)
    return frame


def refresh_frame(glass: bpy.types.Object) -> None:
    """Fit the frame that is shown to the glass and its settings; nothing where none is shown."""
    frame = next((child for child in glass.children if child.get(RIG_TAG) == "frame"), None)
    if frame is None or frame.data.library is not None:
        return
    corners = np.array(glass.bound_box)
    (x0, y0, _), (x1, y1, z) = corners.min(axis=0), corners.max(axis=0)
    wide, proud = glass.mirror_scan.frame_width, glass.mirror_scan.frame_depth
    gap = BACKING / metres_per_unit_of(glass)
    inner = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    outer = [(x0 - wide, y0 - wide), (x1 + wide, y0 - wide), (x1 + wide, y1 + wide), (x0 - wide, y1 + wide)]
    front = max(proud, 0.1 * gap)
    places = [(*p, z + front) for p in inner] + [(*p, z + front) for p in outer] + [(*p, z - gap) for p in outer]
    faces = [(11, 10, 9, 8)]
    for k in range(4):
        after = (k + 1) % 4
        if wide > 0:
            faces.append((k, 4 + k, 4 + after, after))
        faces.append((4 + k, 8 + k, 8 + after, 4 + after))
    frame.data.clear_geometry()
    frame.data.from_pydata(places, [], faces)
    frame.data.update()


def metres_per_unit_of(item: bpy.types.Object) -> float:
    """Metres in a Blender unit of the first scene that an object is in."""
    scenes = item.users_scene
    return metres_per_unit(scenes[0]) if scenes else 1.0


def remove_orphans(scene: bpy.types.Scene) -> None:
    """Remove frames whose mirror was deleted."""
    gone = [item for item in scene.objects if item.get(RIG_TAG) == "frame" and item.parent is None]
    if gone:
        bpy.data.batch_remove([*gone, *(item.data for item in gone if item.data.users == 1)])


def remove_rig(scene: bpy.types.Scene) -> None:
    """Remove camera, mirrors, frames, mannequin and room that earlier rigs brought, and nothing else."""
    ours = {item for item in scene.objects if item.get(RIG_TAG) and item.library is None}
    collections = {
        c for c in scene.collection.children_recursive if c.name.startswith(COLLECTION) and c.library is None
    }
    for item in (item for c in collections for item in c.objects):  # of 0.7.0, which marked only its mirrors
        camera = item.type == "CAMERA" and item.name.startswith("Depth Camera")
        if item.library is None and (camera or item.mirror_scan.is_mirror):
            ours.add(item)
    data = {item.data for item in ours if item.data is not None and item.data.users == 1}
    empty = [c for c in collections if set(c.objects) <= ours and not c.children and c.name.startswith(COLLECTION)]
    bpy.data.batch_remove([*ours, *data, *empty])


def rig_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection of the rig that is planned: its camera's, else the scan's."""
    camera = scene.mirror_scan.rig_camera
    found = [c for c in camera.users_collection if c.name.startswith(COLLECTION)] if camera is not None else []
    return found[0] if found else root_of(scene)


def add_person(scene: bpy.types.Scene, mesh: Mesh) -> bpy.types.Object:
    """The mannequin of a rig, where the rig expects the person; it becomes what the rig looks at."""
    from .avatar_objects import create_avatar

    person = create_avatar(
        mesh, name="Mannequin", collection=rig_collection(scene), unit=metres_per_unit(scene)
    )  # fmt: skip
    person[RIG_TAG] = "person"
    scene.mirror_scan.rig_person = person
    return person


def add_room(
    scene: bpy.types.Scene, room: tuple[float, float, float, float, float], place: tuple[float, float] = (0.0, 0.0)
) -> bpy.types.Object:
    """The walls of a room [m] as lines that cannot be selected, around ``place`` as in :func:`add_objects`."""
    unit = metres_per_unit(scene)
    aside = (unit * place[0], unit * place[0], unit * place[1], unit * place[1], 0.0)
    room = tuple(value + by for value, by in zip(room, aside, strict=True))
    x0, x1, y0, y1, z1 = (value / unit for value in room)
    mesh = bpy.data.meshes.new("Room")
    places = [(x, y, z) for z in (0.0, z1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    edges = [(k, (k + 1) % 4) for k in range(4)]
    edges += [(4 + a, 4 + b) for a, b in edges] + [(k, 4 + k) for k in range(4)]
    mesh.from_pydata(places, edges, [])
    item = bpy.data.objects.new("Room", mesh)
    item[RIG_TAG] = "room"
    item.hide_select = item.hide_render = True
    item.display_type = "WIRE"
    rig_collection(scene).objects.link(item)
    scene.mirror_scan.rig_room = room
    return item


def rig_camera(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The camera that a rig looks with: the planned rig's, else the scene's."""
    return planned_camera(scene) or scene.camera


def person_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """What a rig looks at: the active object if it has a person's size, else the rig's mannequin or person, or None."""
    active = subject_of(context)
    if active is not None and person_sized(active, context.scene):
        return active
    return rig_person(context.scene)


def person_sized(body: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether an object has about the size of a person: upright, and less deep than high; a factory cube has not.

    Its height is along whichever of its own axes is the most upright: what was imported often lies in them. An object
    at no finite place counts as one, so that whatever is wrong with it is reported.
    """
    size, axes = metres_per_unit(scene) * np.array(body.dimensions), np.array(body.matrix_world)[:3, :3]
    if not (np.isfinite(size).all() and np.isfinite(axes).all()):
        return True
    upright = int(np.argmax(np.abs(axes[2]) / np.maximum(np.linalg.norm(axes, axis=0), 1e-9)))
    height = size[upright]
    across, along = sorted(np.delete(size, upright))
    return bool(LEAST_HEIGHT <= height <= MOST_HEIGHT and across <= 0.7 * height and along <= 1.3 * height)


def standing_place(body: bpy.types.Object) -> tuple[float, float]:
    """Where a body stands, seen from above (x, y) in Blender units: at its origin, as avatars do, else at its middle.

    (0, 0) for an object at no finite place.
    """
    matrix = np.array(body.matrix_world)
    box = np.array(body.bound_box) @ matrix[:2, :3].T + matrix[:2, 3]
    origin = matrix[:2, 3]
    if not np.isfinite(box).all():
        return 0.0, 0.0
    within = (box.min(axis=0) < origin).all() and (origin < box.max(axis=0)).all()
    x, y = origin if within else 0.5 * (box.min(axis=0) + box.max(axis=0))
    return float(x), float(y)


def rig_fields(scene: bpy.types.Scene) -> tuple[dict, list[dict]]:
    """The planned rig as fields of core's ``Rig`` and its mirrors' of ``FramedMirror``.

    Raises
    ------
    MirrorScanError
        When the scene has no camera, or a mirror is not flat.
    """
    camera = rig_camera(scene)
    if camera is None:
        raise MirrorScanError(say("There are mirrors but no camera; add one and make it the active camera"))
    fields = camera_of(camera, metres_per_unit(scene))
    return fields | {"sensor": scene.mirror_scan.rig_sensor, "room": None}, mirrors_of(scene)


def rig_in_room(scene: bpy.types.Scene, place: tuple[float, float]) -> tuple[dict, list[dict]]:
    """:func:`rig_fields` with walls: those of the room that was drawn if the rig is within, else 0.6 m round the rig.

    Unlike there the person, who stands at ``place`` (x, y) in Blender units, is at the origin.

    Raises
    ------
    MirrorScanError
        As :func:`rig_fields`.
    """
    rig, mirrors = rig_fields(scene)
    person = metres_per_unit(scene) * np.array((*place, 0.0))
    rig["camera"] = tuple((rig["camera"] - person).tolist())
    for mirror in mirrors:
        mirror["centre"] = tuple((mirror["centre"] - person).tolist())
    places = np.array([rig["camera"], (0.0, 0.0, 0.0), *(mirror["centre"] for mirror in mirrors)])
    (x0, y0), (x1, y1) = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    drawn = np.array(scene.mirror_scan.rig_room) - np.repeat(person, 2)[:5]
    shown = any(item.get(RIG_TAG) == "room" for item in scene.objects)
    if shown and drawn[0] < x0 and x1 < drawn[1] and drawn[2] < y0 and y1 < drawn[3]:
        room = drawn.tolist()
    else:
        top = float(places[:, 2].max()) + 0.6
        room = [float(x0) - 0.6, float(x1) + 0.6, float(y0) - 0.6, float(y1) + 0.6, max(2.4, top)]
    return rig | {"room": tuple(room)}, mirrors


def _in_units(matrix: Matrix, unit: float) -> Matrix:
    """A pose in metres as one in Blender units: the place changes, the axes keep their length."""
    matrix.translation /= unit
    return matrix


def mirrors_of(scene: bpy.types.Scene) -> list[dict]:
    """Fields of ``FramedMirror`` for each visible object of the scene that is marked as a mirror.

    Raises
    ------
    MirrorScanError
        When one is not flat, or has no size.
    """
    mirrors, unit = [], metres_per_unit(scene)
    for item in scene.objects:
        if not item.mirror_scan.is_mirror or item.hide_render:
            continue
        corners = np.array(item.bound_box)
        low, high = corners.min(axis=0), corners.max(axis=0)
        matrix = np.array(item.matrix_world)
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        width, height, thick = (high - low) * scale * unit
        if min(width, height) <= 1e-4 or thick > 0.2 * min(width, height):
            text = say(
                "{name}: is marked as a mirror, but is not flat along its local Z axis; flatten it, or turn off Is a "
                "Mirror"
            )
            raise MirrorScanError(text.format(name=item.name))
        top = (*(low[:2] + high[:2]) / 2, high[2])
        settings = item.mirror_scan
        mirrors.append(
            {
                "name": _mirror_name(item.name),
                "centre": tuple(unit * float(value) for value in (matrix @ (*top, 1.0))[:3]),
                "normal": tuple(float(value) for value in np.cross(matrix[:3, 0], matrix[:3, 1])),
                "up": tuple(float(value) for value in matrix[:3, 1]),
                "width": float(width),
                "height": float(height),
                "frame_width": unit * settings.frame_width,
                "frame_depth": unit * settings.frame_depth,
            }
        )
    return mirrors


def mirror_title(item: bpy.types.Object) -> str:
    """What a mirror is called in texts."""
    return _mirror_name(item.name)


def _mirror_name(title: str) -> str:
    """The mirror that an object called ``title`` is: “left” of “Mirror left”, but “mirror 1” of “Mirror 1”."""
    name = title.removeprefix("Mirror ")
    return f"mirror {name}" if name != title and name.isdigit() else name[:63] or title


def camera_of(camera: bpy.types.Object, unit: float = 1.0) -> dict:
    """Place and angles of ``Rig`` for a camera object.

    Raises
    ------
    MirrorScanError
        When the object looks nowhere, since it is scaled to nothing or at no finite place.
    """
    pose = np.array(camera.matrix_world) @ _FLIP
    size = np.linalg.norm(pose[:3, :3], axis=0)
    if not (np.isfinite(pose).all() and size.min() > 1e-9):
        text = say("{name}: its scale is zero or its position invalid; set the scale to 1 and move it into the scene")
        raise MirrorScanError(text.format(name=camera.name))
    turn = pose[:3, :3] / size
    ahead = turn[:, 2]
    tilt = -math.asin(max(-1.0, min(1.0, ahead[2])))
    pan = math.atan2(ahead[0], ahead[1])
    # what is left of the turn when pan and tilt are taken out is roll about the camera's own axis
    right = np.array((math.cos(pan), -math.sin(pan), 0.0))
    down = np.cross(ahead, right)
    roll = math.atan2(turn[:, 0] @ down, turn[:, 0] @ right)
    return {
        "camera": tuple(unit * float(value) for value in pose[:3, 3]),
        "pan_deg": math.degrees(pan),
        "tilt_deg": math.degrees(tilt),
        "roll_deg": math.degrees(roll),
    }


def subject_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object if it is a body to scan: a mesh with faces that is no mirror."""
    active = context.object
    if active is None or active.type != "MESH" or not active.data.polygons or active.mirror_scan.is_mirror:
        return None
    return active


def world_surface(context: bpy.types.Context, body: bpy.types.Object) -> Mesh:
    """The body as it is seen, modifiers and pose included, in the world's frame [m].

    Raises
    ------
    MirrorScanError
        When modifiers leave no faces.
    """
    from .avatar_objects import active_colors, check_finite

    evaluated = body.evaluated_get(context.evaluated_depsgraph_get())
    data = evaluated.to_mesh()
    try:
        data.calc_loop_triangles()
        vertices = np.empty((len(data.vertices), 3), np.float32)
        data.vertices.foreach_get("co", vertices.ravel())
        triangles = np.empty((len(data.loop_triangles), 3), np.int32)
        data.loop_triangles.foreach_get("vertices", triangles.ravel())
        colors = active_colors(data, but=COVERAGE)
    finally:
        evaluated.to_mesh_clear()
    if not len(triangles):
        raise MirrorScanError(say("{name} has no faces").format(name=body.name))
    matrix = np.array(body.matrix_world)
    check_finite(body, vertices @ matrix[:3, :3].T + matrix[:3, 3])
    if np.linalg.det(matrix[:3, :3]) < 0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    vertices = metres_per_unit(context.scene) * (vertices @ matrix[:3, :3].T + matrix[:3, 3])
    return Mesh(vertices, triangles, colors)


def surface_at_origin(context: bpy.types.Context, body: bpy.types.Object) -> Mesh:
    """:func:`world_surface` of a body that is moved along the floor so that it stands at the world's origin.

    Raises
    ------
    MirrorScanError
        As :func:`world_surface`.
    """
    surface = world_surface(context, body)
    x, y = standing_place(body)
    return dataclasses.replace(
        surface, vertices=surface.vertices - metres_per_unit(context.scene) * np.array((x, y, 0))
    )
