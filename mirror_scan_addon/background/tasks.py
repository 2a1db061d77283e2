"""The jobs that take long, as generator functions that need no bpy: any process may run them (:mod:`.second_process`).

They take and give plain values, arrays and core's plain records (Intrinsics, Mesh), so that handing them over imports
nothing heavy: numba stays out of Blender's window. Mirrors go as *records*, the plain form :mod:`.scan_records` keeps
in a scene: ``{"name", "picks", "source", "plane", "residual_mm", "message"}``.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...core.camera import Intrinsics, RgbdImage
from ...core.errors import CaptureError, MirrorError, MirrorScanError
from ...core.mesh import Mesh, Texture
from ...core.mirrors import Mirror
from ...core.preview.palette import depth_colors
from .mirror_judgement import ENOUGH, judged, picks_of

if TYPE_CHECKING:
    from ...core.avatar.avatar_file import Avatar
    from ...core.avatar.garment import Garment
    from ...core.avatar.pose import SkinWeights
    from ...core.avatar.skeleton import Skeleton
    from ...core.capture import Capture, ReadOptions
    from ...core.decimation import Reduced
    from ...core.measurements import Measurements
    from ...core.motion import Clip, Motion, Soles
    from ...core.pipeline import Settings
    from ...core.rig_planning.placement_search import Placement
    from ...core.simulation.scene import Rig

Result = TypeVar("Result")
Steps = Generator[tuple[float, str], None, Result]

READING, AVERAGING = "Reading the capture", "Averaging the frames"
FINDING, FITTING = "Finding the mirrors", "Fitting the mirrors"


@dataclass(frozen=True)
class Cloud:
    """A capture's points.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3), dtype=float32]
        Camera frame [m].
    pixel : np.ndarray [shape=(N,), dtype=int32]
        Row · width + column of each.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
    intrinsics : Intrinsics
    info : dict
        name, format, path, frames, size, sensor, who names it, what it measures, and notes.
    """

    points: np.ndarray
    pixel: np.ndarray
    color: np.ndarray | None
    intrinsics: Intrinsics
    info: dict

    @property
    def depth(self) -> np.ndarray:
        """Depth map (H, W) float32 [m], 0 = no reading."""
        depth = np.zeros(self.intrinsics.height * self.intrinsics.width, np.float32)
        depth[self.pixel] = self.points[:, 2]
        return depth.reshape(self.intrinsics.height, self.intrinsics.width)


@dataclass(frozen=True)
class Loaded:
    """A capture averaged to one depth map (H, W) [m], its pictures (H, W, 3) uint8, and what it says of mirrors."""

    depth: np.ndarray
    color: np.ndarray | None
    depth_picture: np.ndarray
    intrinsics: Intrinsics
    info: dict
    placement: np.ndarray
    mirrors: list[dict]
    seen: np.ndarray | None


@dataclass(frozen=True)
class Fitted:
    """Mirrors after a fit, and warnings about them.

    ``seen``: through which of them each pixel (H, W) was seen (0 directly, -1 unknown).
    """

    mirrors: list[dict]
    seen: np.ndarray | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Subject:
    """The capture sorted: maps (H, W); ``height`` [m] is above the floor, or the lowest point of the person."""

    seen: np.ndarray
    view: np.ndarray
    height: np.ndarray
    floor: bool
    clearance: float
    placement: np.ndarray
    pixels: list[int]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Built:
    """What of a reconstruction goes into the file; ``mirrors`` as they were in the end."""

    mesh: Mesh
    report: dict
    warnings: tuple[str, ...]
    mirrors: list[dict]


@dataclass(frozen=True)
class Scanned:
    """A capture with the mirrors it has or that were found, and the avatar; or why there is none."""

    loaded: Loaded
    built: Built | None
    problem: MirrorScanError | None


@dataclass(frozen=True)
class Checked:
    """What a mesh is (:func:`.soundness.mesh_report`) and its problems, as plain dicts."""

    report: dict
    problems: list[dict]


@dataclass(frozen=True)
class Rigged:
    """An avatar's mesh, fine enough to bend, with its skeleton and weights; all in the frame of the mesh [m]."""

    mesh: Mesh
    skeleton: Skeleton
    weights: SkinWeights
    texture: Texture | None = None


@dataclass(frozen=True)
class Source:
    """What an avatar was built from.

    Parameters
    ----------
    path, frames, reading
        As :func:`build_steps` takes them; an empty path says that ``cloud`` is all there is.
    mirrors : list of dict
        Records of the mirrors as they were in the end.
    placement : list
        (4, 4), rigid: camera frame → avatar frame.
    cloud : Cloud or None
    """

    path: str
    frames: int
    reading: dict
    mirrors: list[dict]
    placement: list
    cloud: Cloud | None


