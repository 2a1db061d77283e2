"""A virtual person scanned and built in Blender with nothing stood in for: capture folder to avatar."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")


def test_a_scan_becomes_an_avatar(bpy, scan):
    folder, height = scan
    assert bpy.ops.mirror_scan.build_avatar(filepath=str(folder), frames=4) == {"FINISHED"}
    avatar = bpy.context.object
    bpy.context.view_layer.update()
    assert avatar.dimensions.z == pytest.approx(height, abs=0.03)
    corners = np.array(avatar.bound_box)
    assert corners[:, 2].min() == pytest.approx(0, abs=0.03)  # stands on the ground, Z up
    data = avatar.data
    edges = np.zeros(len(data.edges), dtype=int)
    loop_edges = np.empty(len(data.loops), dtype=np.int32)
    data.loops.foreach_get("edge_index", loop_edges)
    np.add.at(edges, loop_edges, 1)
    assert (edges == 2).all()  # closed, as Blender counts it
    kind = np.empty(len(data.polygons), dtype=np.int8)
    data.attributes["kind"].data.foreach_get("value", kind)
    assert set(np.unique(kind)) == {0, 1, 2}
    view = np.empty(len(data.vertices), dtype=np.int8)
    data.attributes["view"].data.foreach_get("value", view)
    assert {0, 1, 2} <= set(np.unique(view))
    # The mannequin faces −Y: what the camera saw directly is its front.
    y = np.empty(3 * len(data.vertices), dtype=np.float32)
    data.attributes["position"].data.foreach_get("vector", y)
    y = y[1::3]
    assert y[view == 0].mean() < y[(view == 1) | (view == 2)].mean() - 0.05


def test_undo_of_the_real_thing_leaves_nothing(bpy, scan):
    folder, _ = scan
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.mirror_scan.build_avatar(filepath=str(folder), frames=1)
    bpy.ops.ed.undo_push(message="built")
    bpy.ops.ed.undo()
    assert len(bpy.data.objects) == len(bpy.data.meshes) == len(bpy.data.materials) == 0
