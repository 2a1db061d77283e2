"""A skeleton for an avatar, motions that move it, a tracker that is followed, and files it goes to."""

from __future__ import annotations

import json
import socket
import threading
import time

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def person():
    """A mannequin and its true skeleton."""
    from mirror_scan.core.simulation.mannequin import rigged_mannequin

    return rigged_mannequin(resolution=0.014)


@pytest.fixture(scope="module")
def found(person):
    """The steps' own result, made once: an Add Skeleton of these tests takes no time."""
    from mirror_scan.mirror_scan_addon import tasks

    job = tasks.skeleton_steps(person[0])
    while True:
        try:
            next(job)
        except StopIteration as end:
            return end.value


@pytest.fixture
def avatar(bpy, person, found, monkeypatch):
    """The mannequin in the scene, selected."""
    from mirror_scan.mirror_scan_addon import tasks
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    def skeleton_steps(mesh):
        yield 0.0, "Looking for the joints"
        return found

    monkeypatch.setattr(tasks, "skeleton_steps", skeleton_steps)
    made = avatar_objects.create_avatar(person[0], collection=bpy.context.scene.collection)
    avatar_objects.select_only(bpy.context, made)
    return made


def shape(bpy, item):
    """Vertices (V, 3) in the world as they are shown."""
    data = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", points)
    place = np.array(item.matrix_world)
    return points.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3]


def test_a_skeleton_stands_in_the_avatar(bpy, avatar, person, found):
    avatar.location, avatar.rotation_euler.z = (1.0, -2.0, 0.5), 0.7
    bpy.context.view_layer.update()
    before = shape(bpy, avatar)
    assert bpy.ops.mirror_scan.add_skeleton() == {"FINISHED"}
    bones = avatar.parent
    assert [c.name for c in bones.users_collection] == [f"{avatar.name} Skeleton"] and bones.show_in_front
    assert len(bones.data.bones) == 22 and {g.name for g in avatar.vertex_groups} == {b.name for b in bones.data.bones}
    after = shape(bpy, avatar)
    np.testing.assert_allclose(after[: len(before)], before, atol=2e-4)  # refined: vertices are added behind
    place = np.array(bones.matrix_world)
    for name in ("LeftForeArm", "RightLeg", "Head"):
        head = place[:3, :3] @ np.array(bones.data.bones[f"mixamorig:{name}"].head_local) + place[:3, 3]
        truth = person[1].joints[list(_bones()).index(name)]
        assert np.linalg.norm(np.linalg.inv(place)[:3, :3] @ (head - place[:3, 3]) - truth) < 0.03
    assert not bpy.ops.mirror_scan.add_skeleton.poll()


def _bones():
    from mirror_scan.core.avatar.skeleton import BONES

    return BONES


def test_undo_takes_the_skeleton_back(bpy, avatar):
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.mirror_scan.add_skeleton()
    bpy.ops.ed.undo_push(message="skeleton")
    bpy.ops.ed.undo()
    assert not bpy.data.armatures and bpy.data.objects["Avatar"].parent is None
    bpy.ops.ed.redo()
    assert len(bpy.data.armatures) == 1


def test_what_has_no_whole_person_gets_no_skeleton(bpy, capsule):
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    made = avatar_objects.create_avatar(capsule, collection=bpy.context.scene.collection)
    avatar_objects.select_only(bpy.context, made)
    with pytest.raises(RuntimeError, match=r"^Error: [^\n]+\s*$"):
        bpy.ops.mirror_scan.add_skeleton()
    assert not bpy.data.armatures and made.parent is None and not made.vertex_groups


@pytest.mark.parametrize("clip", ["idle", "walk", "arms_up", "squat", "turn"])
def test_a_clip_moves_the_avatar(bpy, avatar, clip):
    bpy.ops.mirror_scan.add_skeleton()
    rest = shape(bpy, avatar)
    assert bpy.ops.mirror_scan.apply_motion(clip=clip) == {"FINISHED"}
    scene = bpy.context.scene
    moved = []
    for frame in np.linspace(scene.frame_start, scene.frame_end, 6).astype(int):
        scene.frame_set(int(frame))
        posed = shape(bpy, avatar)
        moved.append(np.linalg.norm(posed - rest, axis=1).max())
        assert posed[:, 2].min() > -0.01
    assert max(moved) > (0.05 if clip == "idle" else 0.2)


