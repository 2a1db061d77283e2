"""Advice cures what it names."""

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.rig_planning.area_coverage import body_samples
from mirror_scan.core.rig_planning.placement_advice import placement_advice
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig


@pytest.fixture(scope="module")
def body():
    return body_samples(mannequin(resolution=0.02), 1024)


def test_the_readmes_placement_needs_no_move(body) -> None:
    checks = placement_advice(body, default_rig())
    assert [check.name for check in checks] == ["direct", "right", "left"]
    for check in checks:
        assert check.advice is None and all(check.whole(part) for part in ("head", "hands", "feet"))


@pytest.mark.parametrize(("rise", "part", "way"), [(0.5, "feet", "down"), (-0.06, "head", "up")])
def test_a_mirror_too_high_or_too_low_is_moved_back(body, rise, part, way) -> None:
    rig = default_rig(mirror_size=(0.8, 1.32))  # on the floor, it is too low for the head
    mirror = rig.mirrors[1]
    moved = replace(mirror, centre=(*mirror.centre[:2], mirror.centre[2] + rise))
    checks = placement_advice(body, replace(rig, mirrors=(rig.mirrors[0], moved)))
    assert not checks[2].whole(part) and checks[2].whole("head" if part == "feet" else "feet")
    said = str(checks[2].advice)
    assert said.startswith("left mirror: ") and f"the {part}" in said and f"move it {way} by" in said
    assert checks[2].advice is not None and checks[2].advice.mirrors == ("left",)
    by = float(said.split(f"move it {way} by ")[1].split(" cm")[0]) / 100.0
    cured = replace(moved, centre=(*moved.centre[:2], moved.centre[2] + (by if way == "up" else -by)))
    assert placement_advice(body, replace(rig, mirrors=(rig.mirrors[0], cured)))[2].advice is None


def test_what_no_move_cures_says_what_size_would(body) -> None:
    rig = default_rig(mirror_size=(0.25, 1.75))
    larger = []
    for mirror, check in zip(rig.mirrors, placement_advice(body, rig)[1:], strict=True):
        said = str(check.advice)
        assert "use a mirror that is" in said and "wider" in said
        by = float(said.split("that is ")[1].split(" cm wider")[0]) / 100.0
        larger.append(replace(mirror, width=mirror.width + by))
    for check in placement_advice(body, replace(rig, mirrors=tuple(larger)))[1:]:
        assert check.advice is None or "move it" in str(check.advice) or "turn it" in str(check.advice)


def test_a_camera_that_cuts_the_feet_off_is_tilted_or_moved(body) -> None:
    rig = default_rig(tilt_deg=-12.0)
    direct = placement_advice(body, rig)[0]
    assert not direct.whole("feet") and "tilt the camera down" in str(direct.advice)
    near = placement_advice(body, default_rig(subject_distance=1.2))[0]
    assert "move the camera back" in str(near.advice)
    assert np.isfinite(list(near.shown.values())).all()