@dataclass(frozen=True)
class Textured:
    """A texture of an avatar's triangles, and what the report says of it."""

    texture: Texture
    summary: dict


@dataclass(frozen=True)
class Measured:
    """A body's measurements, and what the report says of them."""

    measurements: Measurements
    summary: dict


@dataclass(frozen=True)
class Simulated:
    """A virtual capture, and what of the body (V,) int8 each view sees best, with the shares of its surface."""

    loaded: Loaded
    coverage: np.ndarray
    shares: list[float]


@dataclass(frozen=True)
class RigChecked:
    """What a rig of objects would see of a body, plainly, and a small picture of what its camera sees.

    ``shares``: of the area, by view; ``parts``: of the area of head, hands and feet; ``views``: for each view its name,
    which parts are whole in it, and what to move; ``image`` (H, W, 3) uint8.
    """

    seen: float
    shares: dict[str, float]
    parts: dict[str, float]
    views: list[dict]
    error_mm: float
    light_mm: float
    lit_twice: float
    image: np.ndarray


# --- capture ---------------------------------------------------------------------------------------------------------


def load_steps(path: str, frames: int, mirrors_path: str = "", reading: dict | None = None) -> Steps[Loaded]:
    """Read a capture, average its burst, and fit the mirrors it knows; ``reading`` is of
    :func:`.scan_records.reading_of`."""
    yield 0.0, READING
    capture = _open(path, frames, mirrors_path, reading)
    return (yield from _loaded(capture, path))[0]


def record_steps(camera: str, folder: str, frames: int) -> Steps[Loaded]:
    """Record a burst of a live camera (a name of ``core.record.DRIVERS``) into ``folder``, and load it."""
    yield 0.0, "Starting the camera"
    from ...core.capture.live_camera import DRIVERS, record

    with DRIVERS[camera]() as stream:
        yield 0.1, "Recording: hold still"
        record(stream, folder, frames)
    yield 0.3, READING
    return (yield from load_steps(folder, 0))


def live_steps(source: dict, capture: str, frames_folder: str, shutter: dict) -> Steps[str]:
    """Look at a live camera, or a recording played as one, until the burst is taken; the folder of the burst.

    Parameters
    ----------
    source : dict
        ``camera``: a name of ``core.guidance.playback.CAMERAS``; ``serial`` of it, or the path of the recording;
        ``paced`` for a recording, and ``rate`` [1/s]; ``mirrors``: how many there are, where it does not say.
    capture : str
        Folder to make for the burst.
    frames_folder : str
        Where :mod:`.live_frames` puts each frame that is looked at.
    shutter : dict
        Arguments of ``core.guidance.ShutterSettings``.
    """
    yield 0.0, "Starting the camera"
    from ...core.capture import MirrorPicks
    from ...core.guidance import LiveScene, LiveSettings, Shutter, ShutterSettings, guide
    from ...core.guidance.playback import CAMERAS, mirrors_of
    from ...core.guidance.shutter import write_burst
    from .live_frames import picture_of, write_picture

    recording = source["camera"] == "playback"
    more = {"paced": source["paced"], "rate": source["rate"]} if recording else {}
    rate = float(source["rate"])
    clock = (lambda number: number / rate) if recording and not source["paced"] else None
    with CAMERAS[source["camera"]](serial=source["serial"] or None, **more) as stream:
        live = LiveSettings(beside=clock is None, mirrors=source["mirrors"])
        known = mirrors_of(source["serial"]) if recording else ()
        scene = LiveScene(stream.intrinsics, stream.sensor, known, live)
        taker = Shutter(stream.intrinsics, ShutterSettings(**shutter))
        picture = None
        for update in guide(stream, scene, taker, clock=clock):
            picture = picture_of(update, picture)
            write_picture(frames_folder, picture)
            yield 0.9 * update.share, LIVE_WORDS[update.state]
        picks = [one for one in scene.known if isinstance(one, MirrorPicks)]
        write_burst(capture, stream, taker.burst, taker.color, picks)
    return capture


LIVE_WORDS = {
    "advising": "Looking: follow the advice in the viewport", "well": "All is well: hold still",
    "counting down": "All is well: hold still", "burst": "Taking the burst: hold still",
    "done": "The burst has been taken",
}  # fmt: skip
"""What the status bar says of each state of the shutter."""


