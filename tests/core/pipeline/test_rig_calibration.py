"""A rig calibrated empty, written, read and used again; damage to the file; a rig that has moved."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings
from mirror_scan.core.mirrors.rig_file import mirrors_for, read_rig, write_rig
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.pipeline.rig_calibration import calibrate, moved_warning, moved_warnings
from mirror_scan.core.simulation.props import wall_behind
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate

SPECK = Mesh(np.array([(9.0, 9, 9), (9.1, 9, 9), (9, 9.1, 9)]), np.array([(0, 1, 2)], np.int32))
"""Nobody: a triangle outside the room."""


@pytest.fixture(scope="module")
def empty():
    return simulate(SPECK, default_rig("azure_kinect", frames=8, seed=5))


@pytest.fixture(scope="module")
def rig(empty):
    return calibrate(replace(empty.capture, mirrors=()))


def clean(capture):
    return one_depth_map(capture)[0]


def test_an_empty_rig(rig, empty, simulated):
    body = simulated("azure_kinect").truth.body.vertices
    true = {m.name: plane_mirror(m.name, m.point, m.normal) for m in empty.truth.mirrors}
    assert {m.name for m in rig.mirrors} == set(true)
    for mirror in rig.mirrors:
        error = np.linalg.norm(reflect(body, mirror) - reflect(body, true[mirror.name]), axis=1)
        assert np.median(error) < 0.002 and mirror.displacement(body) < 0.002


def test_written_and_read(rig, tmp_path):
    write_rig(tmp_path / "rig.json", rig)
    again = read_rig(tmp_path / "rig.json")
    assert again.intrinsics == rig.intrinsics
    for a, b in zip(again.mirrors, rig.mirrors, strict=True):
        assert a.name == b.name and a.source == "rig file" and a.refined and a.points_used == b.points_used
        for field in ("point", "normal", "basis", "rectangle", "outline", "covariance"):
            np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-12)
    assert mirrors_for(again, rig.intrinsics) == again.mirrors


@pytest.mark.parametrize("thickness, offset", [(0.006, 0.0), (0.0, 0.012)])
def test_known_glass_goes_into_the_rig(person, tmp_path, thickness, offset):
    """The mirror is where it appears to reflect; that its frame lies in front of that is no move."""
    thick = default_rig("azure_kinect", frames=8, seed=5, frame_depth=offset)
    thick = replace(thick, mirrors=tuple(replace(m, glass_thickness=thickness) for m in thick.mirrors))
    empty = simulate(SPECK, thick)
    glass = MirrorSettings(glass_offset=offset, glass_thickness=thickness)
    write_rig(tmp_path / "rig.json", calibrate(empty.capture, mirror=glass))
    placed = read_rig(tmp_path / "rig.json").mirrors
    true = {m.name: plane_mirror(m.name, m.point, m.normal) for m in empty.truth.mirrors}
    for mirror in placed:
        assert mirror.glass_thickness == pytest.approx(thickness)
        assert mirror.frame_ahead == pytest.approx(glass.behind_frame, abs=1e-4)
        error = np.linalg.norm(reflect(person.vertices, mirror) - reflect(person.vertices, true[mirror.name]), axis=1)
        assert np.median(error) < 0.003
    later = simulate(person, replace(thick, seed=6)).capture
    assert moved_warnings(RgbdImage(clean(later), later.intrinsics), list(placed)) == []
    pushed = [replace(m, centre=tuple(np.array(m.centre) - 0.008 * m.axes[2])) for m in thick.mirrors]
    later = simulate(person, replace(thick, seed=6, mirrors=tuple(pushed))).capture
    assert moved_warnings(RgbdImage(clean(later), later.intrinsics), list(placed))


def test_used_for_a_later_snapshot(rig, simulated):
    capture = simulated("azure_kinect").capture
    made = reconstruct(capture, mirrors=rig.mirrors)
    assert not [w for w in made.warnings if "moved" in w] and made.report["mesh"]["watertight"]


def test_a_rig_that_moved_is_told(rig, simulated, person):
    standing = clean(simulated("azure_kinect").capture)
    intrinsics = rig.intrinsics
    for mirror in rig.mirrors:
        file = replace(mirror, source="rig file")
        assert moved_warning(RgbdImage(standing, intrinsics), file) is None
        pushed = replace(file, point=file.point + 0.015 * file.normal)
        assert "moved" in moved_warning(RgbdImage(standing, intrinsics), pushed)
        away = replace(file, point=file.point + 0.15 * file.normal)
        assert "not where it was" in moved_warning(RgbdImage(standing, intrinsics), away)
        assert moved_warning(RgbdImage(np.zeros_like(standing), intrinsics), file) is None, (
            "what is not seen is not blamed"
        )


@pytest.mark.parametrize(
    "what", ["nothing", "camera 5 mm", "camera 1°", "camera 5 cm", "mirror 5 mm", "mirror 1°", "mirror 5 cm"]
)
def test_a_rig_that_was_knocked(rig, person, what):
    """The things themselves are moved: the camera, or one mirror."""
    base = default_rig("azure_kinect", frames=8, seed=6)
    right, left = base.mirrors
    out = np.array(right.normal)
    turn = np.radians(1.0)
    turned = (out[0] * np.cos(turn) - out[1] * np.sin(turn), out[0] * np.sin(turn) + out[1] * np.cos(turn), out[2])
    pushed = {
        d: replace(base, mirrors=(replace(right, centre=tuple(right.centre + d * out)), left)) for d in (0.005, 0.05)
    }
    knocked = {
        "nothing": base,
        "camera 5 mm": replace(base, camera=tuple(np.array(base.camera) + (0, 0.005, 0))),
        "camera 1°": replace(base, pan_deg=1.0),
        "camera 5 cm": replace(base, camera=tuple(np.array(base.camera) + (0.05, 0, 0))),
        "mirror 5 mm": pushed[0.005],
        "mirror 1°": replace(base, mirrors=(replace(right, normal=turned), left)),
        "mirror 5 cm": pushed[0.05],
    }[what]
    told = moved_warnings(RgbdImage(clean(simulate(person, knocked).capture), rig.intrinsics), rig.mirrors)
    print("\n".join(told))
    assert len(told) == (what != "nothing")
    if what.startswith("camera"):
        assert "most likely it was the camera" in told[0]
    if what.startswith("mirror"):
        assert told[0].startswith("right: the rig has moved since it was calibrated")
        how = {"mirror 5 mm": "5 mm forward", "mirror 1°": "turned by 1.", "mirror 5 cm": "50 mm forward"}[what]
        assert how in told[0]


def test_a_noisy_camera_notices_five_millimetres(person):
    """What the slopes and the shift of a plane may be off by chance is known to less than their sum at the person."""
    base = default_rig("realsense_d455", 2.4, frames=10, seed=11)
    rig = calibrate(replace(simulate(SPECK, base).capture, mirrors=()))
    camera = np.array(base.camera)
    for move, told in (((0, 0, 0), 0), ((0.005, 0, 0), 1), ((0, 0.005, 0), 1), ((0, 0, 0.005), 0)):
        knocked = replace(base, camera=tuple(camera + move), seed=12)
        texts = moved_warnings(RgbdImage(clean(simulate(person, knocked).capture), rig.intrinsics), rig.mirrors)
        assert len(texts) == told, "up and down, along its own planes, no mirror has moved"
        assert all("most likely it was the camera" in text for text in texts)


def test_a_wall_does_not_hide_a_move(person):
    """How thick the glass is before its wall is not known, but it is as thick as when it was calibrated."""
    base = default_rig("azure_kinect", frames=6, frame_width=0.0, seed=13)
    walls = [wall_behind(m) for m in base.mirrors]
    hung = clean(simulate(person, base, walls).capture)
    mirrors = find_mirrors(RgbdImage(hung, base.intrinsics))
    assert len(mirrors) == 2 and all(m.covariance[2, 2] > 0.005**2 for m in mirrors)
    assert moved_warnings(RgbdImage(hung, base.intrinsics), mirrors) == []
    pushed = [replace(m, point=m.point + 0.006 * m.normal) for m in mirrors]
    assert len(moved_warnings(RgbdImage(hung, base.intrinsics), pushed)) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c.update(format="other"), "not a rig file"),
        (lambda c: c.update(version=9), "version 9"),
        (lambda c: c.update(mirrors=[]), "no mirrors"),
        (lambda c: c["intrinsics"].update(fx="x"), "intrinsics.*number"),
        (lambda c: c["intrinsics"].update(fx=-1), "positive"),
        (lambda c: c["mirrors"][0].update(point=[1, 2]), "“point” must hold 3"),
        (lambda c: c["mirrors"][0].update(normal=[0, 0, 0]), "left"),
        (lambda c: c["mirrors"][0].update(rectangle=[[1, 0], [0, 1]]), "rectangle is empty"),
        (lambda c: c["mirrors"][0].update(covariance=[["a"]]), "no numbers"),
        (lambda c: c["mirrors"][0].update(covariance=[[1, 0, 0], [0, -1, 0], [0, 0, 1]]), "not a covariance matrix"),
        (lambda c: c["mirrors"][0].update(point=[0, 1e200, 2]), "below 1000"),
        (lambda c: c["intrinsics"].update(cx=10**400), "far too large"),
        (lambda c: c["mirrors"][0].update(down=[10**400, 0, 0]), "no numbers"),
        (lambda c: c["mirrors"].append(3), "mirror 3"),
    ],
)
def test_damaged_files(rig, tmp_path, change, said):
    path = tmp_path / "rig.json"
    write_rig(path, rig)
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(MirrorError, match=said) as caught:
        read_rig(path)
    assert "rig.json" in str(caught.value) or "left" in str(caught.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(MirrorError, match="cannot be read"):
        read_rig(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("[[", encoding="utf-8")
    with pytest.raises(MirrorError, match="not JSON"):
        read_rig(tmp_path / "text.json")


def test_another_camera(rig):
    intrinsics = rig.intrinsics
    with pytest.raises(MirrorError, match="pixels"):
        mirrors_for(rig, replace(intrinsics, width=320))
    with pytest.raises(MirrorError, match="lens"):
        mirrors_for(rig, replace(intrinsics, fx=1.02 * intrinsics.fx))


def test_a_rig_without_mirrors(simulated, empty):
    bare = simulate(SPECK, replace(default_rig("azure_kinect", frames=1), mirrors=()))
    with pytest.raises(MirrorError, match="no mirror was found"):
        calibrate(bare.capture)
    plane = empty.truth.mirrors[:1]
    with pytest.raises(MirrorError, match="plane alone"):
        calibrate(empty.capture, plane)
