"""Placements stand in their room and are at least as good as the README's."""

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.rig_planning.area_coverage import area_coverage, body_samples
from mirror_scan.core.rig_planning.placement_search import find_placement, footprint
from mirror_scan.core.rig_planning.predicted_error import predicted_error
from mirror_scan.core.rig_planning.rooms import Room
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig


@pytest.fixture(scope="module")
def body():
    return mannequin(resolution=0.02)


def check_in_room(placement) -> None:
    x0, x1, y0, y1, z1 = placement.rig.room
    sizes = sorted((placement.room.width, placement.room.depth))
    assert sorted((x1 - x0, y1 - y0)) == pytest.approx(sizes) and z1 == placement.room.height
    for mirror in placement.rig.mirrors:
        stands = footprint(mirror)
        assert (stands[:, 0] > x0).all() and (stands[:, 0] < x1).all()
        assert (stands[:, 1] > y0).all() and (stands[:, 1] < y1).all()
        assert mirror.centre[2] - mirror.height / 2 >= 0 and mirror.centre[2] + mirror.height / 2 <= z1
    places = [footprint(mirror, 50) for mirror in placement.rig.mirrors]
    for k, one in enumerate(places):
        for other in places[:k]:
            assert np.linalg.norm(one[:, None] - other[None], axis=-1).min() > 0.04


@pytest.mark.slow
def test_a_room_that_holds_the_readmes_placement_gets_one_as_good(body) -> None:
    told: list[float] = []
    found = find_placement(
        Room(3.2, 4.0, 2.4), "azure_kinect", body=body, progress=lambda fraction, message: told.append(fraction)
    )
    assert told == sorted(told) and 0.9 < told[-1] <= 1.0
    check_in_room(found)
    assert found.readme
    samples, rig = body_samples(body), default_rig(tilt_deg=1.0)
    known = area_coverage(samples, rig)
    assert found.coverage.share >= known.share - 0.002
    assert found.error.mean_mm <= predicted_error(samples, known, rig).mean_mm * 1.005


def test_a_room_too_small_says_by_how_much(body) -> None:
    with pytest.raises(MirrorScanError, match="cm (wider|deeper)") as raised:
        find_placement(Room(1.6, 1.9, 2.4), "azure_kinect", body=body)
    assert "too small" in str(raised.value) and "\n" not in str(raised.value)
    with pytest.raises(MirrorScanError, match="higher than the room"):
        find_placement(Room(4.0, 5.0, 1.7), "azure_kinect", body=body)
    with pytest.raises(MirrorScanError, match="one to six"):
        find_placement(Room(4.0, 5.0), "azure_kinect", (), body)
    with pytest.raises(MirrorScanError, match="no sensor"):
        find_placement(Room(4.0, 5.0), "brownie", body=body)
    with pytest.raises(MirrorScanError, match="room"):
        Room(0.0, 3.0)
