"""Garments from a body itself: T-shirt, trousers and skirt, with weights and pins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..avatar.garment import Garment
from ..avatar.pose import Pose, SkinWeights, bone_matrices, posed_skeleton, skinned
from ..avatar.skeleton import BONES, Skeleton
from ..avatar.skin_weights import strongest
from ..avatar.weight_fields import body_size
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.half_edges import open_edges
from ..mesh.submesh import keep_triangles, triangle_components
from ..numeric.rotations import unit
from .body_distance import BodyDistance
from .cloth_mesh import pushed_out, relaxed, smoothed_where_crossing
from .dressing_pose import brought_back, dressing_pose
from .level_cut import cut_at_level, snapped
from .offset_surface import offset_surface
from .skirt_tube import skirt_tube
from .weight_transfer import at_skin, dense, held_near, transferred

KINDS = ("tshirt", "trousers", "skirt")
NAMES = {"tshirt": "T-Shirt", "trousers": "Trousers", "skirt": "Skirt"}
LAYER = 0.006
"""Each garment has so much more ease than the one that was put on before it [m]."""
DEFAULT_EASE, LEAST_EASE, MOST_EASE = 0.015, 0.002, 0.08
"""Distance from skin to cloth [m]."""

_COLORS = {"tshirt": (226, 224, 216), "trousers": (62, 76, 104), "skirt": (150, 62, 72)}  # sRGB
_USUAL_SIZE = 0.78  # body size of an adult, see body_size [m]
_SPACING = 0.0165  # of vertices, on an adult [m]
_CLOSING = 0.025  # creases narrower than a ball of that radius are bridged, on an adult [m]
_GAP, _LEAST_GAP = 0.4, 0.003  # from the skin at rest: a share of the ease, and at least so much [m]
_NECK = 0.2  # where the neckline's middle is at the lowest, from the joint Neck to the joint Head
_WIDEST_NECK = 1.3  # times the width where the neck is narrowest
_NECK_TILT = np.radians(28.0)  # the neckline is lower in front
_SLEEVE, _ANKLE = 0.62, 0.86  # where sleeves and trouser legs end, along upper arm and shin
_SKIRT = 0.94  # and the skirt, along the thighs
_LOOSER = {"tshirt": 0.8, "trousers": 0.5}  # ease at the hem is so much larger
_HEM = 0.055  # of the shirt, below the hip joints, on an adult [m]
_FLARE = 0.1  # of the skirt at its hem, of body size
_SNAP = 0.35  # vertices nearer to a cut than this share of the spacing are moved onto it
_RELAXING = 12  # rounds
_PINNED, _FREE = 0.03, 0.07  # from the edge that holds a garment: pinned so far, free from there on [m on an adult]
_ARMS = np.array([name.endswith(("Arm", "ForeArm", "Hand")) for name in BONES])
_HANDS = np.array([name.endswith(("ForeArm", "Hand")) for name in BONES])
_HEAD = np.array([name in ("Neck", "Head") for name in BONES])
_BESIDE = 1.0  # "far from the cut", for surface that a cut does not concern [m]


class _Plane(NamedTuple):
    """A plane that parts what a garment keeps (towards ``normal``) from what it does not, for some of the surface.

    ``bones`` (22,) bool: the plane counts where these bones hold most; all do where it is None.
    """

    point: np.ndarray
    normal: np.ndarray
    bones: np.ndarray | None = None


@dataclass(frozen=True)
class _Body:
    """A body in the pose it is dressed in.

    Parameters
    ----------
    mesh, skeleton
        In that pose.
    matrices : np.ndarray [shape=(22, 4, 4)]
        From rest to it.
    weights : np.ndarray [shape=(V, 22)]
    scale : float
        Its size, an adult's 1.
    """

    mesh: Mesh
    skeleton: Skeleton
    matrices: np.ndarray
    weights: np.ndarray
    scale: float

    def joint(self, name: str) -> np.ndarray:
        return self.skeleton.joints[BONES.index(name)]

    def tail(self, name: str) -> np.ndarray:
        return self.skeleton.tails()[BONES.index(name)]

    def along(self, name: str, share: float) -> np.ndarray:
        """A point of a bone."""
        return self.joint(name) + share * (self.tail(name) - self.joint(name))


def make_garment(
    mesh: Mesh, skeleton: Skeleton, weights: SkinWeights, kind: str, ease: float = DEFAULT_EASE, tight: bool = False
) -> Garment:
    """A garment cut to a body.

    T-shirt and trousers are parts of a surface at a distance around the body, whose creases are bridged; the skirt is
    a tube of convex sections. They are cut out in a pose without contacts and brought back to rest by their weights.

    Parameters
    ----------
    mesh : Mesh
        The body, closed, in the avatar frame and rest pose [m].
    skeleton, weights
        Of the body.
    kind : {"tshirt", "trousers", "skirt"}
    ease : float
        Distance from skin to cloth, 0.002 to 0.08; larger towards the hem unless ``tight`` [m].
    tight : bool
        For a piece that the skeleton alone shall move: nowhere wider than ``ease``.

    Returns
    -------
    Garment
        About 17 mm from vertex to vertex on an adult, on a child less.

    Raises
    ------
    MirrorScanError
        When there is no such kind, the ease is out of range, or the body is too damaged for a garment.
    """
    if kind not in KINDS:
        raise MirrorScanError(f"clothes: there is no “{kind}”; choose one of {', '.join(KINDS)}")
    if not LEAST_EASE <= ease <= MOST_EASE:
        raise MirrorScanError(
            f"clothes: an ease of {1000 * ease:g} mm is not possible; choose one from {1000 * LEAST_EASE:g} to "
            f"{1000 * MOST_EASE:g} mm"
        )
    body = _dressed_pose(mesh, skeleton, weights, legs_apart=kind == "trousers")
    if kind == "skirt":
        made, places, top = _skirt(body, ease, tight)
    else:
        made, places, top = _cut_out(body, kind, ease, tight)
    if len(made.triangles) < 50:
        raise MirrorScanError(
            f"clothes: the body leaves no room for a {NAMES[kind].lower()}; look at its skeleton", code="no_person"
        )
    return _finished(body, made, places, top, kind, ease, tight, mesh)


def _dressed_pose(mesh: Mesh, skeleton: Skeleton, weights: SkinWeights, legs_apart: bool) -> _Body:
    pose: Pose = dressing_pose(skeleton, legs_apart)
    matrices = bone_matrices(skeleton, pose)
    posed = Mesh(skinned(mesh.vertices, weights, matrices), mesh.triangles)
    scale = float(np.clip(body_size(skeleton) / _USUAL_SIZE, 0.3, 1.2))
    return _Body(posed, posed_skeleton(skeleton, pose), matrices, dense(weights), scale)


def _planes(body: _Body, kind: str) -> list[_Plane]:
    """What a T-shirt or trousers are cut out by; the first is the edge that holds the garment."""
    down = np.array([0.0, 0.0, -1.0])
    if kind == "trousers":
        found = [_Plane(body.joint("Spine"), down)]
        for side in ("Left", "Right"):
            legs = np.array([name in (f"{side}UpLeg", f"{side}Leg", f"{side}Foot", f"{side}ToeBase") for name in BONES])
            shin = unit(body.joint(f"{side}Leg") - body.joint(f"{side}Foot"))
            found.append(_Plane(body.along(f"{side}Leg", _ANKLE), shin, legs))
        return found
    tilted = np.array([0.0, np.sin(_NECK_TILT), -np.cos(_NECK_TILT)])
    found = [_Plane(body.along("Neck", _NECK), tilted, ~_ARMS)]
    for side in ("Left", "Right"):
        arm = np.array([name.startswith(side) for name in BONES]) & _ARMS
        inwards = unit(body.joint(f"{side}Arm") - body.joint(f"{side}ForeArm"))
        found.append(_Plane(body.along(f"{side}Arm", _SLEEVE), inwards, arm))
    hips = 0.5 * (body.joint("LeftUpLeg") + body.joint("RightUpLeg")) + _HEM * body.scale * down
    return [*found, _Plane(hips, -down, ~_ARMS)]


def _cut_out(body: _Body, kind: str, ease: float, tight: bool) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """A T-shirt or trousers, places (V, 2) of its vertices in an image, and points (K, 3) of the edge it hangs on."""
    spacing = _SPACING * body.scale
    easing = np.full(len(body.mesh.vertices), ease) if tight else ease * _looseness(body, kind)
    shell = offset_surface(body.mesh, easing, _CLOSING * body.scale, spacing)
    skin = BodyDistance(body.mesh)

    def held(vertices: np.ndarray) -> np.ndarray:
        return at_skin(body.weights, skin.triangles, skin.at(vertices))

    made, planes = shell, _planes(body, kind)
    if kind == "tshirt":
        planes[0] = _neckline(body, shell.vertices[held(shell.vertices)[:, _ARMS].sum(axis=1) < 0.5], planes[0])
    for plane in planes:
        values = (made.vertices - plane.point) @ plane.normal
        if plane.bones is not None:
            values = np.where(held(made.vertices)[:, plane.bones].sum(axis=1) > 0.5, values, _BESIDE)
        vertices, values = snapped(values, made, plane.normal, _SNAP * spacing)
        made = cut_at_level(Mesh(vertices, made.triangles), values)
        if not len(made.triangles):
            return made, np.zeros((0, 2)), np.zeros((0, 3))
    label, _ = triangle_components(made.triangles, len(made.vertices))
    made = keep_triangles(made, label == np.bincount(label).argmax())
    made = relaxed(made, shell, _RELAXING)
    return made, _front_and_back(made), _border_near(made, planes[0], spacing)


def _neckline(body: _Body, shell: np.ndarray, plane: _Plane) -> _Plane:
    """The lowest plane across the neck in which the surface (V, 3) around it is not yet as wide as the shoulders."""
    shares = np.arange(_NECK, 0.95, 0.1)
    widths = []
    for share in shares:
        way = shell - body.along("Neck", share)
        near = np.abs(way @ plane.normal) < 0.6 * _SPACING * body.scale
        widths.append(np.abs(way[near, 0]).max(initial=0.0))
    wide = np.array(widths)
    fits = wide <= _WIDEST_NECK * np.min(wide[wide > 0], initial=np.inf)
    return plane._replace(point=body.along("Neck", float(shares[fits.argmax()])))


def _looseness(body: _Body, kind: str) -> np.ndarray:
    """Share of the ease (V,) at a body's vertices: 1 at shoulders and waist, more towards the hem."""
    if kind == "tshirt":
        high, low = body.joint("Spine2")[2], body.joint("LeftUpLeg")[2]
    else:
        high, low = body.joint("LeftUpLeg")[2], body.joint("LeftFoot")[2]
    down = np.clip((high - body.mesh.vertices[:, 2]) / max(high - low, 1e-6), 0.0, 1.0)
    return 1.0 + _LOOSER[kind] * down


