"""A studio about an object: three lights, a camera and a backdrop, in one collection that can be removed again."""

from __future__ import annotations

import json
import math

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .avatar_objects import discard_on_error
from .scan_records import STUDIO, studio_of

CAMERA_BEFORE = "mirror_scan_camera_before"
VIEW_ANGLE = math.radians(25)  # the camera stands that far to the side of the person's front
LENS = 65.0  # [mm]
PORTRAIT = (1080, 1920)  # [px]
_AIR = 1.08  # round the object in the picture
_GREY = (0.42, 0.43, 0.45, 1.0)  # of the backdrop, linear

# Azimuth from the camera and height above the horizon [deg], distance and size [heights of the object], brightness.
_LIGHTS = {
    "Studio Key": (-48.0, 38.0, 1.5, 0.9, 24.0),
    "Studio Fill": (55.0, 15.0, 1.7, 1.2, 9.0),
    "Studio Rim": (155.0, 45.0, 1.5, 0.6, 20.0),
}
"""Brightness: watts of a light for an object one unit tall; light falls with the square of its distance."""


def add_studio(target: bpy.types.Scene, subject: bpy.types.Object) -> bpy.types.Collection:
    """A studio about ``subject`` in the scene ``target``; one that is there already goes.

    The camera becomes the scene's. Resolution and view transform are the studio's until it is removed.

    Parameters
    ----------
    target : bpy.types.Scene
    subject : bpy.types.Object
        A mesh of the scene; its front is its own −Y.
    """
    remove_studio(target)
    low, high = _bounds(target, subject)
    center, size = Vector((low + high) / 2), float(np.linalg.norm(high - low))
    height = max(float(high[2] - low[2]), 0.3 * size, 1e-6)
    to_front = Matrix.Rotation(_yaw(subject) + VIEW_ANGLE, 3, "Z")
    with discard_on_error() as made:
        collection = bpy.data.collections.new("Studio")
        made.append(collection)
        collection[STUDIO] = json.dumps(_settings(target))
        if target.camera is not None:
            collection[CAMERA_BEFORE] = target.camera
        for name, (azimuth, elevation, distance, extent, watts) in _LIGHTS.items():
            toward = to_front @ _direction(azimuth, elevation)
            light = bpy.data.lights.new(name, "AREA")
            made.append(light)
            light.shape, light.size, light.energy = "DISK", extent * height, watts * (distance * height) ** 2
            placed = _placed(name, light, center + toward * distance * height, center, collection)
            made.append(placed)
        made.append(_backdrop(Vector((center.x, center.y, low[2])), height, to_front, collection))
        camera = bpy.data.cameras.new("Studio Camera")
        made.append(camera)
        camera.lens = LENS
        _use_settings(target, {"resolution": list(PORTRAIT), "view_transform": "Standard", "look": "None"})
        half = _half_angles(camera)
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        distance = _distance(corners - np.array(center), np.array(to_front), half)
        camera.clip_start, camera.clip_end = 1e-3 * distance, max(camera.clip_end, 20.0 * distance)
        place = center + to_front @ Vector((0.0, -distance, 0.0))
        made.append(_placed("Studio Camera", camera, place, center, collection))
        target.camera = made[-1]
        target.collection.children.link(collection)
    return collection


def remove_studio(target: bpy.types.Scene) -> bool:
    """Take the studio out of a scene, which gets its own camera and settings back; whether there was one."""
    collection = studio_of(target)
    if collection is None:
        return False
    mine = set(collection.objects)
    before = collection.get(CAMERA_BEFORE)
    if target.camera in mine:
        target.camera = before if before is not None and before.name in target.objects else None
    _use_settings(target, json.loads(collection[STUDIO]))
    data = {item.data for item in mine if item.data is not None and item.data.users == 1}
    materials = {slot.material for item in mine for slot in item.material_slots if slot.material is not None}
    bpy.data.batch_remove([*mine, *data, collection])
    bpy.data.batch_remove([material for material in materials if not material.users])
    return True


def _settings(target: bpy.types.Scene) -> dict:
    """What a studio changes of a scene."""
    render, view = target.render, target.view_settings
    return {
        "resolution": [render.resolution_x, render.resolution_y],
        "view_transform": view.view_transform,
        "look": view.look,
    }


