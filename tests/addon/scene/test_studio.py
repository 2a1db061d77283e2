"""The studio: it shows the whole avatar from its front, however it stands, and leaves no trace when it goes."""

from __future__ import annotations

import math

import numpy as np
import pytest


def stand(bpy, capsule, scale=1.0, yaw=0.0, place=(0.0, 0.0, 0.0)):
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    avatar = avatar_objects.create_avatar(capsule, collection=bpy.context.scene.collection)
    avatar.scale = [scale] * 3
    avatar.rotation_euler = 0.0, 0.0, yaw
    avatar.location = place
    bpy.context.view_layer.update()
    avatar_objects.select_only(bpy.context, avatar)
    return avatar


def blocks(bpy) -> dict[str, list[str]]:
    names = ("objects", "meshes", "materials", "cameras", "lights", "collections")
    return {name: sorted(block.name for block in getattr(bpy.data, name)) for name in names}


@pytest.mark.parametrize(
    ("scale", "yaw", "place"),
    [(1.0, 0.0, (0, 0, 0)), (1000.0, 2.0, (5.0, -3000.0, 10.0)), (0.01, -1.2, (0.5, 0.0, 0.0))],
)
def test_the_camera_sees_all_of_the_avatar_from_its_front(bpy, capsule, scale, yaw, place):
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    avatar = stand(bpy, capsule, scale, yaw, place)
    assert bpy.ops.mirror_scan.add_studio() == {"FINISHED"}
    scene = bpy.context.scene
    corners = [avatar.matrix_world @ Vector(corner) for corner in avatar.bound_box]
    seen = np.array([world_to_camera_view(scene, scene.camera, corner) for corner in corners])
    assert (seen[:, :2] > 0).all() and (seen[:, :2] < 1).all() and np.ptp(seen[:, 1]) > 0.6
    assert (seen[:, 2] > scene.camera.data.clip_start).all() and (seen[:, 2] < scene.camera.data.clip_end).all()
    front = avatar.matrix_world.to_3x3() @ Vector((0, -1, 0))
    toward = scene.camera.matrix_world.translation - (corners[0] + corners[6]) / 2
    assert front.to_2d().angle(toward.to_2d()) == pytest.approx(math.radians(25), abs=1e-4)
    backdrop = bpy.data.objects["Studio Backdrop"]
    floor = min((backdrop.matrix_world @ vertex.co).z for vertex in backdrop.data.vertices)
    assert 0 < min(corner.z for corner in corners) - floor < 0.01 * 1.7 * scale


def test_it_goes_without_a_trace_and_gives_back_what_was_there(bpy, capsule):
    stand(bpy, capsule)
    scene = bpy.context.scene
    own = bpy.data.objects.new("My Camera", bpy.data.cameras.new("My Camera"))
    scene.collection.objects.link(own)
    scene.camera = own
    scene.render.resolution_x, scene.render.resolution_y = 777, 333
    scene.view_settings.view_transform = "Raw"
    before = blocks(bpy)
    bpy.ops.mirror_scan.add_studio()
    once = blocks(bpy)
    bpy.ops.mirror_scan.add_studio()
    assert blocks(bpy) == once and scene.camera != own
    assert bpy.ops.mirror_scan.remove_studio() == {"FINISHED"}
    assert blocks(bpy) == before and scene.camera == own
    assert (scene.render.resolution_x, scene.render.resolution_y) == (777, 333)
    assert scene.view_settings.view_transform == "Raw"
    assert not bpy.ops.mirror_scan.remove_studio.poll()


def test_the_users_camera_may_go_and_a_camera_of_the_users_stays(bpy, capsule):
    stand(bpy, capsule)
    scene = bpy.context.scene
    first = bpy.data.objects.new("First", bpy.data.cameras.new("First"))
    scene.collection.objects.link(first)
    scene.camera = first
    bpy.ops.mirror_scan.add_studio()
    bpy.data.objects.remove(first)
    bpy.ops.mirror_scan.remove_studio()
    assert scene.camera is None
    bpy.ops.mirror_scan.add_studio()
    second = bpy.data.objects.new("Second", bpy.data.cameras.new("Second"))
    scene.collection.objects.link(second)
    scene.camera = second
    bpy.ops.mirror_scan.remove_studio()
    assert scene.camera == second


def test_an_asset_has_a_picture_of_the_avatar(bpy, capsule):
    avatar = stand(bpy, capsule)
    assert bpy.ops.mirror_scan.mark_as_asset() == {"FINISHED"}
    assert avatar.asset_data is not None
    pixels = np.empty(math.prod(avatar.preview.image_size) * 4, np.float32)
    avatar.preview.image_pixels_float.foreach_get(pixels)
    picture = pixels.reshape(*avatar.preview.image_size, 4)
    corner, middle = picture[2, 2, :3], picture[128, 128, :3]
    assert tuple(avatar.preview.image_size) == (256, 256) and (picture[..., 3] == 1).all()
    assert np.abs(corner - middle).max() > 0.1
