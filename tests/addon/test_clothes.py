"""Clothes in Blender: garments of ours and an artist's own, as cloth on a collider, baked, undone and in files."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def rigged():
    """A mannequin with skeleton and weights."""
    from mirror_scan.core.avatar.skin_weights import skin_weights
    from mirror_scan.core.simulation.mannequin import rigged_mannequin

    mesh, skeleton = rigged_mannequin(resolution=0.018)
    return mesh, skeleton, skin_weights(mesh, skeleton)


@pytest.fixture
def avatar(bpy, rigged):
    """The mannequin in the scene, with an armature, selected."""
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects

    mesh, skeleton, weights = rigged
    scene = bpy.context.scene
    made = avatar_objects.create_avatar(mesh, collection=scene.collection)
    armature.add_armature(made, skeleton, weights, scene.collection)
    avatar_objects.select_only(bpy.context, made)
    return made


def walk(bpy, avatar, frames):
    assert bpy.ops.mirror_scan.apply_motion(clip="walk") == {"FINISHED"}
    bpy.context.scene.frame_end = bpy.context.scene.frame_start + frames - 1


def evaluated(bpy, item):
    """An object as its modifiers leave it, in the world."""
    from mirror_scan.core.mesh import Mesh

    data = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    data.calc_loop_triangles()
    points = np.empty((len(data.vertices), 3), np.float32)
    data.attributes["position"].data.foreach_get("vector", points.ravel())
    triangles = np.empty((len(data.loop_triangles), 3), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    place = np.array(item.matrix_world)
    return Mesh(points @ place[:3, :3].T + place[:3, 3], triangles)


def gaps(bpy, garment, avatar):
    from mirror_scan.core.clothes.body_distance import BodyDistance

    return BodyDistance(evaluated(bpy, avatar)).at(evaluated(bpy, garment).vertices).distance


def worn(avatar):
    from mirror_scan.mirror_scan_addon.scene import cloth

    return cloth.garments_of(avatar)


def test_a_skirt_falls_over_a_walk_and_stays_out(bpy, avatar):
    avatar.parent.location = (0.5, 1.0, 0.2)
    walk(bpy, avatar, 8)
    assert bpy.ops.mirror_scan.dress("EXEC_DEFAULT", kind="skirt", bake=True) == {"FINISHED"}
    (skirt,) = worn(avatar)
    assert skirt.name.startswith(avatar.name) and bpy.context.object == avatar
    cloth = next(modifier for modifier in skirt.modifiers if modifier.type == "CLOTH")
    assert cloth.point_cache.is_baked and cloth.point_cache.frame_end == bpy.context.scene.frame_end
    bpy.context.scene.frame_set(bpy.context.scene.frame_end)
    distance = gaps(bpy, skirt, avatar)
    assert np.quantile(distance, 0.003) > 0.002 and (distance < -0.001).sum() == 0
    pinned = skirt.vertex_groups["Pinned"].index
    free = [not any(m.group == pinned for m in vertex.groups) for vertex in skirt.data.vertices]
    by_bones = next(modifier for modifier in skirt.modifiers if modifier.type == "ARMATURE")
    fallen = evaluated(bpy, skirt).vertices
    cloth.show_viewport = False
    moved = np.linalg.norm(evaluated(bpy, skirt).vertices - fallen, axis=1)
    assert by_bones.object == avatar.parent and np.median(moved[free]) > 0.003
    collider = next(item for item in bpy.data.objects if item.name.endswith("Collider"))
    assert collider.hide_render and len(collider.data.polygons) <= 6100


def test_a_tight_shirt_needs_no_collider(bpy, avatar):
    assert bpy.ops.mirror_scan.dress(kind="tshirt", tight=True, ease=4.0) == {"FINISHED"}
    (shirt,) = worn(avatar)
    assert [modifier.type for modifier in shirt.modifiers] == ["ARMATURE", "SHRINKWRAP", "SHRINKWRAP", "SHRINKWRAP"]
    assert not any(item.name.endswith("Collider") for item in bpy.data.objects)
    distance = gaps(bpy, shirt, avatar)
    assert distance.min() > 0.002 and np.median(distance) < 0.008


def test_a_garment_that_is_made_again_replaces_the_first(bpy, avatar):
    for ease in (10.0, 25.0):
        bpy.ops.mirror_scan.dress(kind="trousers", ease=ease)
        bpy.ops.mirror_scan.dress(kind="trousers", ease=ease)
    assert len(worn(avatar)) == 1 and sum(item.name.endswith("Collider") for item in bpy.data.objects) == 1


def test_undo_takes_a_garment_off(bpy, avatar):
    bpy.ops.ed.undo_push(message="start")
    name = avatar.name
    bpy.ops.mirror_scan.dress(kind="skirt")
    bpy.ops.ed.undo_push(message="dressed")
    assert len(bpy.data.objects) == 4
    bpy.ops.ed.undo()
    assert len(bpy.data.objects) == 2 and not worn(bpy.data.objects[name])


def tube(bpy, radius, low, high):
    """An artist's skirt: a cylinder without caps, in an object that is moved and scaled."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=48, radius=radius, depth=high - low, end_fill_type="NOTHING",
                                        location=(0, 0, (low + high) / 2))  # fmt: skip
    made = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    return made


def select(bpy, active, *others):
    bpy.ops.object.select_all(action="DESELECT")
    for item in (active, *others):
        item.select_set(True)
    bpy.context.view_layer.objects.active = active


