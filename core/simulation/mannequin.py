"""A shop-window mannequin, made by formulas: smooth-blended limbs in an A-pose, with painted clothes.

The shape is drawn at 1.70 m from eight-heads figure-drawing proportions, posed, meshed by
:func:`~.distance_field.surface`, painted, and scaled to the height asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..avatar.skeleton import BONES, ENDS, Skeleton
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..numeric.union_find import connected_labels
from .distance_field import LOFT, Primitives, Solid, frame_along, nearest_primitive, surface

DRAWN_HEIGHT = 1.70
_LIMITS = {
    "arm_angle_deg": (20.0, 78.0),
    "elbow_bend_deg": (0.0, 45.0),
    "leg_spread_deg": (3.0, 22.0),
    "girth": (0.8, 1.35),
    "shoulder_width": (0.88, 1.15),
    "hip_width": (0.88, 1.15),
    "head_turn_deg": (-45.0, 45.0),
    "bust": (0.0, 1.0),
    "arm_forward_deg": (-20.0, 80.0),
    "step_deg": (-20.0, 20.0),
}


@dataclass(frozen=True)
class Figure:
    """Proportions, pose and clothes of a mannequin. Left and right are the subject's.

    Parameters
    ----------
    arm_angle_deg : float
        Upper arms below the horizontal: 20 (almost a T) to 78 (hanging).
    elbow_bend_deg : float
        Forearms forward of the upper arms' line, 0 to 45.
    leg_spread_deg : float
        Each leg outward from the vertical, 3 to 22.
    girth : float
        Thickness of trunk and limbs at a given height, 0.8 to 1.35.
    shoulder_width, hip_width : float
        Relative breadth, 0.88 to 1.15.
    bust : float
        0 = flat chest, 1 = full.
    head_turn_deg : float
        Head about the vertical, positive to the subject's left, -45 to 45.
    arm_forward_deg : float
        Arms about the vertical through the shoulders, 0 = out to the sides, 80 = almost straight ahead; from -20.
    step_deg : float
        Left leg forward and right leg back from the vertical, both feet flat on the floor; negative the other way
        round, -20 to 20. The legs are drawn as much longer as keeps the hips at their height, 6 % at most.
    skin, hair, shirt, stripe, trousers, shoes : tuple of int
        sRGB.
    """

    arm_angle_deg: float = 45.0
    elbow_bend_deg: float = 10.0
    leg_spread_deg: float = 9.0
    girth: float = 1.0
    shoulder_width: float = 1.0
    hip_width: float = 1.0
    bust: float = 0.0
    head_turn_deg: float = 0.0
    arm_forward_deg: float = 0.0
    step_deg: float = 0.0
    skin: tuple[int, int, int] = (226, 178, 146)
    hair: tuple[int, int, int] = (74, 50, 36)
    shirt: tuple[int, int, int] = (46, 96, 168)
    stripe: tuple[int, int, int] = (244, 236, 214)
    trousers: tuple[int, int, int] = (70, 74, 86)
    shoes: tuple[int, int, int] = (158, 52, 44)

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise MirrorScanError(f"mannequin: {name} = {value} is not within {low:g} to {high:g}")
        for field in fields(self):
            if field.name not in _LIMITS:
                color = getattr(self, field.name)
                if len(color) != 3 or not all(0 <= c <= 255 for c in color):
                    raise MirrorScanError(f"mannequin: {field.name} = {color} is not three numbers from 0 to 255")


def random_figure(rng: np.random.Generator) -> Figure:
    """Someone else: proportions, pose and colours drawn within what people have."""

    def color(low, high):
        return tuple(int(c) for c in rng.integers(low, high, 3))

    red, green, blue = (int(c) for c in np.array([238, 196, 166]) * rng.uniform(0.42, 1.0))
    return Figure(
        arm_angle_deg=rng.uniform(35, 68), elbow_bend_deg=rng.uniform(0, 25), leg_spread_deg=rng.uniform(6, 14),
        girth=rng.uniform(0.88, 1.22), shoulder_width=rng.uniform(0.92, 1.08), hip_width=rng.uniform(0.92, 1.1),
        bust=float(rng.choice((0.0, rng.uniform(0.3, 1.0)))), head_turn_deg=rng.uniform(-20, 20),
        skin=(red, green, blue), hair=color(20, 120), shirt=color(40, 200), stripe=color(200, 256),
        trousers=color(30, 140), shoes=color(20, 180),
    )  # fmt: skip


def mannequin(
    height: float = 1.70, figure: Figure | None = None, resolution: float = 0.007, seed: int | None = None
) -> Mesh:
    """A closed, coloured body: one component, genus 0, 2-manifold.

    Parameters
    ----------
    height : float
        Sole to crown [m].
    figure : Figure or None
        Proportions, pose and clothes; None = the default, or drawn by ``seed`` when that is given.
    resolution : float
        Edge length of the triangles [m]; time and memory grow with its inverse square and cube. 7 mm gives about
        100 000 triangles.
    seed : int or None
        Draw a random figure.

    Returns
    -------
    Mesh
        Avatar frame [m]: Z up, facing -Y, soles on z = 0, +X is the subject's left. With ``colors``.

    Raises
    ------
    MirrorScanError
        When a number is out of its range, or limbs of this figure touch so that the body would have a handle.
    """
    return _made(height, figure, resolution, seed)[0]


def rigged_mannequin(
    height: float = 1.70, figure: Figure | None = None, resolution: float = 0.007, seed: int | None = None
) -> tuple[Mesh, Skeleton]:
    """:func:`mannequin`, and its skeleton where Mixamo's rig of MakeHuman would have it.

    The joints that the formulas turn about, moved by what that rig differs from them: its hips and shoulders lie
    further out and its ankles lower. The differences are the same for every figure, at 1.70 m: the mean of some figures
    to which a template with MakeHuman's joints had been fitted.
    """
    mesh, figure, low, scale = _made(height, figure, resolution, seed)
    drawn = _draw_skeleton(figure)
    place = np.diag((scale, scale, scale, 1.0))
    place[2, 3] = -low * scale
    return mesh, drawn.transformed(place)


def _made(
    height: float, figure: Figure | None, resolution: float, seed: int | None
) -> tuple[Mesh, Figure, float, float]:
    """The mannequin and its figure; the drawing's lowest point [m] and what its size was multiplied with after that."""
    if not 0.3 <= height <= 3.0:
        raise MirrorScanError(f"mannequin: height = {height} m is outside 0.3 to 3 m; give metres")
    scale = height / DRAWN_HEIGHT
    if not 0.002 <= resolution / scale <= 0.02:
        raise MirrorScanError(f"mannequin: resolution = {resolution} m must be between 2 and 20 mm at 1.70 m")
    if figure is None:
        figure = Figure() if seed is None else random_figure(np.random.default_rng(seed))
    solid = _draw(figure)
    primitives = solid.build()
    vertices, triangles = surface(primitives, resolution / scale)
    if euler_characteristic(len(vertices), triangles) != 2 or component_count(len(vertices), triangles) != 1:
        raise MirrorScanError(
            "mannequin: limbs touch, so the body has a handle; raise leg_spread_deg, lower arm_angle_deg or girth"
        )
    colors = _paint(figure, solid.names, primitives, vertices)
    low = float(vertices[:, 2].min())
    vertices[:, 2] -= low
    scale = height / vertices[:, 2].max()
    return Mesh(vertices * scale, triangles, colors), figure, low, float(scale)


