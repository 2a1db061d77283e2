"""The skeleton of a closed mesh of a standing person: a body template is fitted to it, whose joints are known."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...mesh import FILL, Mesh
from ...mesh.normals import vertex_normals
from ...mesh.surface_distance import sample_surface
from ...numeric.rotations import from_vectors, to_vectors, unit
from ..skeleton import BONES, OTHER_SIDE, Skeleton
from .body_template import BodyState, BodyTemplate, body_template, posed
from .person_check import check_person, check_standing, foot_missing, forearm_missing, part_shares, stands_unread
from .template_fit import Fit, Surface, feet, fit, forearms, joint_spread, mirrored_turn

_SAMPLES = 3000
_ARMS_DOWN = (-80.0, -25.0, 0.0, 25.0)  # from the template's rest pose, which has them some 45° down [deg]
_COARSE, _FINE = np.geomspace(0.12, 0.05, 8), np.geomspace(0.05, 0.025, 12)
_SLIDING = 0.02  # weight along the surface in the fine steps
_FILLED = 0.3  # how much filled surface counts, next to measured one
_ROUGH = np.radians(7.0)  # normals of what a view saw, to those of a smoother mesh: so rough a view counts half
_OWN, _SMOOTHER = np.radians(8.0), np.radians(20.0)  # so rough, a view's own normals are taken, or the smoother mesh's
_FEW = 30  # samples of a view that say how rough it is
_RIGID = 2  # first steps without change of shape
_BUMPS, _ROUNDS = 0.03, 30  # of body height; rounds of smoothing at most
_INSIDE, _MOST_INSIDE = 0.012, 0.06  # of body height under the trunk's skin; share of a forearm that may lie so deep
_TRUNK = [BONES.index(name) for name in ("Hips", "Spine", "Spine1", "Spine2", "LeftUpLeg", "RightUpLeg")]
_SIDES = ("Left", "Right")
_FAR = 0.05  # of body height: a point is not farther off than this when starts are compared


def find_skeleton(mesh: Mesh) -> Skeleton:
    """Joints of a whole person who stands upright, arms anywhere from hanging to raised to the sides.

    The body template is fitted from several arm angles; the best goes on to the end. About 2 s of one core's time.

    Parameters
    ----------
    mesh : Mesh
        Closed, outward, avatar frame [m]: Z up, facing -Y, +X is the subject's left.

    Raises
    ------
    ReconstructionError
        When the mesh is not a whole standing person; says which part is missing.
    """
    check_standing(mesh)
    found = fitted_body(mesh)
    bottom, top = mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()
    check_person(body_template(), found, float(bottom), float(top))
    return Skeleton(found.body.joints, found.body.ends, confidence(found))


def fitted_body(mesh: Mesh, template: BodyTemplate | None = None) -> Fit:
    """The template fitted to a mesh, whatever it is of."""
    template = template or body_template()
    surface, coarse = sampled(mesh)
    starts = [fit(template, coarse, _start(template, mesh, angle), _COARSE, _RIGID) for angle in _ARMS_DOWN]
    best = min(starts, key=lambda found: (len(lost_forearms(template, found)), _apart(found)))
    lost = set(forearms(lost_forearms(template, best)))
    floor = _floor(mesh)

    def finished() -> Fit:
        start = _as_other_side(best.state, lost)
        return fit(template, surface, start, _FINE, lost=lost, tangent=_SLIDING, floor=floor)

    found = finished()
    shares = part_shares(template, found)
    gone = [*lost_forearms(template, found), *(side for side in _SIDES if forearm_missing(shares, side))]
    more = {*forearms(gone), *feet([side for side in _SIDES if foot_missing(shares, side)])} - lost
    if more:
        lost |= more
        found = finished()
    return found


def _floor(mesh: Mesh) -> float:
    """Height of what the body stands on [m]: z = 0 when its feet were not read, else its lowest point."""
    low, high = mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()
    return 0.0 if stands_unread(float(low), float(high)) else float(low)


def lost_forearms(template: BodyTemplate, found: Fit) -> list[str]:
    """Sides whose forearm went into the trunk: that is where one goes whose own surface is missing."""
    bone = np.argmax(template.weights, axis=1)
    trunk = np.flatnonzero(np.isin(bone, _TRUNK))
    lost = []
    for side in _SIDES:
        arm = found.body.points[np.isin(bone, forearms([side]))]
        way = arm[:, None] - found.body.points[trunk]
        nearest = np.argmin(np.einsum("ijk,ijk->ij", way, way), axis=1)
        out = np.einsum("ik,ik->i", way[np.arange(len(arm)), nearest], found.body.normals[trunk[nearest]])
        if np.mean(out < -_INSIDE * found.state.height) > _MOST_INSIDE:
            lost.append(side)
    return lost


def _as_other_side(state: BodyState, lost: Collection[int]) -> BodyState:
    """Limbs with ``lost`` bones as the other side's; where both sides lack them, as in the rest pose."""
    turns = state.turns.copy()
    for first, parts in (("ForeArm", ("Shoulder", "Arm", "ForeArm", "Hand")), ("Foot", ("Foot", "ToeBase"))):
        sides = [side for side in _SIDES if BONES.index(side + first) in lost]
        for bone in (BONES.index(side + part) for side in sides for part in parts):
            other = to_vectors(state.turns[OTHER_SIDE[bone]])
            turns[bone] = from_vectors(mirrored_turn(other)) if len(sides) == 1 else np.eye(3)
    return replace(state, turns=turns)


