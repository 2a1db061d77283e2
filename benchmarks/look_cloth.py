"""Clothes of ours in Blender: skirt and shirt over a walk, how they keep off the body and what a frame costs.

``python -m benchmarks.look_cloth [--bodies s006 …] [--frames 60] [--pictures DIR]``; it needs the bpy module.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES, ENDS, Skeleton
from mirror_scan.core.avatar.skin_weights import skin_weights, skinned_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import rigged_mannequin

from .machine import say
from .results import Finding, Result, Table, limits_table, number
from .rigged_bodies import rigged_bodies

FRAMES = 60
LEAST_GAP, MOST_SECONDS = 2.0, 1.5  # [mm], [s]
NEAR_SKIN = 0.008  # where skin lies so near to other skin, cloth has no room [m]
_RESOLUTION = 0.0125  # of the mannequin [m]
BODIES = ("s006", "s020")


def subjects(names: tuple[str, ...]) -> list[tuple[str, Mesh, Skeleton, SkinWeights]]:
    """The mannequin, and bodies of ``../shared/data/rigged`` by name, with weights of ours."""
    mesh, skeleton = rigged_mannequin(resolution=_RESOLUTION)
    mesh, weights = skinned_mesh(mesh, skeleton)
    found = [("mannequin", mesh, skeleton, weights)]
    for body in rigged_bodies():
        if body.name in names:
            skeleton = with_hands(body.skeleton)
            found.append((body.name, body.mesh, skeleton, skin_weights(body.mesh, skeleton)))
    return found


def with_hands(skeleton: Skeleton) -> Skeleton:
    """The skeleton with hands that have a length: where the truth knows none, they go on from the forearms."""
    ends = skeleton.ends.copy()
    for side in ("Left", "Right"):
        wrist, elbow = (skeleton.joints[BONES.index(side + name)] for name in ("Hand", "ForeArm"))
        ends[ENDS.index(f"{side}Hand_End")] = wrist + 0.7 * (wrist - elbow)
    return replace(skeleton, ends=ends)


def no_room(body: Mesh, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Which of some points (N, 3) of the body's skin lie within 8 mm of other skin, (N,) bool.

    Other skin is what rays from just outside the skin meet on their way, straight outwards or aslant.
    """
    from mirror_scan.core.mesh.bvh import build_bvh, raycast
    from mirror_scan.core.numeric.rotations import frames

    tree = build_bvh(np.ascontiguousarray(body.vertices), body.triangles)
    start, axes = points + 1e-5 * normals, frames(normals, np.roll(normals, 1, axis=1))
    met = np.zeros(len(points), np.bool_)
    for slope in (0.0, 30.0, 60.0):
        for turn in range(8 if slope else 1):
            a, b = np.radians(slope), np.pi / 4 * turn
            aslant = axes @ (np.cos(a), np.sin(a) * np.cos(b), np.sin(a) * np.sin(b))
            met |= raycast(tree, start, aslant, NEAR_SKIN)[1] >= 0
    return met


