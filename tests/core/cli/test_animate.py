"""Avatars with a skeleton on the command line: ``reconstruct --skeleton`` and ``animate``, without Blender."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.avatar.avatar_file import Avatar, read_avatar, write_avatar
from mirror_scan.core.avatar.clip import Clip
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.motion import CLIPS
from standing_body import skeleton_of


@pytest.fixture
def avatar(tmp_path):
    """The file of an avatar whose skin is a dot beside each joint."""
    skeleton = skeleton_of(45.0, 9.0)
    vertices = (skeleton.joints[:, None] + 0.02 * np.eye(3)).reshape(-1, 3)
    triangles = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    index = np.zeros((len(vertices), 4), np.uint8)
    index[:, 0] = np.repeat(np.arange(len(BONES)), 3)
    weights = SkinWeights(index, np.tile(np.float32([1, 0, 0, 0]), (len(vertices), 1)))
    path = tmp_path / "avatar.glb"
    write_avatar(path, Avatar(Mesh(vertices, triangles), skeleton, weights))
    return path


def test_a_motion_is_not_replaced_by_what_is_made_of_it(avatar, tmp_path, capsys):
    path = tmp_path / "dance.glb"
    path.write_bytes(b"a motion")
    assert cli.main(["animate", str(avatar), str(path), "-o", str(tmp_path / "." / "dance.glb")]) == 1
    assert "is the motion that is read" in capsys.readouterr().err and path.read_bytes() == b"a motion"


@pytest.mark.parametrize("name", sorted(CLIPS))
def test_own_clips_go_into_a_glb(avatar, tmp_path, capsys, name):
    out = tmp_path / "moving.glb"
    assert cli.main(["animate", str(avatar), name, "-o", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    moving, still = read_avatar(out), read_avatar(avatar)
    np.testing.assert_allclose(moving.mesh.vertices, still.mesh.vertices, atol=1e-6)
    (motion,) = moving.clips
    assert motion.name == name and len(motion.rotations) > 3
    assert not still.clips and sorted(p.name for p in tmp_path.iterdir()) == ["avatar.glb", "moving.glb"]


def test_a_bvh_file_goes_into_a_glb(avatar, tmp_path):
    joints = "\n".join(
        ("HIERARCHY", "ROOT Hips", "{", "OFFSET 0 0.95 0",
         "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation", chain("Spine", (0, 0.1, 0), chain(
             "Spine1", (0, 0.1, 0), chain("Neck", (0, 0.3, 0), chain("Head", (0, 0.1, 0), end((0, 0.2, 0)))) + "".join(
                 chain(f"{side}Shoulder", (sign * 0.05, 0.25, 0), chain(f"{side}Arm", (sign * 0.12, 0, 0), chain(
                     f"{side}ForeArm", (sign * 0.27, 0, 0), chain(f"{side}Hand", (sign * 0.24, 0, 0),
                                                                 end((sign * 0.15, 0, 0))))))
                 for side, sign in (("Left", 1), ("Right", -1))))) + "".join(
            chain(f"{side}UpLeg", (sign * 0.09, -0.07, 0), chain(f"{side}Leg", (0, -0.4, 0), chain(
                f"{side}Foot", (0, -0.4, 0), chain(f"{side}ToeBase", (0, -0.06, 0.12), end((0, 0, 0.06))))))
            for side, sign in (("Left", 1), ("Right", -1))), "}")
    )  # fmt: skip
    channels = 6 + 3 * 21 - 3  # Spine2 is missing
    rows = [" ".join(["0", "0.95", "0", *["0"] * (channels - 3)]) for _ in range(5)]
    path = tmp_path / "still.bvh"
    path.write_text(joints + "\nMOTION\nFrames: 5\nFrame Time: 0.04\n" + "\n".join(rows) + "\n")
    assert cli.main(["animate", str(avatar), str(path), "-o", str(tmp_path / "b.glb"), "--in-place", "--quiet"]) == 0
    (motion,) = read_avatar(tmp_path / "b.glb").clips
    assert motion.rate == pytest.approx(25.0, abs=0.01) and len(motion.rotations) == 5
    skeleton = read_avatar(avatar).skeleton
    arm = BONES.index("LeftForeArm")
    along = motion.rotations[2, arm] @ (skeleton.tails()[arm] - skeleton.joints[arm])
    assert along[0] / np.linalg.norm(along) > 0.99  # the file's rest pose is a T


def chain(name: str, offset, inner: str) -> str:
    return (f"JOINT {name}\n{{\nOFFSET {' '.join(map(str, offset))}\n"
            f"CHANNELS 3 Zrotation Xrotation Yrotation\n{inner}}}\n")  # fmt: skip


def end(offset) -> str:
    return f"End Site\n{{\nOFFSET {' '.join(map(str, offset))}\n}}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{avatar}", "hop", "-o", "{out}.glb"), "idle, walk"),
        (("{avatar}", "walk", "-o", "{out}.ply"), ".glb"),
        (("{avatar}", "walk", "-o", "{out}.fbx"), "Blender"),
        (("{avatar}", "{out}.fbx", "-o", "{out}.glb"), "Blender"),
        (("{avatar}", "{out}.bvh", "-o", "{out}.glb"), ".bvh"),
        (("{out}.blend", "walk", "-o", "{out}.glb"), "Blender"),
        (("{out}.ply", "walk", "-o", "{out}.glb"), "no avatar"),
        (("{bare}", "walk", "-o", "{out}.glb"), "no skeleton"),
    ],
)
def test_what_cannot_be_animated_is_one_line(avatar, tmp_path, capsys, arguments, words):
    bare = tmp_path / "bare.glb"
    write_avatar(bare, Avatar(read_avatar(avatar).mesh))
    filled = [part.format(avatar=avatar, bare=bare, out=tmp_path / "out") for part in arguments]
    assert cli.main(["animate", *filled]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and words in error
    assert sorted(p.name for p in tmp_path.iterdir()) == ["avatar.glb", "bare.glb"]


def test_readers_and_writers_come_from_outside(avatar, tmp_path):
    got = {}

    def write(path, what, *, clip):
        got["clip"] = clip
        path.write_text("x")

    readers = {".blend": lambda path: read_avatar(avatar)}
    arguments = ["animate", str(tmp_path / "a.blend"), "walk", "-o", str(tmp_path / "a.usd"), "--quiet"]
    assert cli.main(arguments, writers={".usd": write}, readers=readers) == 0
    assert isinstance(got["clip"], Clip)


def test_reconstruct_writes_the_skeleton(folder, monkeypatch, capsys):
    """What the pipeline found goes into a .glb without Blender, in the avatar's frame, and into the report."""
    from mirror_scan.core import pipeline
    from mirror_scan.core.pipeline.report import skeleton_summary

    skeleton = skeleton_of(45.0, 9.0)
    index, weight = np.zeros((3, 4), np.uint8), np.tile(np.float32([1, 0, 0, 0]), (3, 1))
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    to_avatar = np.eye(4)
    to_avatar[:3, 3] = 1, 2, 3

    def reconstruct(capture, mirrors=None, settings=None, progress=None, frame="avatar"):
        assert settings.skeleton
        report = {"mesh": {"vertices": 3, "triangles": 1, "watertight": True, "height_m": 1.0, "volume_l": 1.0},
                  "skeleton": skeleton_summary(skeleton)}  # fmt: skip
        moved = skeleton.transformed(np.linalg.inv(to_avatar))
        return pipeline.Reconstruction(
            mesh.transformed(np.linalg.inv(to_avatar)), frame, to_avatar, report, (), (), (), moved,
            SkinWeights(index, weight),
        )  # fmt: skip

    monkeypatch.setattr(pipeline, "reconstruct", reconstruct)
    out, report = folder.parent / "a.glb", folder.parent / "r.json"
    arguments = ["reconstruct", str(folder), "-o", str(out), "--report", str(report), "--frame", "camera", "--mirrors"]
    (folder.parent / "none.json").write_text('{"mirrors": []}')
    assert cli.main([*arguments, str(folder.parent / "none.json"), "--vrm", "--quiet"]) == 0
    found = read_avatar(out)
    np.testing.assert_allclose(found.mesh.vertices, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(found.skeleton.joints, skeleton.joints, atol=2e-6)
    written = json.loads(report.read_text())["skeleton"]
    assert list(written["joints"]) == list(BONES) and list(written["confidence"]) == list(BONES)
    np.testing.assert_allclose(written["joints"]["Head"], skeleton.joints[5])
