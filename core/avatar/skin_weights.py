"""Skin weights: which bones move each vertex of an avatar, from its shape and its skeleton alone.

Tables say how strongly each bone holds a point (:mod:`.weight_fields`). They know of no surface, so a limb might pull
what only lies near it: limbs are parted by distances along the surface first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from ..mesh import SURFACE, Mesh
from ..mesh.bvh import build_bvh, raycast
from ..mesh.half_edges import edge_keys
from ..mesh.normals import vertex_normals
from ..mesh.self_intersections import self_intersections
from ..mesh.submesh import triangle_components
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..numeric.rotations import about_axis, shortest_turn
from ..numeric.sparse_least_squares import elimination_order, solve_squares
from .pose import Pose, SkinWeights, bone_matrices, skinned
from .skeleton import BONES, PARENTS, Skeleton
from .weight_fields import WeightFields, body_size, bone_likelihoods, known_fields

# Trunk, left arm, right arm, left leg, right leg: the limb of each bone.
_FIRST = ("Hips", "LeftShoulder", "RightShoulder", "LeftUpLeg", "RightUpLeg")
LIMBS = np.searchsorted([BONES.index(name) for name in _FIRST], np.arange(len(BONES)), side="right") - 1
_LIMB_COUNT = len(_FIRST)

_INFLUENCES = 4
_LEAST = 0.005  # a share below this is left out
_REACH, _FADE = 0.08, 0.02  # so far beyond its own surface a limb's hold begins to fade, by e each so far [body sizes]
_GONE = 20.0  # log-likelihood by which it has faded where it is gone
_WITHIN = 0.9  # of a bone's length: its tip may lie outside the skin
_STEP_IN = 0.001  # below the skin, where rays begin [m]
_ARMPIT, _CROTCH = 0.3, 0.12  # so far around the arms' joints, and below the legs', fills are refined [body sizes]
_SMOOTHING = 3  # rounds of averaging with neighbours
_RAISED, _SPREAD = np.radians(77.0), np.radians(45.0)  # of arms and legs, for a look at how skin is stretched
_STRETCHED, _TAUT = 3.65, 3.8  # of its length: an edge that is relaxed, and one that must be
_RELAXED, _ROUNDS = 0.03, 15  # how far around such edges [body sizes], and how often
_FOLDED, _KNEES = np.radians(85.0), np.radians(95.0)  # of thighs and knees, for a look at how skin folds
_FOLDS = 0.3  # so far around the legs' joints skin may fold into itself [body sizes]
_SPREADING = (0.04, 0.05, 0.06, 0.07)  # how far around such folds weights are spread, round by round [body sizes]
_CLEAR = 0.4  # share of the faces that cross at first, below which it is enough
_TINY = 0.001  # shorter edges are taken for so long [m]


def skinned_mesh(mesh: Mesh, skeleton: Skeleton) -> tuple[Mesh, SkinWeights]:
    """The mesh with fills fine enough to bend, and its weights.

    Parameters
    ----------
    mesh : Mesh
        Closed. Seams and fills are refined where ``view`` and ``kind`` say which they are; what was measured stays.
    skeleton : Skeleton
        In the mesh's frame.
    """
    if mesh.view is not None and mesh.kind is not None and (mesh.kind == SURFACE).any():
        size = body_size(skeleton)
        hips = skeleton.joints[[BONES.index("LeftUpLeg"), BONES.index("RightUpLeg")]]
        arms = skeleton.joints[[BONES.index("LeftArm"), BONES.index("RightArm")]]
        crotch = hips.mean(axis=0) - (0.0, 0.0, _CROTCH * size)
        near = np.linalg.norm(mesh.vertices - crotch, axis=1) < _CROTCH * size
        for arm in arms:
            near |= np.linalg.norm(mesh.vertices - arm, axis=1) < _ARMPIT * size
        wanted = np.where(near, edge_length_at_vertices(mesh), np.inf)
        mesh = refine(mesh, wanted, 1.0)[0]
    return mesh, skin_weights(mesh, skeleton)


def skin_weights(mesh: Mesh, skeleton: Skeleton, fields: WeightFields | None = None) -> SkinWeights:
    """Weights of a closed mesh: at most 4 bones a vertex, each row's sum 1, smooth; a limb holds only its own skin.

    Parameters
    ----------
    mesh : Mesh
        Closed, in metres; shared vertices.
    skeleton : Skeleton
        In the mesh's frame.
    fields : WeightFields, optional
        Other tables than those that come with the program.

    Notes
    -----
    About 0.3 s for 30 000 vertices.
    """
    hold = bone_likelihoods(mesh.vertices, skeleton, fields or known_fields())
    edges = unique_edges(mesh)
    near = _neighbours(mesh.vertices, edges)
    _part_limbs(hold, mesh, skeleton, near)
    weights = _softmax(hold)
    for _ in range(_SMOOTHING):
        weights = _smoothed(weights, near)
    _unfold(weights, mesh, skeleton, edges, near)
    _relax(weights, mesh.vertices, skeleton, edges, near)
    return strongest(weights)


def strongest(weights: np.ndarray) -> SkinWeights:
    """Four bones of each vertex, of weights (V, 22); rows sum to 1.

    The strongest, but limbs before the trunk: skin that a small share joins to a raised arm would jump where the trunk
    takes that place. What the others hold goes to their nearest relative among the four.
    """
    limb = np.where((LIMBS > 0) & (weights >= _LEAST), weights, 0.0)
    first = np.argsort(-limb, axis=1, kind="stable")[:, : _INFLUENCES // 2]
    rank = weights.copy()
    np.put_along_axis(rank, first, np.take_along_axis(weights + (limb > 0.0), first, axis=1), axis=1)
    index = np.argsort(-rank, axis=1, kind="stable")[:, :_INFLUENCES]
    weight = np.take_along_axis(weights, index, axis=1)
    weight[weight < _LEAST] = 0.0
    left = weights.copy()
    np.put_along_axis(left, index, np.where(weight > 0.0, 0.0, np.take_along_axis(left, index, axis=1)), axis=1)
    apart = np.where(weight[:, None] > 0.0, _STEPS_APART[:, index].transpose(1, 0, 2), 3 * len(BONES))
    rows, bones = np.nonzero(left > 0.0)
    np.add.at(weight, (rows, apart[rows, bones].argmin(axis=1)), left[rows, bones])
    order = np.argsort(-weight, axis=1, kind="stable")
    weight = np.take_along_axis(weight, order, axis=1) / weight.sum(axis=1, keepdims=True)
    index = np.where(weight > 0.0, np.take_along_axis(index, order, axis=1), 0)
    return SkinWeights(index.astype(np.uint8), weight.astype(np.float32))


def _steps_apart() -> np.ndarray:
    """How many joints lie between each two bones (22, 22); from the trunk a limb is farther than anything else."""
    steps = np.full((len(BONES), len(BONES)), len(BONES))
    for bone, parent in enumerate(PARENTS):
        steps[bone, bone] = 0
        if parent >= 0:
            steps[bone, :bone] = steps[:bone, bone] = steps[parent, :bone] + 1
    steps[np.ix_(LIMBS == 0, LIMBS > 0)] += len(BONES)
    return steps


_STEPS_APART = _steps_apart()


def unique_edges(mesh: Mesh) -> np.ndarray:
    """Edges (E, 2), each once."""
    count = len(mesh.vertices)
    keys = np.unique(edge_keys(mesh.triangles, count))
    return np.stack((keys // count, keys % count), axis=1)


def _softmax(hold: np.ndarray) -> np.ndarray:
    shares = np.exp(hold - hold.max(axis=1, keepdims=True))
    return shares / shares.sum(axis=1, keepdims=True)


def _limbs_seen(mesh: Mesh, skeleton: Skeleton) -> np.ndarray:
    """Which limbs (V, 5) a vertex sees from within the body: the nearest point of their bones, with no skin between.

    A limb that lies beside another one is not seen from there, however near it is.
    """
    vertices, heads = mesh.vertices, skeleton.joints
    along = _WITHIN * (skeleton.tails() - heads)
    inside = vertices - _STEP_IN * vertex_normals(vertices, mesh.triangles)
    nearest = np.full((_LIMB_COUNT, len(vertices)), np.inf)
    towards = np.empty((_LIMB_COUNT, len(vertices), 3))
    for bone, limb in enumerate(LIMBS):
        at = np.clip(dot(vertices - heads[bone], along[bone]) / max(along[bone] @ along[bone], 1e-9), 0.0, 1.0)
        way = heads[bone] + at[:, None] * along[bone] - inside
        distance = np.linalg.norm(way, axis=1)
        closer = distance < nearest[limb]
        nearest[limb, closer] = distance[closer]
        towards[limb, closer] = way[closer]
    tree = build_bvh(vertices, mesh.triangles)
    hit = raycast(tree, np.tile(inside, (_LIMB_COUNT, 1)), towards.reshape(-1, 3), 1.0)[1]
    return (hit < 0).reshape(_LIMB_COUNT, -1).T


def _part_limbs(hold: np.ndarray, mesh: Mesh, skeleton: Skeleton, near: Neighbours) -> None:
    """Weaken in ``hold`` (V, 22) each limb's bones away from the limb's own surface.

    Its own surface is what sees it and is held by it most, in one piece.
    """
    size = body_size(skeleton)
    own = _softmax(hold) @ np.eye(_LIMB_COUNT)[LIMBS]
    limb = np.where(_limbs_seen(mesh, skeleton), own + 1e-6, 0.0).argmax(axis=1)
    for number in range(_LIMB_COUNT):
        core = _largest_piece(mesh, limb == number)
        if not core.any():
            continue
        beyond = _surface_distances(core, near, (_REACH + _GONE * _FADE) * size) / size
        fade = np.clip((beyond - _REACH) / _FADE, 0.0, _GONE)
        hold[:, LIMBS == number] -= fade[:, None]


def _largest_piece(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """The ``chosen`` vertices (V,) that hang together most."""
    triangles = mesh.triangles[chosen[mesh.triangles].all(axis=1)]
    piece = np.zeros(len(chosen), np.bool_)
    if len(triangles):
        label, _ = triangle_components(triangles, len(chosen))
        piece[triangles[label == np.bincount(label).argmax()]] = True
    return piece


class Neighbours(NamedTuple):
    """Whose neighbour each vertex is: ``heads[starts[v]:starts[v + 1]]``, and how far away [m]."""

    starts: np.ndarray
    heads: np.ndarray
    lengths: np.ndarray


def _neighbours(vertices: np.ndarray, edges: np.ndarray) -> Neighbours:
    both = np.concatenate((edges, edges[:, ::-1]))
    both = both[np.argsort(both[:, 0], kind="stable")]
    lengths = np.linalg.norm(vertices[both[:, 0]] - vertices[both[:, 1]], axis=1)
    return Neighbours(np.searchsorted(both[:, 0], np.arange(len(vertices) + 1)), both[:, 1].copy(), lengths)


@njit(cache=True, nogil=True, error_model="numpy")
def _surface_distances(start, near, reach):
    """Distance (V,) along edges from the vertices ``start`` (V,) bool; inf beyond ``reach`` [m].

    Vertices whose distance fell are looked at again, in the order they did (Moore 1959).
    """
    distance = np.full(len(start), np.inf)
    waits = start.copy()
    queue = np.empty(len(start), np.int64)  # a ring; none waits twice
    first, count = 0, 0
    for v in range(len(start)):
        if start[v]:
            distance[v] = 0.0
            queue[count] = v
            count += 1
    while count > 0:
        v = queue[first]
        first = (first + 1) % len(queue)
        count -= 1
        waits[v] = False
        for e in range(near.starts[v], near.starts[v + 1]):
            w, further = near.heads[e], distance[v] + near.lengths[e]
            if further < distance[w] and further <= reach:
                distance[w] = further
                if not waits[w]:
                    waits[w] = True
                    queue[(first + count) % len(queue)] = w
                    count += 1
    return distance


@njit(cache=True, nogil=True, error_model="numpy")
def _smoothed(values, near):
    """Each vertex's values (V, K), half of them its neighbours' mean."""
    out = values.copy()
    for v in range(len(values)):
        degree = near.starts[v + 1] - near.starts[v]
        if degree == 0:
            continue
        for k in range(values.shape[1]):
            total = 0.0
            for e in range(near.starts[v], near.starts[v + 1]):
                total += values[near.heads[e], k]
            out[v, k] = 0.5 * (values[v, k] + total / degree)
    return out


def _unfold(weights: np.ndarray, mesh: Mesh, skeleton: Skeleton, edges: np.ndarray, near: Neighbours) -> None:
    """Spread weights (V, 22) where skin runs through itself as somebody squats: groins and hollows of the knees.

    About faces that cross, weights become harmonic, round by round farther around them, until few faces cross.
    """
    size = body_size(skeleton)
    joints = skeleton.joints[[BONES.index(side + part) for side in ("Left", "Right") for part in ("UpLeg", "Leg")]]
    apart = np.linalg.norm(mesh.vertices[:, None] - joints, axis=2).min(axis=1)
    triangles = mesh.triangles[(apart < _FOLDS * size)[mesh.triangles].all(axis=1)]
    if not len(triangles):
        return
    at, corners = np.unique(triangles, return_inverse=True)
    corners = corners.reshape(-1, 3).astype(np.int32)
    matrices = bone_matrices(skeleton, squatting())
    crossed = _crossing(mesh.vertices[at], corners)
    stiffness = 1.0 / np.maximum(np.linalg.norm(np.diff(mesh.vertices[edges], axis=1)[:, 0], axis=1), _TINY)
    region = np.zeros(len(mesh.vertices), np.bool_)
    first = 0
    for reach in _SPREADING:
        crossing = _crossing(skinned(mesh.vertices[at], strongest(weights[at]), matrices), corners) & ~crossed
        first = max(first, int(crossing.sum()))
        if crossing.sum() <= _CLEAR * first:
            return
        start = np.zeros(len(mesh.vertices), np.bool_)
        start[triangles[crossing]] = True
        region |= np.isfinite(_surface_distances(start, near, reach * size))
        make_harmonic(weights, region, edges, stiffness)


def _crossing(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (T,) cross another one."""
    found = np.zeros(len(triangles), np.bool_)
    found[np.unique(self_intersections(vertices, triangles))] = True
    return found


