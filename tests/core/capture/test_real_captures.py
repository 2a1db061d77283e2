"""Every real capture at hand decodes, and to the values an independent reader finds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.kinect_disparity import depth_of_disparity
from mirror_scan.core.capture.recordings.azure_mkv import calibrated

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the real captures are not on this machine")
PCD = ("five_people.pcd", "person.pcd", "milk_cartoon_all_small_clorox.pcd")
GRABBED = sorted(p.stem for p in (REAL / "pcl" / "grabber_sequences" / "pcd").glob("*.pcd"))


def camera_of(capture):
    camera = capture.intrinsics
    return camera.fx, camera.fy, camera.cx, camera.cy


def png16(path):
    """16-bit values by OpenCV."""
    cv2 = pytest.importorskip("cv2")
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def rgb_by_opencv(path):
    cv2 = pytest.importorskip("cv2")
    return cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1]


@pytest.mark.parametrize("name", PCD)
def test_point_clouds_of_pcl(name):
    open3d = pytest.importorskip("open3d")
    path = REAL / "pcl" / name
    capture = open_capture(path)
    cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    points = np.asarray(cloud.points).reshape(480, 640, 3)
    np.testing.assert_array_equal(capture.depth[0], np.nan_to_num(points[..., 2]).astype(np.float32))
    if len(cloud.colors):
        colors = np.rint(np.asarray(cloud.colors) * 255).reshape(480, 640, 3)
        np.testing.assert_array_equal(capture.color, colors)
    else:
        assert capture.color is None
    assert camera_of(capture) == (525, 525, 319.5, 239.5)
    v, u = np.nonzero(capture.depth[0])
    z = capture.depth[0][v, u].astype(float)
    np.testing.assert_allclose((u - 319.5) / 525 * z, points[v, u, 0], atol=2e-6)
    np.testing.assert_allclose((v - 239.5) / 525 * z, points[v, u, 1], atol=2e-6)


@pytest.mark.parametrize("name", GRABBED)
def test_one_frame_stored_three_ways(name):
    folder = REAL / "pcl" / "grabber_sequences"
    cloud = open_capture(folder / "pcd" / f"{name}.pcd")
    packed = open_capture(folder / "pclzf" / f"{name}_depth.pclzf")
    tiff = open_capture(folder / "tiff" / f"{name}_depth.tiff")
    np.testing.assert_array_equal(packed.depth, tiff.depth)
    np.testing.assert_array_equal(packed.color, tiff.color)
    np.testing.assert_array_equal(packed.depth[0], png16(folder / "tiff" / f"{name}_depth.tiff") / np.float32(1000))
    np.testing.assert_array_equal(packed.color, rgb_by_opencv(folder / "tiff" / f"{name}_rgb.tiff"))
    assert camera_of(cloud) == camera_of(packed) == (525, 525, 320, 240)
    both = (cloud.depth > 0) & (packed.depth > 0)
    assert both.mean() > 0.5
    np.testing.assert_allclose(cloud.depth[both], packed.depth[both], atol=1e-6)


def test_a_folder_of_the_grabber_is_a_burst():
    capture = open_capture(REAL / "pcl" / "grabber_sequences" / "pclzf")
    assert capture.depth.shape == (3, 480, 640) and camera_of(capture) == (525, 525, 320, 240)


def test_tum_and_sun_images():
    folder = REAL / "open3d_other"
    tum = open_capture(folder / "TUM_depth.png")
    np.testing.assert_allclose(tum.depth[0], png16(folder / "TUM_depth.png") / 5000, rtol=1e-6)
    np.testing.assert_array_equal(tum.color, rgb_by_opencv(folder / "TUM_color.png"))
    sun = open_capture(folder / "SUN_depth.png")
    stored = png16(folder / "SUN_depth.png")
    np.testing.assert_allclose(sun.depth[0], ((stored >> 3) | (stored << 13)) / 1000, rtol=1e-6)
    open3d = pytest.importorskip("open3d")
    read = open3d.io.read_image
    for made, name, capture in (("tum", "TUM", tum), ("sun", "SUN", sun)):
        make = getattr(open3d.geometry.RGBDImage, f"create_from_{made}_format")
        suffix = "png" if name == "TUM" else "jpg"
        theirs = make(read(str(folder / f"{name}_color.{suffix}")), read(str(folder / f"{name}_depth.png")))
        depth = np.asarray(theirs.depth)
        known = depth > 0  # Open3D leaves out what is beyond its limit
        assert known.mean() > 0.5
        np.testing.assert_allclose(capture.depth[0][known], depth[known], atol=2e-6)


def test_raw_disparity_of_nyu():
    path = REAL / "open3d_other" / "NYU_depth.pgm"
    raw = np.frombuffer(path.read_bytes()[-614400:], "<u2").reshape(480, 640)
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], depth_of_disparity()[np.minimum(raw, 2047)])
    assert capture.sensor == "kinect_v1" and capture.color.shape == (480, 640, 3)
    linear = open_capture(path, options=ReadOptions(disparity="linear")).depth[0]
    known = (raw < 1000) & (raw > 300)
    np.testing.assert_allclose(linear[known], 1 / (-0.0030711016 * raw[known] + 3.3309495161), rtol=1e-6)


def test_azure_recording_against_pyav():
    av = pytest.importorskip("av")
    path = REAL / "azure_mkv" / "recording.mkv"
    with av.open(str(path)) as video:
        stream = next(s for s in video.streams.video if s.metadata.get("title") == "DEPTH")
        theirs = [frame.to_ndarray() for frame in video.decode(stream)]
    np.testing.assert_array_equal(theirs[0], png16(REAL / "azure_mkv" / "frame0_depth.png"))
    from mirror_scan.core.capture.recordings import azure_mkv

    stored = azure_mkv.read(path, None, ReadOptions())
    np.testing.assert_array_equal(stored.depth, np.array(theirs) / np.float32(1000))
    assert np.abs(stored.color.astype(int) - rgb_by_opencv(REAL / "azure_mkv" / "frame0_color.jpg")).max() <= 3
    opened = open_capture(path)
    assert opened.intrinsics.is_pinhole and opened.color.shape[:2] == opened.depth.shape[1:]
    # straightening neither loses readings nor moves them in depth
    assert (opened.depth > 0).sum() / (stored.depth > 0).sum() > 1
    for share in (5, 25, 50, 75, 95):
        before, after = (np.percentile(d[d > 0], share) for d in (stored.depth, opened.depth))
        assert abs(before - after) < 0.12


def test_azure_calibration_meets_the_checked_unit():
    content = json.loads((REAL / "azure_mkv" / "calibration.json").read_text())
    depth, color, pose = calibrated(content, (640, 576), (1280, 720))
    parameters = content["CalibrationInformation"]["Cameras"][1]["Intrinsics"]["ModelParameters"]
    np.testing.assert_allclose((color.cx, color.cy), (parameters[0] * 1280 - 0.5, parameters[1] * 960 - 120.5))
    np.testing.assert_allclose((depth.cx, depth.cy), (0.51296979 * 1024 - 192.5, 0.51692355 * 1024 - 180.5), atol=1e-4)
    np.testing.assert_allclose(pose[:3, 3], (-0.032083, -0.002205, 0.003884), atol=1e-6)


@pytest.mark.parametrize("name", ["45", "686"])
def test_rooms_with_mirrors(name):
    folder = REAL / "nyu_mirrors" / "raw_sensorD"
    intrinsics = Intrinsics(608, 456, 519.0, 519.0, 303.5, 227.5)
    capture = open_capture(folder / f"{name}.png", options=ReadOptions(intrinsics=intrinsics))
    np.testing.assert_array_equal(capture.depth[0], png16(folder / f"{name}.png") / np.float32(1000))


def test_azure_depth_alone_is_straightened_by_published_values():
    capture = open_capture(REAL / "azure_mkv" / "frame0_depth.png")
    assert capture.sensor == "azure_kinect" and capture.intrinsics.is_pinhole
    assert any("published" in note for note in capture.notes)