def sampled(mesh: Mesh) -> tuple[Surface, Surface]:
    """Points spread evenly over a mesh with its normals; fewer, with the normals of a smoother mesh.

    A view's noise grows with its distance, so what mirrors showed is several times as wrong as what was seen directly.
    How rough a view left the surface says how noisy it was: the rougher, the less it counts, and the more its normals
    are those of the smoother mesh. What filled holes counts less than what was measured.
    """
    points, triangle = sample_surface(mesh, _SAMPLES)
    corners = mesh.triangles[triangle]
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    smooth = _smoothed(mesh, normals.copy())
    own, smoother = unit(normals[corners].sum(axis=1)), unit(smooth[corners].sum(axis=1))
    filled = np.zeros(len(points), np.bool_) if mesh.kind is None else mesh.kind[triangle] == FILL
    view = np.full(len(points), -1) if mesh.view is None else np.median(mesh.view[corners], axis=1).astype(np.int64)
    view[filled] = -1
    bent = np.arccos(np.clip(np.einsum("ij,ij->i", own, smoother), -1.0, 1.0))
    rough = np.full(len(points), np.median(bent))
    for each in np.unique(view):
        if np.count_nonzero(view == each) >= _FEW:
            rough[view == each] = np.median(bent[view == each])
    counts = 1.0 / (1.0 + (rough / _ROUGH) ** 4)
    counts /= counts.mean() if filled.all() else counts[~filled].mean()
    if not filled.all():
        counts[filled] *= _FILLED
    share = np.interp(rough, (_OWN, _SMOOTHER), (0.0, 1.0))[:, None]
    fine = Surface(points, unit((1.0 - share) * own + share * smoother), counts)
    return fine, Surface(points[::3], smoother[::3], counts[::3])


def _smoothed(mesh: Mesh, normals: np.ndarray) -> np.ndarray:
    """Normals (V, 3) averaged along edges over ``_BUMPS``, so that a scan's bumps do not send pairs astray."""
    ends = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    edge = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1).mean()
    bumps = _BUMPS * np.ptp(mesh.vertices[:, 2])
    count = np.maximum(np.bincount(ends[:, 0], minlength=len(normals)), 1)
    for _ in range(min(round((bumps / edge) ** 2), _ROUNDS)):
        for axis in range(3):
            around = np.bincount(ends[:, 0], normals[ends[:, 1], axis], len(normals))
            normals[:, axis] = 0.5 * (normals[:, axis] + around / count)
    return normals


def confidence(found: Fit) -> np.ndarray:
    """Of each joint (22,), 0 to 1: how little the fit leaves open."""
    return np.clip(np.exp(-joint_spread(body_template(), found) / (0.02 * found.state.height)), 0.0, 1.0)


def _start(template: BodyTemplate, mesh: Mesh, down: float) -> BodyState:
    """The mean body as tall as the mesh above its floor, in its place, arms so many degrees further down."""
    low, high = _floor(mesh), mesh.vertices[:, 2].max()
    turns = np.tile(np.eye(3), (len(BONES), 1, 1))
    for side, name in ((1, "LeftArm"), (-1, "RightArm")):
        turns[BONES.index(name)] = from_vectors(np.array([0.0, side * np.radians(down), 0.0]))
    state = BodyState(np.zeros(3), float(high - low), np.zeros(len(template.basis)), turns)
    points = posed(template, state).points
    middle = np.median(mesh.vertices, axis=0) - np.median(points, axis=0)
    return BodyState(np.array([middle[0], middle[1], low - points[:, 2].min()]), state.height, state.shape, turns)


def _apart(found: Fit) -> float:
    far = _FAR * found.state.height
    return float(np.minimum(found.to_surface, far).mean() + np.minimum(found.to_body, far).mean())
