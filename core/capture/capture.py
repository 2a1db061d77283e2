"""What a camera wrote, as one data type: :class:`Capture`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Intrinsics
from ..errors import CaptureError


@dataclass(frozen=True)
class MirrorPicks:
    """What is known of one mirror before it is fitted, as ``mirrors.json`` holds it.

    Either points picked on its frame (``frame_pixels`` (K, 2) float64, (u, v) [px]) or a known plane
    (``point`` (3,), ``normal`` (3,), camera frame [m]).
    """

    name: str
    frame_pixels: np.ndarray | None = None
    point: np.ndarray | None = None
    normal: np.ndarray | None = None


@dataclass(frozen=True)
class Capture:
    """One snapshot (or a burst of a still subject) of one depth camera.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z of each pixel [m], 0 = no reading.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        sRGB, aligned to the depth map.
    intrinsics : Intrinsics
        Of the depth map; a pinhole once opened.
    mirrors : tuple of MirrorPicks
        What the capture itself says about its mirrors; empty when it says nothing.
    name, format : str
        For messages and reports.
    color_intrinsics : Intrinsics or None
        As a reader made it: of a ``color`` not yet aligned. Once opened: of ``native_color``, a pinhole; None without.
    depth_to_color : np.ndarray [shape=(4, 4)] or None
        Takes camera-frame points [m] into the colour camera's frame: a rotation and a shift. None as
        ``color_intrinsics`` is, and where a reader knows that a ``color`` of another size is aligned to depth.
    sensor : str
        The camera that took it, where the file names it: ``kinect_v1``, ``kinect_v2``, ``azure_kinect``,
        ``realsense_d415``, ``realsense_d435``, ``realsense_d455``, ``phone``, or ``unknown``.
    confidence : np.ndarray [shape=(F, H, W), dtype=uint8] or None
        The camera's own trust in each reading, 0 low to 2 high.
    turn_degrees, mirrored : int, bool
        What the file says of the stream as stored: the clockwise rotation that makes it upright, and whether left and
        right are exchanged. 0 and False once opened.
    notes : tuple of str
        What the reader had to assume or leave out, one sentence each, for a person.
    sensor_from : {"file", "format", "name", "size"}
        Who says so: the file; its format, which only that camera has; a folder's name; or nobody, and the image has the
        size of that camera's.
    native_color : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8] or None
        sRGB, the colour camera's own pixels, as sharp as they were recorded: straightened where its lens distorts
        (black where the lens saw nothing), else untouched; rotated and mirrored as depth is. Only where
        :attr:`ReadOptions.native_color` asks for it. Where the file holds nothing but colour of depth's size and
        aligned to it, ``color`` itself.
    """

    depth: np.ndarray
    color: np.ndarray | None
    intrinsics: Intrinsics
    mirrors: tuple[MirrorPicks, ...] = field(default=())
    name: str = "capture"
    format: str = "unknown"
    color_intrinsics: Intrinsics | None = None
    depth_to_color: np.ndarray | None = None
    sensor: str = "unknown"
    confidence: np.ndarray | None = None
    turn_degrees: int = 0
    mirrored: bool = False
    notes: tuple[str, ...] = ()
    sensor_from: str = "file"
    native_color: np.ndarray | None = None


@dataclass(frozen=True)
class ReadOptions:
    """What a file cannot say, or says wrongly. Every default leaves it to the file.

    Parameters
    ----------
    intrinsics : Intrinsics or None
        Of the depth map as it is stored, with its distortion, in place of what the file says.
    depth_unit_m : float or None
        Metres that one stored unit means (0.001 for millimetres), in place of what the file says.
    disparity : {"factory", "linear", "tangent"}
        Formula for the raw 11-bit values of a Kinect v1; see :mod:`.kinect_disparity`.
    raw_disparity : bool or None
        Whether a lone image or array holds raw Kinect v1 values; None decides by their range.
    kinect_calibration : {"factory", "burrus"}
        Calibration of a Kinect v1 whose recording holds none.
    turn_degrees : {0, 90, 180, 270} or None
        Clockwise rotation that makes the picture upright; None takes what the file says, else 0.
    mirrored : bool or None
        Whether left and right are exchanged in the stream; None takes what the file says, else False.
    min_confidence : int
        Readings the camera trusts less are dropped: 0 keeps all, 1 drops the low, 2 the low and medium.
    color : bool
        Whether to read colour.
    lens_unit_m : float or None
        Metres that one stored unit means, as the file of ``intrinsics`` states it; for RGB-D folders and lone images.
    notes : tuple of str
        What was found out about these options, to stand among the capture's notes.
    mirrors : bool
        Whether to read the file of mirrors that lies in the capture's folder.
    native_color : bool
        Whether to keep the colour camera's own pixels beside the colour that is aligned to depth, for a texture; it
        costs their memory, and time where its lens must be straightened.
    """

    intrinsics: Intrinsics | None = None
    depth_unit_m: float | None = None
    disparity: str = "factory"
    raw_disparity: bool | None = None
    kinect_calibration: str = "factory"
    turn_degrees: int | None = None
    mirrored: bool | None = None
    min_confidence: int = 1
    color: bool = True
    lens_unit_m: float | None = None
    notes: tuple[str, ...] = ()
    mirrors: bool = True
    native_color: bool = False

    def __post_init__(self) -> None:
        if self.depth_unit_m is not None and not 1e-7 <= self.depth_unit_m <= 1e3:
            raise CaptureError(
                f"the depth unit cannot be {1000 * self.depth_unit_m:g} mm; give millimetres from 0.0001 to 1000000",
                code="unit",
            )
        if self.disparity not in ("factory", "linear", "tangent"):
            raise CaptureError(f"the disparity formula is factory, linear or tangent, not {self.disparity!r}")
        if self.kinect_calibration not in ("factory", "burrus"):
            raise CaptureError(f"the Kinect calibration is factory or burrus, not {self.kinect_calibration!r}")
        if self.turn_degrees not in (None, 0, 90, 180, 270):
            raise CaptureError(
                f"a capture can be rotated by 0, 90, 180 or 270 degrees, not {self.turn_degrees}", code="rotation"
            )
        if self.min_confidence not in (0, 1, 2):
            raise CaptureError(f"the least confidence is 0, 1 or 2, not {self.min_confidence}")


def stored_capture(
    path: Path,
    format: str,
    depth: np.ndarray,
    color: np.ndarray | None,
    intrinsics: Intrinsics,
    color_intrinsics: Intrinsics | None = None,
    depth_to_color: np.ndarray | None = None,
    *,
    notes: Iterable[str] = (),
    **fields: Any,
) -> Capture:
    """What a reader hands over: a capture as it is stored, with the name of its file or folder.

    Parameters
    ----------
    path : Path
        What was read; a folder gives its whole name, a file its name without the suffix.
    format, depth, color, intrinsics, notes
        See :class:`Capture`.
    color_intrinsics, depth_to_color
        See :class:`Capture`; dropped where there is no colour.
    **fields
        Further fields of :class:`Capture` that the file gives.
    """
    return Capture(
        depth,
        color,
        intrinsics,
        name=path.resolve().name if path.is_dir() else path.stem,
        format=format,
        color_intrinsics=color_intrinsics if color is not None else None,
        depth_to_color=depth_to_color if color is not None else None,
        notes=tuple(notes),
        **fields,
    )
