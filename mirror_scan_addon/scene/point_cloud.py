"""The capture in the .blend: an object of loose points that holds its whole depth map, and two pictures.

A vertex is a pixel with a reading, where the camera saw it (camera frame; the object's matrix stands it upright). Its
integer attribute ``pixel`` says which one, so that the depth map comes back exactly: z is the vertex's own, and the
camera is kept with the object. What is found out about a point is an attribute too.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict

import bpy
import numpy as np
from mathutils import Matrix

from ...core.camera import Intrinsics, unproject
from ...core.errors import CaptureError
from ..language.texts import say
from ..tasks import Cloud
from .avatar_objects import COLOR, discard_on_error

INFO = "mirror_scan_capture"  # custom property of the object: what is known of the capture, as JSON text
STAMP = "mirror_scan_stamp"  # custom property of its mesh: new with each change, so that what is drawn can be kept
PLACED = "mirror_scan_placed"  # custom property of the object: where we put it, to see whether somebody moved it
PICTURE = 320  # least width of a picture kept beside the points [px]
PIXEL = "pixel"
SEEN, VIEW, HEIGHT = "seen", "view", "height"  # attributes; as in core.views.Views, and above the floor [m]


def is_cloud(target: bpy.types.Object | None) -> bool:
    return target is not None and target.type == "MESH" and isinstance(target.get(INFO), str)


def cloud_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The scene's cloud, if it is there and still one."""
    target = scene.mirror_scan.cloud
    return target if is_cloud(target) and target.name in scene.objects else None


def create_cloud(
    name: str,
    depth: np.ndarray,
    color: np.ndarray | None,
    intrinsics: Intrinsics,
    info: dict,
    placement: np.ndarray,
    collection: bpy.types.Collection | None,
    unit: float = 1.0,
) -> bpy.types.Object:
    """An object with a vertex for each reading of ``depth`` (H, W) [m], where ``placement`` puts it, see :func:`place`;
    in ``collection``, or in none yet.

    Raises
    ------
    CaptureError
        When there is no reading at all. Nothing is left in the file then.
    """
    pixel = np.flatnonzero(depth.ravel() > 0).astype(np.int32)
    if not len(pixel):
        raise CaptureError(
            say("{name}: no pixel has a depth reading; load another capture").format(name=name), code="not_loaded"
        )
    points = unproject(depth, intrinsics).reshape(-1, 3)[pixel].astype(np.float32)
    points[:, 2] = depth.ravel()[pixel]
    with discard_on_error() as made:
        mesh = bpy.data.meshes.new(name)
        made.append(mesh)
        mesh.vertices.add(len(pixel))
        mesh.attributes["position"].data.foreach_set("vector", points.ravel())
        mesh.attributes.new(PIXEL, "INT", "POINT").data.foreach_set("value", pixel)
        if color is not None:
            rgba = np.ones((len(pixel), 4), np.float32)
            rgba[:, :3] = color.reshape(-1, 3)[pixel] / np.float32(255)
            attribute = mesh.color_attributes.new(COLOR, "BYTE_COLOR", "POINT")
            attribute.data.foreach_set("color_srgb", rgba.ravel())
        touch(mesh)
        cloud = bpy.data.objects.new(name, mesh)
        made.append(cloud)
        cloud[INFO] = json.dumps(info | {"intrinsics": asdict(intrinsics)}, ensure_ascii=False)
        cloud.display_type = "BOUNDS"  # its points are drawn by the overlay, in colour
        cloud.hide_render = True
        place(cloud, placement, unit)
        if collection is not None:
            collection.objects.link(cloud)
    return cloud


