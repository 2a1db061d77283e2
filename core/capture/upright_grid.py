"""A capture as the pipeline expects it: depth and colour on one upright pinhole grid, left and right as in the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, project
from ..camera.image_registration import (
    color_on_depth,
    first_readings,
    straightened,
    undistort_color,
    undistort_depth,
    undistort_labels,
)
from ..camera.pinhole import undistort
from ..errors import CaptureError, Notice
from .capture import Capture, MirrorPicks

_TURNS = {0: 0, 90: 1, 180: 2, 270: 3}


def align(capture: Capture) -> Capture:
    """Straighten depth and bring colour onto its grid.

    Parameters
    ----------
    capture : Capture
        As a reader made it: ``intrinsics`` may have distortion; ``color`` is of any size when ``color_intrinsics`` and
        ``depth_to_color`` are given, else aligned to the depth map as it is stored.

    Returns
    -------
    Capture
        Pinhole ``intrinsics``, ``color`` of the depth map's size, ``color_intrinsics`` and ``depth_to_color`` None;
        picks on mirrors moved along.

    Raises
    ------
    CaptureError
        When the colour image is of another size and its alignment to the depth map is unknown.
    """
    depth, color, camera = capture.depth, capture.color, capture.intrinsics
    notes = capture.notes
    if color is not None and capture.color_intrinsics is None and color.shape[:2] != depth.shape[1:]:
        raise CaptureError(
            f"{capture.name}: colour is {color.shape[1]}×{color.shape[0]} px, depth {camera.width}×{camera.height}; "
            "their alignment is unknown; align them when recording, or leave colour out"
        )
    if not camera.is_pinhole:
        straight = straightened(camera)
        depth = undistort_depth(depth, camera, straight, interpolate=capture.sensor != "kinect_v1")
        confidence = None if capture.confidence is None else undistort_labels(capture.confidence, camera, straight)
        if color is not None and capture.color_intrinsics is None:
            color = undistort_color(color, camera, straight)
        mirrors = tuple(_moved(pick, lambda uv: _straight_pixels(uv, camera, straight)) for pick in capture.mirrors)
        capture = replace(capture, depth=depth, confidence=confidence, intrinsics=straight, mirrors=mirrors)
    if color is not None and capture.color_intrinsics is not None:
        pose = np.eye(4) if capture.depth_to_color is None else capture.depth_to_color
        color, seen = color_on_depth(first_readings(depth), capture.intrinsics, color, capture.color_intrinsics, pose)
        if seen < 0.9:
            note = Notice("the colour camera sees only {seen:.0%} of the readings; the rest stays black", seen=seen)
            notes = (*notes, note)
    return replace(capture, color=color, color_intrinsics=None, depth_to_color=None, notes=notes)


def turned(capture: Capture, degrees: int) -> Capture:
    """``capture`` rotated clockwise by 0, 90, 180 or 270°, as an image is; the camera frame rotates with it.

    A camera mounted on its side, rotated by 90° clockwise (seen from behind), is made upright by 90.

    Raises
    ------
    CaptureError
        For any other angle.
    """
    if degrees not in _TURNS:
        raise CaptureError(f"{capture.name}: a capture can be rotated by 0, 90, 180 or 270 degrees, not {degrees}")
    for _ in range(_TURNS[degrees]):
        height = capture.intrinsics.height
        old = capture.intrinsics
        capture = replace(
            capture,
            depth=_turn(capture.depth),
            color=None if capture.color is None else np.ascontiguousarray(np.rot90(capture.color, -1)),
            confidence=None if capture.confidence is None else _turn(capture.confidence),
            intrinsics=Intrinsics(old.height, old.width, old.fy, old.fx, old.height - 1 - old.cy, old.cx),
            mirrors=tuple(
                _moved(
                    pick,
                    lambda uv, h=height: np.column_stack((h - 1 - uv[:, 1], uv[:, 0])),
                    lambda p: np.array((-p[1], p[0], p[2])),
                )
                for pick in capture.mirrors
            ),
        )
    return capture


def unmirrored(capture: Capture) -> Capture:
    """``capture`` with left and right exchanged: for streams that are mirrored (Kinect v2's SDK)."""
    width, old = capture.intrinsics.width, capture.intrinsics
    return replace(
        capture,
        depth=np.ascontiguousarray(capture.depth[:, :, ::-1]),
        color=None if capture.color is None else np.ascontiguousarray(capture.color[:, ::-1]),
        confidence=None if capture.confidence is None else np.ascontiguousarray(capture.confidence[:, :, ::-1]),
        intrinsics=replace(old, cx=width - 1 - old.cx),
        mirrors=tuple(
            _moved(
                pick,
                lambda uv: np.column_stack((width - 1 - uv[:, 0], uv[:, 1])),
                lambda p: np.array((-p[0], p[1], p[2])),
            )
            for pick in capture.mirrors
        ),
    )


def _turn(maps: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.rot90(maps, -1, axes=(1, 2)))


def _moved(pick: MirrorPicks, pixels, vector=lambda p: p) -> MirrorPicks:
    """``pick`` with its pixels and its plane taken through two functions."""
    if pick.frame_pixels is not None:
        return replace(pick, frame_pixels=pixels(pick.frame_pixels))
    return replace(pick, point=vector(pick.point), normal=vector(pick.normal))


def _straight_pixels(pixels: np.ndarray, intrinsics: Intrinsics, straight: Intrinsics) -> np.ndarray:
    """Pixels (K, 2) in the straightened image; those outside the lens's field are left out."""
    rays = undistort((pixels - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy), intrinsics.distortion)
    rays = rays[np.isfinite(rays).all(axis=1)]
    if len(rays) < 3:
        raise CaptureError(
            "picks on a mirror's frame are outside the field in which the lens model is valid; pick further in"
        )
    return project(np.column_stack((rays, np.ones(len(rays)))), straight)
