"""Undistortion and registration against closed forms and OpenCV; turns and mirrored streams against points."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, project, unproject
from mirror_scan.core.camera.image_registration import (
    color_on_depth,
    straightened,
    undistort_color,
    undistort_depth,
)
from mirror_scan.core.camera.pinhole import distort, rays_of_pixels, undistort
from mirror_scan.core.capture import Capture, MirrorPicks, ReadOptions, open_capture
from mirror_scan.core.capture.upright_grid import align, turned, unmirrored
from mirror_scan.core.errors import CaptureError

AZURE = Intrinsics(
    320, 288, 252.0, 252.0, 166.0, 163.0,
    (0.5479, -0.02097, 2e-5, -7e-5, -0.00265, 0.88968, 0.08613, -0.01391),
)  # fmt: skip
FISHY = Intrinsics(320, 240, 220.0, 221.0, 158.0, 121.0, (-0.28, 0.07, 0.001, -0.0005, -0.007))
WIDE = Intrinsics(320, 240, 300.0, 300.0, 160.0, 120.0)


def tilted_plane(camera, normal=(0.2, -0.1, 0.97), offset=2.0):
    """What ``camera`` reads of the plane normal · p = offset (H, W) float32."""
    rays = rays_of_pixels(camera)
    return (offset / (rays @ np.array(normal[:2]) + normal[2])).astype(np.float32)


def pose_of(angle=0.03, shift=(-0.03, 0.004, 0.002)):
    pose = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    pose[:3, 3] = shift
    return pose


@pytest.mark.parametrize("camera", [AZURE, FISHY])
def test_lens_model_is_opencv_s_and_is_inverted(camera):
    cv2 = pytest.importorskip("cv2")
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    rays = rays_of_pixels(camera)
    assert np.isfinite(rays).all()
    points = np.concatenate((rays, np.ones((*rays.shape[:2], 1))), axis=-1)
    theirs = cv2.projectPoints(points.reshape(-1, 3), np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))[0]
    v, u = np.mgrid[: camera.height, : camera.width]
    np.testing.assert_allclose(theirs.reshape(*rays.shape), np.stack((u, v), axis=-1), atol=1e-6)
    np.testing.assert_allclose(project(points, camera), np.stack((u, v), axis=-1), atol=1e-6)
    depth = np.full((camera.height, camera.width), 2.5, np.float32)
    np.testing.assert_allclose(unproject(depth, camera), points * 2.5)


def test_no_direction_beyond_the_fold():
    intrinsics = (-0.4, 0.0, 0.0, 0.0)
    r = np.sqrt(1 / 1.2)  # r (1 - 0.4 r²) turns back here
    highest = distort(np.array((r, 0.0)), intrinsics)[0]
    assert np.isnan(undistort(np.array((highest * 1.01, 0.0)), intrinsics)).all()
    np.testing.assert_allclose(undistort(np.array((highest * 0.98, 0.0)), intrinsics)[0], 0.785, atol=0.05)
    assert np.isnan(undistort(np.array((np.nan, 0.0)), intrinsics)).all()


@pytest.mark.parametrize("camera", [AZURE, FISHY])
def test_a_tilted_plane_stays_one_when_straightened(camera):
    straight = straightened(camera)
    assert straight.is_pinhole and straight.fx == camera.fx
    assert straight.width * straight.height <= 2.26 * camera.width * camera.height
    depth = tilted_plane(camera)
    got = undistort_depth(depth[None], camera, straight)[0]
    truth = tilted_plane(straight)
    inside = got > 0
    assert inside.mean() > 0.85
    assert np.abs(got - truth)[inside].max() < 5e-3  # the border takes the nearest reading
    assert np.abs(got - truth)[inside].mean() < 1e-4
    nearest = undistort_depth(depth[None], camera, straight, interpolate=False)[0]
    assert np.isin(nearest[nearest > 0], depth).all()


def test_edges_are_not_blurred():
    depth = np.full((1, 240, 320), 1.0, np.float32)
    depth[:, :, 160:] = 3.0
    got = undistort_depth(depth, FISHY, straightened(FISHY))
    assert set(np.unique(got)) <= {np.float32(0), np.float32(1), np.float32(3)}


def test_color_is_straightened_as_opencv_does():
    cv2 = pytest.importorskip("cv2")
    v, u = np.mgrid[:240, :320]
    color = np.stack((127 + 120 * np.sin(u / 25), 127 + 120 * np.cos(v / 20), (u + v) / 3), axis=-1).astype(np.uint8)
    straight = straightened(FISHY)
    matrix = np.array([[FISHY.fx, 0, FISHY.cx], [0, FISHY.fy, FISHY.cy], [0, 0, 1]])
    target = np.array([[straight.fx, 0, straight.cx], [0, straight.fy, straight.cy], [0, 0, 1]])
    size = straight.width, straight.height
    maps = cv2.initUndistortRectifyMap(matrix, np.array(FISHY.distortion), np.eye(3), target, size, cv2.CV_32FC1)
    theirs = cv2.remap(color, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    ours = undistort_color(color, FISHY, straight)
    inside = (maps[0] > 0) & (maps[0] < 319) & (maps[1] > 0) & (maps[1] < 239)
    assert np.abs(ours.astype(int) - theirs)[inside].max() <= 3  # OpenCV interpolates in 1/32 px


def test_colour_of_a_plane_comes_from_where_it_projects():
    depth = tilted_plane(WIDE)
    camera, pose = Intrinsics(640, 480, 600.0, 600.0, 320.0, 240.0, (0.1, -0.05, 0.001, -0.001)), pose_of()
    v, u = np.mgrid[:480, :640]
    color = np.stack((u * 255 / 639, v * 255 / 479, np.zeros_like(u)), axis=-1).round().astype(np.uint8)
    got, seen = color_on_depth(depth, WIDE, color, camera, pose)
    points = unproject(depth, WIDE) @ pose[:3, :3].T + pose[:3, 3]
    pixels = project(points, camera)
    inside = (pixels > 0).all(axis=-1) & (pixels[..., 0] < 639) & (pixels[..., 1] < 479)
    np.testing.assert_allclose(got[inside][:, :2], pixels[inside] * (255 / 639, 255 / 479), atol=1.1)
    assert abs(seen - inside.mean()) < 0.02


def test_what_the_colour_camera_cannot_see_takes_no_foreground_colour():
    """A red box before a green wall: behind the box's edge the wall stays green."""
    depth = np.full((240, 320), 3.0, np.float32)
    depth[60:180, 120:200] = 1.0
    pose = pose_of(0, (-0.05, 0, 0))
    box = np.zeros(depth.shape, np.bool_)
    box[60:180, 105:185] = True  # 0.05 m to the left at 1 m are 15 px
    color = np.where(box[..., None], np.uint8((255, 0, 0)), np.uint8((0, 255, 0)))
    got, _ = color_on_depth(depth, WIDE, color, WIDE, pose)
    lit = got.any(axis=-1)
    np.testing.assert_array_equal(
        got[(depth == 3) & lit], np.broadcast_to((0, 255, 0), (((depth == 3) & lit).sum(), 3))
    )
    np.testing.assert_array_equal(got[depth == 1], np.broadcast_to((255, 0, 0), ((depth == 1).sum(), 3)))


