"""A virtual snapshot with its truth: :func:`simulate`, and the RGB-D folder it makes: :func:`write_simulation`."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics, project
from ..camera.image_resampling import area_resampled
from ..capture import Capture, MirrorPicks
from ..capture.folders.lens_file import color_file
from ..capture.folders.rgbd_folder import COLOR_INTRINSIC_NAME
from ..capture.upright_grid import align
from ..errors import MirrorScanError, OutputError
from ..io import write_mesh
from ..io.images import write_png
from ..mesh import Mesh
from ..mesh.bvh import Bvh
from ..numeric.srgb import from_linear, to_linear
from .multipath import by_one_way, by_phase, by_pulse
from .rays import BODY, FRAME, Sight, lit, lit_by, look
from .returned_light import albedo, depth_warp, noise_gain, signal, skin_delay
from .scene import FramedMirror, Rig, apparent_plane
from .sensors import find_sensor, measure

Paint = Callable[[np.ndarray], np.ndarray]
"""Colours (N, 3) of points (N, 3); see :func:`simulate`."""
PICKS = 8
PICK_JITTER = 0.7
"""How far a click misses, each way [px]."""
INTERFERENCE_RATIO = 0.4
"""Light by other ways this strong, relative to the reading's own, spoils it.

It leaves the gaps of some centimetres between the views that Kinect v1 captures with mirrors show."""
_GRAY = 240  # of a body whose light is to be known: the brightest light there is, 1.06, leaves it below 255
_BAND_PIXELS = 1_500_000  # of a large colour image traced at a time, 120 bytes each


@dataclass(frozen=True)
class Truth:
    """What is really there, camera frame [m].

    Parameters
    ----------
    body : Mesh
        The subject.
    mirrors : tuple of MirrorPicks
        Each glass as ``point`` and unit ``normal`` towards the room: the best plane of where it appears to reflect,
        through the centre of the glass where that is flat and silvered on its front.
    camera_to_avatar : np.ndarray [shape=(4, 4)]
    labels : np.ndarray [shape=(H, W), dtype=int8]
        Body pixels: 0 = seen directly, n = through mirror n; -1 elsewhere and in images of images.
    readable : np.ndarray [shape=(H, W), dtype=bool]
        False in the sensor's shadow, where patterns interfere, and where there is nothing.
    sight : Sight
        Ideal depth, object, view, reflections, incidence and colour of every pixel.
    """

    body: Mesh
    mirrors: tuple[MirrorPicks, ...]
    camera_to_avatar: np.ndarray
    labels: np.ndarray
    readable: np.ndarray
    sight: Sight


@dataclass(frozen=True)
class Simulation:
    """A virtual capture, the rig it came from, and its truth."""

    capture: Capture
    truth: Truth
    rig: Rig


def simulate(
    subject: Mesh, rig: Rig, props: Sequence[Mesh] = (), paint: Paint | None = None, others: Sequence[Rig] = ()
) -> Simulation:
    """Take a virtual snapshot of ``subject`` (avatar frame) with ``rig``; ``props`` stand in the room as well.

    Where the rig's colour camera is not the depth camera, ``native_color`` is its image, and ``color`` is aligned
    to what the sensor read, as :func:`..capture.open_capture` does it.

    ``paint`` gives the subject's colour at each point of its surface, where vertex colours would blur a pattern finer
    than the triangles: (N, 3) float64 points, avatar frame [m], of the subject as it was handed over → (N, 3) sRGB
    values, 0 to 255. Light and mirrors change it as they change vertex colours, which are then those of the vertices.

    The capture's ``mirrors`` are eight picks on each frame, missed by up to 0.7 px like a careful click; a mirror
    whose frame is almost outside the picture (or that has no frame) comes with its true plane instead.

    ``others`` are cameras like the rig's that shine into the scene at the same time; of each only its place and lens
    count. Where their pattern is too strong beside the rig's own, a camera with ``interference`` reads nothing, as
    where its own comes by two ways; a camera that times light has more noise (:func:`.returned_light.noise_gain`).
    Stereo cameras gain rather than lose by more dots: nothing changes for them.

    Raises
    ------
    MirrorScanError
        When the subject's arrays cannot be a mesh, or ``paint`` does not give a colour for each point.
    """
    if paint is not None:
        subject = replace(subject, colors=np.rint(_painted(paint, subject.vertices)).astype(np.uint8))
    sensor = find_sensor(rig.sensor)
    seeds = np.random.SeedSequence(rig.seed).spawn(3)
    noise, clicks, grain = (np.random.default_rng(s) for s in seeds)
    sight, bvh = look(subject, rig, props)
    readable = sight.object > 0
    interference = sensor.interference if rig.interference is None else rig.interference
    if interference or sensor.baseline > 0:
        light = lit(sight, bvh, rig, sensor.baseline)
        once = sight.bounces <= 1
        own = np.take_along_axis(light, np.where(once, sight.view, 0)[..., None].astype(np.intp), axis=-1)[..., 0]
        # Images of images are lit by longer ways than are traced here: they are taken as lit.
        readable &= ~once | (own > 0)
        if interference:
            spoiling = light.sum(axis=-1) - own
            for other in others:
                spoiling = spoiling + lit_by(sight, bvh, rig, other, sensor.baseline)
            readable &= ~once | (spoiling <= INTERFERENCE_RATIO * own)
    apparent = _apparent_depth(sight, bvh, rig, subject)
    strength = gain = returned = None
    surface = albedo(sight, subject, props, rig.optics)
    disturbed = bool(others) and sensor.principle in ("phase", "pulse")
    if rig.optics.weakens:
        returned = signal(sight, rig, sensor, surface)
        strength = returned / max(sensor.faintest, 1e-12)
    if disturbed or (returned is not None and sensor.principle != "pattern"):  # whether dots are bright hardly counts
        strangers = [lit_by(sight, bvh, rig, other, 0.0) for other in others] if disturbed else []
        gain = noise_gain(returned, sight, rig, sensor, surface * sum(strangers))
    fixed = rig.optics.fixed_noise if rig.optics.correlated_noise and sensor.baseline > 0 else None
    depth = measure(
        sensor, np.where(readable, apparent, 0.0), sight.incidence, rig.intrinsics.fx, rig.frames, noise,
        gain=gain, strength=strength, fixed=fixed,
    )  # fmt: skip
    color = _color_image(sight, subject, rig, props, paint)
    color = color + np.rint(1.5 * grain.standard_normal(color.shape, dtype=np.float32))
    color = np.clip(color, 0, 255).astype(np.uint8)
    avatar_to_camera = np.linalg.inv(rig.camera_to_avatar)
    planes = tuple(_plane(m, rig.camera, avatar_to_camera) for m in rig.mirrors)
    picks = tuple(
        _picks(m, i, rig.intrinsics, avatar_to_camera, sight, clicks) or plane
        for i, (m, plane) in enumerate(zip(rig.mirrors, planes, strict=True))
    )
    labels = np.where((sight.object == BODY) & (sight.bounces <= 1), sight.view, -1).astype(np.int8)
    capture = Capture(depth, None, rig.intrinsics, picks, f"simulated {rig.sensor}", "simulation")
    return Simulation(
        _with_color(capture, color, rig),
        Truth(subject.transformed(avatar_to_camera), planes, rig.camera_to_avatar, labels, readable, sight),
        rig,
    )


def _apparent_depth(sight: Sight, bvh: Bvh, rig: Rig, subject: Mesh) -> np.ndarray:
    """What z the sensor would read without noise (H, W) [m]; 0 where its optics leave nothing to read."""
    optics, sensor = rig.optics, find_sensor(rig.sensor)
    depth = sight.depth
    if sensor.principle in ("phase", "pulse"):
        within = skin_delay(sight, bvh, subject, optics)
        if not optics.multipath:
            depth = by_one_way(sight, rig, within)
        elif sensor.principle == "phase":
            depth = by_phase(sight, lit(sight, bvh, rig, 0.0), rig, optics, within)
        else:
            depth = by_pulse(sight, lit(sight, bvh, rig, 0.0), rig, optics.pulse_length, within)
    if optics.warp and sensor.principle != "exact":
        depth = np.where(depth > 0, depth + depth_warp(rig, sensor, depth), 0.0)
    return depth


def _color_image(
    sight: Sight, subject: Mesh, rig: Rig, props: Sequence[Mesh], paint: Paint | None
) -> np.ndarray:  # fmt: skip
    """The colour image without its grain (Hc, Wc, 3): by its own camera; moved and later, if the optics say so."""
    optics, beside, samples = rig.optics, rig.seen_by_color, rig.color_samples
    moved = optics.sway * optics.color_delay
    plain = not _own_color_camera(rig) and paint is None and samples == 1
    if plain and moved == 0.0 and optics.color_shift == (0.0, 0.0):
        return _tinted(sight.color, sight, rig)
    step = np.eye(4)
    step[0, 3] = moved
    there = subject.transformed(step)
    if paint is not None:
        there = replace(there, colors=np.full((len(there.vertices), 3), _GRAY, np.uint8))
    camera, depth = beside.intrinsics, rig.intrinsics
    # The shift is given in pixels of the depth map.
    across, down = optics.color_shift[0] * camera.fx / depth.fx, optics.color_shift[1] * camera.fy / depth.fy
    lens = replace(camera, cx=camera.cx + across, cy=camera.cy + down)
    if samples > 1:
        lens = lens.scaled(samples * camera.width, samples * camera.height)
    rows = max(1, _BAND_PIXELS // (lens.width * samples))  # of the image, in a band
    bands = []
    for first in range(0, camera.height, rows):
        height = min(rows, camera.height - first)
        band = replace(lens, height=samples * height, cy=lens.cy - samples * first)
        seen = look(there, replace(beside, intrinsics=band), props)[0]
        image = seen.color
        if paint is not None:
            body = seen.object == BODY
            points = seen.point[body] - step[:3, 3]
            image[body] = np.clip(np.rint(_painted(paint, points) * (image[body] / _GRAY)), 0, 255)
        image = _tinted(image, seen, rig)
        bands.append(image if samples == 1 else area_resampled(image, camera.width, height))
    return np.concatenate(bands)


def _painted(paint: Paint, points: np.ndarray) -> np.ndarray:
    """Colours (N, 3) float64 of points (N, 3), 0 to 255."""
    colors = np.asarray(paint(points), np.float64)
    if colors.shape != (len(points), 3) or not np.isfinite(colors).all():
        raise MirrorScanError(f"paint gave an array of {colors.shape} for {len(points)} points; give (N, 3) numbers")
    return np.clip(colors, 0.0, 255.0)


def _tinted(color: np.ndarray, sight: Sight, rig: Rig) -> np.ndarray:
    """Colours as the mirrors on the way tint them; images of images are taken to come by one mirror."""
    if all(m.tint == (1.0, 1.0, 1.0) for m in rig.mirrors):
        return color
    gains = np.array([(1.0, 1.0, 1.0), *(m.tint for m in rig.mirrors)])
    at = sight.bounces > 0
    light = to_linear(color[at] / 255.0) * gains[sight.view[at]] ** sight.bounces[at][:, None].astype(float)
    tinted = color.copy()
    tinted[at] = np.clip(np.rint(255.0 * from_linear(light)), 0, 255)
    return tinted


def _own_color_camera(rig: Rig) -> bool:
    """Whether the colour camera sees anything else than the depth camera."""
    return rig.color_camera != rig.intrinsics or not np.array_equal(rig.depth_to_color, np.eye(4))


def _with_color(capture: Capture, color: np.ndarray, rig: Rig) -> Capture:
    """The capture with its colour image: aligned to depth, and as its own camera took it where that is another."""
    if not _own_color_camera(rig):
        return replace(capture, color=color)
    pose, camera, depth = rig.depth_to_color, rig.color_camera, rig.intrinsics
    if np.array_equal(pose, np.eye(4)) and camera == depth.scaled(camera.width, camera.height):
        aligned = area_resampled(color, depth.width, depth.height)
        return replace(capture, color=aligned, native_color=color, color_intrinsics=camera, depth_to_color=pose)
    return align(replace(capture, color=color, color_intrinsics=camera, depth_to_color=pose), native=True)


def _plane(mirror: FramedMirror, eye: Sequence[float], avatar_to_camera: np.ndarray) -> MirrorPicks:
    turn, shift = avatar_to_camera[:3, :3], avatar_to_camera[:3, 3]
    point, normal = apparent_plane(mirror, eye)
    return MirrorPicks(mirror.name, None, turn @ point + shift, turn @ normal)


def _picks(
    mirror: FramedMirror, index: int, intrinsics: Intrinsics, avatar_to_camera: np.ndarray, sight: Sight,
    rng: np.random.Generator,
) -> MirrorPicks | None:  # fmt: skip
    """Clicks along the middle of the moulding where it is seen directly; None if there are fewer than 3."""
    if mirror.frame_width == 0:
        return None
    right, up, normal = mirror.axes
    w, h = (mirror.width + mirror.frame_width) / 2, (mirror.height + mirror.frame_width) / 2
    corners = np.array([(-w, -h), (w, -h), (w, h), (-w, h), (-w, -h)])
    at = np.linspace(0, 4, 801)[:-1]
    side = at.astype(int)
    flat = corners[side] + (at - side)[:, None] * (corners[side + 1] - corners[side])
    points = np.array(mirror.centre) + flat[:, :1] * right + flat[:, 1:] * up + mirror.frame_depth * normal
    pixels = project(points @ avatar_to_camera[:3, :3].T + avatar_to_camera[:3, 3], intrinsics)
    pixels = np.round(pixels + rng.uniform(-PICK_JITTER, PICK_JITTER, pixels.shape), 1)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    u, v = np.rint(pixels).astype(int).T
    inside = (u >= 0) & (u < intrinsics.width) & (v >= 0) & (v < intrinsics.height)
    pixels, u, v = pixels[inside], u[inside], v[inside]
    seen = (sight.object[v, u] == FRAME) & (sight.index[v, u] == index) & (sight.bounces[v, u] == 0)
    pixels = pixels[seen]
    if len(pixels) < 3:
        return None
    # At a distance from one another, as a person picks: one from each eighth of what is visible of the frame.
    parts = np.array_split(pixels, min(PICKS, len(pixels)))
    return MirrorPicks(mirror.name, np.array([part[rng.integers(len(part))] for part in parts]))


def write_simulation(simulation: Simulation, folder: str | os.PathLike) -> None:
    """Write an RGB-D folder with ``mirrors.json`` and ``truth/`` (body.ply, rig.json, labels.png).

    ``truth/labels.png`` holds ``labels`` + 1: 0 = not the body, 1 = direct, n + 1 = through mirror n.

    Raises
    ------
    OutputError
        When the folder holds other depth frames than would be written over, or cannot be written.
    """
    folder = Path(folder)
    capture, truth, rig = simulation.capture, simulation.truth, simulation.rig
    names = [f"{i:06d}.png" for i in range(len(capture.depth))]
    others = sorted({p.name for p in folder.glob("depth/*")} - set(names))
    if others:
        raise OutputError(f"{folder / 'depth' / others[0]} belongs to another capture; choose an empty folder")
    try:
        for sub in ("depth", "color", "truth"):
            (folder / sub).mkdir(parents=True, exist_ok=True)
        intrinsics = capture.intrinsics
        matrix = [intrinsics.fx, 0, 0, 0, intrinsics.fy, 0, intrinsics.cx, intrinsics.cy, 1]
        _write_json(
            folder / "intrinsic.json",
            {"width": intrinsics.width, "height": intrinsics.height, "intrinsic_matrix": matrix},
        )
        described = folder / COLOR_INTRINSIC_NAME
        described.unlink(missing_ok=True)
        if capture.color_intrinsics is not None and capture.depth_to_color is not None:
            _write_json(described, color_file(capture.color_intrinsics, capture.depth_to_color))
        mirrors = [
            {"name": m.name, "frame_pixels": m.frame_pixels.tolist()}
            if m.frame_pixels is not None
            else {"name": m.name, "plane": _plane_entry(m)}
            for m in capture.mirrors
        ]
        _write_json(folder / "mirrors.json", {"mirrors": mirrors})
        planes = [
            {
                "name": m.name, **_plane_entry(m), "sag": list(made.sag), "glass_thickness": made.glass_thickness,
                "reflectivity": made.reflectivity, "tint": list(made.tint),
            }
            for m, made in zip(truth.mirrors, rig.mirrors, strict=True)
        ]  # fmt: skip
        _write_json(folder / "truth" / "rig.json", {
            "frame": "camera: x right, y down, z forward, metres",
            "mirrors": planes,
            "camera_to_avatar": truth.camera_to_avatar.tolist(),
            "sensor": rig.sensor, "frames": rig.frames, "seed": rig.seed, "optics": asdict(rig.optics),
        })  # fmt: skip
    except OSError as error:
        raise OutputError(f"cannot write into {folder}: {error.strerror}; choose another folder") from error
    for name, frame in zip(names, capture.depth, strict=True):
        write_png(folder / "depth" / name, np.rint(frame * 1000.0).clip(0, 65535).astype(np.uint16))
    image = capture.color if capture.native_color is None else capture.native_color
    assert image is not None  # simulate always gives a colour image
    write_png(folder / "color" / "000000.png", image)
    write_png(folder / "truth" / "labels.png", (truth.labels + 1).astype(np.uint8))
    write_mesh(folder / "truth" / "body.ply", truth.body)


def _plane_entry(mirror: MirrorPicks) -> dict[str, list[float]]:
    """The known plane of a mirror as ``mirrors.json`` and ``rig.json`` hold it."""
    assert mirror.point is not None and mirror.normal is not None  # simulate gives a plane where it gives no picks
    return {"point": mirror.point.tolist(), "normal": mirror.normal.tolist()}


def _write_json(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")
