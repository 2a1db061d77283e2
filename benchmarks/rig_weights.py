"""Skin weights: avatars of bodies with a known rig, posed, against the truly posed bodies, by the true joints.

Beside ours stand the true weights of the nearest point of the body (what the scan itself costs), Blender's bone heat,
and each vertex with its nearest bone. ``python -m benchmarks.rig_weights [BODY …]`` prints the table alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, Skeleton
from mirror_scan.core.avatar.skin_weights import skinned_mesh, strongest
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.triangle_mesh import barycentric
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

from .machine import say
from .results import Result, Table

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "rigged"
BODIES = {"s020": "azure_kinect", "s037": "azure_kinect", "s011": "azure_kinect", "s038": "realsense_d455",
          "s009": "kinect_v2", "s065": "azure_kinect"}  # fmt: skip
"""Bare bodies, and what scans them."""
POSES = ("tpose", "armsup", "knee60", "squat")
ALLOWED = {"tpose": (1.0, 5.0), "armsup": (1.0, 5.0), "knee60": (1.0, 5.0), "squat": (3.0, 9.0)}
"""Mean and 95 % above the true weights [mm]."""


class Rig:
    """A body with its true skeleton and weights."""

    def __init__(self, name: str):
        folder = FOLDER / name
        self.body = read_mesh(folder / "body.ply")
        joints = json.loads((folder / "joints.json").read_text())
        stored = np.load(folder / "weights.npz")
        self.dense = np.zeros((len(self.body.vertices), len(BONES)))
        order = np.array([BONES.index(bone) for bone in stored["bones"]])
        rows = np.arange(len(self.dense))[:, None]
        np.add.at(self.dense, (rows, order[stored["index"]]), stored["weight"])
        places = np.array([joints[bone] for bone in BONES])
        ends = [joints["HeadTop_End"], *(self._fingertips(places, side) for side in ("Left", "Right"))]
        ends += [joints["LeftToe_End"], joints["RightToe_End"]]
        self.skeleton = Skeleton(places, np.array(ends), np.ones(len(BONES)))
        self._poses = json.loads((folder / "poses" / "poses.json").read_text())
        self.posed = {pose: np.load(folder / "poses" / f"{pose}.npy").astype(np.float64) for pose in POSES}

    def _fingertips(self, joints: np.ndarray, side: str) -> np.ndarray:
        hand, before = BONES.index(f"{side}Hand"), BONES.index(f"{side}ForeArm")
        own = self.body.vertices[self.dense[:, hand] > 0.9]
        along = (own - joints[hand]) @ (joints[hand] - joints[before])
        return own[np.argsort(along)[-20:]].mean(axis=0)

    def pose(self, name: str, skeleton: Skeleton) -> Pose:
        """The named pose for another skeleton: the same turns; the hips go where the true ones go."""
        matrices = np.array([self._poses[name]["bones"][bone] for bone in BONES])
        moved = matrices[0, :3, :3] @ self.skeleton.joints[0] + matrices[0, :3, 3]
        return Pose(matrices[:, :3, :3], moved - self.skeleton.joints[0])

    def nearest_weights(self, mesh: Mesh) -> SkinWeights:
        """The true weights of the body's nearest point."""
        tree = build_bvh(self.body.vertices, self.body.triangles)
        _, triangle, nearest = closest_point(tree, mesh.vertices)
        corners = self.body.triangles[triangle]
        shares = np.clip(barycentric(nearest, self.body.vertices[corners]), 0.0, 1.0)
        return strongest(np.einsum("vk,vkb->vb", shares, self.dense[corners]))


