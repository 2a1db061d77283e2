"""RGB-D folder (the convention of Open3D's recorders): ``intrinsic.json``, ``depth/``, ``color/``, ``mirrors.json``.

Colour may be larger than depth; ``color_intrinsic.json`` says what took it and from where.

Every check answers in one line that names the file, what is wrong with it and what to do.
"""

from __future__ import annotations

import os
import re
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, MirrorError, Notice
from ...io.images import checked_png, read_image
from ...io.json_files import load_json, numbers, short
from ...numeric.threads import each
from ..capture import Capture, MirrorPicks, ReadOptions, stored_capture
from ..depth_units import SCENE_DEPTH_M, DepthUnit, doubt, in_metres, recognise_unit
from ..frames import FrameChoice, chosen_frames, empty_burst, paired_color
from ..nominal_intrinsics import nominal_camera
from .lens_file import LensFile, read_color_file, read_lens_file
from .lens_file import read_intrinsics as read_intrinsics

FORMAT = "RGB-D folder"
INTRINSIC_NAMES = ("intrinsic.json", "camera_intrinsic.json")
COLOR_INTRINSIC_NAME = "color_intrinsic.json"
COLOR_FOLDERS = ("color", "rgb", "image", "images")  # Open3D's and RealSense's recorders; Redwood has the others
COLOR_SUFFIXES = (".png", ".jpg", ".jpeg")
SENSOR_WORDS = {
    "kinect_v2": ("kinectv2", "kinect2", "kinectone", "kinectforwindowsv2"),
    "femto_bolt": ("femto",),
    "azure_kinect": ("azurekinect", "azure", "k4a"),
    "kinect_v1": ("kinectv1", "kinect1", "kinect360", "primesense", "xtion", "ps1080", "kinect"),
    "realsense_d415": ("d415",),
    "realsense_d435": ("d435",),
    "realsense_d455": ("d455",),
    "phone": ("phone", "ipad", "lidar", "truedepth"),
    "ideal": ("ideal",),
}
MAX_MIRRORS = 100  # a view is numbered by an int8


def recognises(path: Path) -> bool:
    """Whether ``path`` is a folder that holds any part of an RGB-D capture."""
    return path.is_dir() and ((path / "depth").is_dir() or any((path / name).is_file() for name in INTRINSIC_NAMES))


def read(path: Path, frames: FrameChoice = None, options: ReadOptions | None = None) -> Capture:
    """Read an RGB-D folder.

    Parameters
    ----------
    path : Path
        The folder.
    frames : int, str or None
        Which depth frames, as :func:`.reader_choice.open_capture` has it.
    options : ReadOptions or None
        ``intrinsics`` and ``depth_unit_m`` replace those of the folder.

    Returns
    -------
    Capture
        ``mirrors`` as ``mirrors.json`` has them, empty without that file.

    Raises
    ------
    CaptureError, MirrorError
        See the module's first line.
    """
    options = options or ReadOptions()
    depth_files = _images(path / "depth", (".png",))
    lens = _lens(path, depth_files, options)
    intrinsics = options.intrinsics or lens.intrinsics
    assert intrinsics is not None  # one of both was read
    notes = list(lens.notes)
    if not depth_files:
        raise CaptureError(
            f"{path / 'depth'}: holds no PNG; put the depth frames there (16 bit, millimetres)", code="empty"
        )
    chosen = chosen_frames(path / "depth", frames, len(depth_files))
    stated = next((u for u in (options.depth_unit_m, options.lens_unit_m, lens.unit_m) if u is not None), None)
    depth, note = _read_depth([depth_files[i] for i in chosen], intrinsics, stated)
    notes += [note] if note else []
    if stated is not None and options.depth_unit_m is None:
        first = next(frame for frame in depth if frame.any())
        notes += doubt(np.rint(first / np.float32(stated)).clip(0, 65535).astype(np.uint16), stated)
    color = color_camera = pose = None
    if options.color:
        color_files = next(filter(None, (_images(path / name, COLOR_SUFFIXES) for name in COLOR_FOLDERS)), [])
        if color_files:
            matching, note = paired_color(depth_files, chosen[0], color_files)
            color = _read_color(color_files[matching])
            notes += [note] if note else []
            color_camera, pose, said = color_camera_of(path, color_files[matching], color, intrinsics)
            notes += said
    mirror_file = path / "mirrors.json"
    mirrors = read_mirrors(mirror_file, intrinsics) if options.mirrors and mirror_file.exists() else ()
    return stored_capture(
        path, FORMAT, depth, color, intrinsics, color_camera, pose, mirrors=mirrors, sensor=sensor_named(lens.sensor),
        sensor_from=lens.sensor_from, notes=notes,
    )  # fmt: skip


