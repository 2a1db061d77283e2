"""Azure Kinect and Femto, against cameras made of arrays under the names of the makers' packages."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, unproject
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.live_camera import DRIVERS, record
from mirror_scan.core.errors import CaptureError, MirrorScanError

LENS = Intrinsics(64, 58, 50.4, 50.4, 31.7, 28.9, (0.4, 0.1, 0.0001, -0.0002, 0.02, 0.7, 0.2, 0.05))
DEPTH = np.full((58, 64), 1500, np.uint16)
BGRA = np.tile(np.array((10, 20, 200, 255), np.uint8), (58, 64, 1))


class Name:
    def __getattr__(self, name):
        return name


@pytest.fixture
def azure(monkeypatch):
    """A module of pyk4a's names; ``left``: how many frames come before the camera is gone."""
    module = ModuleType("pyk4a")
    module.left, module.stopped, module.configs = 9, [], []

    class K4AException(Exception):
        pass

    class K4ATimeoutException(K4AException):
        pass

    calibration = SimpleNamespace(
        get_camera_matrix=lambda kind: np.array(((LENS.fx, 0, LENS.cx), (0, LENS.fy, LENS.cy), (0, 0, 1))),
        get_distortion_coefficients=lambda kind: np.array(LENS.distortion),
    )

    class PyK4A:
        def __init__(self, config=None, device_id=0):
            module.configs.append(config)
            self.serial, self.calibration = f"00{device_id}", calibration

        open = start = close = lambda self: None

        def stop(self):
            module.stopped.append(self.serial)

        def get_capture(self, timeout=-1):
            if not module.left:
                raise K4ATimeoutException
            module.left -= 1
            return SimpleNamespace(depth=DEPTH, transformed_color=BGRA)

    module.PyK4A, module.K4AException, module.K4ATimeoutException = PyK4A, K4AException, K4ATimeoutException
    module.Config = lambda **options: options
    module.connected_device_count = lambda: 2
    module.ColorResolution = module.ImageFormat = module.DepthMode = module.FPS = module.CalibrationType = Name()
    monkeypatch.setitem(sys.modules, "pyk4a", module)
    return module


@pytest.fixture
def femto(monkeypatch):
    module = ModuleType("pyorbbecsdk")
    module.started, module.left, module.stopped = [], 9, []

    class OBError(Exception):
        pass

    def image(data):
        return SimpleNamespace(get_data=data.tobytes, get_height=lambda: 58, get_width=lambda: 64,
                               get_depth_scale=lambda: 1.0)  # fmt: skip

    k1, k2, p1, p2, k3, k4, k5, k6 = LENS.distortion
    bent = SimpleNamespace(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3, k4=k4, k5=k5, k6=k6)

    class Frames:
        get_depth_frame = staticmethod(lambda: image(DEPTH))
        get_color_frame = staticmethod(lambda: image(np.ascontiguousarray(BGRA[..., 2::-1])))
        as_frame_set = lambda self: self  # noqa: E731

    class Profiles:
        get_default_video_stream_profile = staticmethod(lambda: "default")

        def get_video_stream_profile(self, width, height, form, rate):
            if width == 7:
                raise OBError("no such profile")
            return (width, height, form, rate)

    class Pipeline:
        def __init__(self, device=None):
            self.device = device

        get_stream_profile_list = staticmethod(lambda kind: Profiles())
        get_camera_param = staticmethod(lambda: SimpleNamespace(depth_intrinsic=LENS, depth_distortion=bent))

        def start(self, config):
            module.started.append((self.device, config.streams))

        def stop(self):
            module.stopped.append(self.device)

        def wait_for_frames(self, timeout):
            module.left -= 1
            return Frames() if module.left >= 0 else None

    class Config:
        def __init__(self):
            self.streams = []

        def enable_stream(self, profile):
            self.streams.append(profile)

        def set_frame_aggregate_output_mode(self, mode):
            assert mode == "FULL_FRAME_REQUIRE"

    devices = SimpleNamespace(get_count=lambda: 1, get_device_by_serial_number=lambda serial: f"device {serial}")
    module.Context = lambda: SimpleNamespace(query_devices=lambda: devices)
    module.AlignFilter = lambda align_to_stream: SimpleNamespace(process=lambda frames: frames)
    module.OBError, module.Pipeline, module.Config = OBError, Pipeline, Config
    module.OBSensorType = module.OBFormat = module.OBStreamType = module.OBFrameAggregateOutputMode = Name()
    monkeypatch.setitem(sys.modules, "pyorbbecsdk", module)
    return module


def is_a_wall(folder, sensor):
    """The wall is flat at 1.5 m, its colour is kept, and a pixel looks the same way as through the lens."""
    capture = open_capture(folder)
    read = capture.depth[0] > 0
    assert capture.sensor == sensor and capture.intrinsics.is_pinhole and read.mean() > 0.9
    np.testing.assert_allclose(capture.depth[0][read], 1.5, atol=1e-3)
    assert np.abs(np.median(capture.color[read], axis=0) - (200, 20, 10)).max() <= 1
    edge = unproject(np.full((58, 64), 1.5, np.float32), LENS)[28, 2]
    seen = unproject(capture.depth[0], capture.intrinsics)[read]
    assert np.linalg.norm(seen - edge, axis=1).min() < 0.03


def test_azure_kinect_by_pyk4a_s_names(azure, tmp_path):
    azure_mode = {"size": (640, 576), "rate": 30, "serial": "001"}
    from mirror_scan.core.capture.drivers import azure_kinect

    azure_kinect.MODES[(64, 58)] = "SMALL"
    try:
        with DRIVERS["azure_kinect"](**azure_mode | {"size": (64, 58)}) as stream:
            is_a_wall(record(stream, tmp_path / "scan", frames=2, settle=1), "azure_kinect")
    finally:
        del azure_kinect.MODES[(64, 58)]
    assert azure.stopped == ["001"] and azure.configs[-1]["depth_mode"] == "SMALL"
    assert azure.configs[-1]["camera_fps"] == "FPS_30" and azure.configs[-1]["color_format"] == "COLOR_BGRA32"
    for wrong, words in (({"size": (848, 480)}, "no depth images of 848×480"), ({"rate": 60}, "60 frames a second"),
                         ({"serial": "7"}, "serial number 7")):  # fmt: skip
        with pytest.raises(CaptureError, match=words), DRIVERS["azure_kinect"](**azure_mode | wrong):
            pass
    azure.connected_device_count = lambda: 0
    with pytest.raises(CaptureError, match="no Azure Kinect is connected"), DRIVERS["azure_kinect"]():
        pass


def test_a_femto_by_the_sdk_s_names(femto, tmp_path):
    with DRIVERS["femto"](serial="A") as stream:
        is_a_wall(record(stream, tmp_path / "scan", frames=2, settle=1), "femto_bolt")
    assert femto.started == [("device A", ["default", (1280, 0, "RGB", 30)])] and femto.stopped == ["device A"]
    with pytest.raises(CaptureError, match="no such profile.*not 7×7"), DRIVERS["femto"](size=(7, 7)):
        pass
    femto.left = 0
    with pytest.raises(CaptureError, match="sends no frames"), DRIVERS["femto"]():
        pass
    assert femto.stopped == ["device A", None]


@pytest.mark.parametrize(("name", "package"), [("azure_kinect", "pyk4a"), ("femto", "pyorbbecsdk")])
def test_without_the_maker_s_package_it_is_said_which(name, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MirrorScanError, match=f"pip install {package}"), DRIVERS[name]():
        pass