def _use_settings(target: bpy.types.Scene, settings: dict) -> None:
    target.render.resolution_x, target.render.resolution_y = settings["resolution"]
    for name in ("view_transform", "look"):
        # the colour configuration, and with it the names, can be another one by now
        known = target.view_settings.bl_rna.properties[name].enum_items
        if settings[name] in known or not len(known):
            setattr(target.view_settings, name, settings[name])


def _bounds(target: bpy.types.Scene, subject: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (3,) of the object in the world, as it is posed now."""
    layer = next((layer for layer in target.view_layers if subject.name in layer.objects), None)
    shown = subject
    if layer is not None:
        layer.update()
        shown = subject.evaluated_get(layer.depsgraph)
    corners = np.array([shown.matrix_world @ Vector(corner) for corner in shown.bound_box])
    return corners.min(axis=0), corners.max(axis=0)


def _yaw(subject: bpy.types.Object) -> float:
    """How far the object's front is turned about the vertical from the world's −Y [rad]."""
    front = subject.matrix_world.to_3x3() @ Vector((0.0, -1.0, 0.0))
    return 0.0 if math.hypot(front.x, front.y) < 1e-9 else math.atan2(front.x, -front.y)


def _direction(azimuth: float, elevation: float) -> Vector:
    """Unit vector from the object's front, by degrees to the viewer's right and upwards."""
    across, up = math.radians(azimuth), math.radians(elevation)
    return Vector((math.sin(across) * math.cos(up), -math.cos(across) * math.cos(up), math.sin(up)))


def _placed(
    name: str, data: bpy.types.ID, place: Vector, center: Vector, collection: bpy.types.Collection
) -> bpy.types.Object:
    """An object at ``place`` that looks at ``center``."""
    item = bpy.data.objects.new(name, data)
    item.matrix_world = Matrix.Translation(place) @ (center - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    collection.objects.link(item)
    return item


def _half_angles(camera: bpy.types.Camera) -> tuple[float, float]:
    """Half the camera's angles across and up [rad]; the sensor is fitted to the longer side of the picture."""
    wide, tall = PORTRAIT
    longer = math.tan(camera.angle / 2)
    return math.atan(longer * wide / max(wide, tall)), math.atan(longer * tall / max(wide, tall))


def _distance(corners: np.ndarray, axes: np.ndarray, half: tuple[float, float]) -> float:
    """How far a level camera stands from the origin to see all ``corners`` (8, 3); it looks along its own +Y."""
    across, along, up = (corners @ axes).T
    needed = np.maximum(np.abs(across) / math.tan(half[0]), np.abs(up) / math.tan(half[1]))
    return float((_AIR * needed - along).max())


def _backdrop(foot: Vector, height: float, to_front: Matrix, collection: bpy.types.Collection) -> bpy.types.Object:
    """A floor that bends up into a wall behind the object."""
    radius, front, back, wall, wide = 0.8, 3.5, 1.6, 3.0, 5.0  # [heights of the object]
    bend = np.linspace(0.0, math.pi / 2, 13)
    along = [-front, *(back + radius * np.sin(bend)), back + radius]
    up = [0.0, *(radius * (1.0 - np.cos(bend))), wall]
    profile = height * np.column_stack((along, up))
    left, right = (np.insert(profile, 0, side * wide * height, axis=1) for side in (-1.0, 1.0))
    count = len(profile)
    rows = np.arange(count - 1)
    data = bpy.data.meshes.new("Studio Backdrop")
    faces = np.column_stack((rows, rows + count, rows + count + 1, rows + 1))
    data.from_pydata(np.concatenate((left, right)).tolist(), [], faces.tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    material = bpy.data.materials.new("Studio Backdrop")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = _GREY
    shader.inputs["Roughness"].default_value = 1.0
    material.diffuse_color = _GREY
    data.materials.append(material)
    item = bpy.data.objects.new("Studio Backdrop", data)
    item.matrix_world = Matrix.Translation(foot - Vector((0.0, 0.0, 1e-3 * height))) @ to_front.to_4x4()
    item.hide_select = True
    collection.objects.link(item)
    return item
