"""Measurements drawn on the body: one curve a measure, where the tape runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix

from .scan_records import TAPES

if TYPE_CHECKING:
    from ...core.measurements import Measurements

_COLOR = (1.0, 0.42, 0.02, 1.0)
_THICKNESS = 0.0025  # half of a tape's [m]


def draw_tapes(
    avatar: bpy.types.Object, measurements: Measurements, collection: bpy.types.Collection, unit: float
) -> bpy.types.Collection:
    """Curves of all measures in a collection of their own, in ``collection``; those of an earlier time go.

    Parameters
    ----------
    avatar : bpy.types.Object
        The curves hang on it; they stay where they are while its skeleton moves it.
    measurements : Measurements
        Along the axes of the avatar's mesh [m].
    collection : bpy.types.Collection
    unit : float
        Metres in a unit of the avatar's mesh.
    """
    remove_tapes(avatar)
    own = bpy.data.collections.new(f"{avatar.name} Measurements")
    own[TAPES] = avatar
    collection.children.link(own)
    material = bpy.data.materials.get("Tape") or bpy.data.materials.new("Tape")
    material.diffuse_color = _COLOR
    for name, measured in measurements.items():
        curve = bpy.data.curves.new(name, "CURVE")
        curve.dimensions = "3D"
        curve.bevel_depth = _THICKNESS / unit
        curve.materials.append(material)
        for loop in measured.loops:
            spline = curve.splines.new("POLY")
            spline.points.add(len(loop) - 1)
            points = np.column_stack((loop / unit, np.ones(len(loop))))
            spline.points.foreach_set("co", points.astype(np.float32).ravel())
            spline.use_cyclic_u = measured.closed
        item = bpy.data.objects.new(name, curve)
        item.parent, item.matrix_parent_inverse = avatar, Matrix()
        item.color, item.hide_render = _COLOR, True
        own.objects.link(item)
    return own


def tapes_of(avatar: bpy.types.Object) -> bpy.types.Collection | None:
    """The collection with an avatar's curves; None when there is none."""
    return next((found for found in bpy.data.collections if found.get(TAPES) == avatar), None)


def remove_tapes(avatar: bpy.types.Object) -> None:
    """Take an avatar's curves out of the file."""
    own = tapes_of(avatar)
    if own is not None:
        curves = [item.data for item in own.objects if item.type == "CURVE"]
        bpy.data.batch_remove([*own.objects, *curves, own])