def euler_characteristic(vertex_count: int, triangles: np.ndarray) -> int:
    """V - E + T; 2 for one closed surface without handles."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    return vertex_count - len(np.unique(edges[:, 0] * vertex_count + edges[:, 1])) + len(triangles)


def component_count(vertex_count: int, triangles: np.ndarray) -> int:
    """Connected components."""
    edges = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    return len(np.unique(connected_labels(edges[:, 0], edges[:, 1], vertex_count)))


def _rotation(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def _draw(f: Figure) -> Solid:
    solid = Solid()
    _trunk(solid, f)
    for side in (1, -1):
        _leg(solid, f, side)
        _arm(solid, f, side)
    first = len(solid)
    _head(solid)
    solid.rotate(first, _rotation(2, f.head_turn_deg), np.array([0.0, 0.01, 0.0]))
    return solid


def _trunk(solid: Solid, f: Figure) -> None:
    g, w, h = f.girth, f.shoulder_width, f.hip_width
    # height, half-width, depth to the front, depth to the back, spine forward (-) or back (+)
    rows = np.array([
        (0.800, 0.125 * h, 0.080, 0.090, 0.010), (0.850, 0.165 * h, 0.095, 0.105, 0.010),
        (0.900, 0.171 * h, 0.100, 0.108, 0.008), (0.960, 0.163 * h, 0.098, 0.098, 0.000),
        (1.020, 0.147 * h, 0.096, 0.082, -0.008), (1.080, 0.138, 0.096, 0.080, -0.010),
        (1.140, 0.143 * w, 0.098, 0.086, -0.006), (1.200, 0.155 * w, 0.104, 0.098, 0.000),
        (1.260, 0.166 * w, 0.108, 0.108, 0.004), (1.320, 0.170 * w, 0.102, 0.112, 0.010),
        (1.370, 0.162 * w, 0.086, 0.104, 0.016), (1.405, 0.135 * w, 0.068, 0.086, 0.020),
        (1.425, 0.098 * w, 0.054, 0.066, 0.020), (1.440, 0.056, 0.038, 0.042, 0.018),
    ])  # fmt: skip
    z = rows[:, 0]
    thick = 1 + (g - 1) * np.clip((1.44 - z) / 0.1, 0, 1)
    belly = 1 + 0.9 * max(g - 1, 0) * np.exp(-(((z - 1.04) / 0.13) ** 2))
    wide, front, back = rows[:, 1] * thick, rows[:, 2] * thick * belly, rows[:, 3] * thick
    stations = np.stack(((z - z[0]) / (z[-1] - z[0]), wide, wide, front, back, 0 * z, rows[:, 4]), axis=1)
    solid.loft("trunk", (0, 0, z[0]), (0, 0, z[-1]), stations, 0.02, (0.05, 0.05), 2.35, np.eye(3))
    neck = np.array([
        (0.0, 0.090, 0.090, 0.058, 0.066, 0, 0.004), (0.25, 0.066, 0.066, 0.055, 0.058, 0, 0.002),
        (0.5, 0.056, 0.056, 0.054, 0.054, 0, 0.0),
        (1.0, 0.055, 0.055, 0.056, 0.056, 0, 0.0),
    ])  # fmt: skip
    neck[:, 1:5] *= 1 + 0.5 * (g - 1)
    solid.loft("neck", (0, 0.022, 1.40), (0, 0.004, 1.54), neck, 0.02, (0.02, 0.02))
    for side in (1, -1):
        solid.capsule("trunk", (0.040, 0.022, 1.445), (0.150 * w, 0.018, 1.378), 0.026, 0.040, 0.07, side)
        solid.ellipsoid("trunk", (0.078 * w, -0.072 * g, 1.285), (0.078, 0.036, 0.062), 0.05, side=side)
        solid.ellipsoid("trunk", (0.085 * w, 0.085 * g, 1.300), (0.070, 0.034, 0.095), 0.05, side=side)
        solid.ellipsoid("trunk", (0.078 * h, 0.068 * g, 0.865), (0.080 * g, 0.066 * g, 0.080), 0.05, side=side)
        if f.bust > 0:
            size = 0.035 + 0.033 * f.bust
            solid.ellipsoid("trunk", (0.078, -0.084 * g, 1.255), (size * 1.05, size, size), 0.04, side=side)


def _leg_joints(f: Figure, side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hip, knee and ankle; the left ones, x mirrored for the right."""
    down = np.array([np.tan(np.radians(f.leg_spread_deg)), -np.tan(np.radians(side * f.step_deg)), -1.0])
    down /= np.linalg.norm(down)
    hip = np.array([0.088 * f.hip_width * (1 + 0.5 * (f.girth - 1)), 0.005, 0.875])
    length = (hip[2] - 0.085) / -down[2]
    return hip, hip + 0.49 * length * down - (0, 0.008, 0), hip + length * down + (0, 0.016, 0)