def test_a_file_moves_it_at_the_scenes_rate(bpy, avatar, tmp_path):
    bpy.ops.mirror_scan.add_skeleton()
    bpy.context.scene.render.fps = 24
    (tmp_path / "nod.bvh").write_text(NOD)
    assert bpy.ops.mirror_scan.apply_motion(filepath=str(tmp_path / "nod.bvh"), lock_feet=False) == {"FINISHED"}
    assert bpy.context.scene.frame_end == 1 + 24  # a second
    with pytest.raises(RuntimeError, match="choose a BVH or FBX file"):
        bpy.ops.mirror_scan.apply_motion(filepath=str(tmp_path / "nod.abc"))
    (tmp_path / "bad.bvh").write_text("HIERARCHY\nROOT Hips\n{")
    with pytest.raises(RuntimeError, match=r"^Error: [^\n]*bad\.bvh[^\n]+\s*$"):
        bpy.ops.mirror_scan.apply_motion(filepath=str(tmp_path / "bad.bvh"))


@pytest.mark.parametrize(("ending", "read"), [("glb", "gltf"), ("fbx", "fbx"), ("usdc", "usd")])
def test_files_hold_skeleton_weights_and_clip(bpy, avatar, tmp_path, ending, read):
    bpy.ops.mirror_scan.add_skeleton()
    bpy.ops.mirror_scan.apply_motion(clip="squat")
    bpy.context.scene.frame_set(40)
    wanted = shape(bpy, avatar)
    file = tmp_path / f"avatar.{ending}"
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(file)) == {"FINISHED"}
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    {"gltf": bpy.ops.import_scene.gltf, "fbx": bpy.ops.import_scene.fbx, "usd": bpy.ops.wm.usd_import}[read](
        filepath=str(file)
    )
    bones = next(item for item in bpy.data.objects if item.type == "ARMATURE")
    body = max((item for item in bpy.data.objects if item.type == "MESH"), key=lambda item: len(item.data.polygons))
    assert len(bones.data.bones) == 22 and len(body.vertex_groups) == 22
    action = bones.animation_data.action
    bpy.context.scene.frame_set(40 + round(action.frame_range[0]) - 1)
    found = shape(bpy, body)
    for low, high in ((wanted.min(axis=0), found.min(axis=0)), (wanted.max(axis=0), found.max(axis=0))):
        np.testing.assert_allclose(high, low, atol=0.004)