def squatting() -> Pose:
    """Thighs 85° ahead, knees bent by 95°, the trunk upright."""
    rotations = np.tile(np.eye(3), (len(BONES), 1, 1))
    for side in ("Left", "Right"):
        rotations[BONES.index(f"{side}UpLeg")] = about_axis(0, -_FOLDED)
        for name in ("Leg", "Foot", "ToeBase"):
            rotations[BONES.index(side + name)] = about_axis(0, _KNEES - _FOLDED)
    return Pose(rotations, np.zeros(3))


def _relax(weights: np.ndarray, vertices: np.ndarray, skeleton: Skeleton, edges: np.ndarray, near: Neighbours) -> None:
    """Spread weights (V, 22) where raised arms or legs apart would stretch skin too far: no webs, where fills are.

    About edges that are stretched, weights become harmonic, as evenly spread as the weights around allow. Where that
    does not suffice, again, with stretched edges stiffer and more of what is around them.
    """
    size = body_size(skeleton)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    matrices = bone_matrices(skeleton, limbs_apart(skeleton))
    raised = skinned(vertices, strongest(weights), matrices)
    region = np.zeros(len(vertices), np.bool_)
    stiffness = 1.0 / np.maximum(lengths, _TINY)
    asked = np.arange(len(edges))  # elsewhere nothing changes
    for _ in range(_ROUNDS):
        a, b = edges[asked].T
        stretch = np.linalg.norm(raised[a] - raised[b], axis=1) / np.maximum(lengths[asked], _TINY)
        if not (stretch > _TAUT).any():
            return
        start = np.zeros(len(vertices), np.bool_)
        start[edges[asked[stretch > _STRETCHED]]] = True
        region |= np.isfinite(_surface_distances(start, near, _RELAXED * size))
        stiffness[asked] *= np.maximum(stretch / _STRETCHED, 1.0)
        make_harmonic(weights, region, edges, stiffness)
        raised[region] = skinned(vertices[region], strongest(weights[region]), matrices)
        asked = np.flatnonzero(region[edges].any(axis=1))