def _feet_ahead(f: Figure) -> tuple[np.ndarray, np.ndarray]:
    """Where the left foot points, and what is across it."""
    toes_out = _rotation(2, 7.0 + 0.5 * f.leg_spread_deg)
    return toes_out @ np.array([0.0, -1.0, 0.0]), toes_out @ np.array([1.0, 0.0, 0.0])


def _leg(solid: Solid, f: Figure, side: int) -> None:
    g = f.girth
    hip, knee, ankle = _leg_joints(f, side)
    thigh = np.array([
        (0.00, 0.080, 0.080, 0.084, 0.088, 0, 0.002), (0.25, 0.083, 0.088, 0.088, 0.084, 0, 0.0),
        (0.50, 0.074, 0.072, 0.080, 0.074, 0, -0.002), (0.75, 0.063, 0.062, 0.067, 0.062, 0, 0.0),
        (0.92, 0.056, 0.056, 0.059, 0.056, 0, 0.0), (1.00, 0.048, 0.047, 0.050, 0.048, 0, 0.0),
    ])  # fmt: skip
    calf = np.array([
        (0.00, 0.047, 0.046, 0.048, 0.048, 0, 0.0), (0.12, 0.052, 0.052, 0.050, 0.058, 0, 0.002),
        (0.30, 0.056, 0.054, 0.047, 0.067, 0, 0.004), (0.50, 0.051, 0.048, 0.043, 0.060, 0, 0.004),
        (0.72, 0.042, 0.040, 0.039, 0.046, 0, 0.002), (0.90, 0.037, 0.037, 0.038, 0.041, 0, 0.0),
        (1.00, 0.037, 0.037, 0.040, 0.042, 0, 0.0),
    ])  # fmt: skip
    thigh[:, 1:5] *= g * (1 - 0.06 * np.abs(g - 1))
    calf[:, 1:5] *= 1 + 0.75 * (g - 1)
    solid.loft("thigh", hip, knee, thigh, 0.035, (0.06, 0.03), 2.0, side=side)
    solid.loft("calf", knee, ankle, calf, 0.02, (0.03, 0.03), 2.0, side=side)
    solid.ellipsoid("thigh", knee + (0, -0.036 * g, 0.008), (0.032, 0.022, 0.040), 0.04, side=side)
    ahead, across = _feet_ahead(f)
    heel = np.array([ankle[0], ankle[1], 0.018]) - 0.034 * ahead
    # position heel to toe, half-width outside and inside, below, above; the sole is cut flat at z = 0
    shoe = np.array([
        (0.00, 0.030, 0.030, 0.030, 0.052, 0.000, 0), (0.15, 0.036, 0.034, 0.030, 0.066, 0.000, 0),
        (0.35, 0.037, 0.033, 0.030, 0.068, 0.001, 0), (0.55, 0.044, 0.038, 0.030, 0.050, 0.002, 0),
        (0.75, 0.051, 0.045, 0.030, 0.037, 0.001, 0), (0.90, 0.046, 0.046, 0.030, 0.030, -0.003, 0),
        (1.00, 0.038, 0.042, 0.030, 0.026, -0.006, 0),
    ])  # fmt: skip
    solid.loft("shoe", heel, heel + 0.195 * ahead, shoe, 0.018, (0.026, 0.042), 2.3, (across, (0, 0, 1), ahead), side)