def _open(path: str, frames: int, mirrors_path: str, reading: dict | None, native_color: bool = False) -> Capture:
    from ...core.capture import ReadOptions, open_capture
    from ...core.capture.folders.lens_file import lens_options
    from ...core.capture.folders.rgbd_folder import read_mirrors

    options = dict(reading or {})
    intrinsics, lens = options.pop("intrinsics", ""), options.pop("lens", "")
    if intrinsics:
        options |= lens_options(intrinsics)
    mirrors = options.pop("mirrors", True) and not mirrors_path
    options = ReadOptions(**options, native_color=native_color, mirrors=mirrors)
    if lens and not intrinsics:
        capture = _open_with_lens(path, frames, options, lens)
    else:
        capture = open_capture(path, frames or None, options)
    if mirrors_path:
        capture = dataclasses.replace(capture, mirrors=read_mirrors(mirrors_path, capture.intrinsics))
    return capture


def _open_with_lens(path: str, frames: int, options: ReadOptions, sensor: str) -> Capture:
    """A capture with the published lens of a sensor, in whichever of its sizes the images are."""
    from ...core.capture import open_capture
    from ...core.capture.nominal_intrinsics import published_lenses

    first: CaptureError | None = None
    for lens in published_lenses(sensor):
        try:
            return open_capture(path, frames or None, dataclasses.replace(options, intrinsics=lens))
        except CaptureError as error:  # of another size, or something that no lens helps with
            first = first or error
    assert first is not None  # every sensor has a lens
    raise first


def _loaded(capture: Capture, path: str) -> Steps[tuple[Loaded, np.ndarray]]:
    """What is shown of a capture, and how much each pixel's readings spread over the frames, relative to z."""
    yield 0.4, AVERAGING
    from ...core.depth.depth_map import one_depth_map
    from ...core.depth.sensor_recognition import measuring_principle
    from ...core.depth.settings import DepthSettings

    depth, spread = one_depth_map(capture)
    yield 0.7, FITTING
    from ...core.views.capture_placement import upright_frame

    records = [_record_of_picks(known) for known in capture.mirrors]
    fitted = _fit(depth, capture.intrinsics, records, 0.0, None, capture.sensor)
    info = {
        "name": capture.name,
        "format": capture.format,
        "path": path,
        "frames": len(capture.depth),
        "size": [capture.intrinsics.width, capture.intrinsics.height],
        "color": capture.color is not None,
        "sensor": capture.sensor,
        "sensor_from": capture.sensor_from,
        "measures": measuring_principle(capture, DepthSettings()).measures,
        "notes": list(capture.notes),
    }
    loaded = Loaded(
        depth, capture.color, depth_colors(depth), capture.intrinsics, info,
        upright_frame(depth, capture.intrinsics), fitted.mirrors, fitted.seen,
    )  # fmt: skip
    return loaded, spread


# --- mirrors ---------------------------------------------------------------------------------------------------------


def fit_steps(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    mirrors: list[dict],
    glass_offset: float,
    numbers: list[int] | None = None,
    sensor: str = "",
) -> Steps[Fitted]:
    """Fit every mirror that has picks; one that cannot be fitted says why in its record.

    ``numbers`` are the mirrors' places in the scene's list, from 0, when these are not all.
    """
    yield 0.0, FITTING
    return _fit(depth, intrinsics, mirrors, glass_offset, numbers, sensor)


def find_mirrors_steps(
    depth: np.ndarray, color: np.ndarray | None, intrinsics: Intrinsics, glass_offset: float, sensor: str = ""
) -> Steps[Fitted]:
    """Mirrors that show themselves; none found gives an empty list."""
    yield 0.0, FINDING
    from ...core.mirror_detection.detection import find_mirrors

    found = find_mirrors(RgbdImage(depth, intrinsics, color), glass_offset=glass_offset)
    yield 0.9, FITTING
    records = _judged_records(found, depth, intrinsics, sensor)
    return Fitted(records, _seen(depth, intrinsics, found) if found else None)


def calibrate_steps(
    cloud: Cloud, mirrors: list[dict], glass_offset: float, path: str, glass_thickness: float = 0.0
) -> Steps[Fitted]:
    """Place the mirrors of a rig, found when there are none yet, and write them to the rig file ``path``."""
    yield 0.0, FITTING if mirrors else FINDING
    from ...core.mirrors.picked_mirror import MirrorSettings
    from ...core.mirrors.rig_file import read_rig, write_rig
    from ...core.pipeline.rig_calibration import calibrate

    known = tuple(_known(record) for record in mirrors)
    glass = MirrorSettings(glass_offset=glass_offset, glass_thickness=glass_thickness)
    write_rig(path, calibrate(_capture_of(cloud), known, glass))
    placed = list(read_rig(path).mirrors)  # as later captures will have them
    records = _judged_records(placed, cloud.depth, cloud.intrinsics, str(cloud.info.get("sensor", "")))
    return Fitted(records, _seen(cloud.depth, cloud.intrinsics, placed))


