"""The printed plan is to scale, and its files are read back."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.mirrors.rig_file import mirrors_for, read_rig
from mirror_scan.core.rig_planning.area_coverage import area_coverage, body_samples
from mirror_scan.core.rig_planning.placement_search import Placement
from mirror_scan.core.rig_planning.plan_drawing import heights_in_words, plan_drawing, tape_marks, write_plan_drawing
from mirror_scan.core.rig_planning.plan_files import write_plan
from mirror_scan.core.rig_planning.predicted_error import predicted_error
from mirror_scan.core.rig_planning.rooms import Room
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import apparent_plane, default_rig

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def body():
    return mannequin(resolution=0.02)


@pytest.fixture(scope="module")
def placement(body) -> Placement:
    rig = default_rig()
    rig = replace(
        rig, room=(-1.6, 2.0, -3.0, 1.4, 2.4),
        mirrors=(replace(rig.mirrors[0], name='<& "'), replace(rig.mirrors[1], name="left")),
    )  # fmt: skip
    samples = body_samples(body, 512)
    covered = area_coverage(samples, rig)
    return Placement(
        rig, Room(3.6, 4.4, 2.4), False, covered, predicted_error(samples, covered, rig), False, 1
    )  # fmt: skip


def test_the_plan_is_valid_and_to_scale(placement) -> None:
    root = ET.fromstring(plan_drawing(placement).encode())
    assert (root.get("width"), root.get("height")) == ("297mm", "210mm")
    texts = "".join(element.text or "" for element in root.iter(f"{SVG}text"))
    one_to = float(texts.split("1 m at 1 : ")[1].split(",")[0])
    crosses = [
        [float(line.get(key)) for key in ("x1", "y1", "x2", "y2")]
        for line in root.iter(f"{SVG}line") if line.get("stroke") == "#c2410c"
    ]  # fmt: skip
    places = np.array([(0.5 * (x1 + x2), 0.5 * (y1 + y2)) for x1, y1, x2, y2 in crosses[::2]])
    marks = tape_marks(placement)
    assert len(marks) == len(places) == 6
    truth = np.array([mark.place for mark in marks])
    for k in range(1, len(marks)):
        drawn = np.linalg.norm(places[k] - places[0]) * one_to / 1000.0
        assert drawn == pytest.approx(np.linalg.norm(truth[k] - truth[0]), abs=0.002)
    assert marks[0].from_left == pytest.approx(1.6) and marks[0].from_near == pytest.approx(0.5)
    for element in root.iter(f"{SVG}text"):
        assert 0 <= float(element.get("x")) <= 297 and 0 <= float(element.get("y")) <= 210


def test_a_camera_that_is_turned_is_drawn_and_described_so(placement) -> None:
    def field_of_view(made: Placement) -> list[tuple[float, float]]:
        shapes = ET.fromstring(plan_drawing(made).encode()).iter(f"{SVG}polygon")
        points = next(shape for shape in shapes if shape.get("fill") == "#f2c94c").get("points")
        return [tuple(map(float, point.split(","))) for point in points.split()]

    straight = field_of_view(placement)
    turned = replace(placement, rig=replace(placement.rig, pan_deg=100.0, roll_deg=-3.0))
    seen = field_of_view(turned)
    assert "turned 100.0° to the right" in plan_drawing(turned) and "rolled 3.0° anticlockwise" in plan_drawing(turned)
    leaning = default_rig(lean_deg=(4.0, 0.0)).mirrors
    said = heights_in_words(replace(placement.rig, mirrors=leaning))
    assert "leaning" in said[1] and said[2].strip() == "its top forward by 4.0°" and "upright" in said[4]
    assert seen[0] == straight[0]  # the camera
    angles = np.unwrap([np.arctan2(y - seen[0][1], x - seen[0][0]) for x, y in seen[1:]])
    lens = placement.rig.intrinsics
    wide = np.arctan(lens.cx / lens.fx) + np.arctan((lens.width - 1 - lens.cx) / lens.fx)
    assert (np.diff(angles) > 0).all() and np.ptp(angles) == pytest.approx(wide, abs=1e-3)
    assert angles.mean() == pytest.approx(np.radians(10.0), abs=0.3)  # to the right and 10° towards the reader


def test_files_of_a_plan_are_read_back(placement, body, tmp_path) -> None:
    paths = write_plan(placement, body, tmp_path)
    assert [path.name for path in paths] == ["plan.svg", "rig.json", "preview.png"]
    rig = placement.rig
    to_camera = np.linalg.inv(rig.camera_to_avatar)
    for mirror, made in zip(mirrors_for(read_rig(paths[1]), rig.intrinsics), rig.mirrors, strict=True):
        point, normal = apparent_plane(made, rig.camera)
        point, normal = to_camera[:3, :3] @ point + to_camera[:3, 3], to_camera[:3, :3] @ normal
        assert np.allclose(mirror.point, point) and np.allclose(mirror.normal, normal)
        assert np.allclose(np.diff(mirror.rectangle, axis=1)[:, 0], (made.width, made.height))
    with pytest.raises(Exception, match="does not exist"):
        write_plan_drawing(tmp_path / "nowhere" / "plan.svg", placement)