def _arm_axes(f: Figure) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of the left arm: along the upper arm, up, ahead, and along the forearm."""
    a, bend = np.radians(f.arm_angle_deg), np.radians(f.elbow_bend_deg)
    forward = _rotation(2, -f.arm_forward_deg)
    along = forward @ np.array([np.cos(a), 0.0, -np.sin(a)])
    up = forward @ np.array([np.sin(a), 0.0, np.cos(a)])
    ahead = forward @ np.array([0.0, -1.0, 0.0])
    return along, up, ahead, np.cos(bend) * along + np.sin(bend) * ahead


def _arm_joints(f: Figure) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shoulder, elbow and wrist; the left ones, x mirrored for the right."""
    along, _, _, forearm = _arm_axes(f)
    shoulder = np.array([0.172 * f.shoulder_width * (1 + 0.25 * (f.girth - 1)), 0.016, 1.375])
    return shoulder, shoulder + 0.272 * along, shoulder + 0.272 * along + 0.235 * forearm


def _arm(solid: Solid, f: Figure, side: int) -> None:
    g = 1 + 0.8 * (f.girth - 1)
    along, up, ahead, forearm = _arm_axes(f)
    bend = np.radians(f.elbow_bend_deg)
    shoulder, elbow, wrist = _arm_joints(f)
    upper = np.array([
        (0.0, 0.054, 0.048, 0.054, 0.052, 0, 0), (0.25, 0.051, 0.048, 0.050, 0.050, 0, 0),
        (0.55, 0.045, 0.045, 0.047, 0.047, 0, 0), (0.85, 0.039, 0.038, 0.040, 0.041, 0, 0),
        (1.0, 0.037, 0.037, 0.038, 0.040, 0, 0),
    ])  # fmt: skip
    lower = np.array([
        (0.0, 0.037, 0.037, 0.038, 0.039, 0, 0), (0.22, 0.041, 0.040, 0.043, 0.042, 0, 0),
        (0.5, 0.036, 0.036, 0.038, 0.037, 0, 0), (0.8, 0.026, 0.026, 0.031, 0.030, 0, 0),
        (1.0, 0.021, 0.021, 0.028, 0.028, 0, 0),
    ])  # fmt: skip
    upper[:, 1:5] *= g
    lower[:, 1:5] *= 1 + 0.6 * (g - 1)
    solid.loft("upper arm", shoulder, elbow, upper, 0.045, (0.05, 0.03), 2.0, side=side)
    deltoid = (0.062 * g, 0.058 * g, 0.060 * g)
    solid.ellipsoid("upper arm", shoulder + 0.03 * along + 0.006 * up, deltoid, 0.05, side=side)
    solid.loft("forearm", elbow, wrist, lower, 0.018, (0.03, 0.02), 2.0, side=side)
    # The hand lies in the plane of the forearm and the forward direction, thumb ahead, fingers a little curled inward.
    thumbward = np.cos(bend) * ahead - np.sin(bend) * along
    inward = np.cross(forearm, thumbward)
    inward *= -np.sign(inward @ up)
    palm = np.array([
        (0.0, 0.015, 0.015, 0.025, 0.025, 0, 0), (0.4, 0.017, 0.016, 0.037, 0.037, 0, 0),
        (1.0, 0.014, 0.013, 0.041, 0.040, 0, 0),
    ])  # fmt: skip
    axes = (frame_along(forearm)[0], -thumbward, forearm)
    solid.loft("hand", wrist, wrist + 0.095 * forearm, palm, 0.015, (0.02, 0.012), 2.4, axes, side)
    knuckles = wrist + 0.088 * forearm
    for across, reach in ((0.0275, 0.078), (0.0092, 0.088), (-0.0092, 0.083), (-0.0268, 0.066)):
        root = knuckles + across * thumbward
        middle = root + 0.52 * reach * (forearm + 0.10 * inward)
        tip = middle + 0.48 * reach * (forearm + 0.38 * inward)
        solid.capsule("hand", root, middle, 0.0118, 0.0112, 0.006, side)
        solid.capsule("hand", middle, tip, 0.0112, 0.0100, 0.005, side)
    base = wrist + 0.026 * forearm + 0.022 * thumbward + 0.004 * inward
    joint = base + 0.034 * forearm + 0.034 * thumbward + 0.010 * inward
    solid.capsule("hand", base, joint, 0.0170, 0.0130, 0.016, side)
    tip = joint + 0.036 * forearm + 0.010 * thumbward + 0.004 * inward
    solid.capsule("hand", joint, tip, 0.0130, 0.0100, 0.006, side)