def color_camera_of(
    folder: Path, file: Path, color: np.ndarray, intrinsics: Intrinsics
) -> tuple[Intrinsics | None, np.ndarray | None, list[str]]:
    """What ``color_intrinsic.json`` of a folder says of a colour image.

    Parameters
    ----------
    folder, file : Path
        Where that file lies, and the image.
    color : np.ndarray [shape=(Hc, Wc, 3)]
        The image.
    intrinsics : Intrinsics
        Of the depth map.

    Returns
    -------
    color_intrinsics, depth_to_color, notes
        As :func:`.capture.stored_capture` takes them: both None where colour is aligned to depth, the pose alone None
        where it is aligned and larger.

    Raises
    ------
    CaptureError
        When the file is wrong or for another size, or there is none and colour has neither depth's size nor, larger,
        its shape.
    """
    height, width = color.shape[:2]
    aligned = (width, height) == (intrinsics.width, intrinsics.height)
    described = folder / COLOR_INTRINSIC_NAME
    if not described.is_file():
        if not aligned and not holds_scaled(color, intrinsics):
            raise CaptureError(
                f"{file}: is {width}×{height} pixels, but depth has {intrinsics.width}×{intrinsics.height}; align "
                f"colour to depth when recording, write {COLOR_INTRINSIC_NAME} with its intrinsics and depth_to_color, "
                "or remove the color folder to go without",
                code="color",
            )
        return None, None, []
    camera, pose, notes = read_color_file(described)
    if (camera.width, camera.height) != (width, height):
        if not aligned:
            raise CaptureError(
                f"{described}: is for {camera.width}×{camera.height} pixels, {file.name} has {width}×{height}; give "
                "the intrinsics of this resolution",
                code="lens_wrong",
            )
        note = Notice(
            "{name} is for {lens_width}×{lens_height} pixels, {image} has {width}×{height}, as depth: it was not used",
            name=described.name, lens_width=camera.width, lens_height=camera.height, image=file.name, width=width,
            height=height,
        )  # fmt: skip
        return None, None, [note]
    if pose is None:
        note = Notice(
            "{name} has no “depth_to_color”: the colour camera is taken to be where the depth camera is",
            name=described.name,
        )
        notes, pose = (*notes, note), np.eye(4)
    same = np.array_equal(pose, np.eye(4)) and _same_view(camera, intrinsics.scaled(width, height))
    return camera, None if same else pose, list(notes)


def holds_scaled(color: np.ndarray, intrinsics: Intrinsics) -> bool:
    """Whether a colour image is larger than the depth map of ``intrinsics`` and of its shape, within 2 %."""
    height, width = color.shape[:2]
    across, along = width / intrinsics.width, height / intrinsics.height
    return min(across, along) >= 1 and abs(across - along) <= 0.02 * max(across, along)


def _same_view(one: Intrinsics, other: Intrinsics) -> bool:
    """Whether two cameras for images of one size see the same in each pixel, within a hundredth of one."""
    near = np.abs(one.packed - other.packed).max() < 0.01
    return bool(near and not any(one.distortion) and not any(other.distortion)) or one == other


