"""Skeletons as armatures: Blender moves the skin as core does; every format brings bones, weights and motion back."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.avatar_file import PREFIX, Avatar
from mirror_scan.core.avatar.bone_axes import rest_axes
from mirror_scan.core.avatar.clip import Clip
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES
from scipy.spatial.transform import Rotation
from standing_body import skeleton_of

FRAMES = 6


@pytest.fixture(scope="module")
def avatar(capsule):
    """A capsule with a skeleton, weights and a motion."""
    rng = np.random.default_rng(8)
    count = len(capsule.vertices)
    weight = -np.sort(-rng.dirichlet(np.ones(4), count), axis=1).astype(np.float32)
    index = np.array([rng.choice(len(BONES), 4, replace=False) for _ in range(count)], np.uint8)
    turns = Rotation.from_rotvec(rng.normal(0, 0.3, (FRAMES * len(BONES), 3))).as_matrix()
    motion = Clip("wave", 25.0, turns.reshape(FRAMES, len(BONES), 3, 3), rng.normal(0, 0.1, (FRAMES, 3)))
    return Avatar(capsule, skeleton_of(45.0, 9.0), SkinWeights(index, weight), [motion])


def moved(avatar: Avatar, frame: int) -> np.ndarray:
    (motion,) = avatar.clips
    pose = Pose(motion.rotations[frame], motion.translations[frame])
    return skinned(avatar.mesh.vertices, avatar.weights, bone_matrices(avatar.skeleton, pose))


def evaluated(bpy, frame: int) -> np.ndarray:
    """World positions of the scene's mesh at a frame."""
    bpy.context.scene.frame_set(frame)
    body = next(item for item in bpy.context.scene.objects if item.type == "MESH" and item.vertex_groups)
    shape = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.empty((len(shape.data.vertices), 3), np.float32)
    shape.data.vertices.foreach_get("co", points.ravel())
    return points @ np.array(shape.matrix_world)[:3, :3].T + np.array(shape.matrix_world)[:3, 3]


def test_blend_opens_with_bones_that_move_the_skin_as_core_does(bpy, avatar, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.export import write_blend

    write_blend(tmp_path / "a.blend", avatar, own_process=True, clip=avatar.clips[0])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base) == (0, FRAMES - 1, 25.0)
    armature = next(item for item in scene.objects if item.type == "ARMATURE")
    assert armature.show_in_front and [bone.name for bone in armature.data.bones] == [PREFIX + name for name in BONES]
    axes = rest_axes(avatar.skeleton)
    for bone, name in enumerate(BONES):
        found = np.array(armature.data.bones[PREFIX + name].matrix_local)
        np.testing.assert_allclose(found[:3, :3], axes[bone], atol=1e-4)
        np.testing.assert_allclose(found[:3, 3], avatar.skeleton.joints[bone], atol=1e-6)
    for frame in (0, FRAMES - 1):
        np.testing.assert_allclose(evaluated(bpy, frame), moved(avatar, frame), atol=2e-4)


