"""Arrays into Blender and back: nothing is lost, nothing is left behind."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bpy")

BLOCKS = ("objects", "meshes", "materials", "scenes", "cameras", "lights", "collections", "images", "worlds")


def blocks(bpy):
    return {name: sorted(block.name for block in getattr(bpy.data, name)) for name in BLOCKS}


def read(data, label, prop, dtype, width=1):
    values = np.empty(len(data.attributes[label].data) * width, dtype=dtype)
    data.attributes[label].data.foreach_get(prop, values)
    return values.reshape(-1, width) if width > 1 else values


def create(mesh, **options):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    return create_avatar(mesh, **options)


def test_round_trip_is_exact(bpy, capsule):
    avatar = create(capsule, collection=bpy.context.collection, report={"mesh": {"height_m": 1.7}, "ü": [1]})
    data = avatar.data
    np.testing.assert_array_equal(read(data, "position", "vector", np.float32, 3), capsule.vertices.astype(np.float32))
    triangles = np.empty(3 * len(data.polygons), dtype=np.int32)
    data.polygons.foreach_get("vertices", triangles)
    np.testing.assert_array_equal(triangles.reshape(-1, 3), capsule.triangles)
    np.testing.assert_array_equal(read(data, "view", "value", np.int8), capsule.view)
    np.testing.assert_array_equal(read(data, "kind", "value", np.int8), capsule.kind)
    assert (data.attributes["view"].domain, data.attributes["kind"].domain) == ("POINT", "FACE")
    rgba = read(data, "Color", "color_srgb", np.float32, 4)
    np.testing.assert_array_equal(np.rint(rgba[:, :3] * 255), capsule.colors)
    np.testing.assert_array_equal(rgba[:, 3], 1)
    assert json.loads(avatar["mirror_scan_report"]) == {"mesh": {"height_m": 1.7}, "ü": [1]}


def test_colours_are_srgb(bpy, capsule):
    """The linear values follow IEC 61966-2-1, so 188 shines half as strong as 255."""
    rgba = read(create(capsule).data, "Color", "color", np.float32, 4)
    value = capsule.colors / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(rgba[:, :3], linear, atol=2e-4)


def test_it_shows_smooth_and_coloured(bpy, capsule):
    avatar = create(capsule, collection=bpy.context.collection)
    assert avatar.name == avatar.data.name == "Avatar"
    assert all(polygon.use_smooth for polygon in avatar.data.polygons)
    assert avatar.data.color_attributes.active_color.name == "Color"
    (material,) = avatar.data.materials
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    (link,) = shader.inputs["Base Color"].links
    assert link.from_node.type == "VERTEX_COLOR" and link.from_node.layer_name == "Color"
    bpy.context.view_layer.update()
    np.testing.assert_allclose(avatar.dimensions, (0.4, 0.4, 1.7), atol=2e-3)
    normals = np.empty(3 * len(avatar.data.vertices), dtype=np.float32)
    avatar.data.vertices.foreach_get("normal", normals)
    outward = capsule.vertices - (0, 0, 0.85)
    assert (np.einsum("ij,ij->i", normals.reshape(-1, 3), outward) > 0).all()


def test_a_second_avatar_shares_the_material_the_user_changed(bpy, capsule):
    first = create(capsule)
    first.data.materials[0].name = "Skin"
    second = create(capsule)
    assert second.data.materials[0] == first.data.materials[0]
    plain = create(replace(capsule, colors=None))
    assert plain.data.materials[0] != first.data.materials[0]
    assert "Color" not in plain.data.attributes


def test_missing_arrays_make_no_attributes(bpy, capsule):
    avatar = create(replace(capsule, colors=None, view=None, kind=None), report=None)
    assert not {"Color", "view", "kind"}.intersection(attribute.name for attribute in avatar.data.attributes)
    assert "mirror_scan_report" not in avatar


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": np.zeros((0, 3)), "triangles": np.zeros((0, 3), np.int32)}, "no triangles"),
        ({"triangles": np.array([[0, 1, 10_000_000]], np.int32), "kind": None}, "does not exist"),
        ({"triangles": np.array([[0, 1, -1]], np.int32), "kind": None}, "does not exist"),
        ({"triangles": np.array([[0, 1, 2, 3]], np.int32)}, r"\(T, 3\)"),
        ({"colors": np.zeros((5, 3), np.uint8)}, "colors must have"),
        ({"view": np.zeros(5, np.int8)}, "view must have"),
    ],
)
def test_bad_arrays_are_refused_and_leave_nothing(bpy, capsule, change, words):
    from mirror_scan.core.errors import OutputError

    before = blocks(bpy)
    with pytest.raises(OutputError, match=words):
        create(replace(capsule, **change), collection=bpy.context.collection)
    assert blocks(bpy) == before


def test_not_a_number_is_refused(bpy, capsule):
    from mirror_scan.core.errors import OutputError

    vertices = capsule.vertices.copy()
    vertices[7, 1] = np.nan
    with pytest.raises(OutputError, match="finite"):
        create(replace(capsule, vertices=vertices))


def test_a_failure_half_way_leaves_nothing(bpy, capsule):
    before = blocks(bpy)
    with pytest.raises(TypeError):
        create(capsule, collection=bpy.context.collection, report={"not json": object()})
    assert blocks(bpy) == before


def test_faces_blender_cannot_hold_are_dropped_with_a_word(bpy, capsule, caplog):
    triangles = capsule.triangles.copy()
    triangles[5] = triangles[4]  # the same face twice
    triangles[9, 1] = triangles[9, 0]  # a vertex twice in a face
    avatar = create(replace(capsule, triangles=triangles))
    assert len(avatar.data.polygons) == len(triangles) - 2
    assert "removed 2 faces" in caplog.text


def test_sixty_thousand_vertices_in_a_blink(bpy, capsule_60k):
    times = []
    for _ in range(5):
        start = time.process_time()
        create(capsule_60k, collection=bpy.context.collection)
        times.append(time.process_time() - start)
    # About 30 ms on an idle 2-core machine; CPU time, with room for one that has other things to do.
    assert min(times) < 0.25, times