def rig_steps(cloud: Cloud, path: str) -> Steps[Fitted]:
    """The mirrors of a rig file, and a warning of each that has moved since it was written."""
    yield 0.0, "Reading the rig file"
    from ...core.mirrors.rig_file import mirrors_for, read_rig
    from ...core.pipeline.rig_calibration import moved_warnings

    placed, depth = list(mirrors_for(read_rig(path), cloud.intrinsics)), cloud.depth
    yield 0.5, FITTING
    warnings = tuple(moved_warnings(RgbdImage(depth, cloud.intrinsics), placed))
    records = _judged_records(placed, depth, cloud.intrinsics, str(cloud.info.get("sensor", "")))
    return Fitted(records, _seen(depth, cloud.intrinsics, placed), warnings)


def _fit(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    records: list[dict],
    glass_offset: float,
    places: list[int] | None = None,
    sensor: str = "",
) -> Fitted:
    from ...core.mirrors.picked_mirror import MirrorSettings, place_mirror

    settings = MirrorSettings(glass_offset=glass_offset)
    answers, placed, numbers = [], [], [-1, 0]
    for place, record in zip(places or range(len(records)), records, strict=True):
        try:
            if len(record["picks"]) >= ENOUGH:
                mirror = place_mirror(RgbdImage(depth, intrinsics), picks_of(record), settings)
            elif record["picks"]:
                from ...core.mirror_detection.mirror_at_picks import find_mirror_at

                mirror = find_mirror_at(RgbdImage(depth, intrinsics), picks_of(record), glass_offset=glass_offset)
            else:
                mirror = mirror_of(record)
        except MirrorError as error:
            answers.append(record | {"plane": "", "residual_mm": 0.0, "message": str(error)})
        else:
            answers.append(record_of(mirror, record["picks"]))
            placed.append(mirror)
            numbers.append(place + 1)
    answers = judged(answers, depth, intrinsics, placed, sensor)
    if not placed:
        return Fitted(answers, None)
    # a view's number is its mirror's place in the list, whether earlier ones are placed or not
    return Fitted(answers, np.array(numbers, np.int8)[_seen(depth, intrinsics, placed) + 1])


def _judged_records(mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, sensor: str) -> list[dict]:
    """Records of placed mirrors, with what each is worth."""
    return judged([record_of(mirror) for mirror in mirrors], depth, intrinsics, mirrors, sensor)


def _seen(depth: np.ndarray, intrinsics: Intrinsics, mirrors: list[Mirror]) -> np.ndarray:
    from ...core.camera import unproject
    from ...core.views.ray_sorting import sort_rays

    return sort_rays(unproject(depth, intrinsics), mirrors, 0.0)[0]


def record_of(mirror: Mirror, picks: Sequence = ()) -> dict:
    """A fitted mirror as a record; ``plane`` holds every field of it as JSON."""

    def plain(value):
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else value

    content = {field.name: plain(getattr(mirror, field.name)) for field in dataclasses.fields(mirror)}
    return {
        "name": mirror.name,
        "picks": [list(map(float, pick)) for pick in picks],
        "source": mirror.source,
        "plane": json.dumps(content),
        "residual_mm": 1000.0 * float(mirror.residual),
        "message": "",
    }


def mirror_of(record: dict) -> Mirror:
    """The fitted mirror of a record, under the name that the record has now.

    Raises
    ------
    MirrorError
        When the record has none, or one that somebody edited into nonsense.
    """
    try:
        content = json.loads(record["plane"])
        known = {field.name for field in dataclasses.fields(Mirror)}
        values = {
            name: np.array(value, dtype=np.float64) if isinstance(value, list) else value
            for name, value in content.items()
            if name in known
        }
        mirror = Mirror(**(values | {"name": record["name"]}))
        shapes = [np.shape(value) for value in (mirror.point, mirror.normal, mirror.basis)]
        if shapes != [(3,), (3,), (3, 3)]:
            raise ValueError(f"shapes are {shapes}")
        return dataclasses.replace(
            mirror, residual=float(mirror.residual), points_used=int(mirror.points_used), source=str(mirror.source)
        )
    except (ValueError, TypeError, AttributeError) as error:
        raise MirrorError(f"{record['name']}: is not placed; find the mirrors or pick points on its frame") from error


