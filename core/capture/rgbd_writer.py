"""An RGB-D folder written frame by frame: what a live recorder, a conversion and a simulation have in common."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..errors import Notice, OutputError
from ..io.images import write_png
from .capture import Capture
from .folders.lens_file import color_file
from .folders.rgbd_folder import COLOR_INTRINSIC_NAME, mirrors_to

MAX_METRES = 65.535  # what 16-bit millimetres hold


class FolderWriter:
    """Writes ``intrinsic.json`` at once, then a depth PNG (16-bit millimetres) a frame.

    Parameters
    ----------
    folder : path
        Made when it is missing; must not hold another capture's frames.
    intrinsics : Intrinsics
        Pinhole of the depth map.
    sensor : str
        As in :class:`.capture.Capture`; left out when unknown.
    sensor_from : str
        As in :class:`.capture.Capture`; left out when a file says so.

    Raises
    ------
    OutputError
        When the folder holds frames already, cannot be written, or the camera has distortion.
    """

    def __init__(
        self, folder: str | os.PathLike, intrinsics: Intrinsics, sensor: str = "unknown", sensor_from: str = "file"
    ) -> None:
        self.folder = Path(folder)
        self.frames = self.readings = self.lost = 0
        self._shape = (intrinsics.height, intrinsics.width)
        if not intrinsics.is_pinhole:
            raise OutputError(f"{self.folder}: an RGB-D folder holds straight pictures; undistort them first")
        others = sorted(p.name for sub in ("depth", "color") for p in (self.folder / sub).glob("*"))
        if others:
            raise OutputError(f"{self.folder}: holds another capture's {others[0]}; choose an empty folder")
        matrix = [intrinsics.fx, 0, 0, 0, intrinsics.fy, 0, intrinsics.cx, intrinsics.cy, 1]
        content = {"width": intrinsics.width, "height": intrinsics.height, "intrinsic_matrix": matrix}
        if sensor != "unknown":
            content["sensor"] = sensor
            content |= {} if sensor_from == "file" else {"sensor_from": sensor_from}
        try:
            (self.folder / "depth").mkdir(parents=True, exist_ok=True)
            self.write_json("intrinsic.json", content)
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot be written: {error.strerror or error}") from error

    def add(self, depth: np.ndarray) -> None:
        """One more frame (H, W) [m]; what 16-bit millimetres cannot hold becomes 0, no reading."""
        if depth.shape != self._shape:
            raise OutputError(f"{self.folder}: frame {self.frames} is {depth.shape}, not {self._shape} as the first")
        known = (depth > 0) & (depth <= MAX_METRES)  # false for NaN
        self.readings += int(np.count_nonzero(known))
        self.lost += int((depth > MAX_METRES).sum())
        units = np.rint(np.where(known, depth, 0) * 1000.0).astype(np.uint16)
        write_png(self.folder / "depth" / f"{self.frames:06d}.png", units)
        self.frames += 1

    def set_color(
        self, color: np.ndarray, intrinsics: Intrinsics | None = None, depth_to_color: np.ndarray | None = None
    ) -> None:
        """The colour image: aligned to depth, or of any size with the camera that took it.

        Parameters
        ----------
        color : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8]
        intrinsics, depth_to_color
            Of the camera that took it, and where it is, as in :class:`.capture.Capture`; None where ``color`` is
            aligned to depth.
        """
        shape = self._shape if intrinsics is None else (intrinsics.height, intrinsics.width)
        if color.shape[:2] != shape:
            other = "depth" if intrinsics is None else "its camera"
            raise OutputError(f"{self.folder}: colour is {color.shape[:2]}, {other} {shape}; align it first")
        if intrinsics is not None:
            if depth_to_color is None:
                raise OutputError(f"{self.folder}: colour has intrinsics but no depth_to_color; give both")
            self.write_json(COLOR_INTRINSIC_NAME, color_file(intrinsics, depth_to_color))
        try:
            (self.folder / "color").mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot be written: {error.strerror or error}") from error
        write_png(self.folder / "color" / "000000.png", color)

    def write_json(self, name: str, content: object) -> None:
        """A JSON file of the folder."""
        try:
            (self.folder / name).write_text(json.dumps(content, indent=1), encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{self.folder / name}: cannot be written: {error.strerror or error}") from error


def write_folder(folder: str | os.PathLike, capture: Capture) -> tuple[str, ...]:
    """Write an opened capture as an RGB-D folder.

    Depth is rounded to millimetres. Of colour, the colour camera's own pixels are written where the capture has them
    (:attr:`.capture.Capture.native_color`), else those aligned to depth. Metadata an RGB-D folder has no place for
    (confidence, notes) is left out.

    Returns
    -------
    tuple of str
        Warnings of what the folder cannot hold.

    Raises
    ------
    OutputError
        See :class:`FolderWriter`; also when none of the readings can be held.
    """
    writer = FolderWriter(folder, capture.intrinsics, capture.sensor, capture.sensor_from)
    for frame in capture.depth:
        writer.add(frame)
    if capture.native_color is not None and capture.native_color is not capture.color:
        writer.set_color(capture.native_color, capture.color_intrinsics, capture.depth_to_color)
    elif capture.color is not None:
        writer.set_color(capture.color)
    if capture.mirrors:
        writer.write_json("mirrors.json", {"mirrors": mirrors_to(capture.mirrors)})
    if not writer.lost:
        return ()
    if not writer.readings:
        raise OutputError(
            f"{writer.folder}: all readings lie beyond {MAX_METRES} m, more than 16-bit millimetres hold; "
            "check the depth unit",
            code="unit",
        )
    return (
        Notice(
            "{share:.1%} of the readings lie beyond {farthest:g} m, more than 16-bit millimetres hold: they were left "
            "out",
            share=writer.lost / (writer.lost + writer.readings),
            farthest=MAX_METRES,
        ),
    )
