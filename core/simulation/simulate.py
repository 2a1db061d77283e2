"""A virtual snapshot with its truth: :func:`simulate`, and the RGB-D folder it makes: :func:`write_simulation`."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics, project
from ..capture import Capture, MirrorPicks
from ..errors import OutputError
from ..io import write_mesh
from ..io.images import write_png
from ..mesh import Mesh
from ..mesh.bvh import Bvh
from .multipath import by_one_way, by_phase, by_pulse
from .rays import BODY, FRAME, Sight, lit, look
from .returned_light import albedo, depth_warp, noise_gain, signal, skin_delay
from .scene import FramedMirror, Rig, apparent_plane
from .sensors import find_sensor, measure

PICKS = 8
PICK_JITTER = 0.7
"""How far a click misses, each way [px]."""
INTERFERENCE_RATIO = 0.4
"""Light by other ways this strong, relative to the reading's own, spoils it.

It leaves the gaps of some centimetres between the views that Kinect v1 captures with mirrors show."""


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


def simulate(subject: Mesh, rig: Rig, props: Sequence[Mesh] = ()) -> Simulation:
    """Take a virtual snapshot of ``subject`` (avatar frame) with ``rig``; ``props`` stand in the room as well.

    The capture's ``mirrors`` are eight picks on each frame, missed by up to 0.7 px like a careful click; a mirror
    whose frame is almost outside the picture (or that has no frame) comes with its true plane instead.

    Raises
    ------
    MirrorScanError
        When the subject's arrays cannot be a mesh.
    """
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
            readable &= ~once | (light.sum(axis=-1) - own <= INTERFERENCE_RATIO * own)
    apparent = _apparent_depth(sight, bvh, rig, subject)
    strength = gain = None
    if rig.optics.weakens:
        returned = signal(sight, rig, sensor, albedo(sight, subject, props, rig.optics))
        strength = returned / max(sensor.faintest, 1e-12)
        if sensor.principle != "pattern":  # dots are found or not: how bright they are hardly counts
            gain = noise_gain(returned, sight, rig, sensor)
    fixed = rig.optics.fixed_noise if rig.optics.correlated_noise and sensor.baseline > 0 else None
    depth = measure(
        sensor, np.where(readable, apparent, 0.0), sight.incidence, rig.intrinsics.fx, rig.frames, noise,
        gain=gain, strength=strength, fixed=fixed,
    )  # fmt: skip
    color = _color_image(sight, subject, rig, props)
    color = color + np.rint(1.5 * grain.standard_normal(color.shape, dtype=np.float32))
    color = np.clip(color, 0, 255).astype(np.uint8)
    avatar_to_camera = np.linalg.inv(rig.camera_to_avatar)
    planes = tuple(_plane(m, rig.camera, avatar_to_camera) for m in rig.mirrors)
    picks = tuple(
        _picks(m, i, rig.intrinsics, avatar_to_camera, sight, clicks) or plane
        for i, (m, plane) in enumerate(zip(rig.mirrors, planes, strict=True))
    )
    labels = np.where((sight.object == BODY) & (sight.bounces <= 1), sight.view, -1).astype(np.int8)
    return Simulation(
        Capture(depth, color, rig.intrinsics, picks, f"simulated {rig.sensor}", "simulation"),
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


def _color_image(sight: Sight, subject: Mesh, rig: Rig, props: Sequence[Mesh]) -> np.ndarray:
    """The colour image without its grain: beside the depth map and later, if the optics say so (H, W, 3)."""
    optics, lens = rig.optics, rig.intrinsics
    moved = optics.sway * optics.color_delay
    if moved == 0.0 and optics.color_shift == (0.0, 0.0):
        return sight.color
    step = np.eye(4)
    step[0, 3] = moved
    beside = replace(lens, cx=lens.cx + optics.color_shift[0], cy=lens.cy + optics.color_shift[1])
    return look(subject.transformed(step), replace(rig, intrinsics=beside), props)[0].color


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
                "reflectivity": made.reflectivity,
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
    assert capture.color is not None  # simulate always gives a colour image
    write_png(folder / "color" / "000000.png", capture.color)
    write_png(folder / "truth" / "labels.png", (truth.labels + 1).astype(np.uint8))
    write_mesh(folder / "truth" / "body.ply", truth.body)


def _plane_entry(mirror: MirrorPicks) -> dict[str, list[float]]:
    """The known plane of a mirror as ``mirrors.json`` and ``rig.json`` hold it."""
    assert mirror.point is not None and mirror.normal is not None  # simulate gives a plane where it gives no picks
    return {"point": mirror.point.tolist(), "normal": mirror.normal.tolist()}


def _write_json(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")
