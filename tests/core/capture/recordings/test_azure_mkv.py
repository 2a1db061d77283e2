"""Azure Kinect recordings: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.pinhole import distort
from mirror_scan.core.capture import ReadOptions, open_capture
from writers import DEPTH, assert_camera, jpeg, saved


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
    intrinsics = (0.05, -0.02, -1e-4, 1e-4, 0.001, 0.01, -0.005, 0.0005)
    inside = capture.depth[0] > 0
    assert inside.mean() > 0.97
    np.testing.assert_array_equal(capture.depth[0][inside], 1)
    v, u = np.nonzero(inside)
    points = np.column_stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)) + (-0.032, -0.002)
    column = distort(points / 1.004, intrinsics)[:, 0] * (0.5 * 320) + 159.5
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
