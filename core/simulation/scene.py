"""What stands where: camera, framed mirrors, floor and walls, in the avatar frame (Z up, metres)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics
from ..errors import MirrorScanError
from .optics import EFFECTS, IDEAL, Optics, real
from .sensors import COLOR_CAMERAS, find_sensor

BACKING = 0.02
"""Thickness of a mirror's board behind the glass [m]."""
GLASS_INDEX = 1.52
"""Refractive index of float glass."""


@dataclass(frozen=True)
class FramedMirror:
    """A rectangular mirror in a frame.

    Parameters
    ----------
    name : str
        For picks and reports.
    centre, normal : tuple of float
        Centre of the glass [m] and where the glass looks, avatar frame; any length.
    up : tuple of float
        Which way the mirror's height runs; made perpendicular to ``normal``.
    width, height : float
        Of the glass [m].
    frame_width : float
        Of the moulding around it [m]; 0 = frameless.
    frame_depth : float
        How far the moulding projects in front of the glass [m].
    reflectivity : float
        Share of a depth camera's light that one reflection gives back, .7 to .95 over glass in the near infrared. It
        shows in what :class:`~.optics.Optics` turns on.
    sag : tuple of float
        How far the middle stands in front of the edges [m], across the width and along the height: the glass is bowed
        like a parabola, and the frame bends with it. ``centre`` and ``normal`` are its mean plane; negative = hollow.
    glass_thickness : float
        Of the glass before the silver [m]; 0 = a front surface mirror. ``centre`` lies on the front.
    tint : tuple of float
        By how much one reflection is redder, greener and bluer than that of a plain mirror (:data:`.rays.SILVER`):
        gains of linear light. It shows in colour alone.
    """

    name: str
    centre: tuple[float, float, float]
    normal: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    width: float = 0.8
    height: float = 1.75
    frame_width: float = 0.035
    frame_depth: float = 0.0
    reflectivity: float = 0.85
    sag: tuple[float, float] = (0.0, 0.0)
    glass_thickness: float = 0.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        sizes = (self.width, self.height, self.frame_width, self.frame_depth)
        finite = np.isfinite((*self.centre, *self.normal, *self.up, *sizes)).all()
        if not finite or min(sizes[:2]) <= 0 or min(sizes[2:]) < 0:
            raise MirrorScanError(f"rig: mirror '{self.name}' has a size or place that is no positive, finite number")
        if not 0.0 < self.reflectivity <= 1.0:
            raise MirrorScanError(
                f"rig: mirror '{self.name}' has a reflectivity of {self.reflectivity}; give a share from 0 to 1"
            )
        if not (np.abs(self.sag) <= 0.05 * np.array((self.width, self.height))).all():
            raise MirrorScanError(
                f"rig: mirror '{self.name}' has a sag of {self.sag} m; at most a twentieth of its size"
            )
        if not 0.0 <= self.glass_thickness <= BACKING / 2:
            raise MirrorScanError(
                f"rig: mirror '{self.name}' has glass of {self.glass_thickness} m; give 0 to {BACKING / 2:g} m"
            )
        if not all(0.0 < gain <= 2.0 for gain in self.tint):
            raise MirrorScanError(f"rig: mirror '{self.name}' has a tint of {self.tint}; give gains from 0 to 2")
        lengths = np.linalg.norm(self.up) * np.linalg.norm(self.normal)
        if np.linalg.norm(np.cross(self.up, self.normal)) <= 1e-6 * lengths:
            raise MirrorScanError(f"rig: mirror '{self.name}': up and normal are parallel or zero; change one of them")

    @property
    def axes(self) -> np.ndarray:
        """Rows: right (seen from behind the glass), up, normal; unit vectors, avatar frame (3, 3)."""
        normal = np.array(self.normal, dtype=float) / np.linalg.norm(self.normal)
        up = np.array(self.up, dtype=float)
        up -= (up @ normal) * normal
        up /= np.linalg.norm(up)
        return np.array([np.cross(up, normal), up, normal])