def _head(solid: Solid) -> None:
    solid.ellipsoid("head", (0, 0.018, 1.606), (0.0745, 0.094, 0.088), 0.03)
    face = np.array([
        (0.00, 0.026, 0.026, 0.022, 0.030, 0, -0.062), (0.12, 0.040, 0.040, 0.040, 0.050, 0, -0.045),
        (0.28, 0.053, 0.053, 0.058, 0.060, 0, -0.028), (0.50, 0.0625, 0.0625, 0.072, 0.07, 0, -0.016),
        (0.75, 0.0665, 0.0665, 0.078, 0.08, 0, -0.012), (1.00, 0.0680, 0.0680, 0.078, 0.08, 0, -0.012),
    ])  # fmt: skip
    solid.loft("head", (0, 0, 1.478), (0, 0, 1.628), face, 0.018, (0.010, 0.05), 2.25, np.eye(3))
    solid.ellipsoid("head", (0, -0.076, 1.488), (0.021, 0.016, 0.014), 0.02)
    solid.ellipsoid("head", (0, -0.070, 1.617), (0.050, 0.023, 0.012), 0.018)
    for side in (1, -1):
        solid.ellipsoid("head", (0.038, -0.062, 1.560), (0.022, 0.022, 0.018), 0.02, side=side)
        solid.ellipsoid("head", (0.0300, -0.098, 1.594), (0.0175, 0.0150, 0.0105), -0.012, side=side)
        solid.ellipsoid("eye", (0.0305, -0.0765, 1.594), (0.0150, 0.0125, 0.0095), 0.003, side=side)
    solid.capsule("head", (0, -0.088, 1.606), (0, -0.108, 1.560), 0.0070, 0.0105, 0.012)
    for side in (1, -1):
        solid.ellipsoid("head", (0.0105, -0.0955, 1.5575), (0.0080, 0.0100, 0.0075), 0.008, side=side)
    solid.ellipsoid("head", (0, -0.087, 1.5335), (0.0240, 0.0110, 0.0062), 0.007)
    solid.ellipsoid("head", (0, -0.0850, 1.5215), (0.0200, 0.0110, 0.0068), 0.007)
    for side in (1, -1):
        ear = _rotation(0, -12.0) @ _rotation(2, 22.0)
        solid.ellipsoid("ear", (0.0745, 0.014, 1.580), (0.0085, 0.0185, 0.0315), 0.008, ear.T, side)
    solid.ellipsoid("hair", (0, 0.026, 1.622), (0.0800, 0.0950, 0.0860), 0.006)
    solid.ellipsoid("hair", (0, 0.050, 1.572), (0.0690, 0.0640, 0.0740), 0.010)


