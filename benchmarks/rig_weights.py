"""Skin weights: avatars of bodies with a known rig, posed, against the truly posed bodies, by the true joints.

Beside ours stand the true weights of the nearest point of the body (what the scan itself costs), ours with the joints
that were found, Blender's bone heat, and each vertex with its nearest bone. ``python -m benchmarks.rig_weights
[BODY …]`` prints the tables alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, Skeleton
from mirror_scan.core.avatar.skin_weights import skinned_mesh, strongest
from mirror_scan.core.decimation import decimate
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.triangle_mesh import barycentric
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

from .machine import say
from .results import Finding, Result, Table, limits_table

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "rigged"
BODIES = {"s020": "azure_kinect", "s037": "azure_kinect", "s011": "azure_kinect", "s038": "realsense_d455",
          "s009": "kinect_v2", "s065": "azure_kinect"}  # fmt: skip
"""Bare bodies, and what scans them."""
POSES = ("tpose", "armsup", "knee60", "squat")
ALLOWED = {"tpose": (1.0, 5.0), "armsup": (1.0, 5.0), "knee60": (1.0, 5.0), "squat": (3.0, 9.0)}
"""Mean and 95 % above the true weights and joints [mm]."""
MORE_CROSSING, AND = 1.2, 20
"""Crossing faces: so many times the posed true body's, and so many more."""
LONGEST = 4.0
"""Edges with arms up, of their former length."""


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
    count = crossing(mesh, posed)[0]
    before, after = (edge_lengths(v, mesh.triangles) for v in (mesh.vertices, posed))
    long = before > 1e-3
    return float(distance.mean()), float(np.quantile(distance, 0.95)), count, float((after / before)[long].max())


def edge_by_area(mesh: Mesh) -> float:
    """Mean edge of the triangles, each as often as it is large [m]."""
    edges = edge_lengths(mesh.vertices, mesh.triangles).reshape(-1, 3)
    half = edges.sum(axis=1) / 2
    area = np.sqrt(np.maximum(half * np.prod(half[:, None] - edges, axis=1), 0.0))
    return float(np.average(edges.mean(axis=1), weights=area))


def true_cell(rig: Rig, pose: str) -> str:
    """Crossing faces and longest edge of the truly posed body itself."""
    _, _, count, longest = distances(rig.body, rig.posed[pose], rig, pose)
    return f"{count}; {longest:.1f}"


def edge_lengths(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[triangles] - vertices[np.roll(triangles, -1, axis=1)], axis=2).ravel()


def scanned(name: str, sensor: str) -> tuple[Rig, Mesh]:
    """A body's rig, and its avatar as the virtual rig with real optics sees it, in the body's frame."""
    rig = Rig(name)
    simulation = simulate(rig.body, with_real_optics(default_rig(sensor=sensor, seed=3)))
    mesh = reconstruct(simulation.capture, frame="camera").mesh
    return rig, mesh.transformed(simulation.truth.camera_to_avatar)


WAYS: dict[str, Callable[[Mesh, Skeleton], SkinWeights]] = {"bone heat": bone_heat, "nearest bone": slices}


@dataclass
class Posed:
    """An avatar, what moves it, and what comes of it: (mean, 95 % [mm], crossing faces, longest edge) a pose."""

    mesh: Mesh
    weights: SkinWeights
    skeleton: Skeleton
    made: dict[str, tuple[float, float, int, float]] = field(default_factory=dict)

    def measured(self, rig: Rig) -> Posed:
        for pose in POSES:
            self.made[pose] = distances(self.mesh, self.vertices(rig, pose), rig, pose)
        return self

    def vertices(self, rig: Rig, pose: str) -> np.ndarray:
        return skinned(self.mesh.vertices, self.weights, bone_matrices(self.skeleton, rig.pose(pose, self.skeleton)))

    def coarser(self, edge: float) -> Posed:
        """With about as long edges, each as often as its triangle is large [m]."""
        count = round(len(self.mesh.triangles) * (edge_by_area(self.mesh) / edge) ** 2)
        less = decimate(self.mesh, count, weights=self.weights)
        assert less.weights is not None
        return Posed(less.mesh, less.weights, self.skeleton)