def _front_and_back(mesh: Mesh) -> np.ndarray:
    """Places (V, 2) in an image of metres: as seen from the front."""
    return mesh.vertices[:, (0, 2)]


def _border_near(mesh: Mesh, plane: _Plane, spacing: float) -> np.ndarray:
    """Vertices (K, 3) of the border that lie in a plane."""
    border = np.unique(open_edges(mesh.triangles, len(mesh.vertices))[:, :2])
    points = mesh.vertices[border]
    return points[np.abs((points - plane.point) @ plane.normal) < 0.5 * spacing]


def _skirt(body: _Body, ease: float, tight: bool) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """As :func:`_cut_out`, a skirt."""
    spacing = _SPACING * body.scale
    without_arms = body.weights[:, _ARMS].sum(axis=1)[body.mesh.triangles].max(axis=1) < 0.5
    trunk = keep_triangles(body.mesh, without_arms)
    top = body.joint("Spine")[2]
    bottom = 0.5 * (body.along("LeftUpLeg", _SKIRT)[2] + body.along("RightUpLeg", _SKIRT)[2])
    if top - bottom < 5 * spacing:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), np.zeros((0, 2)), np.zeros((0, 3))
    down = np.linspace(0.0, 1.0, round((top - bottom) / spacing) + 1)
    hips = (top - body.joint("LeftUpLeg")[2]) / (top - bottom)
    flare = 0.0 if tight else _FLARE * body_size(body.skeleton)
    easing = ease + flare * np.clip((down - 0.5 * hips) / (1.0 - 0.5 * hips), 0.0, 1.0)
    made, places = skirt_tube(trunk, top - down * (top - bottom), easing, spacing)
    return made, places, made.vertices[places[:, 1] == 0.0]


