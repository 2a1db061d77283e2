"""Every capture format: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.pinhole import distort, undistort
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.decoding.lz4 import lz4_decompress
from mirror_scan.core.capture.decoding.lzf import lzf_decompress
from mirror_scan.core.capture.decoding.lzfse import lzfse_decompress
from mirror_scan.core.capture.decoding.openni_codec import decode_16z
from mirror_scan.core.capture.kinect_disparity import ZeroPlane, depth_of_disparity
from mirror_scan.core.capture.recordings import realsense_bag, realsense_db3
from mirror_scan.core.capture.recordings.realsense_bag import brown_of_inverse
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import openimageio, write_png

DEPTH, COLOR = writers.scene()
METRES = np.divide(DEPTH, 1000, dtype=np.float32)
CAMERA = (60.0, 61.0, 31.5, 24.0)


def saved(folder, name, data):
    path = folder / name
    path.write_bytes(data)
    return path


def jpeg(folder, image):
    """A JPEG file's bytes, by OpenImageIO."""
    oiio = openimageio()
    path = folder / "any.jpg"
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
    spec["Compression"] = "jpeg:100"
    output = oiio.ImageOutput.create("jpeg")
    assert output.open(str(path), spec) and output.write_image(image) and output.close()
    return path.read_bytes()


def assert_camera(camera, fx, fy, cx, cy, within=1e-9):
    np.testing.assert_allclose((camera.fx, camera.fy, camera.cx, camera.cy), (fx, fy, cx, cy), atol=within, rtol=0)


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_organized_pcd(tmp_path, kind):
    cloud = writers.cloud_of(DEPTH, *CAMERA)
    path = saved(tmp_path, "a.pcd", writers.pcd(cloud, COLOR, kind))
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], np.nan_to_num(cloud[..., 2]))
    np.testing.assert_array_equal(capture.color, COLOR)
    assert_camera(capture.intrinsics, *CAMERA, within=2e-3)
    open3d = pytest.importorskip("open3d")
    theirs = np.asarray(open3d.io.read_point_cloud(str(path), remove_nan_points=False).points)
    np.testing.assert_array_equal(theirs.reshape(cloud.shape).astype(np.float32), cloud)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian", "range grid"])
def test_organized_ply(tmp_path, kind):
    depth, color = writers.scene(160, 120)
    camera = (150.0, 150.0, 80.0, 59.5)
    cloud = writers.cloud_of(depth, *camera)
    grid = kind == "range grid"
    path = saved(tmp_path, "a.ply", writers.ply(cloud, color, "binary_little_endian" if grid else kind, grid))
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], np.nan_to_num(cloud[..., 2]))
    np.testing.assert_array_equal(capture.color[depth > 0], color[depth > 0])
    assert_camera(capture.intrinsics, *camera, within=2e-3)


def test_clouds_with_other_axes_are_the_same_camera(tmp_path):
    """z backward and y up (OpenGL), z up and y forward (Blender), millimetres: one camera, one depth map."""
    cloud = writers.cloud_of(DEPTH, *CAMERA)
    for name, axes in {
        "opengl": cloud * (1, -1, -1),
        "z up": np.stack((cloud[..., 0], cloud[..., 2], -cloud[..., 1]), axis=-1),
        "turned": np.stack((cloud[..., 2], -cloud[..., 0], -cloud[..., 1]), axis=-1),
        "millimetres": cloud * 1000,
    }.items():
        capture = open_capture(saved(tmp_path, f"{name}.pcd", writers.pcd(axes.astype(np.float32), COLOR, "binary")))
        np.testing.assert_allclose(capture.depth[0], METRES, rtol=1e-6, err_msg=name)
        assert_camera(capture.intrinsics, *CAMERA, within=5e-3)
        assert not any("left-handed" in note for note in capture.notes), name
    wrong = open_capture(
        saved(tmp_path, "left.pcd", writers.pcd((cloud * (-1, 1, 1)).astype(np.float32), COLOR, "binary"))
    )
    assert any("left-handed" in note for note in wrong.notes)
    with pytest.raises(CaptureError, match="not what one camera sees"):
        shuffled = np.random.default_rng(0).permutation(cloud.reshape(-1, 3)).reshape(cloud.shape)
        open_capture(saved(tmp_path, "b.pcd", writers.pcd(shuffled, COLOR, "binary")))