def _record_of_picks(known) -> dict:
    """What a capture says of a mirror, as a record that is not fitted yet, or of the plane it gives."""
    if known.frame_pixels is None:
        from ...core.mirrors.mirror import plane_mirror

        return record_of(plane_mirror(known.name, known.point, known.normal))
    picks = np.asarray(known.frame_pixels, dtype=float).tolist()
    return {"name": known.name, "picks": picks, "source": "picked", "plane": "", "residual_mm": 0.0, "message": ""}


# --- subject ---------------------------------------------------------------------------------------------------------


def find_subject_steps(depth: np.ndarray, intrinsics: Intrinsics, mirrors: list[dict], views: dict) -> Steps[Subject]:
    """Sort every pixel into view and part; ``views`` are the fields of ``core.views.ViewSettings``."""
    yield 0.0, "Finding the person"
    from ...core.avatar.coordinate_frame import avatar_frame
    from ...core.subject.subject_search import find_subject
    from ...core.subject.subject_views import ViewSettings

    settings = ViewSettings(**views)
    placed = [mirror_of(record) for record in mirrors]
    found = find_subject(RgbdImage(depth, intrinsics), placed, settings)
    subject = found.points[found.labels >= 0]
    lowest = float((subject @ found.up).min()) if found.floor is None else found.floor
    return Subject(
        found.seen,
        found.labels,
        (found.points @ found.up - lowest).astype(np.float32),
        found.floor is not None,
        max(settings.floor_clearance, 3.0 * found.floor_noise),
        avatar_frame(subject, found.up, found.axis, found.floor),
        [int((found.labels == view).sum()) for view in range(len(placed) + 1)],
        found.warnings,
    )


# --- avatar ----------------------------------------------------------------------------------------------------------


def build_steps(
    path: str,
    frames: int,
    mirrors: list[dict] | None = None,
    mirrors_path: str = "",
    settings: dict | None = None,
    cloud: Cloud | None = None,
    reading: dict | None = None,
) -> Steps[Built]:
    """Read a capture and reconstruct it.

    Parameters
    ----------
    path, frames
        What to read; an empty path takes ``cloud`` instead.
    mirrors : list of dict, optional
        Records; by default what the capture or ``mirrors_path`` says, and if that is nothing they are found.
    settings : dict, optional
        By the names of ``core.pipeline.Settings``, each a dict of the fields that differ from the defaults.
    reading : dict, optional
        Of :func:`.scan_records.reading_of`.
    """
    yield 0.0, READING
    if path:
        capture = _open(path, frames, mirrors_path, reading)
    elif cloud is not None:
        capture = _capture_of(cloud)
    else:
        raise CaptureError("no capture is chosen; load one first", code="not_loaded")
    yield 0.05, "Loading the program"
    from ...core.pipeline import reconstruction_steps
    from ...core.pipeline.avatar_stages import scaled

    known = None if mirrors is None else tuple(_known(record) for record in mirrors)
    steps = reconstruction_steps(capture, known, _settings_of(settings))
    return _built((yield from scaled(steps, (0.1, 1.0))))


SCAN_SHARES = (0.16, 0.32)
"""When the capture is loaded and when its mirrors are found, as shares of the time from the file to the avatar."""


def scan_steps(
    path: str,
    frames: int,
    mirrors_path: str = "",
    settings: dict | None = None,
    reading: dict | None = None,
    glass_offset: float = 0.0,
) -> Steps[Scanned]:
    """From a file to the avatar: read a capture, find its mirrors unless it names them, and reconstruct it.

    What goes wrong once the capture is read is part of the result, so that its points can be shown: arguments as of
    :func:`build_steps`.
    """
    yield 0.0, READING
    capture = _open(path, frames, mirrors_path, reading)
    yield 0.02, "Loading the program"
    from ...core.depth.settings import DepthSettings
    from ...core.pipeline import reconstruction_steps
    from ...core.pipeline.avatar_stages import scaled

    read, found = SCAN_SHARES
    loaded, spread = yield from scaled(_loaded(capture, path), (0.04, read))
    known: tuple | None = None
    if not loaded.mirrors:
        seen = yield from scaled(
            find_mirrors_steps(loaded.depth, loaded.color, loaded.intrinsics, glass_offset), (read, found)
        )
        loaded = dataclasses.replace(loaded, mirrors=seen.mirrors, seen=seen.seen)
        known = tuple(mirror_of(record) for record in seen.mirrors)
    chosen = _settings_of(settings)
    averaged = (loaded.depth, spread) if chosen.depth == DepthSettings() else None
    try:
        steps = reconstruction_steps(capture, known, chosen, averaged=averaged)
        return Scanned(loaded, _built((yield from scaled(steps, (found, 1.0)))), None)
    except MirrorScanError as error:
        return Scanned(loaded, None, error)


