"""The paper's experiment 5.3: cut in three, thinned and sewn up, a body is closed and where it was."""

from __future__ import annotations

import csv

import numpy as np
import pymeshlab
import pytest
import trimesh
from mirror_scan.core import cli
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.experiments.decimation import decimate
from mirror_scan.core.experiments.zippering import run, split, write_results
from mirror_scan.core.io import write_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.submesh import triangle_components, vertex_fans


def mesh_of(body: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(body.vertices, np.float64), np.array(body.faces, np.int32))


def euler(mesh: Mesh) -> int:
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).euler_number


@pytest.fixture(scope="module")
def steps(person):
    return run(person, (0, 40), samples=50_000)


def test_closed_and_near_the_original(person, steps):
    height = np.ptp(person.vertices[:, 2])
    for step in steps:
        body = trimesh.Trimesh(step.mesh.vertices, step.mesh.triangles, process=False)
        assert body.is_watertight and body.is_winding_consistent and body.body_count == 1
        assert step.report["manifold"] and step.report["components"] == 1 and step.seam_triangles > 100
        assert 0 < step.mean < 0.001 * height
    none, forty = steps
    assert none.vertices[0] == forty.vertices[0]
    for k in (1, 2):
        assert forty.vertices[k] == round(0.6 * none.vertices[k])
    assert none.mean < forty.mean


def test_distances_agree_with_pymeshlab(person, steps):
    step = steps[1]
    for ours, sampled, target in ((step.there, step.mesh, person), (step.back, person, step.mesh)):
        meshes = pymeshlab.MeshSet()
        for mesh in (sampled, target):
            meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.triangles))
        theirs = meshes.get_hausdorff_distance(
            sampledmesh=0, targetmesh=1, samplevert=False, sampleface=True, samplenum=50_000,
            maxdist=pymeshlab.PercentageValue(50),
        )  # fmt: skip
        # most points lie on both surfaces: the mean is that of the few that do not
        assert ours.mean == pytest.approx(theirs["mean"], rel=0.06)
        assert ours.rms == pytest.approx(theirs["RMS"], rel=0.06)
        # the farthest is the tip of a finger, which either's random points hit by chance
        assert 0.75 * theirs["max"] <= ours.max <= theirs["max"] / 0.75


def test_the_cut_takes_points_only(person):
    parts, axis = split(person)
    original = {tuple(p) for p in person.vertices}
    for number, part in enumerate(parts):
        assert (part.view == number).all() and (part.kind == 0).all()
        assert {tuple(p) for p in part.vertices} <= original
        assert (vertex_fans(part.triangles, len(part.vertices)) == 1).all()
    front, left, right = (part.vertices - axis for part in parts)
    assert (front[:, 1] < 0).all() and (left[:, 1] > 0).all() and (right[:, 1] > 0).all()
    assert (left[:, 0] > 0).all() and (right[:, 0] < 0).all()
    assert sum(len(part.vertices) for part in parts) < len(person.vertices)


@pytest.mark.parametrize("percent", [10, 50, 90])
def test_thinning_keeps_topology_and_outline(person, percent):
    part = split(person)[0][1]
    count = round(len(part.vertices) * (1 - percent / 100))
    thin = decimate(part, count)
    assert len(thin.vertices) == count and (vertex_fans(thin.triangles, count) == 1).all()
    assert twins(thin.triangles, count).min() >= -1
    assert euler(thin) == euler(part)
    assert triangle_components(thin.triangles, count)[1] == triangle_components(part.triangles, len(part.vertices))[1]
    loops = [[m.vertices[loop] for loop in boundary_loops(m.triangles, len(m.vertices))] for m in (part, thin)]
    assert len(loops[0]) == len(loops[1])
    before, after = (np.concatenate(ends) for ends in loops)
    assert len(after) < len(before)
    near = np.linalg.norm(after[:, None] - before[None], axis=2).min(axis=1)
    assert near.max() < 0.025  # two edges