def bow(mirror: FramedMirror, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """How far the glass stands in front of its mean plane at x (right) and y (up) of its centre [m]."""
    across, along = 2.0 * x / mirror.width, 2.0 * y / mirror.height
    return mirror.sag[0] * (1.0 / 3.0 - across**2) + mirror.sag[1] * (1.0 / 3.0 - along**2)


def apparent_depth(thickness: float, cosine: np.ndarray) -> np.ndarray:
    """How far behind the front of the glass the thin mirror lies that sends rays the same way.

    ``t cos θ / √(n² - sin² θ)``, for rays that meet the glass at θ, by Snell's law.
    """
    return thickness * cosine / np.sqrt(GLASS_INDEX**2 - 1.0 + cosine**2)


def glass_delay(thickness: float, cosine: np.ndarray) -> np.ndarray:
    """By how much one crossing (in, to the silver, out) is longer for light than by that thin mirror [m].

    ``2 t (n - 1/n) / cos θ'``, θ' within the glass.
    """
    return 2.0 * thickness * (GLASS_INDEX - 1.0 / GLASS_INDEX) / np.sqrt(1.0 - (1.0 - cosine**2) / GLASS_INDEX**2)


def apparent_plane(mirror: FramedMirror, eye: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Point and unit normal of the plane that is nearest to where the glass appears to reflect, seen from ``eye``.

    That is the mean plane of bowed glass, and lies within the glass of a mirror that is silvered on its back.
    """
    right, up, normal = mirror.axes
    centre = np.array(mirror.centre, dtype=float)
    if mirror.sag == (0.0, 0.0) and mirror.glass_thickness == 0.0:
        return centre, normal
    x, y = (a.ravel() for a in np.meshgrid(*(np.linspace(-0.5, 0.5, 41) * s for s in (mirror.width, mirror.height))))
    away = np.array(eye) - centre - x[:, None] * right - y[:, None] * up
    cosine = np.clip((away @ normal) / np.linalg.norm(away, axis=1), 0.0, 1.0)
    z = bow(mirror, x, y) - apparent_depth(mirror.glass_thickness, cosine)
    # x and y are symmetrical about the centre, so the plane's three numbers are independent.
    tilt = -(x @ z / (x @ x)) * right - (y @ z / (y @ y)) * up + normal
    return centre + z.mean() * normal, tilt / np.linalg.norm(tilt)


@dataclass(frozen=True)
class Rig:
    """Everything a virtual snapshot depends on, except the subject.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the depth map, and of a colour image of its size.
    camera : tuple of float
        Where the camera is, avatar frame [m]. Untilted it looks along +Y, level.
    mirrors : tuple of FramedMirror
        Any number, in any pose.
    pan_deg, tilt_deg, roll_deg : float
        Rotation of the camera to its right, down, and clockwise about its own axis.
    floor : bool
        A floor at z = 0.
    room : tuple of float or None
        Walls at x0, x1, y0, y1 and a ceiling at z1 [m]; None = open space.
    sensor : str
        A name of :data:`~.noise_models.SENSORS`.
    frames : int
        Depth frames of the burst.
    seed : int
        Of all noise; same seed, same bytes.
    interference : bool or None
        Readings are lost where the sensor's pattern arrives by two ways; None = as the sensor is.
    optics : Optics
        What light, glass and surfaces do besides; :data:`~.optics.IDEAL` = nothing.
    color_scale : int
        The colour image is this many times as wide and high as the depth map and shows the same field.
    color_intrinsics : Intrinsics or None
        Of the colour image, a pinhole; None = by ``color_scale``.
    color_offset : tuple of float
        Where the colour camera is in the depth camera's frame [m].
    color_tilt_deg : float
        By how much it looks further down than the depth camera.
    color_samples : int
        Rays along each side of a pixel of the colour image, whose mean it is: a camera's pixel gathers light from all
        of its area, which matters where a pattern is finer than that.
    """

    intrinsics: Intrinsics
    camera: tuple[float, float, float]
    mirrors: tuple[FramedMirror, ...]
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    floor: bool = True
    room: tuple[float, float, float, float, float] | None = (-3.2, 3.2, -4.5, 2.8, 2.8)
    sensor: str = "azure_kinect"
    frames: int = 10
    seed: int = 0
    interference: bool | None = None
    optics: Optics = IDEAL
    color_scale: int = 1
    color_intrinsics: Intrinsics | None = None
    color_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    color_tilt_deg: float = 0.0
    color_samples: int = 1

    def __post_init__(self) -> None:
        find_sensor(self.sensor)
        if self.frames < 1:
            raise MirrorScanError(f"rig: frames = {self.frames}; at least one is needed")
        if self.floor and self.camera[2] <= 0:
            raise MirrorScanError(f"rig: the camera is {-self.camera[2]:g} m under the floor; raise it")
        if self.room is not None:
            x0, x1, y0, y1, z1 = self.room
            if not (x0 < self.camera[0] < x1 and y0 < self.camera[1] < y1 and self.camera[2] < z1):
                raise MirrorScanError("rig: the camera stands outside the room; enlarge the room or move the camera")
        if not 1 <= self.color_scale <= 16 or self.color_scale != int(self.color_scale):
            raise MirrorScanError(f"rig: color_scale = {self.color_scale}; give a whole number from 1 to 16")
        if not 1 <= self.color_samples <= 8 or self.color_samples != int(self.color_samples):
            raise MirrorScanError(f"rig: color_samples = {self.color_samples}; give a whole number from 1 to 8")
        if self.color_intrinsics is not None and not self.color_intrinsics.is_pinhole:
            raise MirrorScanError("rig: the virtual colour camera is a pinhole; leave its distortion out")
        if not np.isfinite((*self.color_offset, self.color_tilt_deg)).all() or np.abs(self.color_offset).max() > 1.0:
            raise MirrorScanError("rig: the colour camera is not within 1 m of the depth camera; move it nearer")

    @property
    def camera_to_avatar(self) -> np.ndarray:
        """(4, 4); camera frame x right, y down, z forward."""
        matrix = np.eye(4)
        looking = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        matrix[:3, :3] = _turn(2, -self.pan_deg) @ _turn(0, -self.tilt_deg) @ looking @ _turn(2, self.roll_deg)
        matrix[:3, 3] = self.camera
        return matrix

    @property
    def color_camera(self) -> Intrinsics:
        """Intrinsics of the colour image."""
        if self.color_intrinsics is not None:
            return self.color_intrinsics
        depth = self.intrinsics
        return depth if self.color_scale == 1 else depth.scaled(
            self.color_scale * depth.width, self.color_scale * depth.height
        )  # fmt: skip

    @property
    def depth_to_color(self) -> np.ndarray:
        """(4, 4); takes points of the depth camera's frame [m] into the colour camera's."""
        color_to_depth = np.eye(4)
        color_to_depth[:3, :3] = _turn(0, -self.color_tilt_deg)
        color_to_depth[:3, 3] = self.color_offset
        return np.linalg.inv(color_to_depth)

    @property
    def seen_by_color(self) -> Rig:
        """The same scene, seen by the colour camera: its intrinsics and its place take the depth camera's."""
        beside = replace(
            self, intrinsics=self.color_camera, color_intrinsics=None, color_scale=1, color_offset=(0.0, 0.0, 0.0),
            color_tilt_deg=0.0,
        )  # fmt: skip
        if self.color_offset == (0.0, 0.0, 0.0) and self.color_tilt_deg == 0.0:
            return beside
        pose = self.camera_to_avatar @ np.linalg.inv(self.depth_to_color)
        ahead = pose[:3, 2]
        pan, tilt = np.degrees((np.arctan2(ahead[0], ahead[1]), np.arcsin(np.clip(-ahead[2], -1.0, 1.0))))
        level = replace(beside, pan_deg=float(pan), tilt_deg=float(tilt), roll_deg=0.0).camera_to_avatar
        rolled = level[:3, :3].T @ pose[:3, :3]
        roll = np.degrees(np.arctan2(rolled[1, 0], rolled[0, 0]))
        x, y, z = (float(value) for value in pose[:3, 3])
        return replace(beside, camera=(x, y, z), pan_deg=float(pan), tilt_deg=float(tilt), roll_deg=float(roll))


def with_own_color_camera(rig: Rig) -> Rig:
    """The rig with the colour camera that its sensor has, in its place (:data:`.sensors.COLOR_CAMERAS`).

    Raises
    ------
    MirrorScanError
        When the sensor has none.
    """
    if rig.sensor not in COLOR_CAMERAS:
        raise MirrorScanError(f"rig: the sensor '{rig.sensor}' has no colour camera of its own; give a color_scale")
    camera = COLOR_CAMERAS[rig.sensor]
    return replace(
        rig, color_intrinsics=camera.intrinsics, color_offset=camera.offset, color_tilt_deg=camera.tilt_deg
    )  # fmt: skip


def room_waves(rig: Rig) -> np.ndarray:
    """What makes floor and walls uneven, as sums of sines (K, 5).

    Wave numbers along the two directions of the surface [rad/m], phase, and heights on the floor and on walls [m].
    """
    if rig.optics.uneven_floor == 0.0 and rig.optics.uneven_walls == 0.0:
        return np.zeros((0, 5))
    rng = np.random.default_rng([rig.seed, 1])
    length = np.array([0.7, 1.1, 1.7, 2.6, 4.0])
    bearing, phase = rng.uniform(0, 2 * np.pi, (2, len(length)))
    # Longer waves are higher; together they rise and fall by about the height asked for.
    share = length**0.5 / np.linalg.norm(length**0.5)
    turns = 2 * np.pi / length
    heights = (rig.optics.uneven_floor * share, rig.optics.uneven_walls * share)
    return np.column_stack((turns * np.cos(bearing), turns * np.sin(bearing), phase, *heights))


def with_real_optics(
    rig: Rig, frequencies: tuple[float, ...] | None = None, effects: Collection[str] = tuple(EFFECTS)
) -> Rig:
    """The rig with everything that applies to its sensor, and with mirrors as they are sold.

    Glass of 4 to 6 mm that gives back 75 to 93 %, its middle up to 2.5 mm in front of or behind the edges of a glass
    1.75 m high (in proportion to the square of its height), all drawn by the rig's seed.

    Parameters
    ----------
    rig : Rig
    frequencies, effects
        See :func:`.optics.real`; ``glass`` and ``bow`` are about the mirrors. What is left out changes nothing else.
    """
    rng = np.random.default_rng([rig.seed, 2])
    mirrors = []
    for mirror in rig.mirrors:
        reflectivity, thickness = rng.uniform((0.75, 0.004), (0.93, 0.006))
        across, along = rng.uniform(-1, 1, 2) * (0.0015, 0.0025) * (np.array((mirror.width, mirror.height)) / 1.75) ** 2
        made = replace(mirror, reflectivity=float(reflectivity))
        if "glass" in effects:
            made = replace(made, glass_thickness=float(thickness))
        if "bow" in effects:
            made = replace(made, sag=(float(across), float(along)))
        mirrors.append(made)
    return replace(rig, mirrors=tuple(mirrors), optics=real(rig.sensor, frequencies, rig.seed, effects))


def _turn(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def default_rig(
    sensor: str = "azure_kinect",
    subject_distance: float = 2.5,
    view_angle_deg: float = 120.0,
    mirrors: int | Sequence[float] = 2,
    path_length: float = 4.6,
    mirror_size: tuple[float, float] = (0.8, 1.75),
    frame_width: float = 0.035,
    frame_depth: float = 0.0,
    lean_deg: float | Sequence[float] = 0.0,
    camera_height: float = 0.9,
    tilt_deg: float = 2.3,
    roll_deg: float = 0.0,
    frames: int = 10,
    seed: int = 0,
    interference: bool | None = None,
    optics: Optics = IDEAL,
    color_scale: int = 1,
) -> Rig:
    """The paper's arrangement: camera in front of the subject, mirrors behind it on either side.

    Each mirror stands so that the subject's axis appears in its middle, seen by a virtual camera ``view_angle_deg``
    around the subject and ``path_length`` away along the folded path.

    Parameters
    ----------
    sensor : str
        A name of :data:`~.noise_models.SENSORS`.
    subject_distance : float
        Camera to subject [m].
    view_angle_deg : float
        Virtual cameras at plus and minus this angle around the subject, 90 < angle < 180.
    mirrors : int or sequence of float
        How many: 1, 2, or more spread evenly from one side round the back to the other (those right behind the
        subject are hidden by it); or the virtual cameras' angles themselves, positive = mirror on the image's right.
    path_length : float
        Camera to mirror to subject [m].
    mirror_size : tuple of float
        Width and height of the glass [m]; it stands 0.12 m above the floor.
    frame_width, frame_depth : float
        See :class:`FramedMirror`.
    lean_deg : float or sequence of float
        Each mirror's top towards the subject.
    camera_height, tilt_deg, roll_deg, frames, seed, interference, optics, color_scale
        See :class:`Rig`.

    Raises
    ------
    MirrorScanError
        When a number is outside its range.
    """
    if isinstance(mirrors, int):
        if mirrors < 0:
            raise MirrorScanError(f"rig: mirrors = {mirrors}; give 0 or more")
        spread = [view_angle_deg] if mirrors == 1 else np.linspace(view_angle_deg, 360.0 - view_angle_deg, mirrors)
        angles = [a if a <= 180 else a - 360 for a in spread] if mirrors else []
    else:
        angles = list(mirrors)
    leans = np.broadcast_to(lean_deg, len(angles))
    camera = np.array([0.0, -subject_distance, camera_height])
    framed: list[FramedMirror] = []
    for angle, lean in zip(angles, leans, strict=True):
        if not 60.0 < abs(angle) <= 180.0 or path_length <= subject_distance:
            raise MirrorScanError(
                f"rig: no mirror gives a view at {angle:g}° over {path_length:g} m; use 60° to 180° and a path "
                f"longer than the subject's distance, {subject_distance:g} m"
            )
        a = np.radians(angle)
        virtual = path_length * np.array([np.sin(a), -np.cos(a)])
        normal = (camera[:2] - virtual) / np.linalg.norm(camera[:2] - virtual)
        reach = ((camera[:2] + virtual) / 2) @ normal / (virtual @ normal)
        side = "right" if angle > 0 else "left"
        taken = sum(m.name.split()[0] == side for m in framed)
        framed.append(
            FramedMirror(
                name=side if not taken else f"{side} {taken + 1}",
                centre=(*(reach * virtual), 0.12 + mirror_size[1] / 2),
                normal=(*(normal * np.cos(np.radians(lean))), -np.sin(np.radians(lean))),
                width=mirror_size[0], height=mirror_size[1], frame_width=frame_width, frame_depth=frame_depth,
            )
        )  # fmt: skip
    xs = [abs(m.centre[0]) + 1.2 for m in framed] + [3.2]
    ys = [m.centre[1] + 1.0 for m in framed] + [2.8]
    room = (-max(xs), max(xs), -subject_distance - 2.0, max(ys), 2.8)
    return Rig(
        find_sensor(sensor).intrinsics, tuple(camera), tuple(framed), tilt_deg=tilt_deg, roll_deg=roll_deg, room=room,
        sensor=sensor, frames=frames, seed=seed, interference=interference, optics=optics, color_scale=color_scale,
    )  # fmt: skip