def bone_heat(mesh: Mesh, skeleton: Skeleton) -> SkinWeights:
    """Blender's automatic weights: ``parent_set(type="ARMATURE_AUTO")``, the four largest."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    data = bpy.data.meshes.new("body")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.triangles.tolist())
    body = bpy.data.objects.new("body", data)
    bones = bpy.data.armatures.new("bones")
    armature = bpy.data.objects.new("bones", bones)
    for made in (body, armature):
        bpy.context.collection.objects.link(made)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    for bone, tail in enumerate(skeleton.tails()):
        made = bones.edit_bones.new(BONES[bone])
        made.head, made.tail = skeleton.joints[bone], tail
    bpy.ops.object.mode_set(mode="OBJECT")
    body.select_set(True)
    armature.select_set(True)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    dense = np.zeros((len(mesh.vertices), len(BONES)))
    place = {group.index: BONES.index(group.name) for group in body.vertex_groups}
    for vertex in data.vertices:
        for member in vertex.groups:
            dense[vertex.index, place[member.group]] = member.weight
    dense[dense.sum(axis=1) == 0, 0] = 1.0
    return strongest(dense)


def slices(mesh: Mesh, skeleton: Skeleton) -> SkinWeights:
    """Each vertex with its nearest bone alone."""
    heads, tails = skeleton.joints, skeleton.tails()
    along = tails - heads
    at = np.einsum("vbi,bi->vb", mesh.vertices[:, None] - heads, along) / np.maximum((along**2).sum(axis=1), 1e-9)
    foot = heads + np.clip(at, 0, 1)[..., None] * along
    nearest = np.linalg.norm(mesh.vertices[:, None] - foot, axis=2).argmin(axis=1)
    return strongest(np.eye(len(BONES))[nearest])


def distances(mesh: Mesh, posed: np.ndarray, rig: Rig, pose: str) -> tuple[float, float, int, float]:
    """Posed avatar to posed body, mean and 95 % [mm]; crossing faces; the longest edge of its former length."""
    tree = build_bvh(rig.posed[pose], rig.body.triangles)
    distance = 1e3 * closest_point(tree, posed)[0]
    crossing = len(np.unique(self_intersections(posed, mesh.triangles)))
    before, after = (edge_lengths(v, mesh.triangles) for v in (mesh.vertices, posed))
    long = before > 1e-3
    return float(distance.mean()), float(np.quantile(distance, 0.95)), crossing, float((after / before)[long].max())


def edge_by_area(mesh: Mesh) -> float:
    """Mean edge of the triangles, each as often as it is large [m]."""
    edges = edge_lengths(mesh.vertices, mesh.triangles).reshape(-1, 3)
    half = edges.sum(axis=1) / 2
    area = np.sqrt(np.maximum(half * np.prod(half[:, None] - edges, axis=1), 0.0))
    return float(np.average(edges.mean(axis=1), weights=area))


def true_cell(rig: Rig, pose: str) -> str:
    """Crossing faces and longest edge of the truly posed body itself."""
    _, _, crossing, longest = distances(rig.body, rig.posed[pose], rig, pose)
    return f"{crossing}; {longest:.1f}"


def edge_lengths(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[triangles] - vertices[np.roll(triangles, -1, axis=1)], axis=2).ravel()


def scanned(name: str, sensor: str) -> tuple[Rig, Mesh]:
    """A body's rig, and its avatar as the virtual rig with real optics sees it, in the body's frame."""
    rig = Rig(name)
    simulation = simulate(rig.body, with_real_optics(default_rig(sensor=sensor, seed=3)))
    mesh = reconstruct(simulation.capture, frame="camera").mesh
    return rig, mesh.transformed(simulation.truth.camera_to_avatar)


WAYS: dict[str, Callable[[Mesh, Skeleton], SkinWeights]] = {"bone heat": bone_heat, "nearest bone": slices}


def run(bodies: Sequence[str] = tuple(BODIES)) -> Result:
    table = Table(
        "Skin weights: posed avatar to truly posed body, by the true joints [mm mean / 95 %]; crossing faces; "
        "longest edge of its former length",
        ("body", "weights", *POSES),
        left=2,
    )
    if not FOLDER.is_dir():
        table.notes.append("left out: no bodies with a rig")
        return Result([table], [])
    over = []
    for name in bodies:
        say(f"rig weights: {name}")
        rig, scan = scanned(name, BODIES[name])
        mesh, own = skinned_mesh(scan, rig.skeleton)
        ways = {"true": rig.nearest_weights(mesh), "ours": own}
        ways |= {way: make(mesh, rig.skeleton) for way, make in WAYS.items()}
        finer = edge_by_area(rig.body) / edge_by_area(mesh)
        table.rows.append((name, f"true body (edges {finer:.1f} ×)", *(true_cell(rig, pose) for pose in POSES)))
        floor = {}
        for way, weights in ways.items():
            cells = []
            for pose in POSES:
                posed = skinned(mesh.vertices, weights, bone_matrices(rig.skeleton, rig.pose(pose, rig.skeleton)))
                mean, most, crossing, longest = distances(mesh, posed, rig, pose)
                floor.setdefault(pose, (mean, most))
                cells.append(f"{mean:.2f} / {most:.1f}; {crossing}; {longest:.1f}")
                if way == "ours":
                    over.append(mean - floor[pose][0] <= ALLOWED[pose][0] and most - floor[pose][1] <= ALLOWED[pose][1])
            table.rows.append((name, way, *cells))
    table.notes.append("where skin meets skin as many more faces cross as edges are shorter than the true body's (×)")
    table.notes.append(f"ours within the limits above the true weights: {sum(over)} of {len(over)}")
    return Result([table], [])


if __name__ == "__main__":
    for made in run(sys.argv[1:] or tuple(BODIES)).tables:
        print(made.text())
