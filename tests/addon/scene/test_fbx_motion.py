"""Motions that Blender exports as FBX come back as core reads their BVH."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import read_bvh, retarget, write_bvh
from motion_figures import angles, apart, gymnastics, skeleton

bpy = pytest.importorskip("bpy")
MOTIONS = Path(__file__).resolve().parents[4] / "shared" / "data" / "motion"


@pytest.fixture
def read_fbx_motion(addon):
    from mirror_scan.mirror_scan_addon.scene.fbx_motion import read_fbx_motion

    return read_fbx_motion


def _exported(bvh: Path, frames: int, folder: Path, up: str = "Y", **options) -> Path:
    """The BVH imported and exported as FBX by Blender; nothing of it stays."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_anim.bvh(
        filepath=str(bvh), update_scene_fps=True, axis_forward="Y" if up == "Z" else "-Z", axis_up=up
    )
    bpy.context.scene.frame_end = frames  # the importer leaves 250
    path = folder / "motion.fbx"
    bpy.ops.export_scene.fbx(filepath=str(path), bake_anim_simplify_factor=0, add_leaf_bones=False, **options)
    return path


def _limbs(joints: np.ndarray) -> np.ndarray:
    ways = []
    for side in ("Left", "Right"):
        for start, end in (("Arm", "ForeArm"), ("ForeArm", "Hand"), ("UpLeg", "Leg"), ("Leg", "Foot")):
            ways.append(joints[:, BONES.index(side + end)] - joints[:, BONES.index(side + start)])
    return np.stack(ways, axis=1)


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_limbs_move_as_those_of_the_bvh(read_fbx_motion, tmp_path, scale):
    write_bvh(tmp_path / "motion.bvh", gymnastics(40))
    path = _exported(tmp_path / "motion.bvh", 40, tmp_path, global_scale=scale)
    before = {block.name for blocks in (bpy.data.objects, bpy.data.armatures, bpy.data.actions, bpy.data.scenes)
              for block in blocks}  # fmt: skip
    motion = read_fbx_motion(path)
    after = {block.name for blocks in (bpy.data.objects, bpy.data.armatures, bpy.data.actions, bpy.data.scenes)
             for block in blocks}  # fmt: skip
    assert after == before
    assert (len(motion), round(motion.rate, 3)) == (40, 30)
    person = skeleton()
    plain, ours = (
        retarget(read_bvh(tmp_path / "motion.bvh"), person, lock_feet=False),
        retarget(motion, person, lock_feet=False),
    )
    turn = ours.turned @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ plain.turned.T
    assert angles(_limbs(ours.joints(person)), _limbs(plain.joints(person)) @ turn.T).max() < 0.1


@pytest.mark.parametrize(
    "name", ["jumping_jacks_cmu", "crouch_jump_zup", "dance_rokoko_cm", "jumps_turn_cgspeed", "squat_armsup_apose_m"]
)
def test_files_of_every_convention(read_fbx_motion, tmp_path, name):
    if not MOTIONS.is_dir():
        pytest.skip("no ../shared/data/motion beside the checkout")
    bvh = read_bvh(MOTIONS / f"{name}.bvh")
    path = _exported(MOTIONS / f"{name}.bvh", len(bvh), tmp_path, "Z" if name.endswith("zup") else "Y")
    motion = read_fbx_motion(path)
    assert len(motion) == len(bvh) and motion.rate == pytest.approx(bvh.rate, rel=1e-5)
    person = skeleton()
    plain, ours = (retarget(each, person, lock_feet=False) for each in (bvh, motion))
    up = np.eye(3) if name.endswith("zup") else np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    turn = ours.turned @ up @ plain.turned.T
    assert angles(_limbs(ours.joints(person)), _limbs(plain.joints(person)) @ turn.T).max() < 0.1


def test_a_rest_pose_that_the_file_keeps_is_used(read_fbx_motion, tmp_path):
    """A skin keeps it: trunk, palms and feet then are the BVH's too."""
    write_bvh(tmp_path / "motion.bvh", gymnastics(20))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_anim.bvh(filepath=str(tmp_path / "motion.bvh"), update_scene_fps=True)
    armature = bpy.context.object
    bpy.context.scene.frame_end = 20
    mesh = bpy.data.meshes.new("skin")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    skin = bpy.data.objects.new("skin", mesh)
    bpy.context.collection.objects.link(skin)
    skin.parent = armature
    skin.modifiers.new("Armature", "ARMATURE").object = armature
    for bone in armature.data.bones:
        skin.vertex_groups.new(name=bone.name).add([0, 1, 2], 0.05, "REPLACE")
    path = tmp_path / "skinned.fbx"
    bpy.ops.export_scene.fbx(filepath=str(path), bake_anim_simplify_factor=0, add_leaf_bones=True)
    person = skeleton()
    plain = retarget(read_bvh(tmp_path / "motion.bvh"), person)
    ours = retarget(read_fbx_motion(path), person)
    assert apart(ours.rotations, plain.rotations).max() < 0.5
    np.testing.assert_allclose(ours.translations, plain.translations, atol=0.01)


def test_files_without_a_motion_are_told(read_fbx_motion, tmp_path, capfd):
    with pytest.raises(MirrorScanError, match="there is no such file"):
        read_fbx_motion(tmp_path / "none.fbx")
    (tmp_path / "noise.fbx").write_bytes(b"Kaydara FBX Binary  \0" + bytes(50))
    with pytest.raises(MirrorScanError, match="noise.fbx: Blender cannot read it"):
        read_fbx_motion(tmp_path / "noise.fbx")
    (tmp_path / "picture.fbx").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(50))
    capfd.readouterr()
    with pytest.raises(MirrorScanError, match=r"picture.fbx: Blender cannot read it: (?!Error)[^\n]+$"):
        read_fbx_motion(tmp_path / "picture.fbx")
    assert capfd.readouterr().err == ""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "cube.fbx"))
    with pytest.raises(MirrorScanError, match="nothing in it moves a skeleton"):
        read_fbx_motion(tmp_path / "cube.fbx")