def _finished(
    body: _Body, made: Mesh, places: np.ndarray, top: np.ndarray, kind: str, ease: float, tight: bool, rest: Mesh
) -> Garment:
    """Weights, rest pose, distance from the skin, pins, colour."""
    gap = max(_GAP * ease, min(_LEAST_GAP, ease))
    limbs = body.weights[:, _HANDS if kind == "tshirt" else _ARMS].sum(axis=1)
    wearing = limbs[body.mesh.triangles].max(axis=1) < 0.5  # skin that the garment may lie on
    posed = BodyDistance(keep_triangles(body.mesh, wearing))
    made = pushed_out(made, posed, gap)
    skin = posed.at(made.vertices)
    known = at_skin(_kept(body.weights, body.mesh, wearing), posed.triangles, skin)
    weights = strongest(transferred(made, skin, known, smoothing=60 if kind == "skirt" else 6))
    made = replace(made, vertices=brought_back(made.vertices, weights, body.matrices))
    resting = BodyDistance(keep_triangles(Mesh(rest.vertices, rest.triangles), wearing))
    made = smoothed_where_crossing(pushed_out(made, resting, gap), resting, gap)
    pinned = np.zeros(len(made.vertices), np.float32)
    if len(top):
        # in the dressing pose, where the edge was found
        there = skinned(made.vertices, weights, body.matrices)
        pinned = held_near(there, top, _PINNED * body.scale, _FREE * body.scale)
    colors = np.tile(np.array(_COLORS[kind], np.uint8), (len(made.vertices), 1))
    made = replace(made, colors=colors)
    return Garment(NAMES[kind], made, weights, pinned, tight, _corners_in_image(made, places, kind))


def _kept(values: np.ndarray, mesh: Mesh, keep: np.ndarray) -> np.ndarray:
    """Values of the vertices that :func:`keep_triangles` keeps."""
    return values[np.unique(mesh.triangles[keep])]


def _corners_in_image(mesh: Mesh, places: np.ndarray, kind: str) -> np.ndarray:
    """Places (T, 3, 2) of the triangles' corners in the unit square: front left, back right; a skirt unrolled."""
    uv = places[mesh.triangles]
    if kind == "skirt":
        across = uv[..., 0]
        across = across + ((across.max(axis=1, keepdims=True) - across) > 0.5)  # over the seam at the back
        return np.stack((across, 1.0 - uv[..., 1]), axis=-1).astype(np.float32)
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    normal_y = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    low, size = places.min(axis=0), np.ptp(places, axis=0).max()
    uv = (uv - low) / (2.0 * size) * 0.98 + 0.005
    uv[normal_y < 0, :, 0] = 0.995 - uv[normal_y < 0, :, 0]
    return uv.astype(np.float32)