def limbs_apart(skeleton: Skeleton) -> Pose:
    """Arms 77° above the horizontal with the collar bones level, legs 45° to the sides."""
    rotations = np.tile(np.eye(3), (len(BONES), 1, 1))
    tails = skeleton.tails()
    for side, out in (("Left", 1.0), ("Right", -1.0)):
        wanted = {
            "Shoulder": (out, 0.0, 0.0), "Arm": (out * np.cos(_RAISED), 0.0, np.sin(_RAISED)),
            "UpLeg": (out * np.sin(_SPREAD), 0.0, -np.cos(_SPREAD)),
        }  # fmt: skip
        for name, direction in wanted.items():
            bone = BONES.index(side + name)
            along = tails[bone] - skeleton.joints[bone]
            rotations[bone] = shortest_turn(along, np.array(direction))
        for start, rest in (("Arm", ("ForeArm", "Hand")), ("UpLeg", ("Leg", "Foot", "ToeBase"))):
            for name in rest:
                rotations[BONES.index(side + name)] = rotations[BONES.index(side + start)]
    return Pose(rotations, np.zeros(3))


def make_harmonic(weights: np.ndarray, region: np.ndarray, edges: np.ndarray, stiffness: np.ndarray) -> None:
    """Replace ``weights`` (V, K) in ``region`` by what is in balance with the rest over edges of given stiffness."""
    inside = np.flatnonzero(region)
    place = np.full(len(region), -1)
    place[inside] = np.arange(len(inside))
    touching = region[edges].any(axis=1)
    edges, stiffness = edges[touching], stiffness[touching] / stiffness[touching].mean()
    free = region[edges].all(axis=1)
    held = np.where(region[edges[~free, :1]], edges[~free], edges[~free, ::-1])  # the free end first
    diagonal = np.bincount(place[held[:, 0]], stiffness[~free], len(inside)) + 1e-9
    known = np.zeros((len(inside), weights.shape[1]))
    np.add.at(known, place[held[:, 0]], stiffness[~free, None] * weights[held[:, 1]])
    used = np.flatnonzero(known.max(axis=0) > _LEAST)
    columns = place[edges[free]]
    roots = np.sqrt(stiffness[free])[:, None] * (1.0, -1.0)
    both = np.concatenate((columns, columns[:, ::-1]))
    both = both[np.argsort(both[:, 0], kind="stable")]
    order = elimination_order(np.searchsorted(both[:, 0], np.arange(len(inside) + 1)), both[:, 1])
    starts = np.arange(0, columns.size + 1, 2)
    found = solve_squares(starts, columns.ravel(), roots.ravel(), diagonal, known[:, used], order)
    found = np.maximum(found, 0.0)
    weights[inside] = 0.0
    weights[np.ix_(inside, used)] = found / np.maximum(found.sum(axis=1, keepdims=True), 1e-12)