def read_cloud(cloud: bpy.types.Object, color: bool = True) -> Cloud:
    """The arrays of a cloud object; without colours, which take longer than all the rest, for who needs none.

    Raises
    ------
    CaptureError
        When somebody's edits left nothing that can be read as a depth map.
    """
    info = cloud_info(cloud)
    mesh = cloud.data
    count = len(mesh.vertices)
    pixel = values(mesh, PIXEL, np.int32)
    try:
        intrinsics = Intrinsics(**info.pop("intrinsics"))
    except (KeyError, TypeError) as error:
        text = say("{name}: the data of its camera is lost; load the capture again")
        raise CaptureError(text.format(name=cloud.name), code="not_loaded") from error
    size = intrinsics.width * intrinsics.height
    if pixel is None or not count or pixel.min() < 0 or pixel.max() >= size:
        text = say("{name}: its points no longer form a depth map; load the capture again")
        raise CaptureError(text.format(name=cloud.name), code="not_loaded")
    points = np.empty((count, 3), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", points.ravel())
    sound = np.isfinite(points).all(axis=1) & (points[:, 2] > 0)
    if not sound.any():
        text = say("{name}: none of its points is in front of the camera any more; load the capture again")
        raise CaptureError(text.format(name=cloud.name), code="not_loaded")
    image = None
    colors = colors_of(mesh) if color else None
    if colors is not None:
        flat = np.zeros((size, 3), np.uint8)
        flat[pixel] = colors
        image = flat.reshape(intrinsics.height, intrinsics.width, 3)
    if not sound.all():  # somebody moved a few to where no camera sees
        points, pixel = points[sound], pixel[sound]
    return Cloud(points, pixel, image, intrinsics, info)


def cloud_info(cloud: bpy.types.Object) -> dict:
    """What is known of the capture: name, format, path, frames, lines, intrinsics.

    Raises
    ------
    CaptureError
        When the text was edited into nonsense.
    """
    try:
        info = json.loads(cloud[INFO])
        if isinstance(info, dict):
            return info
    except ValueError:
        pass
    text = say("{name}: the data of its capture is damaged; load the capture again")
    raise CaptureError(text.format(name=cloud.name), code="not_loaded")


def values(mesh: bpy.types.Mesh, name: str, dtype: type) -> np.ndarray | None:
    """A point attribute of single numbers (N,), or None when it is not there, or of another kind."""
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.domain != "POINT" or len(attribute.data) != len(mesh.vertices):
        return None
    if attribute.data_type not in (("FLOAT",) if np.issubdtype(dtype, np.floating) else ("INT8", "INT")):
        return None
    found = np.empty(len(attribute.data), dtype)
    attribute.data.foreach_get("value", found)
    return found


def colors_of(mesh: bpy.types.Mesh) -> np.ndarray | None:
    """The capture's colours of the points, sRGB (N, 3) uint8, or None when there are none."""
    attribute = mesh.attributes.get(COLOR)
    if attribute is None or attribute.domain != "POINT" or len(attribute.data) != len(mesh.vertices):
        return None
    if attribute.data_type not in ("BYTE_COLOR", "FLOAT_COLOR"):
        return None
    rgba = np.empty((len(attribute.data), 4), np.float32)
    attribute.data.foreach_get("color_srgb", rgba.ravel())
    return np.rint(np.clip(rgba[:, :3], 0, 1) * 255).astype(np.uint8)


def set_values(mesh: bpy.types.Mesh, **maps: np.ndarray) -> None:
    """Write images (H, W) of small integers (int8) or numbers (float32) as point attributes."""
    pixel = values(mesh, PIXEL, np.int32)
    for name, image in maps.items():
        kind = "INT8" if image.dtype == np.int8 else "FLOAT"
        attribute = mesh.attributes.get(name)
        if attribute is not None and (attribute.data_type, attribute.domain) != (kind, "POINT"):
            mesh.attributes.remove(attribute)
            attribute = None
        if attribute is None:
            attribute = mesh.attributes.new(name, kind, "POINT")
        attribute.data.foreach_set("value", np.ascontiguousarray(image.ravel()[pixel]))
    touch(mesh)


def forget_values(mesh: bpy.types.Mesh, *names: str) -> None:
    """Remove attributes that are not true any more."""
    for name in names:
        attribute = mesh.attributes.get(name)
        if attribute is not None:
            mesh.attributes.remove(attribute)
    touch(mesh)


def set_nobody(mesh: bpy.types.Mesh) -> None:
    """Have no point be the person's, where that was told."""
    attribute = mesh.attributes.get(VIEW)
    if attribute is not None and values(mesh, VIEW, np.int8) is not None:
        attribute.data.foreach_set("value", np.full(len(attribute.data), -1, np.int8))
        touch(mesh)


def stamp_of(cloud: bpy.types.Object) -> tuple:
    """What is another after every change of the cloud's data."""
    return cloud.data.session_uid, cloud.data.get(STAMP), len(cloud.data.vertices)


def touch(mesh: bpy.types.Mesh) -> None:
    """Give the mesh a new stamp, unlike any before: undo brings the old one back with the old data."""
    mesh[STAMP] = f"{time.time_ns():x}"
    mesh.update_tag()


def place(cloud: bpy.types.Object, matrix: np.ndarray, unit: float = 1.0) -> None:
    """Put the cloud where ``matrix`` (4, 4), camera frame → world [m], says; unless somebody moved it by hand.

    Its points stay in metres; the object's scale turns them into Blender units of ``unit`` metres.
    """
    where = Matrix.Scale(1.0 / unit, 4) @ Matrix([list(map(float, row)) for row in matrix])
    before = cloud.get(PLACED)
    if before is not None and not np.allclose(np.array(cloud.matrix_world).ravel(), list(before), atol=1e-5 / unit):
        return
    cloud.matrix_world = where
    cloud[PLACED] = [value for row in where for value in row]


def camera_to_world(cloud: bpy.types.Object) -> np.ndarray:
    """(4, 4), from metres before the camera to Blender units in the world."""
    return np.array(cloud.matrix_world)


def create_picture(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """An image data-block of ``pixels`` (H, W, 3) uint8 sRGB, packed into the .blend; a large one is thinned to
    ``PICTURE`` pixels: it is for looking at."""
    pixels = pixels[:: max(1, pixels.shape[1] // PICTURE), :: max(1, pixels.shape[1] // PICTURE)]
    height, width = pixels.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    np.divide(pixels[::-1], 255, out=rgba[..., :3], casting="unsafe")
    with discard_on_error() as made:
        image = bpy.data.images.new(name, width, height)
        made.append(image)
        image.pixels.foreach_set(rgba.ravel())
        image.pack()
    return image