def mirrors_to(mirrors: tuple[MirrorPicks, ...]) -> list[dict]:
    """The list under ``mirrors`` that :func:`mirrors_from` reads."""
    entries = []
    for pick in mirrors:
        if pick.frame_pixels is not None:
            entries.append({"name": pick.name, "frame_pixels": np.asarray(pick.frame_pixels).tolist()})
        else:
            plane = {"point": np.asarray(pick.point).tolist(), "normal": np.asarray(pick.normal).tolist()}
            entries.append({"name": pick.name, "plane": plane})
    return entries


def sensor_named(name: object) -> str:
    """The name of :class:`.capture.Capture.sensor` for what a file or device calls itself.

    ``unknown`` for all others.
    """
    text = re.sub(r"[^a-z0-9]", "", name.lower()) if isinstance(name, str) else ""
    for sensor, words in SENSOR_WORDS.items():
        if any(word in text for word in words):
            return sensor
    return "unknown"


def read_mirrors(path: str | os.PathLike, intrinsics: Intrinsics | None = None) -> tuple[MirrorPicks, ...]:
    """What a ``mirrors.json`` says of the mirrors; with ``intrinsics``, picks are checked against the image size.

    Raises
    ------
    MirrorError
        Unreadable JSON, wrong structure, values that are not finite numbers, fewer than three different picks on a
        mirror, picks outside the image, or a plane without a direction.
    """
    path = Path(path)
    return mirrors_from(path, load_json(path, MirrorError, "mirror_file"), intrinsics)


def mirrors_from(path: Path, content: object, intrinsics: Intrinsics | None = None) -> tuple[MirrorPicks, ...]:
    """As :func:`read_mirrors`, of JSON content already read from ``path``."""
    entries = content.get("mirrors") if isinstance(content, dict) else None
    if not isinstance(entries, list):
        raise MirrorError(
            f'{path}: must be a JSON object with a list: {{"mirrors": [...]}}; pick the mirrors again',
            code="mirror_file",
        )
    if len(entries) > MAX_MIRRORS:
        raise MirrorError(
            f"{path}: names {len(entries)} mirrors; at most {MAX_MIRRORS} are possible", code="mirror_file"
        )
    mirrors = tuple(_mirror(path, i, entry, intrinsics) for i, entry in enumerate(entries, start=1))
    names = [mirror.name for mirror in mirrors]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise MirrorError(f"{path}: two mirrors are named “{repeated[0]}”; give each its own name", code="mirror_file")
    return mirrors


def _lens(path: Path, depth_files: list[Path], options: ReadOptions) -> LensFile:
    """What the folder says of its camera."""
    file = next((path / name for name in INTRINSIC_NAMES if (path / name).is_file()), None)
    if file is not None:
        return read_lens_file(file, options.intrinsics is None)
    if options.intrinsics:
        return LensFile(None)
    # Redwood's scans have no such file and are by PrimeSense's cameras; for others a guess gives wrong sizes
    redwood = depth_files and (path / "image").is_dir()
    nominal = nominal_camera(*_size(depth_files[0])) if redwood else None
    if nominal is None:
        raise CaptureError(
            f"{path / INTRINSIC_NAMES[0]}: is missing; it gives width, height and intrinsic_matrix of the depth "
            "camera; write it, or give a file that holds them (option “intrinsics”)",
            code="lens_missing",
        )
    intrinsics, sensor, note = nominal
    return LensFile(intrinsics, None, sensor, "size", (note,))


def _size(file: Path) -> tuple[int, int]:
    """Width and height of an image file."""
    height, width = read_image(file).shape[:2]
    return width, height