def one(name: str, mesh: Mesh, skeleton: Skeleton, weights: SkinWeights, kind: str, frames: int, pictures: Path | None):
    """Dress a body, let the cloth fall over a walk, and measure: a row of the table."""
    import bpy
    from mirror_scan.core.clothes import make_garment
    from mirror_scan.core.clothes.body_distance import BodyDistance
    from mirror_scan.core.motion import make_clip, sole_points
    from mirror_scan.core.motion.foot_lock import stand_on_floor
    from mirror_scan.mirror_scan_addon.scene import armature, avatar_objects, cloth

    started = time.perf_counter()
    garment = make_garment(mesh, skeleton, weights, kind)
    made_in = time.perf_counter() - started
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 30
    scene.frame_start, scene.frame_end = 0, frames - 1
    avatar = avatar_objects.create_avatar(mesh, collection=scene.collection)
    bones = armature.add_armature(avatar, skeleton, weights, scene.collection)
    clip = make_clip("walk", skeleton, 30.0)
    clip = stand_on_floor(clip, skeleton, sole_points(mesh.vertices, weights, skeleton))
    armature.add_clip(bones, clip)
    worn = cloth.add_garment(avatar, garment, scene.collection)
    cloth.add_collider(avatar, scene.collection, scene)
    cloth.make_cloth(worn, avatar, scene)

    inside, least, excepted = 0, np.inf, 0
    seconds, own = [], []
    for frame in range(frames):
        wall, cpu = time.perf_counter(), time.process_time()
        scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        body, dress = _evaluated(avatar, graph), _evaluated(worn, graph)
        seconds.append(time.perf_counter() - wall)
        own.append(time.process_time() - cpu)
        skin = BodyDistance(body).at(dress.vertices)
        close = skin.distance < LEAST_GAP / 1000.0
        between = np.zeros(len(close), np.bool_)
        if close.any():
            normals = skin.normal[close]
            between[close] = no_room(body, skin.point[close], normals)
        inside += int(np.count_nonzero((skin.distance < 0) & ~between))
        excepted += int(between.sum())
        least = min(least, float(skin.distance[~between].min()))
        if pictures is not None and frame % max(frames // 6, 1) == 0:
            _picture(pictures / f"{name}_{kind}_{frame:03}.png", body, dress)
    count, mean = f"{len(garment.mesh.vertices):,}", float(np.mean(own))
    row = (name, kind, count, number(made_in, 1), str(inside), str(excepted), number(1000 * least, 2),
           number(mean, 2), number(float(np.mean(seconds)), 2))  # fmt: skip
    return row, (inside, 1000 * least, mean)


def _evaluated(item, graph) -> Mesh:
    """An object as its modifiers leave it, in the world."""
    data = item.evaluated_get(graph).data
    vertices = np.empty((len(data.vertices), 3), np.float32)
    data.attributes["position"].data.foreach_get("vector", vertices.ravel())
    data.calc_loop_triangles()
    triangles = np.empty((len(data.loop_triangles), 3), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    matrix = np.array(item.matrix_world)
    return Mesh(vertices @ matrix[:3, :3].T + matrix[:3, 3], triangles)


def _picture(path: Path, body: Mesh, dress: Mesh) -> None:
    from mirror_scan.core.io.images import write_png
    from mirror_scan.core.preview.mesh_views import render_views

    vertices = np.concatenate((body.vertices, dress.vertices))
    triangles = np.concatenate((body.triangles, dress.triangles + np.int32(len(body.vertices))))
    colors = np.repeat(np.uint8([(205, 170, 150), (150, 62, 72)]), [len(body.vertices), len(dress.vertices)], axis=0)
    views = ((0, -1, 0), (1, -0.7, 0.2), (1, 0, 0), (-0.3, 1, 0.1))
    write_png(path, render_views(Mesh(vertices, triangles), colors, views, 300, 560))


def run(
    bodies: tuple[str, ...] = BODIES, kinds: tuple[str, ...] = ("skirt", "tshirt"), frames: int = FRAMES,
    pictures: Path | None = None,
) -> Result:  # fmt: skip
    """Skirt and shirt on every body."""
    import mirror_scan

    mirror_scan.register()
    rows, worst = [], []
    for subject in subjects(bodies):
        for kind in kinds:
            row, figures = one(*subject, kind, frames, pictures)
            say("  ".join(row))
            rows.append(row)
            worst.append(figures)
    columns = ("body", "garment", "vertices", "cut out [s]", "inside", "no room", "least gap [mm]", "CPU s a frame",
               "s a frame")  # fmt: skip
    table = Table(f"Cloth over {frames} frames of a walk", columns, rows, left=2)
    table.notes.append("inside: vertices, summed over the frames; no room: those where skin lies within 8 mm of skin.")
    inside, least, slowest = np.array(worst).T
    findings = [
        Finding("Cloth: no vertex inside the body", f"{int(inside.sum())}", bool(inside.sum() == 0)),
        Finding(f"Cloth: gap >= {LEAST_GAP:g} mm", f"{least.min():.2f} mm", bool(least.min() >= LEAST_GAP)),
        Finding(f"Cloth: <= {MOST_SECONDS:g} s a frame", f"{slowest.max():.2f} s", bool(slowest.max() <= MOST_SECONDS)),
    ]
    return Result([table], findings)


def tables(quick: bool) -> Result:
    """What the benchmark of the look prints; ``quick`` leaves all bodies out but the mannequin."""
    return run(() if quick else BODIES)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--bodies", nargs="*", default=list(BODIES))
    parser.add_argument("--kinds", nargs="+", default=["skirt", "tshirt"])
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    result = run(tuple(options.bodies), tuple(options.kinds), options.frames, options.pictures)
    say(result.tables[0].text())
    say(limits_table(result.findings).text())


if __name__ == "__main__":
    main()
