"""A video of a sequence for a quick look, through PyAV: .mp4, or .webp, which a page shows as a moving picture."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ..errors import OutputError
from ..mesh import Mesh
from ..preview.mesh_views import render_views

VIDEO_FORMATS = {".mp4": ("mp4", "h264"), ".webp": ("webp", "libwebp_anim")}
"""Suffix → container and coder."""
SIZE = (320, 432)
"""Width and height of each of both views [px]; even, as the coders of .mp4 want it."""

_DIRECTIONS = ((0.5, -1.0, 0.12), (-0.5, 1.0, 0.12))  # from the body towards the viewer: front and back
_AROUND, _ABOVE, _BELOW = 0.75, 0.25, 0.05  # of the first body's height: so far the picture reaches about it


class PreviewVideo:
    """Writes a video frame by frame; as a context, it is closed at the end.

    Parameters
    ----------
    path : Path
        .mp4 or .webp; what is written to it is complete only when the video is closed.
    rate : float
        Frames a second.

    Raises
    ------
    OutputError
        Another format, or PyAV is not installed.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._bounds: Mesh | None = None
        self._file: Any = None
        self._stream: Any = None
        check_video(path)

    def __enter__(self) -> PreviewVideo:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def add(self, mesh: Mesh) -> None:
        """One more frame: the body from in front and from behind, by the scale of the first."""
        if self._bounds is None:
            self._bounds = _bounds_about(mesh)
        picture = render_views(
            *_with_bounds(mesh, self._bounds), _DIRECTIONS, SIZE[0], SIZE[1]
        )  # fmt: skip
        frame = self._frame_of(picture)
        for packet in self._stream.encode(frame):
            self._file.mux(packet)

    def close(self) -> None:
        """Finish the file."""
        if self._stream is not None:
            for packet in self._stream.encode():
                self._file.mux(packet)
        if self._file is not None:
            self._file.close()
        self._file = self._stream = None

    def _frame_of(self, picture: np.ndarray) -> Any:
        """A frame of the video, which is opened for the first one."""
        import av

        if self._file is None:
            container, coder = VIDEO_FORMATS[self._path.suffix.lower()]
            options = {"loop": "0"} if container == "webp" else {}
            self._file = av.open(str(self._path), "w", format=container, options=options)
            self._stream = self._file.add_stream(coder, rate=Fraction(self._rate).limit_denominator(1001))
            self._stream.height, self._stream.width = picture.shape[:2]
            self._stream.pix_fmt = "yuv420p"
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")


def check_video(path: Path) -> None:
    """Refuse a video that cannot be written.

    Raises
    ------
    OutputError
    """
    suffix = path.suffix.lower()
    if suffix not in VIDEO_FORMATS:
        raise OutputError(f"{path}: a video is written as {' or '.join(VIDEO_FORMATS)}, not as “{path.suffix}”")
    try:
        import av
    except ImportError as error:
        raise OutputError(f"{path}: a video needs the Python package av; “pip install av”") from error
    coder = VIDEO_FORMATS[suffix][1]
    try:
        av.Codec(coder, "w")
    except ValueError as error:
        others = " or ".join(other for other in VIDEO_FORMATS if other != suffix)
        raise OutputError(f"{path}: the Python package av here cannot write {coder}; choose {others}") from error


def _bounds_about(mesh: Mesh) -> Mesh:
    """Two triangles too small to be seen at opposite corners of what the video shows."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    tall, middle = high[2] - low[2], (low + high) / 2.0
    about = np.array((_AROUND * tall, _AROUND * tall, 0.0))
    corners = np.array((middle - about, middle + about))
    corners[:, 2] = low[2] - _BELOW * tall, high[2] + _ABOVE * tall
    vertices = corners.repeat(3, axis=0) + 1e-6 * np.tile(np.eye(3), (2, 1))
    return Mesh(vertices, np.arange(6, dtype=np.int32).reshape(2, 3), np.zeros((6, 3), np.uint8))


def _with_bounds(mesh: Mesh, bounds: Mesh) -> tuple[Mesh, np.ndarray | None]:
    """The mesh and what gives all pictures one scale, and their colours."""
    count = len(mesh.vertices)
    triangles = np.concatenate((mesh.triangles, bounds.triangles + np.int32(count)))
    whole = Mesh(np.concatenate((mesh.vertices, bounds.vertices)), triangles)
    if mesh.colors is None or bounds.colors is None:
        return whole, None
    return whole, np.concatenate((mesh.colors, bounds.colors))
