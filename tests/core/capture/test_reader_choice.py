"""RGB-D folders: what is written comes back; what is wrong is told in one line that names the file."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.decoding.depth_png import decode_metres
from mirror_scan.core.capture.folders.rgbd_folder import read_mirrors
from mirror_scan.core.errors import CaptureError, MirrorError, MirrorScanError
from mirror_scan.core.io.images import read_image, write_png

WIDTH, HEIGHT = 64, 48
MATRIX = [60.0, 0, 0, 0, 61.0, 0, 31.5, 23.5, 1]
PICKS = [[5, 5], [5.5, 40], [20, 22.25], [-0.5, 47.5]]


def write_folder(folder, *, depth=None, color=True, intrinsic=None, mirrors=None):
    """A small capture; ``depth`` a list of images, ``intrinsic`` and ``mirrors`` objects or raw text."""
    (folder / "depth").mkdir(parents=True)
    frame = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    for i, image in enumerate([frame, frame + 1] if depth is None else depth):
        write_png(folder / "depth" / f"{i:06d}.png", image)
    if color:
        (folder / "color").mkdir()
        write_png(folder / "color" / "000000.png", np.full((HEIGHT, WIDTH, 3), (10, 20, 30), np.uint8))
    if intrinsic is None:
        intrinsic = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": MATRIX}
    for name, content in (("intrinsic.json", intrinsic), ("mirrors.json", mirrors)):
        if content is not None:
            (folder / name).write_text(content if isinstance(content, str) else json.dumps(content))
    return folder


def test_a_good_folder(tmp_path):
    plane = {"name": "left", "plane": {"point": [1, 0, 3], "normal": [0, 0, -1e-200]}}
    mirrors = {"mirrors": [{"name": "right", "frame_pixels": PICKS}, plane]}
    folder = write_folder(tmp_path / "Anna & Bob", mirrors=mirrors)
    (folder / "depth" / "._000000.png").write_bytes(b"what macOS leaves behind")
    capture = open_capture(folder)
    assert capture.depth.dtype == np.float32
    assert capture.depth.shape == (2, HEIGHT, WIDTH)
    np.testing.assert_array_equal(capture.depth[1], np.float32(2.001))
    np.testing.assert_array_equal(capture.color, np.full((HEIGHT, WIDTH, 3), (10, 20, 30), np.uint8))
    camera = capture.intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (60, 61, 31.5, 23.5)
    np.testing.assert_array_equal(capture.mirrors[0].frame_pixels, PICKS)
    np.testing.assert_array_equal(capture.mirrors[1].normal, [0, 0, -1])
    assert (capture.name, capture.format) == ("Anna & Bob", "RGB-D folder")
    assert len(open_capture(folder, frames=1).depth) == 1


def test_a_folder_is_read_without_numba(tmp_path):
    """Compiling takes seconds; who only looks at a capture, or mistyped its name, must not wait for it."""
    folder = write_folder(tmp_path / "a")
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import conftest\n"
        "from mirror_scan.core.capture import open_capture\n"
        f"open_capture({str(folder)!r})\n"
        "sys.exit('numba' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_frames_come_in_natural_order_and_scale_is_heeded(tmp_path):
    intrinsic = {"width": WIDTH, "height": HEIGHT, "depth_scale": 5000,
                 "intrinsic_matrix": np.reshape(MATRIX, (3, 3)).T.tolist()}  # fmt: skip
    folder = write_folder(tmp_path / "a", depth=[], color=False, intrinsic=intrinsic)
    for i in (10, 9, 2):
        write_png(folder / "depth" / f"frame{i}.png", np.full((HEIGHT, WIDTH), 5000 * i, np.uint16))
    (folder / "intrinsic.json").rename(folder / "camera_intrinsic.json")
    capture = open_capture(folder)
    np.testing.assert_array_equal(capture.depth[:, 0, 0], [2, 9, 10])
    assert capture.color is None
    assert capture.mirrors == ()


def test_gray_color_becomes_three_channels(tmp_path):
    folder = write_folder(tmp_path / "a")
    write_png(folder / "color" / "000000.png", np.full((HEIGHT, WIDTH), 77, np.uint8))
    np.testing.assert_array_equal(open_capture(folder).color, np.full((HEIGHT, WIDTH, 3), 77))


def intrinsic_with(**changes):
    return json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": MATRIX} | changes)


BAD_INTRINSICS = {
    "not json": ("{", "not valid JSON"),
    "not text": ("\0\0", "not valid JSON"),
    "nested without end": ("[" * 100_000, "not valid JSON"),
    "a list": ("[]", "JSON object"),
    "no matrix": ('{"width": 64, "height": 48}', "intrinsic_matrix missing"),
    "width zero": (intrinsic_with(width=0), "width"),
    "width fraction": (intrinsic_with(width=64.5), "width"),
    "width true": (intrinsic_with(width=True), "width"),
    "width endless": ('{"width": 1e999, "height": 48, "intrinsic_matrix": []}', "width"),
    "eight numbers": (intrinsic_with(intrinsic_matrix=MATRIX[:8]), "nine finite"),
    "nan": (intrinsic_with(intrinsic_matrix=[math.nan, *MATRIX[1:]]), "nine finite"),
    "words": (intrinsic_with(intrinsic_matrix="fx"), "nine finite"),
    "zero": (intrinsic_with(intrinsic_matrix=[0] * 9), "positive"),
    "negative": (intrinsic_with(intrinsic_matrix=[-60, *MATRIX[1:]]), "positive"),
    "row by row": (intrinsic_with(intrinsic_matrix=[60, 0, 31.5, 0, 61, 23.5, 0, 0, 1]), "row by row"),
    "nested columns": (
        intrinsic_with(intrinsic_matrix=[[60, 0, 0], [0, 61, 0], [31.5, 23.5, 1]]), "column by column"
    ),
    "skewed": (intrinsic_with(intrinsic_matrix=[60, 0, 0, 5, 61, 0, 31.5, 23.5, 1]), "pinhole"),
    "normalised": (intrinsic_with(intrinsic_matrix=[0.9, 0, 0, 0, 0.9, 0, 0.5, 0.5, 1]), "in pixels"),
    "centre zero": (intrinsic_with(intrinsic_matrix=[60, 0, 0, 0, 61, 0, 0, 0, 1]), "centre"),
    "scale zero": (intrinsic_with(depth_scale=0), "depth_scale"),
    "scale text": (intrinsic_with(depth_scale="mm"), "depth_scale"),
    "other size": (
        intrinsic_with(width=320, height=240, intrinsic_matrix=[300, 0, 0, 0, 300, 0, 160, 120, 1]), "320×240"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_INTRINSICS)
def test_bad_intrinsics(tmp_path, case):
    content, words = BAD_INTRINSICS[case]
    folder = write_folder(tmp_path / "a", intrinsic=content)
    with pytest.raises(CaptureError, match=words) as caught:
        open_capture(folder)
    assert_one_line_naming(caught.value, folder)


def flat(value, dtype=np.uint16, shape=(HEIGHT, WIDTH)):
    return np.full(shape, value, dtype)


BAD_FRAMES = {
    "none": ([], "no PNG"),
    "8 bits": ([flat(200, np.uint8)], "8-bit gray"),
    "colour": ([flat(200, np.uint8, (HEIGHT, WIDTH, 3))], "3-channel"),
    "another size": ([flat(1, shape=(24, 32))], "32×24"),
    "second of another size": ([flat(1), flat(1, shape=(24, 32))], "frames of one size"),
    "no reading": ([flat(0), flat(0)], "no pixel of 2 frames"),
}


@pytest.mark.parametrize("case", BAD_FRAMES)
def test_bad_depth_frames(tmp_path, case):
    frames, words = BAD_FRAMES[case]
    folder = write_folder(tmp_path / "a", depth=frames)
    with pytest.raises(CaptureError, match=words) as caught:
        open_capture(folder)
    assert_one_line_naming(caught.value, folder / "depth")


def test_damaged_files(tmp_path):
    folder = write_folder(tmp_path / "a")
    frame = folder / "depth" / "000001.png"
    good = frame.read_bytes()

    def refused(words):
        with pytest.raises(CaptureError, match=words) as caught:
            open_capture(folder)
        assert_one_line_naming(caught.value, folder)

    frame.write_bytes(good[: len(good) // 2])
    refused("truncated")
    frame.write_bytes(forged(100_000, 100_000))
    refused("no size")
    frame.write_bytes(good)
    write_png(folder / "color" / "000000.png", np.zeros((10, 10, 3), np.uint8))
    refused("10×10.*align colour")
    (folder / "color" / "000000.png").write_bytes(b"JFIF")
    refused("not a PNG")
    (folder / "intrinsic.json").unlink()
    refused("is missing")


def test_a_frame_larger_than_memory_is_not_begun(tmp_path):
    side = 16384
    content = intrinsic_with(width=side, height=side, intrinsic_matrix=[side, 0, 0, 0, side, 0, side / 2, side / 2, 1])
    folder = write_folder(tmp_path / "a", depth=[], intrinsic=content)
    (folder / "depth" / "0.png").write_bytes(forged(side, side))
    with pytest.raises(CaptureError, match="no size"):
        open_capture(folder)


def forged(width, height):
    """A PNG of a few bytes whose header promises much."""
    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def mirror(**entry):
    return {"mirrors": [{"name": "right"} | entry]}


def plane(point, normal):
    return mirror(plane={"point": point, "normal": normal})


BAD_MIRRORS = {
    "not json": ('{"mirrors": [}', "line 1"),
    "a list": ([], "must be a JSON object"),
    "no list": ({"mirrors": {}}, "must be a JSON object"),
    "a number": ({"mirrors": [7]}, "mirror 1 must be"),
    "neither": (mirror(), "either frame_pixels or plane"),
    "both": (mirror(frame_pixels=PICKS, plane={}), "either frame_pixels or plane"),
    "two picks": (mirror(frame_pixels=PICKS[:2]), "2 different picks"),
    "one pick thrice": (mirror(frame_pixels=[[5, 5]] * 3), "1 different pick;"),
    "no picks": (mirror(frame_pixels=[]), "0 different picks"),
    "words": (mirror(frame_pixels=[*PICKS, ["a", 2]]), "pick 5 must be two finite numbers"),
    "null": (mirror(frame_pixels=None), "must be a list"),
    "three numbers": (mirror(frame_pixels=[[1, 2, 3]] * 3), "pick 1 must be"),
    "nan": ('{"mirrors": [{"frame_pixels": [[1, 2], [NaN, 4], [5, 6]]}]}', "pick 2 must be"),
    "outside": (mirror(frame_pixels=[*PICKS, [WIDTH - 0.4, 3]]), "outside the 64×48 image"),
    "flat normal": (plane([0, 0, 1], [0, 0, 0]), "normal is zero"),
    "short point": (plane([0, 0], [0, 0, 1]), "plane must be"),
    "plane in words": (mirror(plane="left wall"), "plane must be"),
    "same name": ({"mirrors": [{"name": "a", "frame_pixels": PICKS}] * 2}, "its own name"),
    "odd name": (mirror(frame_pixels=PICKS, name="\x1b[2J"), "printable"),
    "too many": ({"mirrors": [{"frame_pixels": PICKS}] * 101}, "at most 100"),
}


@pytest.mark.parametrize("case", BAD_MIRRORS)
def test_bad_mirrors(tmp_path, case):
    content, words = BAD_MIRRORS[case]
    folder = write_folder(tmp_path / "a", mirrors=content)
    with pytest.raises(MirrorError, match=words) as caught:
        open_capture(folder)
    assert_one_line_naming(caught.value, folder / "mirrors.json")


def test_mirrors_without_names_are_counted(tmp_path):
    (tmp_path / "m.json").write_text(json.dumps({"mirrors": [{"frame_pixels": PICKS}] * 2}))
    assert [m.name for m in read_mirrors(tmp_path / "m.json")] == ["mirror 1", "mirror 2"]
    with pytest.raises(MirrorError, match="cannot be read"):
        read_mirrors(tmp_path / "nowhere.json")


@pytest.mark.parametrize("make", ["missing", "empty", "file"])
def test_what_is_no_capture(tmp_path, make):
    path = tmp_path / "a"
    if make == "empty":
        path.mkdir()
    elif make == "file":
        path.write_text("hello")
    with pytest.raises(CaptureError, match="no such file" if make == "missing" else "is not a capture") as caught:
        open_capture(path)
    assert_one_line_naming(caught.value, path)


def assert_one_line_naming(error: MirrorScanError, path) -> None:
    text = str(error)
    assert str(path) in text
    assert "\n" not in text
    assert len(text) < 400 + len(str(path))


def test_depth_frames_are_decoded_as_openimageio_does(tmp_path):
    """Each of PNG's filters, on smooth and on random pixels; what is not such a picture is left to OpenImageIO."""
    rng = np.random.default_rng(0)
    smooth = (2000 + 3 * np.arange(WIDTH) + 7 * np.arange(HEIGHT)[:, None]).astype(np.uint16)

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    def png(body, bits=16, interlace=0):
        header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, bits, 0, 0, 0, interlace)
        half = len(body) // 2
        parts = (b"IHDR", header), (b"tEXt", b"a\0b"), (b"IDAT", body[:half]), (b"IDAT", body[half:]), (b"IEND", b"")
        return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)

    path = tmp_path / "a.png"
    out = np.empty((HEIGHT, WIDTH), np.float32)
    for image in (smooth, rng.integers(0, 65536, smooth.shape).astype(np.uint16)):
        bytes_of = image.astype(">u2").view(np.uint8).astype(int)
        left, above, corner = (np.zeros_like(bytes_of) for _ in range(3))
        left[:, 2:], above[1:], corner[1:, 2:] = bytes_of[:, :-2], bytes_of[:-1], bytes_of[:-1, :-2]
        guess = left + above - corner
        misses = [np.abs(guess - n) for n in (left, above, corner)]
        paeth = np.choose(np.argmin(misses, axis=0), (left, above, corner))  # argmin takes the first, as PNG does
        filtered = [bytes_of - p for p in (0 * left, left, above, (left + above) // 2, paeth)]
        rows = [bytes([v % 5]) + (filtered[v % 5][v] % 256).astype(np.uint8).tobytes() for v in range(HEIGHT)]
        data = png(zlib.compress(b"".join(rows)))
        path.write_bytes(data)
        np.testing.assert_array_equal(read_image(path), image)
        assert decode_metres(data, 1000.0, out)
        np.testing.assert_array_equal(out, image / np.float32(1000))
        assert not decode_metres(data, 1000.0, np.empty((HEIGHT, WIDTH + 1), np.float32))
    body = b"".join(rows)
    for bad in (png(zlib.compress(body), bits=8), png(zlib.compress(body), interlace=1), png(zlib.compress(body[:-1])),
                png(zlib.compress(body + b"x")), png(b"nothing"), png(zlib.compress(b"\x05" + body[1:]))):  # fmt: skip
        assert not decode_metres(bad, 1000.0, out)


def test_what_the_system_refuses_is_named(tmp_path, monkeypatch):
    """Not by taking permissions away, which the superuser does not notice."""
    folder = write_folder(tmp_path / "a")
    read = Path.read_bytes

    def guarded(path):
        if path.name == "000001.png":
            raise PermissionError(13, "Permission denied", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", guarded)
    with pytest.raises(CaptureError, match="000001.png: cannot be read: Permission denied"):
        open_capture(folder)


def test_links_in_a_circle(tmp_path):
    (tmp_path / "a").mkdir()
    for link, target in (("a/a", "../a"), ("a/depth", "."), ("self", "self")):
        (tmp_path / link).symlink_to(target)
    for path in ("a", "self"):
        with pytest.raises(CaptureError, match=path):
            open_capture(tmp_path / path)
