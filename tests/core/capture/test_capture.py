"""The colour camera's own pixels: each reader keeps them where it is asked to, and says truly where they were taken."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import project, unproject
from mirror_scan.core.camera.image_registration import first_readings
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.camera_poses import open_posed_captures
from mirror_scan.core.capture.capture_summary import words
from mirror_scan.core.capture.rgbd_writer import write_folder
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.io.images import write_png
from scipy.ndimage import map_coordinates
from writers import DEPTH, jpeg, saved

SHIFT = (-0.032, 0.004, 0.002)


def smooth(width, height):
    """A colour image without fine detail (H, W, 3) uint8, the same picture at any size."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    waves = 90 + 60 * u + 40 * v, 200 - 120 * u, 128 + 80 * np.sin(3 * u) * np.cos(2 * v)
    return np.rint(np.stack(waves, axis=-1)).astype(np.uint8)


def slope(width=64, height=48):
    """Depth (H, W) uint16 [mm] of one slanted surface with a few gaps."""
    v, u = np.mgrid[:height, :width]
    depth = 1500 + 200 * u // width + 150 * v // height
    depth[:, width // 3] = 0
    return depth.astype(np.uint16)


def with_lens(folder, name, intrinsics=writers.CAMERA):
    fx, fy, cx, cy = intrinsics
    content = {"width": 64, "height": 48, "intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1]}
    (folder / name).write_text(json.dumps(content))


def rgbd(folder, color, about=None, distortion=None):
    (folder / "depth").mkdir(parents=True)
    (folder / "color").mkdir()
    write_png(folder / "depth" / "0.png", slope())
    write_png(folder / "color" / "0.png", color)
    with_lens(folder, "intrinsic.json")
    if about is not None:
        height, width = color.shape[:2]
        matrix = [62.0 * width / 64, 0, 0, 0, 61.0 * width / 64, 0, width / 2 - 3, height / 2 + 2, 1]
        content = {"width": width, "height": height, "intrinsic_matrix": matrix, **about}
        content |= {} if distortion is None else {"distortion": distortion}
        (folder / "color_intrinsic.json").write_text(json.dumps(content))
    return folder


def column_major(shift):
    return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *shift, 1]


def stray_with_video(folder, color):
    av = pytest.importorskip("av")
    writers.stray(folder, [slope()], np.full((48, 64), 2, np.uint8), down=(1.0, 0.0, 0.0))
    with av.open(str(folder / "rgb.mp4"), "w") as video:
        stream = video.add_stream("libx264", 30, {"crf": "0"})
        stream.height, stream.width, stream.pix_fmt = *color.shape[:2], "yuv444p"
        for packet in (*stream.encode(av.VideoFrame.from_ndarray(color)), *stream.encode()):
            video.mux(packet)
    return folder


def record3d(folder, color):
    pytest.importorskip("liblzfse")
    return saved(folder, "a.r3d", writers.r3d([slope() / np.float32(1000)], jpeg(folder, color)))


def grabber(folder, color):
    folder.mkdir()
    (folder / "s_depth.pclzf").write_bytes(writers.pclzf(slope(), "depth16"))
    (folder / "s_rgb.pclzf").write_bytes(writers.pclzf(color, "rgb24"))
    (folder / "s.xml").write_text(writers.pclzf_xml(61.0, 32.0, 24.0))
    return folder


def lone_image(folder, color, about=None):
    rgbd(folder, color, about)
    (folder / "depth" / "0.png").rename(folder / "x_depth.png")
    (folder / "color" / "0.png").rename(folder / "x_color.png")
    return folder / "x_depth.png"


def ours(path, color):
    folder = rgbd(path.with_suffix(""), color, {"depth_to_color": column_major(SHIFT)})
    write_npz(path, open_capture(folder, options=ReadOptions(native_color=True)))
    return path


BIG, SAME = smooth(256, 192), smooth(64, 48)
CLOUD = writers.cloud_of(np.maximum(slope(160, 120), 1600), 150.0, 150.0, 80.0, 59.5)
#: Name -> a file or folder made in a folder, and whether its colour camera's pixels are not those on depth's grid.
MADE = {
    "azure": (lambda p: saved(p, "a.mkv", writers.mkv(
        [slope(320, 288)], np.insert(smooth(640, 480)[..., ::-1], 3, 255, axis=2).tobytes(), writers.calibration(),
        color_size=(640, 480))), True),
    "bag": (lambda p: saved(p, "a.bag", writers.realsense_bag([slope()], BIG, color_shift=SHIFT)), True),
    "distorted bag": (lambda p: saved(p, "a.bag", writers.realsense_bag(
        [slope()], BIG, intrinsics=(0.08, -0.02, 0.001, -0.001, 0), color_shift=SHIFT)), True),
    "db3": (lambda p: writers.realsense_db3(p / "a.db3", [slope()], BIG, color_shift=SHIFT), True),
    "oni": (lambda p: saved(p, "a.oni", writers.oni([slope()], jpeg(p, BIG), color_codec=b"JPEG")), True),
    "mirrored oni": (lambda p: saved(p, "a.oni", writers.oni(
        [slope()], jpeg(p, BIG), color_codec=b"JPEG", properties=[writers.oni_number("xnMirror", 1)])), True),
    "record3d": (lambda p: record3d(p, BIG), True),
    "stray": (lambda p: stray_with_video(p / "a", BIG), True),
    "npz": (lambda p: ours(p / "a.npz", BIG), True),
    "folder with its camera": (lambda p: rgbd(p / "a", BIG, {"depth_to_color": column_major(SHIFT)}), True),
    "folder with a lens": (lambda p: rgbd(
        p / "a", BIG, {"depth_to_color": column_major(SHIFT)}, [-0.05, 0.01, 0.001, -0.0005, 0.002]), True),
    "folder of larger colour": (lambda p: rgbd(p / "a", BIG), True),
    "folder of a smaller camera": (lambda p: rgbd(p / "a", SAME, {"depth_to_color": column_major(SHIFT)}), True),
    "lone image with its camera": (
        lambda p: lone_image(p / "a", BIG, {"depth_to_color": column_major(SHIFT)}), True),
    "grabber": (lambda p: grabber(p / "a", BIG), True),
    "sun": (lambda p: writers.sun(p / "a", slope(), BIG), True),
    "folder": (lambda p: rgbd(p / "a", SAME), False),
    "lone image": (lambda p: lone_image(p / "a", SAME), False),
    "tum": (lambda p: writers.tum(p / "a", [slope(640, 480)], smooth(640, 480)), False),
    "fakenect": (lambda p: writers.fakenect(
        p / "a", [np.full((480, 640), 700, np.uint16)], smooth(640, 480), (120.0, 0.1042, 7.5, 2.3, 200)), True),
    "pcd": (lambda p: saved(p, "a.pcd", writers.pcd(CLOUD, smooth(160, 120), "binary")), False),
    "ply": (lambda p: saved(p, "a.ply", writers.ply(CLOUD, smooth(160, 120))), False),
}  # fmt: skip


def assert_sees_alike(capture, within=3.0, share=0.99):
    """Readings, taken through ``depth_to_color`` into native colour, have there the colour that is aligned to depth."""
    native, camera, pose = capture.native_color, capture.color_intrinsics, capture.depth_to_color
    assert camera.is_pinhole and native.shape == (camera.height, camera.width, 3) and native.dtype == np.uint8
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6)
    assert np.linalg.det(pose[:3, :3]) > 0
    depth = first_readings(capture.depth)
    known = (depth > 0) & capture.color.any(axis=-1)
    points = unproject(depth, capture.intrinsics)[known] @ pose[:3, :3].T + pose[:3, 3]
    u, v = project(points, camera).T
    inside = (u > 1) & (v > 1) & (u < camera.width - 2) & (v < camera.height - 2)
    assert inside.mean() > 0.6
    seen = np.stack([map_coordinates(native[..., c].astype(float), (v, u), order=1) for c in range(3)], axis=-1)
    miss = np.abs(seen - capture.color[known]).max(axis=-1)[inside]
    assert (miss <= within).mean() >= share, np.percentile(miss, (50, 90, 99, 100))