def test_the_t_pose_becomes_the_rest_pose(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton()
    bpy.ops.mirror_scan.apply_motion(clip="squat")
    assert bpy.ops.mirror_scan.rest_in_t_pose() == {"FINISHED"}
    bones = avatar.parent
    arm = bones.data.bones["mixamorig:LeftForeArm"]
    assert (arm.tail_local - arm.head_local).normalized().x > 0.99
    points = shape(bpy, avatar)
    assert np.ptp(points[:, 0]) > 0.85 * np.ptp(points[:, 2]) and abs(points[:, 2].min()) < 0.02
    assert bones.animation_data.action is None
    bpy.ops.mirror_scan.apply_motion(clip="arms_up")
    bpy.context.scene.frame_set(bpy.context.scene.frame_end // 2)
    assert shape(bpy, avatar)[:, 2].max() > 1.15 * points[:, 2].max()


def test_the_t_pose_of_one_leaves_others_of_its_mesh_as_they_are(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton()
    twin = avatar.copy()
    twin.parent = avatar.parent.copy()
    for item in (twin, twin.parent):
        bpy.context.scene.collection.objects.link(item)
    twin.modifiers["Armature"].object = twin.parent
    bpy.context.view_layer.update()
    before, rest = shape(bpy, twin), [bone.head_local.copy() for bone in twin.parent.data.bones]
    assert bpy.ops.mirror_scan.rest_in_t_pose() == {"FINISHED"}
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(shape(bpy, twin), before)
    assert rest == [bone.head_local for bone in twin.parent.data.bones]
    assert np.ptp(shape(bpy, avatar)[:, 0]) > 1.1 * np.ptp(before[:, 0])
    assert avatar.data != twin.data and avatar.parent.data != twin.parent.data
    mesh = avatar.data
    assert bpy.ops.mirror_scan.rest_in_t_pose() == {"FINISHED"} and avatar.data == mesh  # its own already


def test_a_turned_and_lifted_avatar_is_animated_from_its_file(bpy, avatar, found, tmp_path):
    """Exported where it stands; read, it stands in the avatar frame again, with its clip and the clip's name."""
    from mirror_scan.core.avatar.avatar_file import read_avatar

    bpy.ops.mirror_scan.add_skeleton()
    bpy.ops.mirror_scan.apply_motion(clip="squat")
    avatar.parent.location, avatar.parent.rotation_euler = (1.0, -2.0, 0.8), (0.3, 0.1, 2.0)
    bpy.context.view_layer.update()
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path / "a.glb")) == {"FINISHED"}
    read = read_avatar(tmp_path / "a.glb")
    np.testing.assert_allclose(read.skeleton.joints, found.skeleton.joints, atol=1e-4)
    np.testing.assert_allclose(np.ptp(read.mesh.vertices, axis=0), np.ptp(found.mesh.vertices, axis=0), atol=1e-4)
    (clip,) = read.clips
    assert clip.name == avatar.parent.animation_data.action.name != "Animation"
    joints, pose = clip.joints(read.skeleton), avatar.parent.pose
    for frame in (0, len(clip) // 2, len(clip) - 1):
        bpy.context.scene.frame_set(bpy.context.scene.frame_start + frame)
        heads = [pose.bones[f"mixamorig:{name}"].head for name in _bones()]
        np.testing.assert_allclose(joints[frame], heads, atol=1e-3)


@pytest.mark.parametrize("ending", ["glb", "fbx", "obj"])
def test_a_mirrored_avatar_says_that_its_skeleton_stays_behind(bpy, avatar, tmp_path, ending):
    from mirror_scan.mirror_scan_addon.scene import export

    bpy.ops.mirror_scan.add_skeleton()
    file, kind = tmp_path / f"avatar.{ending}", ending.upper()
    assert not export.write_object(file, avatar, kind)
    avatar.parent.scale.x = -1.0
    bpy.context.view_layer.update()
    assert export.write_object(file, avatar, kind) == (ending != "obj")
    said = bpy.ops.mirror_scan.export_avatar(filepath=str(file))
    assert said == {"FINISHED"} and file.exists()


def test_control_bones_lead_hands_and_feet(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton(controls=True)
    bones = avatar.parent
    rest = shape(bpy, avatar)
    bones.pose.bones["Control LeftHand"].location.y -= 0.1
    bpy.context.view_layer.update()
    moved = np.linalg.norm(shape(bpy, avatar) - rest, axis=1)
    assert moved.max() > 0.05 and (moved < 1e-4).mean() > 0.6
    # a motion has the limbs again
    bpy.ops.mirror_scan.apply_motion(clip="arms_up")
    bpy.context.scene.frame_set(bpy.context.scene.frame_end // 2)
    assert shape(bpy, avatar)[:, 2].max() > 1.1 * rest[:, 2].max()


def test_control_bones_come_along_into_the_t_pose(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton(controls=True)
    bpy.ops.mirror_scan.rest_in_t_pose()
    bpy.context.view_layer.update()
    led = shape(bpy, avatar)
    bpy.ops.mirror_scan.use_controls(on=False)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(led, shape(bpy, avatar), atol=2e-3)


def test_shape_keys_keep_their_rest_pose(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton()
    avatar.shape_key_add(name="Basis")
    joints = [bone.head_local.copy() for bone in avatar.parent.data.bones]
    with pytest.raises(RuntimeError, match="has shape keys"):
        bpy.ops.mirror_scan.rest_in_t_pose()
    assert joints == [bone.head_local for bone in avatar.parent.data.bones]


@pytest.mark.parametrize("change", ["renamed", "removed"])
def test_a_skeleton_that_lacks_a_bone_is_none(bpy, avatar, change):
    bpy.ops.mirror_scan.add_skeleton()
    bones = avatar.parent
    if change == "renamed":
        bones.data.bones["mixamorig:LeftForeArm"].name = "elbow"
    else:
        bpy.context.view_layer.objects.active = bones
        bpy.ops.object.mode_set(mode="EDIT")
        bones.data.edit_bones.remove(bones.data.edit_bones["mixamorig:LeftForeArm"])
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.context.view_layer.objects.active = avatar
    for operator in (bpy.ops.mirror_scan.apply_motion, bpy.ops.mirror_scan.follow_stream):
        assert not operator.poll()
    assert bpy.ops.mirror_scan.add_skeleton() == {"FINISHED"}
    assert bpy.ops.mirror_scan.apply_motion(clip="idle") == {"FINISHED"}


def test_bones_that_turned_by_angles_are_moved_too(bpy, avatar, found):
    bpy.ops.mirror_scan.add_skeleton()
    bones, rest = avatar.parent, shape(bpy, avatar)
    for bone in bones.pose.bones:
        bone.rotation_mode = "XYZ"
    _follow(bpy, _arms_up(found))
    assert shape(bpy, avatar)[:, 2].max() > 1.1 * rest[:, 2].max()
    for bone in bones.pose.bones:
        bone.rotation_mode = "XYZ"
    bpy.ops.mirror_scan.apply_motion(clip="arms_up")
    bpy.context.scene.frame_set(bpy.context.scene.frame_end // 2)
    assert shape(bpy, avatar)[:, 2].max() > 1.1 * rest[:, 2].max()


def test_a_blend_file_gives_the_avatar_in_its_size(bpy, avatar, found, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.blend_avatar import read_blend_avatar

    bpy.ops.mirror_scan.add_skeleton()
    bones = avatar.parent
    bones.location, bones.rotation_euler.z, bones.scale = (1, 2, 3), 1.0, (1.15, 1.15, 1.15)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "taller.blend"))
    read = read_blend_avatar(tmp_path / "taller.blend")
    np.testing.assert_allclose(read.skeleton.joints, 1.15 * found.skeleton.joints, atol=1e-4)
    assert np.ptp(read.mesh.vertices[:, 2]) == pytest.approx(1.15 * np.ptp(found.mesh.vertices[:, 2]), abs=1e-4)


def test_the_avatar_stays_with_its_parent(bpy, avatar):
    platform = bpy.data.objects.new("Platform", None)
    bpy.context.scene.collection.objects.link(platform)
    platform.location, platform.rotation_euler.z, platform.scale = (1, 2, 0), 0.5, (1.2, 1.2, 1.2)
    avatar.parent, avatar.location = platform, (0.3, 0, 0)
    bpy.context.view_layer.update()
    avatar.matrix_parent_inverse = platform.matrix_world.inverted()
    bpy.context.view_layer.update()
    before = shape(bpy, avatar)
    bpy.ops.mirror_scan.add_skeleton()
    np.testing.assert_allclose(shape(bpy, avatar)[: len(before)], before, atol=2e-4)
    platform.location.x += 3
    bpy.context.view_layer.update()
    np.testing.assert_allclose(shape(bpy, avatar)[: len(before)], before + [3, 0, 0], atol=2e-4)


def _follow(bpy, *datagrams: bytes):
    """Follow Stream while these come."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for datagram in datagrams:
                time.sleep(0.2)
                out.sendto(datagram, ("127.0.0.1", port))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        return bpy.ops.mirror_scan.follow_stream(port=port, seconds=0.2 * len(datagrams) + 0.3)
    finally:
        sender.join()
        bpy.context.view_layer.update()


def _arms_up(found) -> bytes:
    from mirror_scan.core.motion import make_clip

    joints = make_clip("arms_up", found.skeleton).joints(found.skeleton)
    return json.dumps({"joints": joints[len(joints) // 2].tolist()}).encode()


def test_what_others_send_does_not_end_following(bpy, avatar, found):
    bpy.ops.mirror_scan.add_skeleton()
    rest = shape(bpy, avatar)
    stranger = json.dumps({"joints": {"Thermostat": [1, 2, 3]}}).encode()
    assert _follow(bpy, _arms_up(found), stranger) == {"FINISHED"}
    assert shape(bpy, avatar)[:, 2].max() > 1.1 * rest[:, 2].max()
    with pytest.raises(RuntimeError, match="names are not known"):
        _follow(bpy, stranger)


def test_control_bones_rest_while_a_tracker_is_followed(bpy, avatar, found):
    bpy.ops.mirror_scan.add_skeleton(controls=True)
    rest = shape(bpy, avatar)
    _follow(bpy, _arms_up(found))
    assert shape(bpy, avatar)[:, 2].max() > 1.1 * rest[:, 2].max()


def test_a_tracker_is_followed(bpy, avatar, person, found):
    """A program that sends joints as if live; what it sent last is the pose that stays."""
    from mirror_scan.core.motion import make_clip

    bpy.ops.mirror_scan.add_skeleton()
    clip = make_clip("arms_up", found.skeleton)
    joints = clip.joints(found.skeleton)[: len(clip) // 2]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            time.sleep(0.3)
            out.sendto(b"no joints", ("127.0.0.1", port))
            for frame in joints:
                out.sendto(json.dumps({"joints": frame.tolist()}).encode(), ("127.0.0.1", port))
                time.sleep(0.01)

    sender = threading.Thread(target=send)
    sender.start()
    assert bpy.ops.mirror_scan.follow_stream(port=port, seconds=2.0, record=True) == {"FINISHED"}
    sender.join()
    bones = avatar.parent
    assert bones.animation_data.action.name.startswith("Stream")
    bpy.context.scene.frame_set(int(bones.animation_data.action.frame_range[1]))
    place = np.array(bones.matrix_world)
    hand = place[:3, :3] @ np.array(bones.pose.bones["mixamorig:LeftHand"].head) + place[:3, 3]
    np.testing.assert_allclose(hand, joints[-1][list(_bones()).index("LeftHand")], atol=0.03)


def test_a_tracker_that_is_silent_or_far_is_told(bpy, avatar):
    bpy.ops.mirror_scan.add_skeleton()
    with pytest.raises(RuntimeError, match="nothing came at port"):
        bpy.ops.mirror_scan.follow_stream(port=39655, seconds=0.1)
    if not bpy.app.online_access:
        with pytest.raises(RuntimeError, match="not allowed online"):
            bpy.ops.mirror_scan.follow_stream(port=39655, address="0.0.0.0", seconds=0.1)


NOD = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Neck
    {
      OFFSET 0 40 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT Head
      {
        OFFSET 0 10 0
        CHANNELS 3 Zrotation Xrotation Yrotation
        End Site
        {
          OFFSET 0 15 0
        }
      }
    }
    JOINT LeftArm
    {
      OFFSET 18 38 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT LeftForeArm
      {
        OFFSET 28 0 0
        CHANNELS 3 Zrotation Xrotation Yrotation
        JOINT LeftHand
        {
          OFFSET 25 0 0
          CHANNELS 3 Zrotation Xrotation Yrotation
          End Site
          {
            OFFSET 15 0 0
          }
        }
      }
    }
    JOINT RightArm
    {
      OFFSET -18 38 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT RightForeArm
      {
        OFFSET -28 0 0
        CHANNELS 3 Zrotation Xrotation Yrotation
        JOINT RightHand
        {
          OFFSET -25 0 0
          CHANNELS 3 Zrotation Xrotation Yrotation
          End Site
          {
            OFFSET -15 0 0
          }
        }
      }
    }
  }
  JOINT LeftUpLeg
  {
    OFFSET 9 -5 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftLeg
    {
      OFFSET 0 -42 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT LeftFoot
      {
        OFFSET 0 -40 0
        CHANNELS 3 Zrotation Xrotation Yrotation
        End Site
        {
          OFFSET 0 -7 14
        }
      }
    }
  }
  JOINT RightUpLeg
  {
    OFFSET -9 -5 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT RightLeg
    {
      OFFSET 0 -42 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT RightFoot
      {
        OFFSET 0 -40 0
        CHANNELS 3 Zrotation Xrotation Yrotation
        End Site
        {
          OFFSET 0 -7 14
        }
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.5
"""
NOD += "".join(f"0 94 0 0 0 0 {'0 0 0 ' * 2} 0 {turn} 0 {'0 0 0 ' * 12}\n" for turn in (0, 20, 0))


def test_vrm_holds_the_avatar_where_its_own_axes_are(bpy, avatar, person, tmp_path):
    """Read again without Blender: in metres at its origin, in the rest pose, whatever the object's place and size."""
    from mirror_scan.core.avatar.avatar_file import read_avatar

    path = tmp_path / "a.vrm"
    with pytest.raises(RuntimeError, match="add a skeleton"):
        bpy.ops.mirror_scan.export_avatar(filepath=str(path))
    assert bpy.ops.mirror_scan.add_skeleton() == {"FINISHED"}
    assert bpy.ops.mirror_scan.apply_motion(clip="squat") == {"FINISHED"}
    bones = avatar.parent
    bones.location, bones.scale = (3, 4, 0), (2, 2, 2)
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(path)) == {"FINISHED"}
    assert b"VRMC_vrm" in path.read_bytes() and not list(tmp_path.glob(".*"))
    again = read_avatar(path)
    tall = np.ptp(person[0].vertices[:, 2])
    assert np.ptp(again.mesh.vertices[:, 2]) == pytest.approx(2 * tall, rel=1e-3)
    assert np.abs(again.mesh.vertices[:, :2].mean(axis=0)).max() < 0.3
    assert again.skeleton is not None and len(again.skeleton.joints) == 22 and again.mesh.colors is not None