def _images(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Image files of a folder in natural order (2 before 10); none when there is no such folder."""
    if not folder.is_dir():
        return []
    try:
        files = [p for p in folder.iterdir() if p.suffix.lower() in suffixes and not p.name.startswith(".")]
    except OSError as error:
        raise CaptureError(f"{folder}: cannot be listed: {error.strerror or error}", code="gone") from error
    return sorted(files, key=lambda p: [(int(s), "") if s.isdecimal() else (-1, s) for s in re.split(r"(\d+)", p.name)])


def _read_depth(files: list[Path], intrinsics: Intrinsics, unit_m: float | None) -> tuple[np.ndarray, str]:
    """Frames (F, H, W) float32 [m], and a note of what was taken for what where ``unit_m`` is None."""
    header = checked_png(files[0])
    if header is None or struct.unpack_from(">II", header, 16) != (intrinsics.width, intrinsics.height):
        _depth_frame(files[0], intrinsics, files)  # reports what is wrong before memory is allocated
    depth = empty_burst(files[0].parent, len(files), intrinsics.height, intrinsics.width)
    scale = 1000.0 if unit_m is None else 1 / unit_m
    decode: Callable[[bytes, float, np.ndarray], bool] | None = None
    if "numba" in sys.modules:  # to read a folder must not cost the import of numba, which takes longer than that
        from ..decoding.depth_png import decode_metres

        decode = decode_metres

    def read(i: int) -> None:
        if not (decode and (data := checked_png(files[i])) and decode(data, scale, depth[i])):
            np.divide(_depth_frame(files[i], intrinsics, files), np.float32(scale), out=depth[i])

    each(read, range(len(files)))
    seen = next((i for i, frame in enumerate(depth) if frame.any()), None)
    if seen is None:
        raise CaptureError(
            f"{files[0].parent}: no pixel of {len(files)} frame{'s' if len(files) > 1 else ''} has a depth reading; "
            "check that the depth stream was on and record again",
            code="empty",
        )
    unit = DepthUnit(0.001)
    if unit_m is not None and 65535 * unit_m < SCENE_DEPTH_M:  # as :func:`.depth_units.in_metres` has it
        depth[depth == np.float32(65535) / np.float32(scale)] = 0
    if unit_m is None and recognise_unit(stored := np.rint(depth[seen] * 1000).astype(np.uint16)).note:
        if len(files) > 1:  # players may come later
            stored = np.rint(depth * 1000).astype(np.uint16)
        unit = recognise_unit(stored)
        depth = in_metres(np.atleast_3d(stored) if stored.ndim == 3 else stored[None], unit)
    return depth, unit.note


def _depth_frame(file: Path, intrinsics: Intrinsics, files: list[Path]) -> np.ndarray:
    """One frame as stored (H, W) uint16."""
    frame = read_image(file)
    if frame.ndim != 2 or frame.dtype != np.uint16:
        bits = {"uint8": 8, "uint16": 16}.get(frame.dtype.name, 32)
        channels = "gray" if frame.ndim == 2 else f"{frame.shape[2]}-channel"
        raise CaptureError(
            f"{file}: is a {bits}-bit {channels} image; depth must be 16-bit gray, in millimetres. "
            "Save the frame again without converting it",
            code="not_a_capture",
        )
    width, height = intrinsics.width, intrinsics.height
    if frame.shape != (height, width):
        first = file == files[0]
        if frame.shape == (width, height):
            raise CaptureError(
                f"{file}: is {frame.shape[1]}×{frame.shape[0]} pixels, but intrinsic.json says {width}×{height}: width "
                "and height are exchanged, or the picture was rotated; give the intrinsics of the picture as it is",
                code="rotation",
            )
        if first:
            raise CaptureError(
                f"{file}: is {frame.shape[1]}×{frame.shape[0]} pixels, but intrinsic.json says {width}×{height}; give "
                "the intrinsics of this resolution",
                code="lens_wrong",
            )
        raise CaptureError(
            f"{file}: is {frame.shape[1]}×{frame.shape[0]} pixels, but {files[0].name} and intrinsic.json have "
            f"{width}×{height}; keep frames of one size only",
            code="lens_wrong",
        )
    return frame


def _read_color(file: Path) -> np.ndarray:
    """Colour (H, W, 3) uint8; gray is repeated, alpha dropped, 16 bit cut to 8."""
    color = read_image(file)
    if color.dtype == np.uint16:
        color = (color >> 8).astype(np.uint8)
    elif color.dtype != np.uint8:
        raise CaptureError(
            f"{file}: colour must have 8 or 16 bits a channel; save it as an ordinary PNG or JPEG", code="color"
        )
    if color.ndim == 2 or color.shape[2] < 3:
        color = np.repeat((color if color.ndim == 2 else color[..., 0])[..., None], 3, axis=2)
    return np.ascontiguousarray(color[..., :3])


def _mirror(path: Path, index: int, entry: object, intrinsics: Intrinsics | None) -> MirrorPicks:
    if not isinstance(entry, dict):
        raise MirrorError(f"{path}: mirror {index} must be a JSON object, not {short(entry)}", code="mirror_file")
    name = entry.get("name", f"mirror {index}")
    if not isinstance(name, str) or not name.strip() or len(name) > 64 or not name.isprintable():
        raise MirrorError(
            f"{path}: the name of mirror {index} must be a short printable text, not {short(name)}", code="mirror_file"
        )
    where = f"{path}: mirror “{name}”"
    if ("frame_pixels" in entry) == ("plane" in entry):
        raise MirrorError(f"{where} needs either frame_pixels or plane, and not both", code="mirror_file")
    if "plane" in entry:
        return MirrorPicks(name, **_plane(where, entry["plane"]))
    return MirrorPicks(name, frame_pixels=_frame_pixels(where, entry["frame_pixels"], intrinsics))


def _plane(where: str, plane: object) -> dict[str, np.ndarray]:
    """Point and unit normal."""
    point = numbers(plane.get("point"), 3) if isinstance(plane, dict) else None
    normal = numbers(plane.get("normal"), 3) if isinstance(plane, dict) else None
    if point is None or normal is None:
        raise MirrorError(
            f'{where}: plane must be {{"point": [x,y,z], "normal": [x,y,z]}} with finite numbers', code="mirror_file"
        )
    longest = np.abs(normal).max()
    if longest == 0:
        raise MirrorError(f"{where}: the plane's normal is zero; it must point somewhere", code="mirror_file")
    normal = normal / longest  # first, so that squares neither overflow nor vanish
    return {"point": point, "normal": normal / np.linalg.norm(normal)}


def _frame_pixels(where: str, picks: object, intrinsics: Intrinsics | None) -> np.ndarray:
    if not isinstance(picks, list):
        raise MirrorError(f"{where}: frame_pixels must be a list of [u, v], not {short(picks)}", code="mirror_file")
    pixels = np.empty((len(picks), 2))
    for i, pick in enumerate(picks):
        pixel = numbers(pick, 2)
        if pixel is None:
            raise MirrorError(
                f"{where}: pick {i + 1} must be two finite numbers [u, v], not {short(pick)}", code="mirror_file"
            )
        pixels[i] = pixel
    different = len(np.unique(pixels, axis=0))
    if different < 3:
        picked = f"{different} different pick{'' if different == 1 else 's'}"
        raise MirrorError(f"{where} has {picked}; a plane needs at least 3 points on the frame", code="mirror_file")
    if intrinsics is not None:
        size = np.array((intrinsics.width, intrinsics.height))
        outside = np.flatnonzero(((pixels < -0.5) | (pixels > size - 0.5)).any(axis=1))
        if len(outside):
            u, v = pixels[outside[0]]
            raise MirrorError(
                f"{where}: pick {outside[0] + 1} at ({u:g}, {v:g}) lies outside the {size[0]}×{size[1]} image; "
                "pick on the depth image of this capture",
                code="mirror_file",
            )
    return pixels