@pytest.mark.parametrize("pins", ["", "Belt"])
def test_an_artists_garment_becomes_cloth(bpy, avatar, rigged, pins):
    hips, knees = rigged[1].joints[0, 2], rigged[1].joints[15, 2]
    own = tube(bpy, 0.26, knees, hips)
    before = evaluated(bpy, own).vertices
    if pins:
        group = own.vertex_groups.new(name=pins)
        top = max(v.co.z for v in own.data.vertices)
        group.add([v.index for v in own.data.vertices if v.co.z >= top - 1e-4], 1.0, "REPLACE")
    select(bpy, avatar, own)
    assert bpy.ops.mirror_scan.prepare_for_cloth(pins=pins) == {"FINISHED"}
    cloth = next(modifier for modifier in own.modifiers if modifier.type == "CLOTH")
    assert cloth.settings.vertex_group_mass == (pins or "Pinned")
    assert own.parent == avatar.parent and any(item.name.endswith("Collider") for item in bpy.data.objects)
    held = own.vertex_groups[pins or "Pinned"].index
    top = [v.index for v in own.data.vertices if any(m.group == held and m.weight > 0.9 for m in v.groups)]
    assert top and min(before[top, 2]) > hips - 0.05
    bpy.context.scene.frame_set(bpy.context.scene.frame_start)
    np.testing.assert_allclose(evaluated(bpy, own).vertices, before, atol=2e-3)


def test_without_a_garment_only_the_avatar_is_prepared(bpy, avatar):
    select(bpy, avatar)
    assert bpy.ops.mirror_scan.prepare_for_cloth() == {"FINISHED"}
    collider = next(item for item in bpy.data.objects if item.name.endswith("Collider"))
    assert collider.collision.use and collider.parent == avatar.parent
    skin, coarse = evaluated(bpy, avatar), evaluated(bpy, collider)
    from mirror_scan.core.mesh.surface_distance import surface_distance

    assert surface_distance(coarse, skin, 20_000).max < 0.006


def test_pins_that_do_not_exist_are_told(bpy, avatar):
    own = tube(bpy, 0.3, 0.6, 0.9)
    select(bpy, avatar, own)
    with pytest.raises(RuntimeError, match="Belt"):
        bpy.ops.mirror_scan.prepare_for_cloth(pins="Belt")
    assert not own.modifiers and len(bpy.data.objects) == 3


def test_an_avatar_without_skeleton_cannot_be_dressed(bpy, rigged):
    from mirror_scan.mirror_scan_addon.scene import avatar_objects

    made = avatar_objects.create_avatar(rigged[0], collection=bpy.context.scene.collection)
    avatar_objects.select_only(bpy.context, made)
    assert not bpy.ops.mirror_scan.dress.poll() and not bpy.ops.mirror_scan.prepare_for_cloth.poll()


def test_a_bake_goes_frame_by_frame_and_can_be_stopped(bpy, avatar):
    from mirror_scan.mirror_scan_addon.operators.dress import _Bake

    walk(bpy, avatar, 6)
    bpy.ops.mirror_scan.dress(kind="skirt")
    (skirt,) = worn(avatar)
    cloth = next(modifier for modifier in skirt.modifiers if modifier.type == "CLOTH")
    bake = _Bake(bpy.context.scene, [skirt.session_uid])
    assert bake.is_alive() and bake.is_alive() and 0 < bake.progress[0] < 1
    bake.ask_to_stop()
    assert not bake.is_alive() and worn(avatar) == [skirt] and not cloth.point_cache.is_baked


def test_a_dressed_file_comes_back(bpy, rigged, tmp_path):
    from mirror_scan.core.avatar.avatar_file import Avatar
    from mirror_scan.core.clothes import make_garment
    from mirror_scan.mirror_scan_addon.scene.blend_avatar import read_blend_avatar
    from mirror_scan.mirror_scan_addon.scene.export import write_blend, write_fbx, write_usd

    mesh, skeleton, weights = rigged
    truth = make_garment(mesh, skeleton, weights, "skirt")
    dressed = Avatar(mesh, skeleton, weights, garments=(truth,))
    for write, name in ((write_fbx, "a.fbx"), (write_usd, "a.usdc"), (write_blend, "a.blend")):
        write(tmp_path / name, dressed)
    assert not bpy.data.objects
    found = read_blend_avatar(tmp_path / "a.blend")
    assert len(found.mesh.vertices) == len(mesh.vertices)
    (skirt,) = found.garments
    np.testing.assert_allclose(skirt.mesh.vertices, truth.mesh.vertices, atol=1e-5)
    np.testing.assert_allclose(skirt.pinned, truth.pinned, atol=1e-5)
    np.testing.assert_allclose(skirt.uv, truth.uv, atol=1e-5)
    worn_there = [item for item in bpy.data.objects if "CLOTH" in {m.type for m in item.modifiers}]
    assert len(worn_there) == 1


def test_what_an_avatar_wears_is_exported_with_it(bpy, avatar, tmp_path):
    from mirror_scan.mirror_scan_addon.scene import export

    bpy.ops.mirror_scan.dress(kind="skirt")
    (skirt,) = worn(avatar)
    count, vertices = len(bpy.data.objects), len(skirt.data.vertices)
    export.write_object(tmp_path / "a.glb", avatar, "GLB")
    assert len(bpy.data.objects) == count and [m.type for m in skirt.modifiers].count("CLOTH") == 1
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "a.glb"))
    there = [
        item for item in bpy.data.objects if item.type == "MESH" and any(m.type == "ARMATURE" for m in item.modifiers)
    ]
    assert len(there) == 2 and any(len(item.data.vertices) >= vertices and "Skirt" in item.name for item in there)