@pytest.mark.parametrize("codec", [b"16zT", b"16zP", b"NONE"])
@pytest.mark.parametrize("old", [False, True])
def test_oni(tmp_path, codec, old):
    frames = [DEPTH, np.roll(DEPTH, 3, axis=1), np.zeros_like(DEPTH)]
    path = saved(tmp_path, "a.oni", writers.oni(frames, COLOR, codec, fov=(1.0, 0.8), old=old))
    capture = open_capture(path, "0:2")
    np.testing.assert_array_equal(capture.depth, np.divide(frames[:2], 1000, dtype=np.float32))
    np.testing.assert_array_equal(capture.color, COLOR)
    assert_camera(capture.intrinsics, 32 / np.tan(0.5), 24 / np.tan(0.4), 32, 24)
    assert capture.sensor == "kinect_v1"


def test_a_mirrored_oni_is_turned_round(tmp_path):
    data = writers.oni([DEPTH], COLOR, properties=[writers.oni_number("xnMirror", 1)])
    path = saved(tmp_path, "a.oni", data)
    np.testing.assert_array_equal(open_capture(path).depth[0], METRES[:, ::-1])
    np.testing.assert_array_equal(open_capture(path).color, COLOR[:, ::-1])
    assert open_capture(path).intrinsics.cx == 63 - 32
    np.testing.assert_array_equal(open_capture(path, options=ReadOptions(mirrored=False)).depth[0], METRES)


def test_oni_units_and_jpeg(tmp_path):
    tenths = writers.oni(
        [DEPTH], jpeg(tmp_path, COLOR), color_codec=b"JPEG", properties=[writers.oni_number("oniPixelFormat", 101)]
    )
    capture = open_capture(saved(tmp_path, "a.oni", tenths))
    np.testing.assert_allclose(capture.depth[0], DEPTH / 10000, rtol=1e-6)
    assert np.abs(capture.color.astype(int) - COLOR).mean() < 6


def test_openni_codecs_on_hard_values():
    rng = np.random.default_rng(1)
    for values in (
        np.array([7]), np.zeros(5000, int), np.full(31, 9000), rng.integers(0, 10001, 3000), np.arange(4000) % 97,
        np.repeat(rng.integers(0, 3000, 200), rng.integers(1, 80, 200)), np.cumsum(rng.integers(-7, 8, 3000)) + 3000,
        np.cumsum(rng.integers(-64, 65, 3000)) + 6000, np.array([0, 32767, 0, 32767]),
    ):  # fmt: skip
        for table in (True, False):
            np.testing.assert_array_equal(decode_16z(writers.encode_16z(values, table), len(values), table), values)


@pytest.mark.parametrize("live", [False, True])
def test_azure_mkv(tmp_path, live):
    depth, _ = writers.scene(320, 288)
    frames = [depth, depth + np.uint16(1)]
    bgra = np.random.default_rng(0).integers(0, 256, (90, 160, 4)).astype(np.uint8)
    path = saved(
        tmp_path, "a.mkv", writers.mkv(frames, bgra.tobytes(), color_size=(160, 90), live=live)
    )  # without calibration: published intrinsics, colour of another size left out
    capture = open_capture(path, options=ReadOptions(intrinsics=Intrinsics(320, 288, 250, 250, 160, 144)))
    np.testing.assert_array_equal(capture.depth, np.divide(frames, 1000, dtype=np.float32))
    assert capture.color is None and any("no calibration" in note for note in capture.notes)
    np.testing.assert_array_equal(
        open_capture(path, "1", ReadOptions(intrinsics=Intrinsics(320, 288, 250, 250, 160, 144))).depth[0],
        np.divide(frames[1], 1000, dtype=np.float32),
    )
    av = pytest.importorskip("av")
    if not live:
        with av.open(str(path)) as video:
            theirs = [f.to_ndarray() for f in video.decode(video.streams.video[0])]
        np.testing.assert_array_equal(theirs, frames)