def _draw_skeleton(f: Figure) -> Skeleton:
    at: dict[str, np.ndarray] = {}
    ahead, _ = _feet_ahead(f)
    for name, side in (("Left", 1), ("Right", -1)):
        hip, knee, ankle = _leg_joints(f, side)
        shoulder, elbow, wrist = _arm_joints(f)
        heel = np.array([ankle[0], ankle[1], 0.0]) - 0.034 * ahead
        limb = {
            "UpLeg": hip + (0.017, 0.024, -0.011), "Leg": knee + (0.006, 0.0, -0.016),
            "Foot": ankle + (-0.006, -0.007, -0.021), "ToeBase": heel + 0.177 * ahead + (0.0, 0.0, 0.030),
            "Toe_End": heel + 0.228 * ahead + (0.0, 0.0, 0.020),
            "Shoulder": np.array([0.38 * shoulder[0], 0.018, 1.420]), "Arm": shoulder + (0.020, -0.008, -0.004),
            "ForeArm": elbow + (0.0, 0.004, -0.002), "Hand": wrist,
            "Hand_End": wrist + 0.180 * _arm_axes(f)[3],
        }  # fmt: skip
        at |= {name + part: joint * (side, 1.0, 1.0) for part, joint in limb.items()}
    middle = {"Hips": (0.019, 0.910), "Spine": (0.003, 1.020), "Spine1": (0.016, 1.133), "Spine2": (0.053, 1.263),
              "Neck": (0.028, 1.450), "Head": (0.018, 1.501), "HeadTop_End": (0.010, 1.700)}  # fmt: skip
    at |= {name: np.array([0.0, y, z]) for name, (y, z) in middle.items()}
    return Skeleton(np.array([at[name] for name in BONES]), np.array([at[name] for name in ENDS]), np.ones(len(BONES)))


_SEGMENTS = {"2": "abged", "3": "abgcd", "4": "fgbc"}


def _digit(text: str, x: np.ndarray, z: np.ndarray, size: float) -> np.ndarray:
    """True where (x, z) lies on the strokes of a seven-segment digit of height ``size`` about the origin."""
    h, w, t = size / 2, size * 0.28, size * 0.075
    bars = {
        "a": (0, h, w + t, t), "g": (0, 0, w + t, t), "d": (0, -h, w + t, t), "b": (w, h / 2, t, h / 2),
        "c": (w, -h / 2, t, h / 2), "f": (-w, h / 2, t, h / 2), "e": (-w, -h / 2, t, h / 2),
    }  # fmt: skip
    on = np.zeros(x.shape, dtype=bool)
    for segment in _SEGMENTS[text]:
        cx, cz, half_x, half_z = bars[segment]
        on |= (np.abs(x - cx) < half_x) & (np.abs(z - cz) < half_z)
    return on