def capture_of(camera=WIDE, **changes):
    rng = np.random.default_rng(0)
    depth = rng.uniform(1, 3, (2, camera.height, camera.width)).astype(np.float32)
    color = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    picks = (
        MirrorPicks("a", frame_pixels=np.array([[5.0, 7.0], [30, 9], [8, 20]])),
        MirrorPicks("b", point=np.array([0.4, 0.1, 2.0]), normal=np.array([0.6, 0.0, 0.8])),
    )
    values = {"color": color, "confidence": (depth > 2).astype(np.uint8)} | changes
    return Capture(depth, intrinsics=camera, mirrors=picks, name="test", **values)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_turns_turn_everything_alike(degrees):
    before = capture_of(Intrinsics(40, 30, 35.0, 36.0, 18.0, 16.0))
    after = turned(before, degrees)
    angle = np.radians(degrees)
    turn = np.round([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    points, moved = unproject(before.depth[1], before.intrinsics), unproject(after.depth[1], after.intrinsics)
    np.testing.assert_allclose(np.rot90(points, -degrees // 90) @ turn.T, moved, atol=1e-9)
    np.testing.assert_array_equal(after.color, np.rot90(before.color, -degrees // 90))
    np.testing.assert_array_equal(after.confidence[0], np.rot90(before.confidence[0], -degrees // 90))
    for old, new in zip(
        before.mirrors[0].frame_pixels.astype(int), after.mirrors[0].frame_pixels.astype(int), strict=True
    ):
        assert before.depth[0, old[1], old[0]] == after.depth[0, new[1], new[0]]
    np.testing.assert_allclose(after.mirrors[1].point, turn @ before.mirrors[1].point)
    np.testing.assert_allclose(after.mirrors[1].normal, turn @ before.mirrors[1].normal)
    with pytest.raises(CaptureError, match="0, 90, 180 or 270"):
        turned(before, 45)


def test_unmirroring_reflects_and_undoes_itself():
    before = capture_of(Intrinsics(40, 30, 35.0, 36.0, 18.0, 16.0))
    after = unmirrored(before)
    points, moved = unproject(before.depth[0], before.intrinsics), unproject(after.depth[0], after.intrinsics)
    np.testing.assert_allclose(points[:, ::-1] * (-1, 1, 1), moved, atol=1e-9)
    np.testing.assert_allclose(after.mirrors[1].point, (-0.4, 0.1, 2.0))
    again = unmirrored(after)
    np.testing.assert_array_equal(again.depth, before.depth)
    assert again.intrinsics == before.intrinsics


def test_align_moves_picks_with_the_image():
    before = capture_of(FISHY)
    after = align(before)
    assert after.intrinsics.is_pinhole and after.color.shape == (*after.depth.shape[1:], 3)
    assert after.confidence.shape == after.depth.shape
    rays = undistort((before.mirrors[0].frame_pixels - (158, 121)) / (220, 221), FISHY.distortion)
    there = (after.mirrors[0].frame_pixels - (after.intrinsics.cx, after.intrinsics.cy)) / (220, 221)
    np.testing.assert_allclose(there, rays, atol=1e-9)
    np.testing.assert_array_equal(after.mirrors[1].point, before.mirrors[1].point)


def test_what_cannot_be_aligned_is_told():
    with pytest.raises(CaptureError, match="alignment is unknown"):
        align(capture_of(color=np.zeros((10, 10, 3), np.uint8)))
    with pytest.raises(CaptureError, match="rotation and a shift"):
        color_on_depth(np.ones((240, 320), np.float32), WIDE, np.zeros((240, 320, 3), np.uint8), WIDE, 2 * np.eye(4))
    with pytest.raises(CaptureError, match="fold inside"):
        straightened(Intrinsics(320, 240, 160.0, 160.0, 160.0, 120.0, (-2.0, 0.0, 0.0, 0.0)))
    for distortion in ((0.1,), (0.1, np.nan, 0, 0), (0.1,) * 6):
        with pytest.raises(CaptureError, match="distortion"):
            Intrinsics(320, 240, 160.0, 160.0, 160.0, 120.0, distortion)


def test_options_turn_and_flip_any_format(tmp_path):
    v, u = np.mgrid[:480, :640]
    np.save(tmp_path / "a.npy", (1 + u / 1000 + v / 5000).astype(np.float32))
    plain = open_capture(tmp_path / "a.npy")
    both = open_capture(tmp_path / "a.npy", options=ReadOptions(turn_degrees=90, mirrored=True))
    np.testing.assert_array_equal(both.depth[0], np.rot90(plain.depth[0][:, ::-1], -1))
    assert (both.intrinsics.width, both.intrinsics.cy) == (480, 319.5)
    assert (both.turn_degrees, both.mirrored) == (0, False)
    v2 = tmp_path / "v2.npy"  # its SDK exchanges left and right: whether that was undone no file says
    np.save(v2, np.full((424, 512), 2.0, np.float32))
    assert any("option “mirrored”" in note for note in open_capture(v2).notes)
    assert not any("option “mirrored”" in note for note in open_capture(v2, options=ReadOptions(mirrored=False)).notes)
    for wrong in ({"turn_degrees": 45}, {"disparity": "magic"}, {"depth_unit_m": 0}, {"min_confidence": 3}):
        with pytest.raises(CaptureError):
            ReadOptions(**wrong)