def test_azure_mkv_with_calibration_is_straight_and_coloured(tmp_path):
    """A plane one metre off, whose colour is a ramp in the colour camera: known in closed form."""
    depth = np.full((288, 320), 1000, np.uint16)
    content = writers.calibration()
    ramp = np.zeros((240, 320, 4), np.uint8)
    ramp[..., 2] = np.rint(np.arange(320) * 255 / 319)  # red, in BGRA
    path = saved(tmp_path, "a.mkv", writers.mkv([depth], ramp.tobytes(), content, color_size=(320, 240)))
    capture = open_capture(path)
    camera = capture.intrinsics
    assert camera.is_pinhole and capture.color.shape == (*capture.depth.shape[1:], 3)
    f = 0.49 * 512
    assert_camera(camera, f, f, camera.cx, camera.cy)
    lens = (0.05, -0.02, -1e-4, 1e-4, 0.001, 0.01, -0.005, 0.0005)
    inside = capture.depth[0] > 0
    assert inside.mean() > 0.97
    np.testing.assert_array_equal(capture.depth[0][inside], 1)
    v, u = np.nonzero(inside)
    points = np.column_stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)) + (-0.032, -0.002)
    column = distort(points / 1.004, lens)[:, 0] * (0.5 * 320) + 159.5
    seen = (column > 1) & (column < 318) & (capture.color[v, u].any(axis=1))
    assert seen.mean() > 0.6
    np.testing.assert_allclose(capture.color[v, u, 0][seen], column[seen] * 255 / 319, atol=1.1)


@pytest.mark.parametrize("kind", [b"NV12", b"YUY2", b"MJPG"])
def test_azure_color_formats(tmp_path, kind):
    """One plain colour, so that every way of storing it must give it back."""
    gray = 137
    raw = {
        b"NV12": bytes([gray]) * (64 * 48) + bytes([128]) * (64 * 24),
        b"YUY2": bytes([gray, 128]) * (64 * 48),
        b"MJPG": jpeg(tmp_path, np.full((48, 64, 3), gray, np.uint8)),
    }[kind]
    path = saved(tmp_path, "a.mkv", writers.mkv([DEPTH], raw, color_kind=kind, color_size=(64, 48)))
    capture = open_capture(path, options=ReadOptions(intrinsics=Intrinsics(64, 48, 60, 60, 32, 24)))
    assert np.abs(capture.color.astype(int) - gray).max() <= 1


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
        lens = rs.intrinsics()
        lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = 64, 48, 60.0, 61.0, 31.0, 23.0
        lens.model, lens.coeffs = rs.distortion.brown_conrady, [0.0] * 5
        stream = rs.video_stream()
        stream.type, stream.fmt = getattr(rs.stream, kind), getattr(rs.format, pixel)
        stream.uid, stream.index, stream.width, stream.height, stream.fps, stream.bpp = uid, 0, 64, 48, 30, size
        stream.intrinsics = lens
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


@pytest.mark.parametrize(
    "given", [None, ZeroPlane(120.0, 0.1042, 7.52, 2.3, 200), ZeroPlane(118.0, 0.105, 7.4, 2.4, 198)]
)
def test_fakenect(tmp_path, given):
    rng = np.random.default_rng(0)
    frames = [rng.integers(400, 1050, (480, 640)).astype(np.uint16) for _ in range(2)]
    frames[0][rng.random((480, 640)) < 0.2] = 2047
    plane = None if given is None else tuple(vars(given).values())
    color = rng.integers(0, 256, (480, 640, 3)).astype(np.uint8)
    capture = open_capture(writers.fakenect(tmp_path / "session", frames, color, plane))
    p = given or ZeroPlane()
    raw = np.array(frames, float)
    metric = ((raw - 4 * p.const_shift) / 4 - 0.375) * p.pixel_size  # libfreenect's registration.c
    mm = 10 * (metric * p.reference_distance / (p.emitter_distance - metric) + p.reference_distance)
    np.testing.assert_allclose(capture.depth, np.where((raw == 2047) | (mm > 10000), 0, mm / 1000), rtol=1e-6)
    f = p.reference_distance / (2 * p.pixel_size)
    assert_camera(capture.intrinsics, f, f, 320, 240)
    assert capture.color.shape == (480, 640, 3) and capture.sensor == "kinect_v1"


