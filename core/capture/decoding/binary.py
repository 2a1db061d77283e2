"""Bytes of untrusted files: bounded reads, parsing that names the file, and images held inside other files."""

from __future__ import annotations

import contextlib
import mmap
import re
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from ...errors import CaptureError
from ...io.images import read_image

_NPY_HEADER = re.compile(
    r"\{'descr': '([<>|][uif][1248])', 'fortran_order': (True|False), 'shape': \(((?:\d{1,9},? ?){0,4})\),? \}\s*"
)


def starts_with(path: Path, *signatures: bytes) -> bool:
    """Whether ``path`` is a file that begins with one of the signatures."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        head = file.read(max(map(len, signatures)))
    return head.startswith(signatures)


@contextlib.contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """The file's bytes, read only as far as they are looked at; views must not outlive the block."""
    with open(path, "rb") as file:
        if not path.stat().st_size:
            raise CaptureError(f"{path}: is empty; copy or record it again")
        view = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        data = memoryview(view)
        try:
            yield data
        finally:
            # An error on its way out still holds slices in its traceback; the mapping then closes with it.
            with contextlib.suppress(BufferError):
                data.release()
                view.close()


@contextlib.contextmanager
def blaming(path: Path, what: str) -> Iterator[None]:
    """Turn what parsing damaged bytes raises into an error that names the file."""
    try:
        yield
    except (struct.error, IndexError, KeyError, ValueError, OverflowError, TypeError, UnicodeError) as error:
        raise CaptureError(f"{path}: is damaged or not {what}; copy or record it again") from error


def npy_header(file: IO[bytes], columns: bool = False) -> tuple[tuple[int, ...], np.dtype, bool]:
    """Shape, type and order (true: Fortran's) of an array in numpy's format; the file is then at its first number.

    Only plain arrays of numbers, in Fortran's order where ``columns`` allows it; numpy's own parser evaluates the
    header as Python text.

    Raises
    ------
    ValueError, struct.error
        When it is not such a header.
    """
    magic = file.read(8)
    if magic[:6] != b"\x93NUMPY" or magic[6:] not in (b"\1\0", b"\2\0"):
        raise ValueError("no array of numpy's format 1 or 2")
    (length,) = struct.unpack("<H", file.read(2)) if magic[6] == 1 else struct.unpack("<I", file.read(4))
    if length > 10_000:
        raise ValueError("the header of an array is too long")
    match = _NPY_HEADER.fullmatch(file.read(length).decode("latin-1"))
    if match is None or (match[2] != "False" and not columns):
        raise ValueError("the array is not of plain numbers" + ("" if columns else " in C order"))
    shape = tuple(int(n) for n in match[3].split(",") if n.strip())
    return shape, np.dtype(match[1]), match[2] == "True"


def read_limited(path: Path, limit: int) -> bytes:
    """The whole file, refused when it is larger than what its kind can be."""
    if path.stat().st_size > limit:
        raise CaptureError(f"{path}: is far too large for what it should hold; is it the right file?")
    return path.read_bytes()


def image_in(data: bytes | memoryview, path: Path, what: str, suffix: str = ".jpg") -> np.ndarray:
    """Pixels of an image file held inside ``path``, as :func:`.images.read_image` gives them."""
    with tempfile.TemporaryDirectory(prefix="mirror_scan_") as folder:
        inner = Path(folder) / f"image{suffix}"
        inner.write_bytes(data)
        try:
            return read_image(inner)
        except CaptureError as error:
            reason = str(error).removeprefix(f"{inner}: ")
            raise CaptureError(f"{path}: {what} cannot be decoded: {reason}") from error


def rgb(image: np.ndarray) -> np.ndarray:
    """Colour (H, W, 3) uint8: gray repeated, alpha dropped, 16 bit cut to 8."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    elif image.dtype.kind == "i" or image.dtype == np.uint32:
        image = (np.maximum(image, 0) >> (8 * image.dtype.itemsize - (7 + (image.dtype.kind == "u")))).astype(np.uint8)
    elif image.dtype != np.uint8:
        image = (np.clip(np.nan_to_num(image), 0, 1) * 255 + 0.5).astype(np.uint8)
    if image.ndim == 2 or image.shape[2] < 3:
        image = np.repeat((image if image.ndim == 2 else image[..., 0])[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., :3])


def yuv_to_rgb(y: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Full-range BT.601 (JFIF) to colour (H, W, 3) uint8; the planes are of one size."""
    y, u, v = (np.asarray(plane, np.float32) for plane in (y, u, v))
    u, v = u - 128, v - 128
    mixed = np.stack((y + 1.402 * v, y - 0.344136 * u - 0.714136 * v, y + 1.772 * u), axis=-1)
    return np.clip(mixed + 0.5, 0, 255).astype(np.uint8)


def yuyv_to_rgb(data: np.ndarray, luma_first: bool = True) -> np.ndarray:
    """Packed 4:2:2 (H, W, 2) uint8, YUYV or UYVY, to colour (H, W, 3) uint8."""
    luma, chroma = (data[..., 0], data[..., 1]) if luma_first else (data[..., 1], data[..., 0])
    return yuv_to_rgb(luma, np.repeat(chroma[:, 0::2], 2, axis=1), np.repeat(chroma[:, 1::2], 2, axis=1))