@pytest.mark.parametrize("name", MADE)
def test_each_reader_keeps_native_colour_and_says_where_it_was_taken(tmp_path, name):
    make, other = MADE[name]
    path = make(tmp_path)
    plain, kept = open_capture(path), open_capture(path, options=ReadOptions(native_color=True))
    assert (plain.native_color, plain.color_intrinsics, plain.depth_to_color) == (None, None, None)
    for field in ("depth", "color", "confidence"):
        np.testing.assert_array_equal(getattr(kept, field), getattr(plain, field))
    assert (kept.intrinsics, kept.notes) == (plain.intrinsics, plain.notes)
    assert (kept.native_color is not kept.color) == other
    assert_sees_alike(kept)
    moved = open_capture(path, options=ReadOptions(native_color=True, turn_degrees=90, mirrored=not kept.mirrored))
    assert (moved.native_color is not moved.color) == other
    assert_sees_alike(moved)
    without = open_capture(path, options=ReadOptions(native_color=True, color=False))
    assert (without.color, without.native_color, without.color_intrinsics, without.depth_to_color) == (None,) * 4


def test_native_colour_without_distortion_is_what_was_stored(tmp_path):
    for name, stored in (("bag", BIG), ("db3", BIG), ("folder with its camera", BIG), ("folder of larger colour", BIG),
                         ("sun", BIG), ("grabber", BIG), ("npz", BIG)):  # fmt: skip
        (tmp_path / name).mkdir()
        capture = open_capture(MADE[name][0](tmp_path / name), options=ReadOptions(native_color=True))
        np.testing.assert_array_equal(capture.native_color, stored)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