def test_kinect_formulas_meet_published_values():
    raw = [500, 800, 900, 950, 1000, 1023]
    published = {
        "linear": [0.557, 1.144, 1.764, 2.419, 3.848, 5.285],
        "tangent": [0.584, 1.195, 1.818, 2.456, 3.779, 5.023],
        "factory": [0.586, 1.194, 1.824, 2.478, 3.864, 5.203],
    }
    for formula, metres in published.items():
        np.testing.assert_allclose(depth_of_disparity(formula)[raw], metres, atol=6e-4)
        assert not depth_of_disparity(formula)[[2047, 1800]].any()


@pytest.mark.parametrize("suffix", [".npy", ".pgm", "swapped.pgm"])
def test_raw_kinect_disparity_alone(tmp_path, suffix):
    v, u = np.mgrid[:480, :640]
    raw = (500 + u // 2 + v // 4).astype(np.uint16)
    raw[:40] = 2047
    path = tmp_path / f"d{suffix}"
    if suffix == ".npy":
        np.save(path, raw)
    else:
        path.write_bytes(
            b"P5\n# a comment\n640 480\n65535\n" + raw.astype(">u2" if suffix == ".pgm" else "<u2").tobytes()
        )
    capture = open_capture(path, options=ReadOptions(disparity="tangent"))
    np.testing.assert_array_equal(capture.depth[0], depth_of_disparity("tangent")[raw])
    assert_camera(capture.intrinsics, *[575.8157389635317] * 2, 320, 240)
    burrus = open_capture(path, options=ReadOptions(kinect_calibration="burrus"))
    assert burrus.intrinsics.is_pinhole and burrus.intrinsics.fx == 594.21


def test_tum(tmp_path):
    depth, color = writers.scene(640, 480)
    frames = [depth, depth + np.uint16(1)]
    folder = writers.tum(tmp_path / "rgbd_dataset_freiburg3_walking", frames, color)
    capture = open_capture(folder)
    np.testing.assert_allclose(capture.depth, np.array(frames) / 1000, rtol=1e-6)
    np.testing.assert_array_equal(capture.color, color)
    assert_camera(capture.intrinsics, 535.4, 539.2, 320.1, 247.6)
    second = open_capture(folder, "1")
    np.testing.assert_array_equal(second.color, np.roll(color, 1, axis=1))
    late = open_capture(writers.tum(tmp_path / "late", frames, color, apart=0.05), "0")
    assert late.color is None and any("no colour image within" in note for note in late.notes)
    (folder / "depth.txt").write_text("1.0 ../../secret.png\n")
    with pytest.raises(CaptureError, match="outside the folder"):
        open_capture(folder)


def test_sun_and_redwood(tmp_path):
    capture = open_capture(writers.sun(tmp_path / "kv1" / "a", DEPTH + np.uint16(8000), COLOR))
    np.testing.assert_allclose(capture.depth[0], (DEPTH + 8000) / 1000, rtol=1e-6)
    assert_camera(capture.intrinsics, 520, 520, 32, 24)
    depth, color = writers.scene(640, 480)
    for name, image in (("depth", depth), ("image", color)):
        (tmp_path / "redwood" / name).mkdir(parents=True)
        write_png(tmp_path / "redwood" / name / "1.png", image)
    capture = open_capture(tmp_path / "redwood")  # no intrinsics: PrimeSense's, with a note
    assert_camera(capture.intrinsics, 525, 525, 319.5, 239.5)
    assert capture.notes and capture.color is not None
    (tmp_path / "redwood" / "image").rename(tmp_path / "redwood" / "color")  # no longer Redwood's: no camera is guessed
    with pytest.raises(CaptureError, match=r"intrinsic\.json: is missing.*intrinsics”"):
        open_capture(tmp_path / "redwood")


def test_pclzf(tmp_path):
    (tmp_path / "s_depth.pclzf").write_bytes(writers.pclzf(DEPTH, "depth16"))
    (tmp_path / "s_rgb.pclzf").write_bytes(writers.pclzf(COLOR, "rgb24"))
    (tmp_path / "s.xml").write_text(writers.pclzf_xml(61.0, 32.0, 24.0))
    for path in (tmp_path, tmp_path / "s_depth.pclzf"):
        capture = open_capture(path)
        np.testing.assert_array_equal(capture.depth[0], METRES)
        np.testing.assert_array_equal(capture.color, COLOR)
        assert_camera(capture.intrinsics, 61, 61, 32, 24)


def test_record3d(tmp_path):
    pytest.importorskip("liblzfse")
    depth, _ = writers.scene(256, 192)
    frames = [depth / np.float32(1000), depth / np.float32(999)]
    frames[0][:5] = np.nan
    trust = (np.indices(depth.shape).sum(axis=0) % 3).astype(np.uint8)
    plain = jpeg(tmp_path, np.full((768, 1024, 3), (200, 90, 40), np.uint8))
    path = saved(tmp_path, "a.r3d", writers.r3d(frames, plain, trust))
    everything = open_capture(path, options=ReadOptions(min_confidence=0))
    np.testing.assert_array_equal(everything.depth, np.nan_to_num(frames))
    np.testing.assert_array_equal(everything.confidence, [trust, trust])
    assert_camera(everything.intrinsics, 50, 50.25, 127.625, 95.625)  # K is for 1024 x 768
    np.testing.assert_allclose(everything.color[50:150, 50:200].reshape(-1, 3).mean(axis=0), (200, 90, 40), atol=3)
    np.testing.assert_array_equal(open_capture(path, 1).depth[0], np.where(trust > 0, np.nan_to_num(frames[0]), 0))
    assert everything.sensor == "phone"


def test_record3d_as_exr(tmp_path):
    oiio = openimageio()
    folder = tmp_path / "EXR_RGBD"
    (folder / "depth").mkdir(parents=True)
    spec = oiio.ImageSpec(64, 48, 1, oiio.FLOAT)
    output = oiio.ImageOutput.create(str(folder / "depth" / "0.exr"))
    values = np.where(DEPTH > 0, METRES, np.nan).astype(np.float32)
    assert output.open(str(folder / "depth" / "0.exr"), spec) and output.write_image(values[..., None])
    assert output.close()
    (folder / "metadata.json").write_text('{"w": 128, "h": 96, "K": [120, 0, 0, 0, 120, 0, 64, 48, 1]}')
    capture = open_capture(folder)
    np.testing.assert_array_equal(capture.depth[0], METRES)
    assert_camera(capture.intrinsics, 60, 60, 31.75, 23.75)
    alone = open_capture(folder / "depth" / "0.exr", options=ReadOptions(intrinsics=Intrinsics(64, 48, 60, 60, 32, 24)))
    np.testing.assert_array_equal(alone.depth[0], METRES)


@pytest.mark.parametrize("kind", ["npy", "png"])
@pytest.mark.parametrize(("down", "turns"), [((0, 1, 0.2), 0), ((1, 0, 0.2), 1), ((0, -1, 0.3), 2), ((-1, 0, 0), 3)])
def test_stray_scanner_is_held_upright(tmp_path, kind, down, turns):
    depth, _ = writers.scene(256, 192)
    trust = np.full(depth.shape, 2, np.uint8)
    trust[:10] = 0
    capture = open_capture(writers.stray(tmp_path / "s", [depth, depth], trust, kind, down))
    expected = np.where(trust > 0, depth / np.float32(1000), 0)
    np.testing.assert_allclose(capture.depth[1], np.rot90(expected, -turns), rtol=1e-6)
    if not turns:
        assert_camera(
            capture.intrinsics, 1430 * 256 / 1920, 1431 * 192 / 1440, 960.5 * 256 / 1920 - 0.5, 720.5 * 192 / 1440 - 0.5
        )


def test_stray_scanner_color_needs_a_video_library(tmp_path, monkeypatch):
    import sys

    depth, _ = writers.scene(256, 192)
    folder = writers.stray(tmp_path / "s", [depth], np.full(depth.shape, 2, np.uint8))
    (folder / "rgb.mp4").write_bytes(b"no video")
    monkeypatch.setitem(sys.modules, "av", None)
    capture = open_capture(folder)
    assert capture.color is None and any("pip install" in note for note in capture.notes)
    monkeypatch.delitem(sys.modules, "av")
    pytest.importorskip("av")
    with pytest.raises(CaptureError, match="rgb.mp4: cannot be decoded"):
        open_capture(folder)


def test_our_npz(tmp_path):
    source = tmp_path / "folder"
    (source / "depth").mkdir(parents=True)
    write_png(source / "depth" / "0.png", DEPTH)
    write_png(source / "depth" / "1.png", DEPTH + np.uint16(1))
    (source / "intrinsic.json").write_text('{"width":64,"height":48,"intrinsic_matrix":[60,0,0,0,61,0,31.5,24,1]}')
    (source / "mirrors.json").write_text('{"mirrors": [{"name": "a", "frame_pixels": [[1, 2], [3, 4], [5, 7]]}]}')
    capture = open_capture(source)
    write_npz(tmp_path / "a.npz", capture)
    again = open_capture(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.depth, capture.depth)
    assert again.intrinsics == capture.intrinsics and again.color is None and again.name == "folder"
    np.testing.assert_array_equal(again.mirrors[0].frame_pixels, capture.mirrors[0].frame_pixels)
    assert len(open_capture(tmp_path / "a.npz", "1:").depth) == 1


@pytest.mark.parametrize(
    ("choice", "expected"),
    [(None, [0, 1, 2, 3, 4]), (2, [0, 1]), ("1:3", [1, 2]), ("3", [3]), ("::2", [0, 2, 4]), ("-2:", [3, 4])],
)
def test_frames_are_chosen(tmp_path, choice, expected):
    np.save(tmp_path / "a.npy", np.arange(1, 6, dtype=np.float32)[:, None, None] * np.ones((1, 480, 640), np.float32))
    assert open_capture(tmp_path / "a.npy", choice).depth[:, 0, 0].tolist() == [n + 1 for n in expected]


@pytest.mark.parametrize("choice", [0, -1, "", "a", "1:2:3:4", "7", "3:3", "1:2:-1", True, 2.5])
def test_frames_that_are_none(tmp_path, choice):
    np.save(tmp_path / "a.npy", np.ones((5, 480, 640), np.float32))
    with pytest.raises(CaptureError, match="a.npy"):
        open_capture(tmp_path / "a.npy", choice)


def test_compressions_against_their_authors_libraries():
    rng = np.random.default_rng(0)
    blocks = [
        bytes(300_000), rng.bytes(70_000), bytes(range(256)) * 900,
        np.cumsum(rng.integers(-2, 3, 90_000)).astype("<i2").tobytes(),
        np.sin(np.arange(50_000) / 50).astype("<f4").tobytes(),
    ]  # fmt: skip
    for data in blocks:
        assert lzf_decompress(writers.lzf_compress(data), len(data)).tobytes() == data
    lz4 = pytest.importorskip("lz4.frame")
    for data in blocks:
        for level, linked, checked in ((0, True, False), (9, False, True)):
            packed = lz4.compress(
                data, compression_level=level, block_linked=linked, content_checksum=checked, block_checksum=checked
            )
            assert lz4_decompress(packed, len(data)).tobytes() == data
    liblzfse = pytest.importorskip("liblzfse")
    for data in blocks:
        assert lzfse_decompress(liblzfse.compress(data), len(data)).tobytes() == data


def test_a_forged_size_is_never_allocated(tmp_path):
    """Headers that promise gigabytes are refused before anything is made."""
    import tracemalloc

    header = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4000\nHEIGHT 4000\nPOINTS 16000000\nDATA binary_compressed\n"
    forged = {
        "a.pcd": header + struct.pack("<II", 10, 192_000_000) + b"0123456789",
        "b.npy": b"\x93NUMPY\1\0\x76\0"
        + b"{'descr': '<u2', 'fortran_order': False, 'shape': (9000, 9000, 9000), }".ljust(117) + b"\n",
        "c.bag": writers.realsense_bag([DEPTH], compression="none").replace(b"size=", b"size=\xff\xff\xff", 1)[: 3000],
        "d.pgm": b"P5 30000 30000 65535\n1234",
        "e.pclzf": struct.pack("<5sII16sII", b"PCLZF", 8000, 8000, b"depth16".ljust(16), 20, 128_000_000) + bytes(20),
    }  # fmt: skip
    for name, data in forged.items():
        path = saved(tmp_path, name, data)
        tracemalloc.start()
        with pytest.raises(CaptureError, match=name) as caught:
            open_capture(path)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000, name
        tracemalloc.stop()
        assert "\n" not in str(caught.value)
