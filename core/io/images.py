"""Images to and from files, by OpenImageIO: the one image library both pip and Blender have."""

from __future__ import annotations

import os
import struct
import sys
import tempfile
import zlib
from pathlib import Path
from types import ModuleType

import numpy as np

from ..errors import CaptureError, MirrorScanError, OutputError
from .atomic_files import replacing

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 8192 * 8192  # of one image, our largest texture; a forged header cannot fill the memory


def openimageio() -> ModuleType:
    """The OpenImageIO module: installed by pip, or the one Blender carries.

    Raises
    ------
    MirrorScanError
        When neither is there.
    """
    try:
        import OpenImageIO
    except ImportError as first:
        # Blender hides the libraries it bundles until they are requested, which only a Blender process can do.
        bpy = sys.modules.get("bpy")
        expose = getattr(getattr(bpy, "utils", None), "expose_bundled_modules", None)
        try:
            if expose is None:
                raise first
            expose()
            import OpenImageIO
        except ImportError as error:
            raise MirrorScanError(
                f"images need the Python package OpenImageIO, which cannot be imported ({error}); "
                "install it with “pip install OpenImageIO”",
                code="wheels",
            ) from error
    return OpenImageIO


def read_image(path: str | os.PathLike, channel: tuple[str, ...] = ()) -> np.ndarray:
    """Pixels of an image file as they are stored: no scaling, no colour conversion.

    Parameters
    ----------
    path : path
        The file.
    channel : tuple of str
        Names, in small letters, of a channel that is read alone where the file has it among others; of a name with
        layers, as renderers write it, the last part or the one before it counts.

    Returns
    -------
    np.ndarray [shape=(H, W) or (H, W, C), dtype=uint8, uint16, int16, uint32, int32 or float32]
        (H, W) when there is one channel. Row 0 is the top one. Alpha is not multiplied in.

    Raises
    ------
    CaptureError
        When the file is missing, truncated, not an image or larger than ``MAX_PIXELS``.
    """
    path = Path(path)
    if not path.is_file():
        raise CaptureError(f"{path}: there is no such file", code="gone")
    checked_png(path)
    oiio = openimageio()
    config = oiio.ImageSpec()
    config["oiio:UnassociatedAlpha"] = 1
    source = oiio.ImageInput.open(_name(path), config)
    if source is None:
        raise CaptureError(f"{path}: is not a readable image ({_reason(oiio.geterror())})")
    try:
        spec = source.spec()
        width, height, channels, first = spec.width, spec.height, spec.nchannels, 0
        parts = [set(name.lower().split(".")[-2:]) for name in spec.channelnames] if channels > 1 else []
        named = next((i for name in channel for i, part in enumerate(parts) if name in part), None)
        if named is not None:
            first, channels = named, 1
        if width < 1 or height < 1 or spec.depth > 1 or width * height > MAX_PIXELS or channels > 4:
            raise CaptureError(f"{path}: {width}×{height} with {channels} channels is no size an image here can have")
        kind = spec.format.basetype
        whole = (oiio.UINT8, oiio.UINT16, oiio.INT16, oiio.UINT32, oiio.INT32)
        wanted = kind if kind in whole else oiio.FLOAT  # which would turn whole numbers into parts of the largest
        pixels = source.read_image(0, 0, first, first + channels, wanted)
        problem = source.geterror()
    finally:
        source.close()
    if pixels is None or problem:
        raise CaptureError(f"{path}: cannot be decoded ({_reason(problem)}); the file is truncated or damaged")
    return pixels.reshape(height, width) if channels == 1 else pixels.reshape(height, width, channels)


def write_png(path: str | os.PathLike, array: np.ndarray) -> None:
    """Write ``array`` as PNG; a file already there is replaced only when the new one is complete.

    Parameters
    ----------
    path : path
        Ends in .png.
    array : np.ndarray [shape=(H, W) uint8 or uint16, or (H, W, 3) uint8]
        Row 0 on top.

    Raises
    ------
    OutputError
        Wrong suffix, shape or dtype, or a file that cannot be written.
    """
    path = Path(path)
    array = np.ascontiguousarray(array)
    gray = array.ndim == 2 and array.dtype in (np.uint8, np.uint16)
    color = array.ndim == 3 and array.shape[2] == 3 and array.dtype == np.uint8
    if path.suffix.lower() != ".png" or not (gray or color) or not array.size:
        raise OutputError(f"{path}: cannot hold an image of shape {array.shape} and type {array.dtype} as PNG")
    oiio = openimageio()
    height, width = array.shape[:2]
    spec = oiio.ImageSpec(width, height, 1 if gray else 3, oiio.UINT16 if array.dtype == np.uint16 else oiio.UINT8)
    spec["png:compressionLevel"] = 4
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create("png")
        if output is None:
            raise OutputError(f"{path}: OpenImageIO cannot write PNG here ({_reason(oiio.geterror())})")
        written = output.open(_name(temporary), spec) and output.write_image(array.reshape(height, width, -1))
        if not (output.close() and written):
            raise OutputError(f"{path}: cannot be written ({_reason(output.geterror())})")


def png_bytes(array: np.ndarray) -> bytes:
    """What :func:`write_png` would write.

    Raises
    ------
    OutputError
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.png"
        write_png(path, array)
        return path.read_bytes()


def image_of_bytes(data: bytes) -> np.ndarray:
    """Pixels of an image that lies within another file; see :func:`read_image`.

    Raises
    ------
    CaptureError
    """
    suffix = ".png" if data.startswith(PNG_SIGNATURE) else ".jpg"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"image{suffix}"
        path.write_bytes(data)
        try:
            return read_image(path)
        except CaptureError as error:
            raise CaptureError(str(error).replace(str(path), "the image in the file", 1)) from error


def checked_png(path: Path) -> bytes | None:
    """The bytes of a PNG, None for another file; libpng itself would complain on the terminal.

    Raises
    ------
    CaptureError
        When the file is cut, altered, of absurd size, or a PNG by its name only.
    """
    data = path.read_bytes()
    if not data.startswith(PNG_SIGNATURE):
        if path.suffix.lower() == ".png":
            raise CaptureError(f"{path}: is not a PNG file, whatever its name says; copy or record it again")
        return None
    position, kind = len(PNG_SIGNATURE), b""
    while kind != b"IEND":
        if position + 12 > len(data):
            raise CaptureError(f"{path}: the PNG is truncated; copy or record it again")
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 8 + length
        if end + 4 > len(data):
            raise CaptureError(f"{path}: the PNG is truncated; copy or record it again")
        if zlib.crc32(data[position + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            raise CaptureError(f"{path}: the PNG is damaged (checksum of {kind.decode('latin-1')}); copy it again")
        if kind == b"IHDR" and length == 13:
            width, height = struct.unpack_from(">II", data, position + 8)
            if not 0 < width * height <= MAX_PIXELS:
                raise CaptureError(f"{path}: {width}×{height} pixels is no size an image here can have")
        position = end + 4
    return data


def _name(path: Path) -> str | bytes:
    """A path as OpenImageIO takes it: one that is not UTF-8, which Linux allows, only as bytes."""
    name = str(path)
    try:
        name.encode()
        return name
    except UnicodeEncodeError:
        return os.fsencode(name)


def _reason(text: str) -> str:
    """One line of whatever the library says."""
    return " ".join(text.split())[:160] or "no reason given"