def test_an_avatar_of_a_blend_comes_back(bpy, avatar, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.blend_avatar import read_blend_avatar
    from mirror_scan.mirror_scan_addon.scene.export import write_blend

    write_blend(tmp_path / "a.blend", avatar, own_process=True)
    found = read_blend_avatar(tmp_path / "a.blend")
    np.testing.assert_allclose(found.mesh.vertices, avatar.mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.mesh.colors, avatar.mesh.colors)
    np.testing.assert_allclose(found.skeleton.joints, avatar.skeleton.joints, atol=1e-6)
    np.testing.assert_allclose(found.skeleton.ends, avatar.skeleton.ends, atol=1e-5)
    np.testing.assert_array_equal(found.weights.index, avatar.weights.index)
    np.testing.assert_allclose(found.weights.weight, avatar.weights.weight, atol=1e-6)


@pytest.mark.parametrize("suffix", ["fbx", "usdc", "glb"])
def test_other_formats_come_back_with_bones_weights_and_motion(bpy, avatar, tmp_path, suffix):
    from mirror_scan.core.avatar.avatar_file import write_avatar
    from mirror_scan.mirror_scan_addon.scene import export

    path = str(tmp_path / f"a.{suffix}")
    if suffix == "glb":
        write_avatar(path, avatar)
    else:
        write = export.write_fbx if suffix == "fbx" else export.write_usd
        write(path, avatar, clip=avatar.clips[0])
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 25
    load = {"fbx": bpy.ops.import_scene.fbx, "usdc": bpy.ops.wm.usd_import, "glb": bpy.ops.import_scene.gltf}[suffix]
    load(filepath=path)
    armature = next(item for item in scene.objects if item.type == "ARMATURE")
    assert len(armature.data.bones) == len(BONES)
    first = 1 if suffix == "fbx" else 0  # where Blender's importer puts the first frame
    for frame in (0, FRAMES - 1):
        np.testing.assert_allclose(evaluated(bpy, first + frame), moved(avatar, frame), atol=5e-4)
    body = next(item for item in scene.objects if item.type == "MESH" and item.vertex_groups)
    assert max(len(vertex.groups) for vertex in body.data.vertices) == 4
    assert body.data.color_attributes


def test_a_motion_of_an_fbx_file_is_read_frame_by_frame(bpy, avatar, tmp_path):
    from mirror_scan.core.avatar.pose import posed_joints
    from mirror_scan.mirror_scan_addon.scene.export import write_fbx
    from mirror_scan.mirror_scan_addon.scene.fbx_motion import read_fbx_motion

    write_fbx(tmp_path / "a.fbx", avatar, clip=avatar.clips[0])
    found = read_fbx_motion(tmp_path / "a.fbx")
    assert (len(found), found.rate) == (FRAMES, 25.0)
    place = [found.joints.index(PREFIX + name) for name in BONES]
    (motion,) = avatar.clips
    np.testing.assert_allclose(found.rest[place], avatar.skeleton.joints, atol=1e-4)
    np.testing.assert_allclose(found.rotations[:, place], motion.rotations, atol=2e-3)
    for frame in range(FRAMES):
        joints = posed_joints(avatar.skeleton, Pose(motion.rotations[frame], motion.translations[frame]))
        np.testing.assert_allclose(found.positions[frame, place], joints, atol=1e-3)


@pytest.mark.parametrize("lengths", [(2, FRAMES), (FRAMES, 2)], ids=["short first", "long first"])
def test_of_several_motions_of_an_fbx_file_the_longest_is_read(bpy, avatar, tmp_path, lengths):
    from mirror_scan.mirror_scan_addon.scene.armature import add_clip
    from mirror_scan.mirror_scan_addon.scene.export import write_blend
    from mirror_scan.mirror_scan_addon.scene.fbx_motion import read_fbx_motion

    (motion,) = avatar.clips
    write_blend(tmp_path / "a.blend", avatar, own_process=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    armature = next(item for item in bpy.context.scene.objects if item.type == "ARMATURE")
    for length in lengths:
        clip = Clip(f"of {length}", motion.rate, motion.rotations[:length], motion.translations[:length])
        action = add_clip(armature, clip)
        track = armature.animation_data.nla_tracks.new()
        track.strips.new(clip.name, 0, action).action_slot = action.slots[0]
    armature.animation_data.action = None
    bpy.ops.export_scene.fbx(
        filepath=str(tmp_path / "a.fbx"), object_types={"ARMATURE"}, bake_anim_use_all_actions=False
    )
    assert len(read_fbx_motion(tmp_path / "a.fbx")) == FRAMES


def test_files_without_a_skeleton_are_told(bpy, reconstruction, tmp_path):
    from mirror_scan.core.errors import MirrorScanError
    from mirror_scan.mirror_scan_addon.scene.blend_avatar import read_blend_avatar
    from mirror_scan.mirror_scan_addon.scene.export import write_blend, write_fbx
    from mirror_scan.mirror_scan_addon.scene.fbx_motion import read_fbx_motion

    write_blend(tmp_path / "a.blend", reconstruction, own_process=True)
    write_fbx(tmp_path / "a.fbx", reconstruction)
    (tmp_path / "b.fbx").write_text("no fbx")
    for read, name in ((read_blend_avatar, "a.blend"), (read_fbx_motion, "a.fbx"), (read_fbx_motion, "b.fbx"),
                       (read_fbx_motion, "c.fbx")):  # fmt: skip
        with pytest.raises(MirrorScanError, match=name):
            read(tmp_path / name)