def _settings_of(fields: dict | None) -> Settings:
    """Settings of a reconstruction, by the fields that differ from the defaults; see :func:`build_steps`."""
    from ...core.pipeline import Settings

    base = Settings()
    return dataclasses.replace(
        base, **{name: dataclasses.replace(getattr(base, name), **chosen) for name, chosen in (fields or {}).items()}
    )


def _capture_of(cloud: Cloud) -> Capture:
    from ...core.capture import Capture

    known = {key: str(cloud.info[key]) for key in ("name", "format", "sensor", "sensor_from") if key in cloud.info}
    return Capture(cloud.depth[None], cloud.color, cloud.intrinsics, **known)


def _known(record: dict):
    """What to build with: picks, which are fitted again to all frames, else the plane that was given or found."""
    return picks_of(record) if len(record["picks"]) >= ENOUGH else mirror_of(record)


def _built(result) -> Built:
    report = result.report | {"warnings": list(result.warnings)}  # with the parts of notices, to be translated
    return Built(result.mesh, report, result.warnings, [record_of(mirror) for mirror in result.mirrors])


# --- check -----------------------------------------------------------------------------------------------------------


def check_steps(mesh: Mesh) -> Steps[Checked]:
    """Check a mesh: closed, in one piece, without crossings; and where it is not."""
    yield 0.0, "Checking the surface"
    from ...core.mesh.soundness import find_problems, mesh_report

    report = mesh_report(mesh)
    yield 0.5, "Looking for problems"
    return Checked(report, [dataclasses.asdict(problem) for problem in find_problems(mesh)])


PICTURE_SIZE = 256
"""Width and height of an asset's picture [px]."""


def picture_steps(mesh: Mesh, front: tuple[float, float, float]) -> Steps[np.ndarray]:
    """A picture (S, S, 3) uint8 of a mesh, seen from ``front``, in its own frame."""
    yield 0.0, "Drawing a picture"
    from ...core.preview.mesh_views import render_views

    return render_views(mesh, mesh.colors, [front], PICTURE_SIZE, PICTURE_SIZE)


# --- skeleton and motion ---------------------------------------------------------------------------------------------


def skeleton_steps(mesh: Mesh, texture: Texture | None = None) -> Steps[Rigged]:
    """Joints and skin weights of an avatar's mesh, in its frame but for where it stands; ``texture`` says where its
    triangles lie in the image it has."""
    yield 0.0, "Looking for the joints"
    from ...core.avatar.joints.skeleton_search import find_skeleton
    from ...core.avatar.skin_weights import skinned_mesh

    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    stand = np.eye(4)
    stand[:3, 3] = -0.5 * (low[0] + high[0]), -0.5 * (low[1] + high[1]), -low[2]
    back = np.linalg.inv(stand)
    standing = mesh.transformed(stand)
    skeleton = find_skeleton(standing)
    yield 0.6, "Computing skin weights"
    refined, weights = skinned_mesh(standing, skeleton)
    if texture is not None and len(refined.triangles) != len(mesh.triangles):
        from ...core.texture import refined_texture

        texture = refined_texture(standing, texture, refined)
    return Rigged(refined.transformed(back), skeleton.transformed(back), weights, texture)


def texture_steps(mesh: Mesh, weights: SkinWeights | None, source: Source, settings: dict) -> Steps[Textured]:
    """A texture for an avatar's mesh, in the avatar frame; ``settings`` are of ``core.texture.TextureSettings``."""
    yield 0.0, READING
    if source.path:
        capture = _open(source.path, source.frames, "", source.reading, native_color=True)
    else:
        capture = _capture_of(source.cloud)
    yield 0.05, "Loading the program"
    from ...core.pipeline.avatar_stages import scaled
    from ...core.pipeline.report import texture_summary
    from ...core.texture import TextureSettings, color_views
    from ...core.texture import texture_steps as steps

    if weights is None:
        yield 0.1, "Looking for the joints"
        try:
            _, weights = _rigged(mesh)
        except MirrorScanError:  # a thing has no joints; its texture is cut by angles
            pass
    mirrors = tuple(mirror_of(record) for record in source.mirrors)
    views = color_views(capture, mirrors, np.array(source.placement))
    job = steps(mesh, views, TextureSettings(**settings), weights)
    texture, summary = yield from scaled(job, (0.3, 1.0))
    return Textured(texture, texture_summary(summary))


def _rigged(mesh: Mesh) -> tuple[Skeleton, SkinWeights]:
    """Skeleton and skin weights of a mesh as it is, in the avatar frame."""
    from ...core.avatar.joints.skeleton_search import find_skeleton
    from ...core.avatar.skin_weights import skin_weights

    skeleton = find_skeleton(mesh)
    return skeleton, skin_weights(mesh, skeleton)


