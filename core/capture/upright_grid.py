"""A capture as the pipeline expects it: depth and colour on one upright pinhole grid, left and right as in the room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, project
from ..camera.image_registration import (
    color_on_depth,
    first_readings,
    straight_color,
    straightened,
    undistort_color,
    undistort_depth,
    undistort_labels,
)
from ..camera.pinhole import undistort
from ..errors import CaptureError, Notice
from .capture import Capture, MirrorPicks

_TURNS = {0: 0, 90: 1, 180: 2, 270: 3}
_QUARTER_TURN = np.array(((0.0, -1, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))  # clockwise, about the view


def align(capture: Capture, native: bool = False) -> Capture:
    """Straighten depth and bring colour onto its grid.

    Parameters
    ----------
    capture : Capture
        As a reader made it: ``intrinsics`` may have distortion; ``color`` is of any size when ``color_intrinsics`` and
        ``depth_to_color`` are given, else aligned to the depth map as it is stored. Where ``native_color`` is given,
        those two are its own, and ``color`` is aligned.
    native : bool
        Whether a ``color`` that was not aligned is kept as ``native_color``.

    Returns
    -------
    Capture
        Pinhole ``intrinsics``, ``color`` of the depth map's size; picks on mirrors moved along. ``native_color``
        straightened, described by a pinhole ``color_intrinsics`` and ``depth_to_color``; without it all three are None.

    Raises
    ------
    CaptureError
        When the colour image is of another size and its alignment to the depth map is unknown.
    """
    depth, color, camera = capture.depth, capture.color, capture.intrinsics
    notes = capture.notes
    own, own_camera = capture.native_color, capture.color_intrinsics
    aligned = own is not None or own_camera is None
    if color is not None and aligned and color.shape[:2] != depth.shape[1:]:
        raise CaptureError(
            f"{capture.name}: colour is {color.shape[1]}×{color.shape[0]} px, depth {camera.width}×{camera.height}; "
            "their alignment is unknown; align them when recording, or leave colour out",
            code="color",
        )
    if not camera.is_pinhole:
        straight = straightened(camera)
        depth = undistort_depth(depth, camera, straight, interpolate=capture.sensor != "kinect_v1")
        confidence = None if capture.confidence is None else undistort_labels(capture.confidence, camera, straight)
        if color is not None and aligned:
            color = undistort_color(color, camera, straight)
        mirrors = tuple(_moved(pick, lambda uv: _straight_pixels(uv, camera, straight)) for pick in capture.mirrors)
        capture = replace(capture, depth=depth, confidence=confidence, intrinsics=straight, mirrors=mirrors)
    pose = np.eye(4) if capture.depth_to_color is None else capture.depth_to_color
    if color is not None and not aligned:
        assert own_camera is not None  # it is what makes colour unaligned
        own = color if native else None
        color, seen = color_on_depth(first_readings(depth), capture.intrinsics, color, own_camera, pose)
        if seen < 0.9:
            note = Notice("the colour camera sees only {seen:.0%} of the readings; the rest stays black", seen=seen)
            notes = (*notes, note)
    capture = replace(capture, color=color, native_color=None, color_intrinsics=None, depth_to_color=None, notes=notes)
    if own is None or own_camera is None:
        return capture
    own, own_camera = straight_color(own, own_camera)
    return replace(capture, native_color=own, color_intrinsics=own_camera, depth_to_color=pose)


def turned(capture: Capture, degrees: int) -> Capture:
    """``capture`` rotated clockwise by 0, 90, 180 or 270°, as an image is; the camera frame rotates with it.

    A camera mounted on its side, rotated by 90° clockwise (seen from behind), is made upright by 90.

    Raises
    ------
    CaptureError
        For any other angle.
    """
    if degrees not in _TURNS:
        raise CaptureError(
            f"{capture.name}: a capture can be rotated by 0, 90, 180 or 270 degrees, not {degrees}", code="rotation"
        )
    for _ in range(_TURNS[degrees]):
        height = capture.intrinsics.height
        color = None if capture.color is None else _turn_color(capture.color)
        capture = replace(
            _with_native(capture, color, _turn_color, _turn_camera, _QUARTER_TURN),
            depth=_turn(capture.depth),
            color=color,
            confidence=None if capture.confidence is None else _turn(capture.confidence),
            intrinsics=_turn_camera(capture.intrinsics),
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
    width = capture.intrinsics.width
    color = None if capture.color is None else _flip_color(capture.color)
    return replace(
        _with_native(capture, color, _flip_color, _flip_camera, np.diag((-1.0, 1.0, 1.0, 1.0))),
        depth=np.ascontiguousarray(capture.depth[:, :, ::-1]),
        color=color,
        confidence=None if capture.confidence is None else np.ascontiguousarray(capture.confidence[:, :, ::-1]),
        intrinsics=_flip_camera(capture.intrinsics),
        mirrors=tuple(
            _moved(
                pick,
                lambda uv: np.column_stack((width - 1 - uv[:, 0], uv[:, 1])),
                lambda p: np.array((-p[0], p[1], p[2])),
            )
            for pick in capture.mirrors
        ),
    )


def _with_native(
    capture: Capture,
    color: np.ndarray | None,
    image: Callable[[np.ndarray], np.ndarray],
    camera: Callable[[Intrinsics], Intrinsics],
    frame: np.ndarray,
) -> Capture:
    """``capture`` with its native colour moved as depth is: by ``image``, ``camera``, and ``frame`` (4, 4) for points.

    Both cameras' frames take the same motion, so the pose between them is seen from there. Where native colour is the
    aligned one, it stays so: ``color`` is that one, moved.
    """
    own, own_camera, pose = capture.native_color, capture.color_intrinsics, capture.depth_to_color
    if own is None or own_camera is None or pose is None:
        return capture
    own = color if own is capture.color else image(own)
    return replace(
        capture, native_color=own, color_intrinsics=camera(own_camera), depth_to_color=frame @ pose @ frame.T
    )


def _turn(maps: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.rot90(maps, -1, axes=(1, 2)))


def _turn_color(color: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.rot90(color, -1))


def _turn_camera(pinhole: Intrinsics) -> Intrinsics:
    return Intrinsics(
        pinhole.height, pinhole.width, pinhole.fy, pinhole.fx, pinhole.height - 1 - pinhole.cy, pinhole.cx
    )


def _flip_color(color: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(color[:, ::-1])


def _flip_camera(pinhole: Intrinsics) -> Intrinsics:
    return replace(pinhole, cx=pinhole.width - 1 - pinhole.cx)


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
            "picks on a mirror's frame are outside the field in which the lens model is valid; pick further in",
            code="mirror_file",
        )
    return project(np.column_stack((rays, np.ones(len(rays)))), straight)