@pytest.mark.parametrize("name", ["azure", "npz", "folder of larger colour", "folder"])
def test_what_was_opened_comes_back_from_a_file_and_a_folder(tmp_path, name, degrees):
    options = ReadOptions(native_color=True)
    capture = open_capture(MADE[name][0](tmp_path), options=replace(options, turn_degrees=degrees))
    write_npz(tmp_path / "again.npz", capture)
    again = open_capture(tmp_path / "again.npz", options=options)
    np.testing.assert_array_equal(again.color, capture.color)
    assert open_capture(tmp_path / "again.npz").native_color is None
    write_folder(tmp_path / "written", capture)
    folder = open_capture(tmp_path / "written", options=options)
    near = capture.depth[0] > 0
    changed = 3 if name == "azure" else 0  # there colour was aligned before its lens was straightened
    assert np.abs(folder.color[near].astype(int) - capture.color[near]).max() <= changed
    assert (tmp_path / "written" / "color_intrinsic.json").is_file() == MADE[name][1]
    for found in (again, folder):
        np.testing.assert_array_equal(found.native_color, capture.native_color)
        np.testing.assert_array_equal(found.depth_to_color, capture.depth_to_color)
        assert found.color_intrinsics == capture.color_intrinsics
        assert_sees_alike(found)


def test_fine_stripes_stay_sharp_when_a_lens_is_straightened(tmp_path):
    """Stripes of four pixels across a mild lens: at least four fifths of their contrast are left in the middle."""
    stripes = np.zeros((192, 256, 3), np.uint8)
    stripes[:] = np.rint(128 + 100 * np.sin(np.arange(256) * np.pi / 2 + np.pi / 4))[None, :, None]
    path = rgbd(tmp_path / "a", stripes, {"depth_to_color": column_major(SHIFT)}, [-0.05, 0.01, 0, 0, 0])
    straight = open_capture(path, options=ReadOptions(native_color=True)).native_color
    middle = straight[80:110, 60:190, 0].astype(float)
    assert np.ptp(middle, axis=1).mean() > 0.8 * np.ptp(stripes)


def test_native_colour_is_that_of_the_first_frame_chosen(tmp_path):
    folder = rgbd(tmp_path / "a", BIG)
    write_png(folder / "depth" / "1.png", DEPTH)
    write_png(folder / "color" / "1.png", BIG[:, ::-1])
    chosen = open_capture(folder, "1:", ReadOptions(native_color=True))
    np.testing.assert_array_equal(chosen.native_color, BIG[:, ::-1])


def test_several_cameras_and_the_summary_know_of_it(tmp_path):
    for name in ("front", "back"):
        rgbd(tmp_path / name, BIG, {"depth_to_color": column_major(SHIFT)})
    pose = np.eye(4).tolist()
    cameras = [{"capture": name, "camera_to_world": pose} for name in ("front", "back")]
    (tmp_path / "poses.json").write_text(json.dumps({"cameras": cameras}))
    plain, _ = open_posed_captures([tmp_path])
    kept, _ = open_posed_captures([tmp_path], options=ReadOptions(native_color=True))
    for capture in kept:
        np.testing.assert_array_equal(capture.native_color, BIG)
        assert "  colour   64×48, aligned to depth; the colour camera's own 256×192" in words(capture)
    for capture in plain:
        assert capture.native_color is None and "  colour   64×48" in words(capture)