def _paint(f: Figure, names: list[str], primitives: Primitives, points: np.ndarray) -> np.ndarray:
    owner, local = nearest_primitive(primitives, points)
    name = np.array(names)[owner]
    left = points[:, 0] > 0
    x, y, z = points.T
    length = primitives.size[owner, 0]
    colors = np.empty((len(points), 3))
    colors[:] = f.skin

    def fill(where, color):
        colors[where] = color

    trunk, upper = name == "trunk", name == "upper arm"
    lofts = primitives.kind[owner] == LOFT
    sleeve = upper & (~lofts | (local[:, 2] < 0.56 * length))
    shirt = (trunk & (z > 0.965)) | sleeve
    collar = (x / 0.085) ** 2 + ((y - 0.018) / 0.078) ** 2 + ((z - 1.475) / 0.062) ** 2 < 1
    shirt &= ~collar
    fill(shirt, f.shirt)
    fill(shirt & (z < 0.985), np.multiply(f.shirt, 0.6))
    front, back = shirt & trunk & (y < 0.0), shirt & trunk & (y > 0.02)
    fill(front & (np.abs(z - 1.145) < 0.026), f.stripe)
    fill(front & (np.abs(z - 1.095) < 0.008), f.stripe)
    fill(front & _digit("3", x, z - 1.27, 0.105), f.stripe)
    # On the back x runs the other way for the viewer.
    fill(back & (_digit("2", -x + 0.062, z - 1.24, 0.19) | _digit("4", -x - 0.062, z - 1.24, 0.19)), f.stripe)
    cuff = sleeve & lofts & (local[:, 2] > 0.48 * length)
    fill(cuff & left, (60, 190, 110))
    fill(cuff & ~left, (225, 70, 60))

    legs = (name == "thigh") | (name == "calf") | (trunk & (z <= 0.965))
    fill(legs, f.trousers)
    fill(legs & (z > 0.935), (52, 36, 26))
    outside = local[:, 0] * np.sign(x) * np.sign(primitives.axes[owner, 0, 0]) > 0
    seam = legs & lofts & ~trunk & (np.abs(local[:, 1]) < 0.011) & outside
    fill(seam & left, (60, 190, 110))
    fill(seam & ~left, (225, 70, 60))
    fill(trunk & (y < 0) & (np.abs(x) < 0.022) & (np.abs(z - 0.95) < 0.014), (200, 178, 90))
    shoe = (name == "shoe") | ((name == "calf") & (z < 0.075))
    fill(shoe, f.shoes)
    fill(shoe & (z < 0.020), (235, 232, 224))
    fill((name == "shoe") & (local[:, 2] > 0.185), (235, 232, 224))

    turn = np.radians(f.head_turn_deg)
    hx = np.cos(turn) * x + np.sin(turn) * (y - 0.01)
    hy = -np.sin(turn) * x + np.cos(turn) * (y - 0.01) + 0.01
    head = np.isin(name, ("head", "eye"))
    fill(name == "hair", f.hair)
    face = head & (hy < -0.03)
    dx = np.abs(hx) - 0.0305
    fill(face & (np.abs(hx) < 0.026) & (np.abs(z - 1.5275) < 0.0085 - 0.12 * np.abs(hx)), (178, 84, 80))
    brow = (np.abs(z - 1.6175 + 4.0 * (dx - 0.002) ** 2) < 0.0042) & (np.abs(dx - 0.001) < 0.019)
    fill(face & brow, np.multiply(f.hair, 0.8))
    eye = face & ((dx / 0.0150) ** 2 + ((z - 1.5935) / 0.0066) ** 2 < 1)
    fill(eye, (246, 244, 240))
    fill(eye & (dx**2 + (z - 1.594) ** 2 < 0.0060**2), (40, 60, 70))
    ear = name == "ear"
    fill(ear, np.multiply(f.skin, (0.96, 0.86, 0.84)))
    return np.clip(np.rint(colors), 0, 255).astype(np.uint8)
