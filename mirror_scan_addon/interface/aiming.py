"""Find the point of the capture under the mouse, in the viewport."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    import numpy as np


SNAP_PX = 14.0
"""How far from the mouse a point of the cloud is searched for [px at 100 % scale]."""

DEPTH_TOLERANCE = 0.12
"""How far behind the frontmost point under the mouse a point may lie and still be found [m]."""

NAVIGATION = ("MIDDLEMOUSE", "WHEEL", "NUMPAD_", "TRACKPAD", "NDOF", "MOUSEROTATE", "MOUSESMARTZOOM", "HOME", "TIMER",
              "WINDOW", "MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "EVT_", "ACCENT_GRAVE")  # fmt: skip
"""Prefixes of the event types that are passed on to Blender while picking."""


class Aim:
    """Finds points (N, 3) of the scene's cloud, in the camera's frame, under the mouse."""

    def __init__(self, points: np.ndarray) -> None:
        self._points = points
        self._picture = None  # the last view, and the points projected into it

    def nearest(self, context: bpy.types.Context, event: bpy.types.Event, region: bpy.types.Region) -> int | None:
        """Index of the point under the mouse; None if there is none."""
        from ...core.preview.point_picking import Picture
        from ..scene import point_cloud

        space = region.data
        view = space.view_matrix @ point_cloud.cloud_of(context.scene).matrix_world
        seen_as = (view.freeze(), space.window_matrix.copy().freeze(), region.width, region.height)
        if self._picture is None or self._picture[0] != seen_as:  # kept as long as the view does not move
            size = region.width, region.height
            self._picture = seen_as, Picture(self._points, view, space.window_matrix, size)
        scale = context.preferences.system.ui_scale
        at = event.mouse_x - region.x, event.mouse_y - region.y
        return self._picture[1].pick(at, SNAP_PX * scale, DEPTH_TOLERANCE * view.median_scale)


def region_under(context, event, area_pointer: int):
    """The window region of the viewport in which picking began, if the mouse is over it and not over anything in front
    of it: sidebars, headers, the navigation gizmo. Else None.

    Where that viewport is gone, since another workspace is shown or a viewport fills the window, any other will do."""
    areas, x, y = context.window.screen.areas, event.mouse_x, event.mouse_y
    area = next((area for area in areas if area.as_pointer() == area_pointer), None)
    if area is None:
        area = next((area for area in areas if area.type == "VIEW_3D" and _inside(area, x, y)), None)
    if area is None or area.type != "VIEW_3D":
        return None
    window = None
    right = 0
    for region in area.regions:
        if region.type == "WINDOW":
            if _inside(region, x, y) and (window is None or len(area.spaces.active.region_quadviews)):
                window = region
        elif region.width > 1 and region.height > 1:
            if region.type != "HUD" and _inside(region, x, y):
                return None
            if region.type == "UI" and region.alignment == "RIGHT":
                right = region.width
    if window is None or _on_gizmo(context, area, window, x, y, right):
        return None
    return window


def _inside(region, x: int, y: int) -> bool:
    return region.x <= x < region.x + region.width and region.y <= y < region.y + region.height


def _on_gizmo(context, area, window, x: int, y: int, covered: int) -> bool:
    """Whether the mouse is on the axes and buttons at the upper right of the viewport."""
    space = area.spaces.active
    if not (space.show_gizmo and space.show_gizmo_navigate):
        return False
    scale = context.preferences.system.ui_scale
    ball = (context.preferences.view.gizmo_size_navigate_v3d + 20) * scale
    right = window.x + window.width - covered
    top = window.y + window.height
    for region in area.regions:  # headers cover the viewport where regions overlap
        if region.type in ("HEADER", "TOOL_HEADER") and region.alignment == "TOP" and region.y < top:
            if region.height > 1 and _inside(window, region.x + region.width // 2, region.y):
                top = min(top, region.y)
    if not right - ball <= x <= right:
        return False
    # below the ball there is a column of small buttons, at its right
    return y >= top - ball or (x >= right - 48 * scale and y >= top - ball - 150 * scale)