def test_a_flat_sheet_keeps_its_outline_exactly():
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    i = np.arange(21 * 20).reshape(20, 21)[:, :-1].ravel()
    faces = np.concatenate((np.column_stack((i, i + 1, i + 22)), np.column_stack((i, i + 22, i + 21))))
    sheet = Mesh(np.column_stack((x.ravel(), y.ravel(), np.full(441, 3.0))), faces.astype(np.int32))
    thin = decimate(sheet, 60)
    body = trimesh.Trimesh(thin.vertices, thin.triangles, process=False)
    assert len(thin.vertices) == 60 and body.area == pytest.approx(1.0, abs=2e-3)
    assert np.abs(thin.vertices[:, 2] - 3).max() < 1e-9 and (body.face_normals[:, 2] > 0).all()


def test_a_closed_tetrahedron_cannot_be_thinned():
    solid = mesh_of(trimesh.creation.icosphere(subdivisions=1))
    left = decimate(solid, 1)
    assert len(left.vertices) >= 4 and euler(left) == 2
    assert trimesh.Trimesh(left.vertices, left.triangles, process=False).is_watertight


def test_what_cannot_be_cut_is_refused(person):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    open_ball = mesh_of(ball)
    open_ball = Mesh(open_ball.vertices, open_ball.triangles[1:])
    for body, words in (
        (open_ball, "must be closed"),
        (Mesh(person.vertices * 1000, person.triangles), "m tall"),
        (Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), "m tall"),
        (mesh_of(trimesh.creation.box()), "empty"),
    ):
        with pytest.raises(MirrorScanError, match=words):
            run(body, (0,))
    for arguments in (((100,),), ((),), ((0,), "nearest")):
        with pytest.raises(MirrorScanError, match="zippering experiment"):
            run(mesh_of(ball), *arguments)


def test_another_tool_gets_the_same_parts(person, tmp_path):
    given = []

    def keep_open(parts):
        given.append(parts)
        return parts

    (step,) = run(person, (30,), samples=5_000, bridge=keep_open)
    assert sum(step.vertices) == len(given[0].vertices) and set(given[0].view.tolist()) == {0, 1, 2}
    assert not step.bridged.report["watertight"] and step.report["watertight"]
    assert step.bridged.there.mean < step.bridged.back.mean, "what is there is on the original, but some is missing"
    write_results([step], person, tmp_path)
    (row,) = csv.DictReader((tmp_path / "table.csv").read_text().splitlines())
    assert row["blender_watertight"] == "False"
    assert float(row["blender_original_to_result_mean_mm"]) == pytest.approx(1000 * step.bridged.back.mean, abs=1e-4)
    (step,) = run(person, (30,), samples=5_000, bridge=lambda parts: None)
    assert step.bridged is None


def test_on_the_command_line(tmp_path, capsys):
    write_mesh(tmp_path / "ball.ply", mesh_of(trimesh.creation.icosphere(subdivisions=5, radius=0.5)))
    words = ["experiment", "zippering", str(tmp_path / "ball.ply"), "-o", str(tmp_path / "out"), "--steps", "0,40"]
    assert cli.main(words) == 0
    said = capsys.readouterr().out
    assert "coronal and sagittal planes" in said  # a ball is compact
    assert "without Blender's Bridge Edge Loops" in said  # core itself knows no Blender
    rows = list(csv.DictReader((tmp_path / "out" / "table.csv").read_text().splitlines()))
    assert [row["decimation_pct"] for row in rows] == ["0", "40"]
    assert all(row["watertight"] == row["manifold"] == "True" for row in rows)
    assert {"plot.png", "result.png"} < {path.name for path in (tmp_path / "out").iterdir()}
    for steps in ("100", "a"):
        assert cli.main([*words[:-1], steps]) == 2
        assert "--steps" in capsys.readouterr().err