def measure_steps(mesh: Mesh, skeleton: Skeleton | None, weights: SkinWeights | None, report: dict) -> Steps[Measured]:
    """Measurements of an avatar's mesh, in the avatar frame, with the errors that its ``report`` lets expect."""
    from ...core.measurements import measure, measurement_summary, view_errors

    if skeleton is None or weights is None:
        yield 0.0, "Looking for the joints"
        skeleton, weights = _rigged(mesh)
    yield 0.6, "Measuring the body"
    try:
        views = view_errors(report) if report else ()
    except (KeyError, IndexError, TypeError, ValueError):  # of an older version, or edited into nonsense
        views = ()
    found = measure(mesh, skeleton, weights, views)
    return Measured(found, measurement_summary(found))


def reduce_steps(mesh: Mesh, triangles: int, texture: Texture | None) -> Steps[Reduced]:
    """A mesh with fewer triangles: ``core.decimation.decimate``."""
    yield 0.0, "Reducing the mesh"
    from ...core.decimation import decimate

    return decimate(mesh, triangles, texture)


def motion_steps(
    source: Motion | str, skeleton: Skeleton, soles: Soles, palms: np.ndarray, rate: float, options: dict
) -> Steps[Clip]:
    """A motion as a clip of ``skeleton``: ``core.motion.choose_clip``; ``options`` are of ``MotionOptions``."""
    yield 0.0, "Moving the skeleton"
    from ...core.motion import MotionOptions, choose_clip

    return choose_clip(source, skeleton, soles, palms, MotionOptions(**options), rate)


def dress_steps(avatar: Avatar, kind: str, ease: float, tight: bool) -> Steps[Garment]:
    """A garment cut to an avatar with a skeleton: ``core.clothes.make_garment``; ``ease`` in metres."""
    yield 0.0, "Cutting out the garment"
    from ...core.clothes import make_garment

    return make_garment(avatar.mesh, avatar.skeleton, avatar.weights, kind, ease, tight)


def garment_weight_steps(garments: Sequence[Mesh], avatar: Avatar) -> Steps[list[SkinWeights]]:
    """Skin weights of garments that lie around an avatar, in its frame and rest pose [m]."""
    found = []
    for number, garment in enumerate(garments):
        yield number / len(garments), "Computing the garment's weights"
        from ...core.clothes.weight_transfer import garment_weights

        found.append(garment_weights(garment, avatar.mesh, avatar.weights))
    return found


# --- virtual rig -----------------------------------------------------------------------------------------------------


def simulate_steps(body: Mesh | None, rig: dict, mirrors: list[dict] | None, folder: str = "") -> Steps[Simulated]:
    """Scan a body (the mannequin without one) with a virtual rig.

    Parameters
    ----------
    body : Mesh or None
        World frame: Z up, floor on z = 0 [m].
    rig : dict
        Fields of ``core.simulation.scene.Rig`` other than mirrors; without ``camera`` arguments of ``default_rig``.
    mirrors : list of dict, optional
        Fields of ``FramedMirror``; None leaves the default rig's own.
    folder : str
        Where to write the capture; "" = nowhere.
    """
    yield 0.0, "Preparing the body"
    from ...core.simulation.coverage import coverage, shares
    from ...core.simulation.mannequin import mannequin
    from ...core.simulation.scene import FramedMirror, Rig, default_rig
    from ...core.simulation.sensors import find_sensor
    from ...core.simulation.simulate import simulate, write_simulation

    subject = mannequin() if body is None else body
    if "camera" in rig:
        intrinsics = find_sensor(rig["sensor"]).intrinsics
        arranged = Rig(intrinsics=intrinsics, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors or ()), **rig)
    else:
        arranged = default_rig(**rig)
        if mirrors is not None:
            arranged = dataclasses.replace(arranged, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors))
    yield 0.2, "Simulating the camera"
    simulation = simulate(subject, arranged)
    if not simulation.capture.depth.any():
        raise MirrorScanError("the virtual camera sees nothing; turn it towards the body, or bring it within range")
    yield 0.7, "Measuring coverage"
    view = coverage(simulation)
    share = shares(view, subject.vertices, subject.triangles, len(arranged.mirrors) + 1)
    if folder:
        yield 0.75, "Writing the capture"
        write_simulation(simulation, Path(folder))
    loaded, _ = yield from _loaded(simulation.capture, folder)
    # The rig already has a place in the world: the points stay where it puts them.
    return Simulated(dataclasses.replace(loaded, placement=arranged.camera_to_avatar), view, share)


