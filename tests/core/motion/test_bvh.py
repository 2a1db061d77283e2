"""BVH read and written; every kind of damage is one clear message."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import read_bvh, write_bvh
from motion_figures import gymnastics
from scipy.spatial.transform import Rotation

CHAIN = """HIERARCHY
ROOT hip
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT knee
  {
    OFFSET 0 -4 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -3 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.04
5 6 7 90 0 0 0 0 90
1 2 3 10 20 30 40 50 60
"""


def _written(tmp_path, text: str, encoding: str = "utf-8"):
    path = tmp_path / "chain.bvh"
    path.write_bytes(text.encode(encoding))
    return path


def test_a_chain_by_hand(tmp_path):
    motion = read_bvh(_written(tmp_path, CHAIN))
    assert motion.joints == ("hip", "knee", "knee_End") and motion.rate == pytest.approx(25)
    np.testing.assert_allclose(motion.rest, [[1, 2, 3], [1, -2, 3], [1, -5, 3]])
    # The root's position replaces its offset; turned by 90° about Z, the knee lies along +X.
    np.testing.assert_allclose(motion.positions[0], [[5, 6, 7], [9, 6, 7], [9, 6, 4]], atol=1e-12)
    hip = Rotation.from_euler("ZXY", [10, 20, 30], degrees=True)
    knee = hip * Rotation.from_euler("YZX", [40, 50, 60], degrees=True)
    np.testing.assert_allclose(motion.rotations[1], [h.as_matrix() for h in (hip, knee, knee)], atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("  ", "\t").replace(" ", "   "),
        lambda text: text.replace("Xposition", "XPOSITION").replace("OFFSET", "Offset"),
        lambda text: text.replace("ROOT hip\n{", "ROOT hip {"),
        lambda text: text.replace("Frames: 2", "Frames:2") + "\n\n",
        lambda text: text.replace("Frames: 2", "Frames: 90"),  # whole frames are there
        lambda text: text + "1 2 3\n",  # the last one is cut off
        lambda text: text.replace("90 0 0 0 0 90", "90 0\n0 0 0 90"),
        lambda text: "\ufeff" + text,
    ],
)
def test_spellings_that_mean_the_same(tmp_path, change):
    plain, other = read_bvh(_written(tmp_path, CHAIN)), read_bvh(_written(tmp_path, change(CHAIN)))
    np.testing.assert_allclose(other.positions, plain.positions)
    np.testing.assert_allclose(other.rotations, plain.rotations)


def test_joints_may_have_six_channels_and_none_and_utf16(tmp_path):
    text = CHAIN.replace("CHANNELS 3 Yr", "CHANNELS 6 Xposition Yposition Zposition Yr")
    text = text.replace("0 0 90\n", "0 -8 0 0 0 90\n").replace("40 50", "0 -4 0 40 50")
    motion = read_bvh(_written(tmp_path, text, "utf-16"))
    np.testing.assert_allclose(motion.positions[0, 1], [13, 6, 7], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "GLTF", "is no BVH file"),
        ("0 0 0 0 90", "0 0 0 0 9,5", "line 19: “9,5” has a decimal comma; export it again with points"),
        ("OFFSET 0 -4 0", "OFFSET 0 -4", "line 8: an OFFSET has 3 numbers, not 2"),
        ("CHANNELS 3 Y", "CHANNELS 4 Y", "line 9: these CHANNELS are not possible"),
        ("Zrotation Xrotation\n    End", "Zrotation Wrotation\n    End", "line 9: these CHANNELS"),
        ("Frame Time: 0.04", "Frame Time: 0", "line 18: a frame time of 0 s is not possible; write the seconds"),
        ("1 2 3 10", "1 2 nan 10", "line 20: a value of nan is not possible"),
        ("1 2 3 10", "1 2 1e300 10", r"line 20: a value of 1e\+300 is not possible"),
        ("1 2 3 10", "1 2 3 -1e18", r"line 20: a value of -1e\+18 is not possible"),
        ("OFFSET 0 -4 0", "OFFSET 0 nan 0", "line 8: this OFFSET is not possible"),
        ("OFFSET 0 -4 0", "OFFSET 0 0 -inf", "line 8: this OFFSET is not possible"),
        ("5 6 7 90", "5 6 90", "line 19: a frame has 9 numbers, not 8"),
        ("5 6 7", "5 six 7", "line 19: “six” is no number"),
        ("MOTION", "", "line 17: “Frames:” is not known here"),
        ("Frames: 2\n", "", "Frames or Frame Time is missing"),
        ("  JOINT knee", "  BONE knee", "line 6: “BONE” is not known here"),
        ("}\nMOTION", "MOTION", "MOTION comes before the skeleton is complete"),
        ("JOINT knee\n  {", "JOINT knee\n", "OFFSET|brace|CHANNELS|known|wrong|complete"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path, old, new, message):
    assert old in CHAIN
    with pytest.raises(MirrorScanError, match=message) as error:
        read_bvh(_written(tmp_path, CHAIN.replace(old, new, 1)))
    assert "chain.bvh" in str(error.value) and "\n" not in str(error.value)


def test_other_ends_of_a_file(tmp_path):
    for cut in (0, 40, CHAIN.index("MOTION"), CHAIN.index("5 6 7")):
        with pytest.raises(MirrorScanError, match="chain.bvh"):
            read_bvh(_written(tmp_path, CHAIN[:cut]))
    with pytest.raises(MirrorScanError, match="cannot be read"):
        read_bvh(tmp_path / "none.bvh")
    with pytest.raises(MirrorScanError, match="bvh"):
        (tmp_path / "noise.bvh").write_bytes(np.random.default_rng(0).bytes(3000))
        read_bvh(tmp_path / "noise.bvh")
    slow = read_bvh(_written(tmp_path, CHAIN.replace("0.04", "0")), rate=60)
    assert slow.rate == 60


def test_written_and_read_again(tmp_path):
    motion = gymnastics()
    write_bvh(tmp_path / "out.bvh", motion)
    again = read_bvh(tmp_path / "out.bvh")
    ours = [again.joints.index(name) for name in motion.joints]
    np.testing.assert_allclose(again.positions[:, ours], motion.positions, atol=1e-5)
    np.testing.assert_allclose(again.rotations[:, ours], motion.rotations, atol=1e-7)
    assert again.rate == pytest.approx(motion.rate)
