"""RGB-D folders: what is written comes back; what is wrong is told in one line that names the file."""

from __future__ import annotations

import json
import math
import struct
import zlib

import numpy as np
import pytest
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.folders.rgbd_folder import read_mirrors
from mirror_scan.core.errors import CaptureError, MirrorError
from mirror_scan.core.io.images import write_png
from writers import HEIGHT, MATRIX, WIDTH, assert_one_line_naming, write_folder

PICKS = [[5, 5], [5.5, 40], [20, 22.25], [-0.5, 47.5]]


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
    about = {"width": 10, "height": 10, "intrinsic_matrix": [9, 0, 0, 0, 9, 0, 4.5, 4.5, 1]}
    turn = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0.01, 0.02, 0, 1]
    for place, message in (
        ([1, 2], "color_intrinsic.json: depth_to_color must be sixteen finite numbers"),
        ([*turn[:15], "x"], "must be sixteen finite numbers"),
        (np.reshape(turn, (4, 4)).T.ravel().tolist(), "is written row by row"),
        (np.reshape(turn, (4, 4)).tolist(), "is written column by column"),
        ([*(2 * np.eye(4)).ravel()[:15].tolist(), 1], "not a rotation and a shift"),
        ([-1, *turn[1:]], "not a rotation and a shift"),
        ([*turn[:12], 32.0, 1.0, 0, 1], "in metres"),
    ):
        (folder / "color_intrinsic.json").write_text(json.dumps(about | {"depth_to_color": place}))
        refused(message)
    other = {"width": 20, "height": 20, "intrinsic_matrix": [18, 0, 0, 0, 18, 0, 9.5, 9.5, 1]}
    (folder / "color_intrinsic.json").write_text(json.dumps(other))
    refused("is for 20×20 pixels, 000000.png has 10×10")
    (folder / "color_intrinsic.json").write_text("[]")
    refused("color_intrinsic.json: must be a JSON object")
    (folder / "color_intrinsic.json").unlink()
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


def large(folder, width, height, about=None):
    """The folder with a ramp of colour of another size, and what ``color_intrinsic.json`` says of it."""
    v, u = np.mgrid[:height, :width]
    color = np.stack((u * 255 // width, v * 255 // height, 0 * u), axis=-1).astype(np.uint8)
    write_png(folder / "color" / "000000.png", color)
    if about is not None:
        (folder / "color_intrinsic.json").write_text(json.dumps(about))
    return color


def test_larger_colour_alone_is_aligned_and_scaled(tmp_path):
    """Each pixel of depth has the mean of the pixels it covers, and a note says what was assumed."""
    folder = write_folder(tmp_path / "a")
    color = large(folder, 4 * WIDTH, 4 * HEIGHT)
    capture = open_capture(folder)
    expected = color.reshape(HEIGHT, 4, WIDTH, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(capture.color, expected, atol=0.5 + 1e-9)
    assert capture.notes == (
        "colour of 256×192 pixels is taken as aligned to depth of 64×48, only larger: nothing says where its camera is",
    )
    large(folder, 4 * WIDTH, 3 * HEIGHT)
    with pytest.raises(CaptureError, match="256×144 pixels, but depth has 64×48.*write color_intrinsic.json"):
        open_capture(folder)


def test_an_aligned_camera_in_its_file_is_no_assumption(tmp_path):
    folder = write_folder(tmp_path / "a")
    large(folder, 128, 96)
    assumed = open_capture(folder)
    matrix = [120.0, 0, 0, 0, 122.0, 0, 63.5, 47.5, 1]
    about = {"width": 128, "height": 96, "intrinsic_matrix": matrix, "depth_to_color": np.eye(4).ravel().tolist()}
    large(folder, 128, 96, about)
    capture = open_capture(folder)
    np.testing.assert_array_equal(capture.color, assumed.color)
    assert capture.notes == ()
    (folder / "color_intrinsic.json").write_text(json.dumps({k: about[k] for k in list(about)[:3]}))
    assert [note for note in open_capture(folder).notes if "taken to be where the depth camera is" in note]


def test_a_camera_of_another_size_than_aligned_colour_is_left_alone(tmp_path):
    folder = write_folder(tmp_path / "a")
    plain = open_capture(folder)
    matrix = [120.0, 0, 0, 0, 122.0, 0, 60, 50, 1]
    (folder / "color_intrinsic.json").write_text(
        json.dumps({"width": 128, "height": 96, "intrinsic_matrix": matrix, "depth_to_color": [1, 0, 0, 0] * 4})
    )
    with pytest.raises(CaptureError, match="depth_to_color"):
        open_capture(folder)
    (folder / "color_intrinsic.json").write_text(json.dumps({"width": 128, "height": 96, "intrinsic_matrix": matrix}))
    capture = open_capture(folder)
    np.testing.assert_array_equal(capture.color, plain.color)
    assert [note for note in capture.notes if "is for 128×96 pixels, 000000.png has 64×48, as depth" in note]


def test_rows_of_a_pose_may_be_nested(tmp_path):
    folder = write_folder(tmp_path / "a")
    pose = np.array([[0.0, -1, 0, 0.01], [1, 0, 0, 0.02], [0, 0, 1, 0.03], [0, 0, 0, 1]])
    about = {"width": 128, "height": 96, "intrinsic_matrix": [120.0, 0, 0, 0, 122.0, 0, 60, 50, 1]}
    for value in (pose.tolist(), pose.T.ravel().tolist()):
        large(folder, 128, 96, about | {"depth_to_color": value})
        found = open_capture(folder, options=ReadOptions(native_color=True))
        np.testing.assert_array_equal(found.depth_to_color, pose)