def mannequin_steps() -> Steps[Mesh]:
    """The person of a planned rig: coarse, 1.70 m, avatar frame."""
    yield 0.0, "Preparing the body"
    from ...core.simulation.mannequin import mannequin

    return mannequin(resolution=0.015)


def check_rig_steps(body: Mesh | None, rig: dict, mirrors: list[dict], height: int = 144) -> Steps[RigChecked]:
    """What a rig would see of a body (the mannequin without one), quickly.

    ``rig`` and ``mirrors`` as for :func:`simulate_steps`, ``height`` of the picture [px].
    """
    yield 0.0, "Simulating the camera"
    from ...core.rig_planning.area_coverage import area_coverage, body_samples
    from ...core.rig_planning.placement_advice import placement_advice
    from ...core.rig_planning.predicted_error import predicted_error
    from ...core.simulation.rays import look

    subject = (yield from mannequin_steps()) if body is None else body
    arranged = _rig_of(rig, mirrors)
    samples = body_samples(subject)
    covered = area_coverage(samples, arranged)
    error = predicted_error(samples, covered, arranged)
    yield 0.5, "Trying what to move"
    views = [
        {"name": view.name, "advice": "" if view.advice is None else view.advice, "hidden": view.hidden,
         **{part: view.whole(part) for part in ("head", "hands", "feet")}}
        for view in placement_advice(samples, arranged)
    ]  # fmt: skip
    yield 0.8, "Drawing what the camera sees"
    lens = arranged.intrinsics
    small = dataclasses.replace(arranged, intrinsics=lens.scaled(round(height * lens.width / lens.height), height))
    return RigChecked(
        covered.share, covered.by_view, covered.by_part, views, error.mean_mm, error.light_mm, error.lit_twice,
        look(subject, small)[0].color,
    )  # fmt: skip


def find_rig_steps(
    body: Mesh | None, room: tuple[float, float, float], sensor: str, mirrors: list[tuple[float, float]],
    frame_width: float,
) -> Steps[tuple[Placement, Mesh]]:  # fmt: skip
    """The best placement in a room, and the person it is for; sizes in metres."""
    yield 0.0, "Preparing the body"
    from ...core.rig_planning.placement_search import PlanSettings, placement_steps
    from ...core.rig_planning.rooms import Room

    subject = (yield from mannequin_steps()) if body is None else body
    settings = PlanSettings(frame_width=frame_width)
    return (yield from placement_steps(Room(*room), sensor, mirrors, subject, settings)), subject


def plan_steps(body: Mesh | None, rig: dict, mirrors: list[dict], path: str) -> Steps[str]:
    """Write the plan of a rig, whose ``rig`` has a room, as an SVG page; the path."""
    yield 0.0, "Preparing the body"
    from ...core.rig_planning.area_coverage import area_coverage, body_samples
    from ...core.rig_planning.placement_search import Placement
    from ...core.rig_planning.plan_drawing import write_plan_drawing
    from ...core.rig_planning.predicted_error import predicted_error
    from ...core.rig_planning.rooms import Room

    subject = (yield from mannequin_steps()) if body is None else body
    arranged = _rig_of(rig, mirrors)
    assert arranged.room is not None
    x0, x1, y0, y1, height = arranged.room
    yield 0.5, "Simulating the camera"
    samples = body_samples(subject)
    covered = area_coverage(samples, arranged)
    error = predicted_error(samples, covered, arranged)
    placement = Placement(arranged, Room(x1 - x0, y1 - y0, height), False, covered, error, False, 1)
    write_plan_drawing(path, placement)
    return path


def _rig_of(rig: dict, mirrors: list[dict]) -> Rig:
    from ...core.simulation.scene import FramedMirror, Rig
    from ...core.simulation.sensors import find_sensor

    intrinsics = find_sensor(rig["sensor"]).intrinsics
    return Rig(intrinsics=intrinsics, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors), **rig)


def sample_steps(folder: str) -> Steps[Loaded]:
    """Take a virtual capture of the mannequin, with what real cameras and mirrors do to light, into a new ``folder``,
    and load it."""
    yield 0.0, "Preparing the body"
    from ...core.io.atomic_files import fresh_folder
    from ...core.simulation.mannequin import mannequin
    from ...core.simulation.optics import real
    from ...core.simulation.scene import default_rig
    from ...core.simulation.simulate import simulate, write_simulation

    rig = default_rig(frames=6, optics=real("azure_kinect"))
    yield 0.05, "Simulating the camera"
    simulation = simulate(mannequin(), rig)
    yield 0.3, "Writing the capture"
    with fresh_folder(folder) as new:
        write_simulation(simulation, new)
    return (yield from load_steps(folder, 0))
