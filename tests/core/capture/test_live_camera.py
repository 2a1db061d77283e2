"""Live recording, against librealsense's own software device and against a camera made of arrays."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.camera import Intrinsics, project
from mirror_scan.core.camera.image_registration import straightened
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture import live_camera as recording
from mirror_scan.core.capture.live_camera import Stream, realsense_stream, record
from mirror_scan.core.errors import CaptureError, OutputError

WIDTH, HEIGHT = 64, 48
CAMERA = Intrinsics(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5)


def made_up(count=1000, camera=CAMERA):
    """Frame n shows a wall at 1 m + n mm, red growing with n."""

    def frames():
        for n in range(count):
            picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
            picture[..., 0] = n
            yield np.full((HEIGHT, WIDTH), 1 + n / 1000, np.float32), picture

    return Stream(camera, "realsense_d435", frames())


def test_a_burst_is_kept_after_the_camera_settled(tmp_path):
    said = []
    folder = record(made_up(), tmp_path / "scan", frames=4, settle=3, progress=lambda f, text: said.append((f, text)))
    capture = open_capture(folder)
    np.testing.assert_allclose(capture.depth[:, 0, 0], [1.003, 1.004, 1.005, 1.006], atol=1e-6)
    assert capture.color[0, 0].tolist() == [6, 0, 0] and capture.sensor == "realsense_d435"
    assert capture.intrinsics == CAMERA
    fractions = [f for f, _ in said]
    assert fractions == sorted(fractions) and fractions[-1] < 1 and "frame 4 of 4" in said[6][1]


def test_nothing_is_written_when_it_goes_wrong(tmp_path):
    for stream, words in ((made_up(5), "stopped after 2 of 4"), (made_up(0), "stopped after 0")):
        with pytest.raises(CaptureError, match=words):
            record(stream, tmp_path / "scan", 4, 3)
    dark = Stream(CAMERA, "unknown", iter([(np.zeros((HEIGHT, WIDTH), np.float32), None)] * 9))
    with pytest.raises(CaptureError, match="sees nothing"):
        record(dark, tmp_path / "scan", 4, 3)

    def stop(fraction, text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(made_up(), tmp_path / "scan", 4, 3, stop)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "holiday.jpg").touch()
    with pytest.raises(OutputError, match="exists already"):
        record(made_up(), tmp_path / "scan")
    with pytest.raises(OutputError, match="create it first"):
        record(made_up(), tmp_path / "no" / "scan")


def test_on_the_command_line_any_driver_can_be_entered(tmp_path, capsys, monkeypatch):
    import contextlib

    asked = []

    @contextlib.contextmanager
    def driver(size, rate, serial):
        asked.append((size, rate, serial))
        yield made_up()

    monkeypatch.setitem(recording.DRIVERS, "realsense", driver)
    words = ["record", str(tmp_path / "scan"), "--frames", "3", "--size", "640x480", "--rate", "15", "--serial", "7"]
    assert cli.main(words) == 0
    assert asked == [((640, 480), 15, "7")] and "3 frames" in capsys.readouterr().out
    assert len(open_capture(tmp_path / "scan").depth) == 3
    assert set(cli.CAMERAS) == set(recording.DRIVERS)
    assert cli.main([*words[:5], "640"]) == 2


class Software:
    """A RealSense that librealsense itself simulates: depth in 0.1 mm, colour by another lens 15 mm to its side."""

    def __init__(self, rs, depth_units=0.0001):
        self.rs, self.units, self.number = rs, depth_units, 0
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Intel RealSense D435I")
        self.sensors, self.profiles, self.lenses = [], [], []
        for uid, (stream, layout, size) in enumerate(
            ((rs.stream.depth, rs.format.z16, (WIDTH, HEIGHT)), (rs.stream.color, rs.format.rgb8, (96, 72)))
        ):
            intrinsics = rs.intrinsics()
            intrinsics.width, intrinsics.height = size
            intrinsics.fx = intrinsics.fy = 60.0 * size[0] / WIDTH
            intrinsics.ppx, intrinsics.ppy = size[0] / 2 - 0.5, size[1] / 2 - 0.5
            intrinsics.model, intrinsics.coeffs = rs.distortion.none, [0.0] * 5
            video = rs.video_stream()
            video.type, video.index, video.uid, video.fmt = stream, 0, uid, layout
            video.width, video.height, video.fps, video.bpp, video.intrinsics = *size, 30, 2 + uid, intrinsics
            sensor = self.device.add_sensor(("Depth", "Color")[uid])
            profile = rs.video_stream_profile(sensor.add_video_stream(video))
            if uid == 0:
                sensor.add_read_only_option(rs.option.depth_units, depth_units)
            self.sensors.append(sensor)
            self.profiles.append(profile)
            self.lenses.append(intrinsics)
        to_color = rs.extrinsics()
        to_color.rotation, to_color.translation = np.eye(3).ravel().tolist(), [-0.015, 0.0, 0.0]
        self.profiles[0].register_extrinsics_to(self.profiles[1], to_color)
        self.device.create_matcher(rs.matchers.default)
        self.syncer = rs.syncer()
        for sensor, profile in zip(self.sensors, self.profiles, strict=True):
            sensor.open(profile)
            sensor.start(self.syncer)

    def wait(self, depth, color):
        """Feed a frame of each stream and take what comes out together."""
        for sensor, profile, pixels in zip(self.sensors, self.profiles, (depth, color), strict=True):
            frame = self.rs.software_video_frame()
            frame.pixels = np.ascontiguousarray(pixels)
            frame.bpp = 2 if pixels.ndim == 2 else 3
            frame.stride = pixels.shape[1] * frame.bpp
            frame.timestamp, frame.domain = 33.0 * self.number, self.rs.timestamp_domain.hardware_clock
            frame.frame_number, frame.profile, frame.depth_units = self.number, profile, self.units
            sensor.on_video_frame(frame)
        self.number += 1
        return self.syncer.wait_for_frames(1000)

    def close(self):
        for sensor in self.sensors:
            sensor.stop()
            sensor.close()


def test_realsense_by_its_software_device(tmp_path):
    rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)
    camera = Software(rs)
    z = np.full((HEIGHT, WIDTH), 15000, np.uint16)  # a wall at 1.5 m, nearer on the right, with a hole
    z[:, 40:] = 12000
    z[10:14, 10:14] = 0
    color = np.zeros((72, 96, 3), np.uint8)
    color[..., 1] = np.arange(96)  # green tells the column of the colour camera

    def wait():
        while True:  # the syncer needs a frame or two before streams come together
            frames = camera.wait(z, color)
            if frames.get_depth_frame() and frames.get_color_frame():
                return frames

    try:
        stream = realsense_stream(wait, camera.lenses[0], camera.units, "Intel RealSense D435I")
        folder = record(stream, tmp_path / "scan", frames=2, settle=1)
    finally:
        camera.close()
    capture = open_capture(folder)
    assert capture.sensor == "realsense_d435" and capture.intrinsics == CAMERA
    np.testing.assert_allclose(capture.depth, np.broadcast_to(z / 10000.0, (2, HEIGHT, WIDTH)), atol=1e-6)
    for u, depth in ((20, 1.5), (50, 1.2)):  # by hand: u_color = 90 ((u - 31.5) / 60 - 0.015 / z) + 47.5
        expected = 90 * ((u - 31.5) / 60 - 0.015 / depth) + 47.5
        assert abs(int(capture.color[30, u, 1]) - expected) <= 1.5
    assert capture.color[12, 12].tolist() == [0, 0, 0], "no depth, no colour"


def test_the_colour_camera_s_own_pixels_by_the_software_device(tmp_path):
    """As the recording above, but for colour: stored as it came, and aligned when it is read."""
    rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)
    camera = Software(rs)
    z = np.full((HEIGHT, WIDTH), 15000, np.uint16)
    color = np.zeros((72, 96, 3), np.uint8)
    color[..., 1] = 2 * np.arange(96)

    def wait():
        while True:
            frames = camera.wait(z, color)
            if frames.get_depth_frame() and frames.get_color_frame():
                return frames

    try:
        to_color = camera.profiles[0].get_extrinsics_to(camera.profiles[1])
        stream = realsense_stream(wait, camera.lenses[0], camera.units, "D435I", (camera.lenses[1], to_color))
        folder = record(stream, tmp_path / "scan", frames=2, settle=1)
    finally:
        camera.close()
    capture = open_capture(folder, options=ReadOptions(native_color=True))
    np.testing.assert_array_equal(capture.native_color, color)
    assert capture.color_intrinsics == Intrinsics(96, 72, 90.0, 90.0, 47.5, 35.5)
    np.testing.assert_allclose(capture.depth_to_color[:3], np.eye(4)[:3] + np.eye(3, 4, 3) * ((-0.015,), (0,), (0,)))
    expected = 2 * (90 * ((30 - 31.5) / 60 - 0.015 / 1.5) + 47.5)
    assert abs(int(capture.color[30, 30, 1]) - expected) <= 1
    lens = camera.lenses[1]
    lens.coeffs = [-0.055, 0.06, 0.0005, -0.0003, -0.02]
    for model in (rs.distortion.brown_conrady, rs.distortion.inverse_brown_conrady):
        lens.model = model
        ours = realsense_stream(wait, camera.lenses[0], camera.units, "D455", (lens, to_color)).color_intrinsics
        pixel = project(np.array((0.3, 0.2, 1.0)), ours)
        assert rs.rs2_project_point_to_pixel(lens, [0.3, 0.2, 1.0]) == pytest.approx(pixel, abs=0.01)
    lens.model = rs.distortion.ftheta
    with pytest.raises(CaptureError, match="lens is .*ftheta"):
        realsense_stream(wait, camera.lenses[0], camera.units, "D455", (lens, to_color))


def test_a_stream_of_another_colour_camera_is_stored_with_its_lens(tmp_path):
    lens = Intrinsics(96, 72, 90.0, 90.0, 47.5, 35.5, (-0.05, 0.01, 0.001, 0.0, 0.0))
    pose = np.eye(4)
    pose[:3, 3] = 0.02, -0.001, 0.003
    frames = ((np.full((HEIGHT, WIDTH), 1.5, np.float32), np.full((72, 96, 3), 80, np.uint8)) for _ in range(9))
    record(Stream(CAMERA, "unknown", frames, lens, pose), tmp_path / "scan", frames=2, settle=1)
    capture = open_capture(tmp_path / "scan", options=ReadOptions(native_color=True))
    assert capture.color_intrinsics == straightened(lens)
    np.testing.assert_array_equal(capture.depth_to_color, pose)
    assert np.median(capture.native_color) == np.median(capture.color) == 80


def test_realsense_without_a_camera_or_the_library(monkeypatch, tmp_path, capsys):
    pytest.importorskip("pyrealsense2", exc_type=ImportError)
    assert cli.main(["record", str(tmp_path / "scan")]) == 1
    assert "no RealSense camera" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "pyrealsense2", None)
    assert cli.main(["record", str(tmp_path / "scan")]) == 1
    assert "pip install pyrealsense2" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
