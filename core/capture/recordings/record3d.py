"""Record3D (iPhone, iPad): ``.r3d`` files, what is in them unzipped, and its EXR + JPG export.

``metadata`` is JSON with K, column by column, *for the colour image of w × h*; depth is float32 metres, LZFSE in
``rgbd/N.depth`` or OpenEXR in ``depth/N.exr``; ``rgbd/N.conf`` holds the LiDAR's confidence 0 to 2.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError
from ...io.images import read_image
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, image_in, read_limited, rgb, starts_with
from ..decoding.file_indices import are_kept, index_of
from ..frames import FrameChoice, chosen_frames, empty_burst, paired_color

FORMAT = "Record3D"
MAX_MEMBER = 64_000_000
MAX_SIDE = 8192
DEFAULT_DEPTH = (256, 192)  # of the LiDAR, longer side first, for files that do not state dw and dh
METADATA = ("metadata", "metadata.json")


class _Files:
    """Members of a zip archive or files of a folder, by names with slashes."""

    def __init__(self, path: Path, archive: zipfile.ZipFile | None) -> None:
        self.path, self._archive = path, archive
        if archive is not None:
            names = archive.namelist()
        else:
            names = [
                f"{d}/{p.name}" for d in ("rgbd", "depth", "rgb") if (path / d).is_dir() for p in (path / d).iterdir()
            ]
            names += [name for name in METADATA if (path / name).is_file()]
        self.every = names
        root = next((str(PurePosixPath(n).parent) for n in names if PurePosixPath(n).name in METADATA), ".")
        self._root = "" if root == "." else root + "/"
        self.names = [n[len(self._root) :] for n in names if n.startswith(self._root)]

    def read(self, name: str) -> bytes:
        if self._archive is None:
            return read_limited(self.path / name, MAX_MEMBER)
        entry = self._archive.getinfo(self._root + name)
        if entry.file_size > MAX_MEMBER or entry.file_size > 1100 * max(entry.compress_size, 1):
            raise CaptureError(f"{self.path}: {name} unpacks to more than it can hold; export it again")
        return self._archive.read(entry)

    def image(self, name: str) -> np.ndarray:
        if self._archive is None:
            return read_image(self.path / name)
        return image_in(self.read(name), self.path, name, PurePosixPath(name).suffix)


def recognises(path: Path) -> bool:
    """Whether ``path`` is a zip archive or a folder with Record3D's metadata and depth."""
    if path.is_dir():
        return any((path / name).is_file() for name in METADATA) and any((path / d).is_dir() for d in ("rgbd", "depth"))
    if not starts_with(path, b"PK\x03\x04"):
        return False
    try:
        with _archive(path) as files:
            names = files.every
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        return path.suffix.lower() == ".r3d"
    return any(PurePosixPath(n).name in METADATA for n in names) and any(n.endswith((".depth", ".exr")) for n in names)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth, its confidence, and the colour image of the first chosen frame."""
    with _opened(path) as files, blaming(path, "a recording of Record3D"):
        about = _metadata(files)
        numbered = {
            int(m[2]): (m[0], m[3])
            for name in files.names
            if (m := re.fullmatch(r"(rgbd|depth)/(\d{1,9})\.(depth|exr)", name))
        }
        order = sorted(numbered)
        chosen = [order[i] for i in chosen_frames(path, frames, len(order))]
        width, height = int(_real(about["w"])), int(_real(about["h"]))
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
            raise ValueError(f"a colour image of {width}×{height}")
        long, short = DEFAULT_DEPTH
        given = (long, short) if width > height else (short, long)
        size = int(_real(about.get("dw", given[0]))), int(_real(about.get("dh", given[1])))
        depth = confidence = None
        for i, number in enumerate(chosen):
            name, kind = numbered[number]
            values = _exr(files, name) if kind == "exr" else _lzfse(files, name, size)
            if depth is None:
                depth = empty_burst(path, len(chosen), *values.shape)
                if f"rgbd/{number}.conf" in files.names:
                    confidence = np.zeros(depth.shape, np.uint8)
            if values.shape != depth.shape[1:]:
                raise ValueError("depth frames are not of one size")
            np.copyto(depth[i], values, where=np.isfinite(values) & (values > 0))
            if confidence is not None:
                confidence[i] = _unpacked(files, f"rgbd/{number}.conf", values.size).reshape(values.shape)
        assert depth is not None  # chosen_frames gives at least one
        if options.depth_unit_m is not None:
            depth *= np.float32(options.depth_unit_m)
        rows, columns = depth.shape[1:]
        camera = options.intrinsics or _intrinsics(about, width, height, chosen[0]).scaled(columns, rows)
        color, notes = None, []
        if options.color:
            pictures = sorted(n for n in files.names if re.fullmatch(r"(rgbd|rgb)/\d{1,9}\.(jpg|jpeg|png)", n))
            if pictures:
                paths = [Path(name) for name in pictures]
                place, note = paired_color([Path(f"{n}.depth") for n in order], order.index(chosen[0]), paths)
                color = rgb(files.image(pictures[place]))
                notes += [note] if note else []
    color_camera = None
    if color is not None:
        # one camera for both; its picture may be stored at another size than K is for
        color_camera = camera.scaled(color.shape[1], color.shape[0])
        if abs(color.shape[1] * rows - color.shape[0] * columns) > 0.02 * color.shape[1] * rows:
            notes.append("colour is left out: it is of another shape than depth")
            color = color_camera = None
    return stored_capture(
        path,
        FORMAT,
        depth,
        color,
        camera,
        color_camera,
        np.eye(4),
        sensor="phone",
        sensor_from="format",
        confidence=confidence,
        notes=notes,
    )


@contextmanager
def _archive(path: Path) -> Iterator[_Files]:
    """The members of an archive, which stays open where its frames are read one after the other."""
    if are_kept():
        yield index_of(path, FORMAT, lambda: _Files(path, zipfile.ZipFile(path)))
        return
    with zipfile.ZipFile(path) as archive:
        yield _Files(path, archive)


@contextmanager
def _opened(path: Path) -> Iterator[_Files]:
    if path.is_dir():
        yield _Files(path, None)
        return
    try:
        with _archive(path) as files:
            yield files
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise CaptureError(f"{path}: is a damaged archive ({error}); copy or export it again") from error


def _metadata(files: _Files) -> dict:
    name = next(n for n in (*METADATA, "") if n in files.names or not n)
    try:
        about = json.loads(text_of(files.read(name), "strict"))
    except (ValueError, RecursionError) as error:
        raise CaptureError(
            f"{files.path}: its metadata is not valid JSON ({type(error).__name__}); export again"
        ) from error
    if not isinstance(about, dict):
        raise ValueError("metadata is no JSON object")
    return about


def _real(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("a number is missing in metadata")
    return float(value)


def _intrinsics(about: dict, width: int, height: int, frame: int) -> Intrinsics:
    """Of the colour image: the frame's own where the file has them, else those of the first frame."""
    own = about.get("perFrameIntrinsicCoeffs")
    if isinstance(own, list) and frame < len(own) and isinstance(own[frame], list) and len(own[frame]) == 4:
        fx, fy, cx, cy = (_real(v) for v in own[frame])
        return Intrinsics(width, height, fx, fy, cx, cy)
    k = [_real(v) for v in about["K"]]
    if len(k) != 9:
        raise ValueError("K is not nine numbers")
    cx, cy = (k[6], k[7]) if k[6] or k[7] else (k[2], k[5])  # column by column, as the app writes it
    return Intrinsics(width, height, k[0], k[4], cx, cy)


def _lzfse(files: _Files, name: str, size: tuple[int, int]) -> np.ndarray:
    width, height = size
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"depth of {width}×{height}")
    return _unpacked(files, name, 4 * width * height).view("<f4").reshape(height, width)


def _unpacked(files: _Files, name: str, size: int) -> np.ndarray:
    from ..decoding.lzfse import lzfse_decompress  # brings numba

    return lzfse_decompress(files.read(name), size)


def _exr(files: _Files, name: str) -> np.ndarray:
    values = files.image(name)
    values = values[..., 0] if values.ndim == 3 else values
    if values.dtype != np.float32:
        raise ValueError(f"{name} is not of real numbers")
    return values
