"""A virtual rig as objects of the scene: a camera, and flat objects that are marked as mirrors.

Objects are in Blender units of ``unit`` metres (:func:`.units.metres_per_unit`); what core gets and gives is in metres.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix

from ...core.errors import MirrorScanError
from ...core.mesh import Mesh
from ..language.texts import say
from .avatar_objects import discard_on_error
from .report_text import mirror_label
from .scan_collections import root_of
from .units import metres_per_unit

if TYPE_CHECKING:
    from ...core.simulation.scene import Rig


COLLECTION = "Mirror Scan Rig"
MATERIAL = "Mirror Scan Glass"
COVERAGE = "Coverage"  # colour attribute of a body: what sees it
_FLIP = np.diag((1.0, -1.0, -1.0, 1.0))  # Blender's camera looks along -z with y up, core's along z with y down


def add_objects(scene: bpy.types.Scene, rig: Rig) -> list[bpy.types.Object]:
    """Camera and mirrors of a rig, in a collection of their own; the camera becomes the scene's."""
    intrinsics, unit = rig.intrinsics, metres_per_unit(scene)
    with discard_on_error() as made:
        collection = bpy.data.collections.new(COLLECTION)
        made.append(collection)
        camera = bpy.data.objects.new("Depth Camera", bpy.data.cameras.new("Depth Camera"))
        made += [camera.data, camera]
        camera.data.sensor_width = 36.0
        camera.data.sensor_fit = "HORIZONTAL"
        camera.data.lens = 36.0 * intrinsics.fx / intrinsics.width
        camera.data.display_size = 0.3 / unit
        camera.data.clip_start, camera.data.clip_end = 0.1 / unit, 100.0 / unit
        camera.matrix_world = _in_units(Matrix((rig.camera_to_avatar @ _FLIP).tolist()), unit)
        objects = [camera]
        material = bpy.data.materials.get(MATERIAL)
        if rig.mirrors and (material is None or material.library is not None):
            material = bpy.data.materials.new(MATERIAL)
            made.append(material)
            material.metallic, material.roughness = 1.0, 0.02
            material.diffuse_color = (0.6, 0.75, 0.85, 1.0)
            if bpy.app.version < (5, 0, 0):
                material.use_nodes = True
            for node in material.node_tree.nodes:
                if node.type == "BSDF_PRINCIPLED":
                    node.inputs["Metallic"].default_value, node.inputs["Roughness"].default_value = 1.0, 0.0
        for mirror in rig.mirrors:
            w, h = mirror.width / 2 / unit, mirror.height / 2 / unit
            mesh = bpy.data.meshes.new(mirror_label(mirror.name))
            made.append(mesh)
            mesh.from_pydata([(-w, -h, 0), (w, -h, 0), (w, h, 0), (-w, h, 0)], [], [(0, 1, 2, 3)])
            mesh.materials.append(material)
            glass = bpy.data.objects.new(mirror_label(mirror.name), mesh)
            made.append(glass)
            axes = mirror.axes
            glass.matrix_world = _in_units(Matrix.Translation(mirror.centre) @ Matrix(axes.T.tolist()).to_4x4(), unit)
            glass.mirror_scan.is_mirror = True
            glass.mirror_scan.frame_width = mirror.frame_width / unit
            glass.mirror_scan.frame_depth = mirror.frame_depth / unit
            objects.append(glass)
        for item in objects:
            collection.objects.link(item)
        root_of(scene).children.link(collection)
        scene.camera = camera
    return objects


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
            text = say("{name}: is marked as a mirror, but is not flat; its glass lies in its local XY plane")
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