def crossing(mesh: Mesh, posed: np.ndarray) -> tuple[int, float]:
    """Crossing faces and their area in the rest pose [cm²]."""
    faces = np.unique(self_intersections(posed, mesh.triangles))
    a, b, c = (mesh.vertices[mesh.triangles[faces, k]] for k in range(3))
    return len(faces), float(1e4 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def run(bodies: Sequence[str] = tuple(BODIES)) -> Result:
    table = Table(
        "Skin weights: posed avatar to truly posed body [mm mean / 95 %]; crossing faces; longest edge of its former "
        "length",
        ("body", "weights", *POSES),
        left=2,
    )
    folds = Table(
        "Skin that runs through skin: crossing faces as they are; with edges as long as the true body's; their area "
        "[cm²]",
        ("body", "weights", *POSES),
        left=2,
    )
    if not FOLDER.is_dir():
        table.notes.append("left out: no bodies with a rig")
        return Result([table], [])
    over: dict[str, list[tuple[str, float, float]]] = {"true": [], "found": []}  # pose, mean and 95 % above the true
    longest, folded = [], []
    for name in bodies:
        say(f"rig weights: {name}")
        rig, scan = scanned(name, BODIES[name])
        ways = _ways(rig, scan)
        finer = edge_by_area(rig.body) / edge_by_area(ways["true"].mesh)
        table.rows.append((name, f"true body (edges {finer:.1f} ×)", *(true_cell(rig, pose) for pose in POSES)))
        for way, posed in ways.items():
            cells = (f"{m:.2f} / {p:.1f}; {count}; {edge:.1f}" for m, p, count, edge in posed.made.values())
            table.rows.append((name, way, *cells))
        for joints, way in (("true", "ours"), ("found", "ours, found joints")):
            for pose in POSES:
                mean, most = (ways[way].made[pose][k] - ways["true"].made[pose][k] for k in (0, 1))
                over[joints].append((pose, mean, most))
            longest.append(ways[way].made["armsup"][3])
        folded += _folds(folds, name, rig, ways)
    folds.notes.append("folds of the same length cross more faces the shorter edges are, and less area")
    return Result([table, folds], _findings(over, longest, folded))


def _ways(rig: Rig, scan: Mesh) -> dict[str, Posed]:
    mesh, own = skinned_mesh(scan, rig.skeleton)
    made = {"true": Posed(mesh, rig.nearest_weights(mesh), rig.skeleton), "ours": Posed(mesh, own, rig.skeleton)}
    found = find_skeleton(scan)
    refined, weights = skinned_mesh(scan, found)
    made["ours, found joints"] = Posed(refined, weights, found)
    made |= {way: Posed(mesh, make(mesh, rig.skeleton), rig.skeleton) for way, make in WAYS.items()}
    return {way: posed.measured(rig) for way, posed in made.items()}


def _folds(table: Table, name: str, rig: Rig, ways: dict[str, Posed]) -> list[tuple[int, int]]:
    """Rows of the table; crossing faces of ours at the true body's edges, and the true body's."""
    pairs, edge = [], edge_by_area(rig.body)
    true = {pose: crossing(rig.body, rig.posed[pose]) for pose in POSES}
    table.rows.append((name, "true body", *(f"{count}; {count}; {area:.0f}" for count, area in true.values())))
    for way in ("true", "ours", "ours, found joints"):
        posed, cells = ways[way].coarser(edge), []
        for pose in POSES:
            as_it_is, area = crossing(ways[way].mesh, ways[way].vertices(rig, pose))
            count, _ = crossing(posed.mesh, posed.vertices(rig, pose))
            cells.append(f"{as_it_is}; {count}; {area:.0f}")
            if way != "true":
                pairs.append((count, true[pose][0]))
        table.rows.append((name, way, *cells))
    return pairs


def _findings(
    over: dict[str, list[tuple[str, float, float]]], longest: list[float], folded: list[tuple[int, int]]
) -> list[Finding]:
    found = []
    for joints, of in over.items():
        for poses, (mean, most) in ((POSES[:3], ALLOWED["tpose"]), (POSES[3:], ALLOWED["squat"])):
            worst = np.array([row[1:] for row in of if row[0] in poses]).max(axis=0)
            found.append(
                Finding(
                    f"{', '.join(poses)} by {joints} joints: ≤ {mean:g} mm mean, ≤ {most:g} mm at 95 % above the true",
                    f"{worst[0]:.1f} / {worst[1]:.1f} mm",
                    bool(worst[0] <= mean and worst[1] <= most),
                )
            )
    worst_edge = max(longest)
    found.append(Finding(f"arms up: longest edge ≤ {LONGEST:g} ×", f"{worst_edge:.1f} ×", worst_edge <= LONGEST))
    share = max((ours - AND) / max(true, 1) for ours, true in folded)
    held = all(ours <= MORE_CROSSING * true + AND for ours, true in folded)
    found.append(
        Finding(f"crossing faces, edges alike: ≤ {MORE_CROSSING:g} × the true body's + {AND}",
                f"{max(share, 0.0):.1f} × + {AND}", held)
    )  # fmt: skip
    return found


if __name__ == "__main__":
    measured = run(sys.argv[1:] or tuple(BODIES))
    for made in (*measured.tables, limits_table(measured.findings)):
        print(made.text())
