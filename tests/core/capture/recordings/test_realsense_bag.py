"""RealSense .bag files, by a writer of our own and by an independent library."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.pinhole import distort, undistort
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.recordings.realsense_bag import brown_of_inverse
from writers import COLOR, DEPTH, METRES, assert_camera, saved


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
@pytest.mark.parametrize("indexed", [True, False])
def test_realsense_bag(tmp_path, compression, indexed):
    if compression == "lz4":
        pytest.importorskip("lz4.frame")
    frames = [DEPTH, np.where(DEPTH > 0, DEPTH + 7, 0).astype(np.uint16)]
    data = writers.realsense_bag(frames, COLOR, compression, unit=0.00025, indexed=indexed)
    path = saved(tmp_path, "a.bag", data)
    capture = open_capture(path)
    np.testing.assert_allclose(capture.depth, np.array(frames) * 0.00025, rtol=1e-6)
    assert_camera(capture.intrinsics, 60, 61, 32, 24)
    assert (capture.sensor, capture.format) == ("realsense_d455", "RealSense .bag")
    inside = DEPTH > 0
    np.testing.assert_array_equal(capture.color[inside], COLOR[inside])


def test_a_ros_bag_by_the_rosbags_library(tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    make = store.types
    header = make["std_msgs/msg/Header"](0, make["builtin_interfaces/msg/Time"](0, 0), "camera")
    roi = make["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    info = make["sensor_msgs/msg/CameraInfo"](
        header, 48, 64, "plumb_bob", np.zeros(5), np.array([60.0, 0, 31, 0, 61, 23, 0, 0, 1]), np.eye(3).ravel(),
        np.zeros(12), 0, 0, roi,
    )  # fmt: skip
    image = make["sensor_msgs/msg/Image"]
    topics = "/camera/aligned_depth_to_color", "/camera/color"
    path = tmp_path / "ros.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer as bag:
        for topic, pixels, encoding in ((topics[0], DEPTH, "16UC1"), (topics[1], COLOR, "bgr8")):
            kind = "sensor_msgs/msg/Image"
            connection = bag.add_connection(f"{topic}/image_raw", kind, typestore=store)
            raw = pixels.view(np.uint8).ravel()
            message = image(header, 48, 64, encoding, 0, len(raw) // 48, raw)
            bag.write(connection, 5, store.serialize_ros1(message, kind))
            kind = "sensor_msgs/msg/CameraInfo"
            connection = bag.add_connection(f"{topic}/camera_info", kind, typestore=store)
            bag.write(connection, 5, store.serialize_ros1(info, kind))
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], METRES)
    np.testing.assert_array_equal(capture.color, COLOR[..., ::-1])
    assert_camera(capture.intrinsics, 60, 61, 31, 23)


def test_inverse_lens_becomes_a_forward_one():
    camera = Intrinsics(640, 480, 390.0, 390.0, 320.0, 240.0)
    inverse = (-0.055, 0.066, -0.0008, 0.0006, -0.021)
    forward = brown_of_inverse(inverse, camera)
    v, u = np.mgrid[:480:20, :640:20]
    distorted = np.stack(((u - 320) / 390, (v - 240) / 390), axis=-1)
    ideal = distort(distorted, inverse)
    assert np.abs(distort(ideal, forward) - distorted).max() * 390 < 0.1
    np.testing.assert_allclose(undistort(distorted, forward), ideal, atol=3e-4)
