"""Train the template that finds skeletons: ``core/avatar/joints/body_template.npz``.

    python tools/train_body_template.py MAKEHUMAN_FOLDER [--people 600] [--seed 1]

Draws people of MakeHuman's shape space (:mod:`makehuman` says which files the folder needs), bare and clothed, mirrors
them, and keeps the mean and the main components of some points of the surface and of the joints, in units of body
height, with the points' weights; some of our own mannequins are among them. None of ``../shared/data/rigged`` takes
part.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from makehuman import BODY, MakeHuman, Person
from mirror_scan.core.avatar.joints.body_template import BodyTemplate
from mirror_scan.core.avatar.joints.skeleton_search import fitted_body
from mirror_scan.core.avatar.skeleton import BONES, END_BONES, OTHER_SIDE, PARENTS
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point, raycast
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.simulation.mannequin import random_figure, rigged_mannequin

POINTS, COMPONENTS = 1200, 40
FILE = Path(__file__).resolve().parents[1] / "core" / "avatar" / "joints" / "body_template.npz"
DENSER = {"Hand": 2.0, "ForeArm": 1.5, "Foot": 1.4, "ToeBase": 1.4, "Head": 1.2, "Neck": 1.4, "LeftArm": 1.3,
          "RightArm": 1.3}  # fmt: skip
"""Points lie closer together on these bones, by this factor."""
BARE = 0.4
"""Share of people without clothes."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--people", type=int, default=600)
    parser.add_argument("--mannequins", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    space, rng = MakeHuman(options.folder), np.random.default_rng(options.seed)
    chosen = chosen_points(space)
    samples = [row for _ in range(options.people) for row in rows(space, space.draw(rng), chosen, rng)]
    template = template_of(space, chosen, np.array(samples))
    samples += [row for seed in range(options.mannequins) for row in mannequin_rows(template, seed)]
    write(template_of(space, chosen, np.array(samples)))


def template_of(space: MakeHuman, chosen: np.ndarray, data: np.ndarray) -> BodyTemplate:
    """Mean and main components of bodies (B, POINTS + 27, 3)."""
    mean = data.mean(axis=0)
    _, size, basis = np.linalg.svd((data - mean).reshape(len(data), -1), full_matrices=False)
    basis = basis[:COMPONENTS] * size[:COMPONENTS, None] / np.sqrt(len(data))
    left = 1 - (size[:COMPONENTS] ** 2).sum() / (size**2).sum()
    print(f"{len(data)} bodies; {COMPONENTS} components leave {100 * left:.1f} % of the variance")
    normals = vertex_normals(space.base[:BODY], space.triangles)[chosen]
    return BodyTemplate(mean, basis.reshape(COMPONENTS, *mean.shape), normals, space.weights[chosen])


def mannequin_rows(template: BodyTemplate, seed: int) -> list[np.ndarray]:
    """The same for one of our mannequins, and mirrored: the template is fitted, drawn onto the surface and unposed."""
    rng = np.random.default_rng([seed, 5])
    figure = replace(random_figure(rng), arm_angle_deg=float(rng.uniform(35, 60)), head_turn_deg=0.0)
    mesh, skeleton = rigged_mannequin(1.70, figure, resolution=0.012)
    rows = []
    for side in (1, -1):
        flip = np.array([side, 1.0, 1.0])
        body = Mesh(mesh.vertices * flip, mesh.triangles[:, ::side])
        joints = (skeleton.joints if side > 0 else skeleton.joints[list(OTHER_SIDE)]) * flip
        ends = (skeleton.ends if side > 0 else skeleton.ends[[0, 2, 1, 4, 3]]) * flip
        found = fitted_body(body, template)
        distance, _, nearest = closest_point(build_bvh(body.vertices, body.triangles), found.body.points)
        out = np.where((distance < 0.03)[:, None], nearest - found.body.points, 0.0)
        blend = (template.weights @ found.body.turns.reshape(-1, 9)).reshape(-1, 3, 3)
        owner = [max(parent, 0) for parent in PARENTS]
        moves = np.vstack((
            np.einsum("vji,vj->vi", blend, out),
            np.einsum("bji,bj->bi", found.body.turns[owner], joints - found.body.joints),
            np.einsum("bji,bj->bi", found.body.turns[list(END_BONES)], ends - found.body.ends),
        ))  # fmt: skip
        row = template.mean + np.tensordot(found.state.shape, template.basis, 1) + moves / found.state.height
        rows.append(row - row[POINTS])
    return rows


def chosen_points(space: MakeHuman) -> np.ndarray:
    """Vertices spread over the skin as a camera can see it."""
    skin = space.base[:BODY]
    normals = vertex_normals(skin, space.triangles)
    hidden = raycast(build_bvh(skin, space.triangles), skin + 0.002 * normals, normals, 0.02)[1] >= 0
    weights = space.weights
    denser = np.array([next((f for name, f in DENSER.items() if bone.endswith(name)), 1.0) for bone in BONES])
    factor = weights @ denser
    allowed = np.flatnonzero(~hidden)
    nearest = np.full(len(allowed), np.inf)
    chosen = [int(np.argmax(skin[allowed, 2]))]
    while len(chosen) < POINTS:
        nearest = np.minimum(nearest, np.linalg.norm(skin[allowed] - skin[allowed[chosen[-1]]], axis=1))
        chosen.append(int(np.argmax(nearest * factor[allowed])))
    return allowed[chosen]


def rows(space: MakeHuman, person: Person, chosen: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Points, joints and ends (POINTS + 27, 3) of a person and of the mirrored person, body height 1, hips at 0."""
    skin = person.vertices[:BODY]
    normals = vertex_normals(skin, space.triangles)
    moved = np.zeros(BODY)
    if rng.random() > BARE:
        for piece, reach in outfit(space, rng):
            moved = np.maximum(moved, covered(space, person, normals, piece, reach))
    if rng.random() < 0.4:
        height = np.ptp(skin[:, 2])
        moved += space.weights @ rng.uniform(-0.002, 0.012, len(BONES)) * height
    dressed = np.vstack((skin + moved[:, None] * normals, person.vertices[BODY:]))
    mirrored = space.mirrored(Person(dressed, person.joints, person.ends))
    bare = space.mirrored(person)
    both = []
    for body, truth in ((dressed, person), (mirrored.vertices, bare)):
        row = np.vstack((body[chosen], truth.joints, truth.ends)) - truth.joints[0]
        both.append(row / np.ptp(skin[:, 2]))
    return both


def outfit(space: MakeHuman, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Clothes, shoes and hair, each with how far it may stand off the skin [m]."""
    kinds = {"suit": [], "shoes": [], "hair": []}
    for name in space.outfits():
        kind = "hair" if name.startswith("hair") else "shoes" if "shoes" in name else "suit"
        kinds[kind].append(name)
    reach = {"suit": 0.06, "shoes": 0.05, "hair": 0.14}
    return [(str(rng.choice(kinds[kind])), reach[kind]) for kind in kinds if rng.random() < 0.8]


def covered(space: MakeHuman, person: Person, normals: np.ndarray, piece: str, reach: float) -> np.ndarray:
    """How far out the outermost cloth lies, each vertex of the skin (BODY,); 0 where there is none."""
    vertices, triangles = space.worn(person, piece)
    bvh = build_bvh(vertices, triangles)
    skin = person.vertices[:BODY]
    out = np.zeros(BODY)
    start = -0.005
    origin = np.full(BODY, start)
    alive = np.arange(BODY)
    for _ in range(6):
        at = skin[alive] + origin[alive, None] * normals[alive]
        t, triangle = raycast(bvh, at, normals[alive], reach)[:2]
        hit = (triangle >= 0) & (origin[alive] + t < reach)
        alive = alive[hit]
        out[alive] = np.maximum(out[alive], origin[alive] + t[hit])
        origin[alive] += t[hit] + 0.0005
    return out


def write(template: BodyTemplate) -> None:
    """Numbers as whole steps: mean in 1 / 20 000 of body height, each component in 127 steps, weights in 255."""
    index = np.argsort(-template.weights, axis=1)[:, :4]
    share = np.take_along_axis(template.weights, index, axis=1)
    share /= share.sum(axis=1, keepdims=True)
    step = np.abs(template.basis).max(axis=(1, 2)) / 127
    np.savez_compressed(
        FILE,
        mean=np.rint(template.mean * 20000).astype(np.int16),
        step=step.astype(np.float32),
        basis=np.rint(template.basis / step[:, None, None]).astype(np.int8),
        normals=np.rint(template.normals * 127).astype(np.int8),
        index=index.astype(np.uint8),
        weight=np.rint(share * 255).astype(np.uint8),
    )
    print(f"{FILE}: {FILE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
