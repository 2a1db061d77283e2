"""Sequences in Blender: a body a frame on the timeline, and one Alembic or USD file for all."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("bpy")

HEIGHTS = (1.0, 1.5, 2.0)


def tower(place):
    """A closed prism of 3 + ``place`` sides, as high as the frame's entry in ``HEIGHTS``; its colour is the frame's."""
    from mirror_scan.core.mesh import Mesh

    sides = 3 + place
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(sides)))
    vertices = np.concatenate((ring, [[0.0, 0.0, HEIGHTS[place]], [0.0, 0.0, -0.1]]))
    after = (np.arange(sides) + 1) % sides
    top, bottom = np.full(sides, sides), np.full(sides, sides + 1)
    triangles = np.concatenate(
        (np.column_stack((np.arange(sides), after, top)), np.column_stack((after, np.arange(sides), bottom)))
    )
    colors = np.full((len(vertices), 3), 60 * (place + 1), np.uint8)
    return Mesh(vertices, triangles.astype(np.int32), colors)


@pytest.fixture
def folder(tmp_path):
    """A sequence as the command writes it."""
    from mirror_scan.core.io import write_mesh
    from mirror_scan.core.io.frame_files import REPORT, frame_name

    for place in range(3):
        write_mesh(tmp_path / frame_name(place, ".ply"), tower(place))
    (tmp_path / REPORT).write_text(json.dumps({"rate": 15}), encoding="utf-8")
    return tmp_path


def test_each_frame_shows_its_own_body(bpy, folder):
    scene = bpy.context.scene
    assert bpy.ops.mirror_scan.import_sequence(filepath=str(folder), start=10) == {"FINISHED"}
    bodies = list(bpy.data.collections[folder.name].objects)
    assert [len(body.data.vertices) for body in bodies] == [5, 6, 7]
    assert (scene.frame_start, scene.frame_end) == (10, 12)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(15)
    for frame, seen in ((1, 0), (10, 0), (11, 1), (12, 2), (40, 2)):
        scene.frame_set(frame)
        assert [not body.hide_render for body in bodies] == [place == seen for place in range(3)]
        assert [body.visible_get() for body in bodies] == [place == seen for place in range(3)]


def test_what_is_no_sequence_is_said(bpy, tmp_path):
    before = len(bpy.data.objects)
    with pytest.raises(RuntimeError, match="holds no frames of a sequence"):
        bpy.ops.mirror_scan.import_sequence(filepath=str(tmp_path))
    with pytest.raises(RuntimeError, match="there is no such file or folder"):
        bpy.ops.mirror_scan.import_sequence(filepath=str(tmp_path / "none" / "none.ply"))
    assert len(bpy.data.objects) == before


@pytest.mark.parametrize("suffix", [".abc", ".usd"])
def test_one_file_holds_all_frames(bpy, tmp_path, suffix):
    from mirror_scan.mirror_scan_addon.command import BlenderWriters

    path = tmp_path / f"body{suffix}"
    scenes, asked = len(bpy.data.scenes), []

    def mesh_at(place):
        asked.append(place)
        return tower(place)

    BlenderWriters()["sequence"](path, 3, mesh_at, 15.0)
    assert len(bpy.data.scenes) == scenes and set(asked) == {0, 1, 2}
    assert not bpy.app.handlers.frame_change_pre
    (tmp_path / "sequence.json").write_text(json.dumps({"rate": 15}), encoding="utf-8")
    assert bpy.ops.mirror_scan.import_sequence(filepath=str(path)) == {"FINISHED"}
    scene = bpy.context.scene
    body = next(body for body in scene.objects if body.type == "MESH")
    for place in range(3):
        scene.frame_set(1 + place)
        seen = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        places = np.array([vertex.co for vertex in seen.vertices])
        world = places @ np.array(body.matrix_world)[:3, :3].T
        assert len(places) == 5 + place
        assert np.ptp(world[:, 2]) == pytest.approx(HEIGHTS[place] + 0.1, abs=1e-4)
        shade = np.array(seen.color_attributes[0].data[0].color_srgb)[:3]
        assert shade == pytest.approx(60 * (place + 1) / 255, abs=0.01)


def test_a_frame_that_was_lost_shifts_no_other(bpy, folder):
    from mirror_scan.core.io.frame_files import frame_name

    (folder / frame_name(2, ".ply")).rename(folder / frame_name(5, ".ply"))  # 2 to 4 were lost
    scene = bpy.context.scene
    assert bpy.ops.mirror_scan.import_sequence(filepath=str(folder)) == {"FINISHED"}
    bodies = list(bpy.data.collections[folder.name].objects)
    assert (scene.frame_start, scene.frame_end) == (1, 6)
    for frame, seen in ((1, 0), (2, 1), (3, 1), (5, 1), (6, 2)):
        scene.frame_set(frame)
        assert [not body.hide_render for body in bodies] == [place == seen for place in range(3)]
    assert bpy.ops.mirror_scan.import_sequence(filepath=str(folder), every=2) == {"FINISHED"}
    assert scene.frame_end == 3


def test_a_mesh_that_cannot_be_read_ends_the_writing(bpy, tmp_path):
    from mirror_scan.core.errors import CaptureError
    from mirror_scan.mirror_scan_addon.command import BlenderWriters

    def mesh_at(place):
        if place == 1:
            raise CaptureError("it is gone")
        return tower(place)

    with pytest.raises(CaptureError, match="it is gone"):
        BlenderWriters()["sequence"](tmp_path / "body.abc", 3, mesh_at, 15.0)
    assert not list(tmp_path.iterdir()) and not bpy.app.handlers.frame_change_pre
