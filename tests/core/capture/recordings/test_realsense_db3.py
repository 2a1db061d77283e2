"""RealSense .db3 files, by a writer of our own and by RealSense's own recorder."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.recordings import realsense_bag, realsense_db3
from writers import COLOR, DEPTH, METRES, assert_camera


def test_realsense_db3(tmp_path):
    frames = [DEPTH, np.where(DEPTH > 0, DEPTH + 7, 0).astype(np.uint16)]
    capture = open_capture(writers.realsense_db3(tmp_path / "a.db3", frames, COLOR, unit=0.0005))
    np.testing.assert_allclose(capture.depth, np.array(frames) * 0.0005, rtol=1e-6)
    assert_camera(capture.intrinsics, 60, 61, 32, 24)
    assert (capture.sensor, capture.format) == ("realsense_d435", "RealSense .db3")
    np.testing.assert_array_equal(capture.color[DEPTH > 0], COLOR[DEPTH > 0])


def test_a_recording_by_the_realsense_sdk(tmp_path):
    """Its software device plays a known scene into its own recorder.

    Skipped, too, where the library is there but not libusb, which it links to."""
    rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)
    device, profiles = rs.software_device(), {}
    for name, kind, pixel, size, uid in (("Depth", "depth", "z16", 2, 1), ("Color", "color", "rgb8", 3, 2)):
        intrinsics = rs.intrinsics()
        intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = (
            64,
            48,
            60.0,
            61.0,
            31.0,
            23.0,
        )
        intrinsics.model, intrinsics.coeffs = rs.distortion.brown_conrady, [0.0] * 5
        stream = rs.video_stream()
        stream.type, stream.fmt = getattr(rs.stream, kind), getattr(rs.format, pixel)
        stream.uid, stream.index, stream.width, stream.height, stream.fps, stream.bpp = uid, 0, 64, 48, 30, size
        stream.intrinsics = intrinsics
        sensor = device.add_sensor(name)
        profiles[name] = sensor, sensor.add_video_stream(stream)
    profiles["Depth"][0].add_read_only_option(rs.option.depth_units, 0.001)
    angle = 0.05
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    place = rs.extrinsics()
    place.rotation, place.translation = turn.T.ravel().tolist(), [0.015, 0.002, -0.003]
    profiles["Depth"][1].register_extrinsics_to(profiles["Color"][1], place)
    try:
        path = tmp_path / "sdk.db3"
        recorder = rs.recorder(str(path), device)
    except RuntimeError:  # before 2.57 it wrote .bag
        path = tmp_path / "sdk.bag"
        recorder = rs.recorder(str(path), device)
    sensors, queue = recorder.query_sensors(), rs.frame_queue(20)
    for sensor, (_, profile) in zip(sensors, profiles.values(), strict=True):
        sensor.open(profile)
        sensor.start(queue)
    for name, pixels in (("Depth", DEPTH), ("Color", COLOR)):
        frame = rs.software_video_frame()
        frame.pixels = np.ascontiguousarray(pixels)
        frame.stride, frame.bpp = pixels.strides[0], pixels.strides[1]
        frame.timestamp, frame.frame_number, frame.domain = 1.0, 1, rs.timestamp_domain.hardware_clock
        frame.profile = profiles[name][1].as_video_stream_profile()
        profiles[name][0].on_video_frame(frame)
        queue.wait_for_frame(5000)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    recorder.pause()
    del recorder, sensors, sensor
    reader = realsense_db3 if path.suffix == ".db3" else realsense_bag
    stored = reader.read(path, None, ReadOptions())
    np.testing.assert_array_equal(stored.depth[0], METRES)
    np.testing.assert_array_equal(stored.color, COLOR)
    np.testing.assert_allclose(stored.depth_to_color[:3, :3], turn, atol=1e-6)
    np.testing.assert_allclose(stored.depth_to_color[:3, 3], (0.015, 0.002, -0.003), atol=1e-6)
    assert_camera(stored.color_intrinsics, 60, 61, 31, 23)
    assert open_capture(path).color.shape == (48, 64, 3)
