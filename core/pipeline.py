"""The whole job, read top to bottom: :func:`reconstruct`."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

import numpy as np

from .camera import Intrinsics, unproject
from .camera.noise_models import NoiseModel
from .capture import Capture, MirrorPicks
from .checks.scene_advice import check_scene
from .checks.view_disagreement import check_agreement, quoted
from .closing.mesh_closing import ClosingSettings, close_mesh
from .depth.burst_fusion import fuse_burst
from .depth.burst_motion import still_warning
from .depth.clean_views import clean
from .depth.noise_estimate import BurstNoise, burst_noise
from .depth.outliers_and_dropouts import remove_flying_pixels
from .depth.sensor_recognition import recognise
from .depth.settings import DepthSettings
from .errors import MirrorError, PicksDisagreeError, ReconstructionError
from .mesh import FILL, SEAM, Mesh
from .mesh.soundness import mesh_report
from .mirror_alignment.floor_alignment import FloorSettings, level_floor
from .mirror_alignment.reflection_alignment import JointSettings, align_reflections
from .mirror_alignment.seam_alignment import SeamSettings, align_seams, mirrored_views, move_views
from .mirror_alignment.view_alignment import AgreementSettings, agree
from .mirror_detection.detection import find_mirrors
from .mirror_detection.edge_segments import DetectionSettings
from .mirror_detection.frameless_mirrors import frameless_notes
from .mirror_detection.mirror_at_picks import contradicted, find_better_at, find_mirror_at
from .mirrors import Mirror
from .mirrors.mirror import reflection_matrix
from .mirrors.picked_mirror import MirrorSettings, place_mirror
from .numeric.point_products import transform
from .numeric.threads import each
from .patches.grid_triangulation import TriangulationSettings, triangulate_view
from .patches.overlap import part_overlaps
from .patches.view_comparison import OverlapSettings
from .rig_file import moved_warnings
from .subject.subject_search import find_subject
from .subject.subject_views import Views, ViewSettings
from .views.view_maps import ViewMaps, view_maps
from .zippering.seam_strips import Seam
from .zippering.zipper import ZipperSettings, zip_patches

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Settings:
    """Every stage's settings; the defaults work."""

    depth: DepthSettings = DepthSettings()
    mirror: MirrorSettings = MirrorSettings()
    detection: DetectionSettings = DetectionSettings()
    alignment: JointSettings = JointSettings()
    floor: FloorSettings = FloorSettings()
    agreement: AgreementSettings = AgreementSettings()
    views: ViewSettings = ViewSettings()
    triangulation: TriangulationSettings = TriangulationSettings()
    overlap: OverlapSettings = OverlapSettings()
    zipper: ZipperSettings = ZipperSettings()
    seams: SeamSettings = SeamSettings()
    closing: ClosingSettings = ClosingSettings()


@dataclass(frozen=True)
class Reconstruction:
    """What :func:`reconstruct` made of a capture.

    Parameters
    ----------
    mesh : Mesh
        Closed and coloured, in ``frame``.
    frame : str
        "avatar" or "camera".
    camera_to_avatar : np.ndarray [shape=(4, 4)]
        Rigid; camera frame → avatar frame.
    report : dict
        The content of ``report.json``, plain Python values only.
    warnings : tuple of str
        What the user should know, in plain words; also in ``report``.
    patches : tuple of Mesh
        The views' patches as they went to the zipper, camera frame.
    mirrors : tuple of Mirror
        Camera frame.
    """

    mesh: Mesh
    frame: str
    camera_to_avatar: np.ndarray
    report: dict
    warnings: tuple[str, ...] = field(default=())
    patches: tuple[Mesh, ...] = field(default=())
    mirrors: tuple[Mirror, ...] = field(default=())


def reconstruct(
    capture: Capture,
    mirrors: tuple[MirrorPicks | Mirror, ...] | None = None,
    settings: Settings = Settings(),
    progress: Progress | None = None,
    frame: str = "avatar",
) -> Reconstruction:
    """Capture → closed, coloured avatar.

    Parameters
    ----------
    capture : Capture
        One snapshot or a burst.
    mirrors : tuple of MirrorPicks or Mirror, optional
        What is known of each mirror; by default what the capture itself holds. Empty: they are found.
    settings : Settings
    progress : callable(fraction, message), optional
        Called at the start of each stage; an exception it raises stops the work.
    frame : {"avatar", "camera"}
        Frame of the mesh.

    Raises
    ------
    CaptureError, MirrorError, ReconstructionError
        The input or the scene is at fault; the message says what to do.
    """
    return finish(reconstruction_steps(capture, mirrors, settings, frame), progress)


def finish(
    steps: Generator[tuple[float, str], None, Reconstruction], progress: Progress | None = None
) -> Reconstruction:
    """Run all the pieces of a job, telling ``progress`` of each."""
    while True:
        try:
            fraction, message = next(steps)
        except StopIteration as done:
            return done.value
        if progress is not None:
            progress(fraction, message)


def reconstruction_steps(
    capture: Capture,
    mirrors: tuple[MirrorPicks | Mirror, ...] | None = None,
    settings: Settings = Settings(),
    frame: str = "avatar",
) -> Generator[tuple[float, str], None, Reconstruction]:
    """:func:`reconstruct` in pieces: yields (fraction done, what comes next), returns the :class:`Reconstruction`."""
    check_frame(frame)
    picks = capture.mirrors if mirrors is None else tuple(mirrors)
    clock = Clock()
    scan = yield from scan_steps(capture, picks, settings, clock, (0.0, 0.6))
    return (yield from joining_steps(scan, settings, frame, clock))


@dataclass(frozen=True)
class Scan:
    """What one camera saw, or several in one frame: a patch and a map a view.

    Parameters
    ----------
    patches : list of Mesh
        One a view, where the subject really is.
    maps : ViewMaps
    up, axis : np.ndarray [shape=(3,)]
        Vertical, and a point of the vertical through the subject.
    floor : float or None
        Height of the floor along ``up`` [m].
    names : list of str
        Of the views.
    mirrors : list of Mirror
    sensor : str
    warnings : tuple of str
    limits : np.ndarray [shape=(N+1, 2)]
        Nearest and farthest depth of the subject in each view [m], see :class:`.subject_views.Views`.
    noise : tuple of BurstNoise
        Of each view's readings, before smoothing.
    """

    patches: list[Mesh]
    maps: ViewMaps
    up: np.ndarray
    axis: np.ndarray
    floor: float | None
    names: list[str]
    mirrors: list[Mirror]
    sensor: str
    warnings: tuple[str, ...]
    limits: np.ndarray
    noise: tuple[BurstNoise, ...]


def scan_steps(
    capture: Capture,
    picks: tuple[MirrorPicks | Mirror, ...],
    settings: Settings,
    clock: Clock,
    part: tuple[float, float],
    meeting: np.ndarray | None = None,
    find: bool = True,
    alone: bool = True,
) -> Generator[tuple[float, str], None, Scan]:
    """One camera's readings → patches: the first half of the job, ``part`` of the whole.

    ``meeting``: where the subject is meant to stand, camera frame [m]; by default where the mirrors look. ``find``:
    without ``picks`` mirrors are searched for. ``alone``: as in :func:`.scene_advice.check_scene`.
    """

    def at(share: float) -> float:
        return part[0] + (part[1] - part[0]) * share

    camera = capture.intrinsics
    yield at(0.0), "Fusing the burst"
    depth, spread = fuse_burst(capture.depth, settings.depth)
    depth = remove_flying_pixels(depth, 1.0 / camera.fx, settings.depth)
    clock.lap("depth")

    yield at(0.17), "Fitting the mirrors"
    placed, told = place_mirrors(picks, depth, capture, settings) if picks or find else ([], ())
    clock.lap("mirrors")

    yield at(0.33), "Finding the subject"
    views = find_subject(depth, camera, placed, settings.views, meeting)
    clock.lap("views")

    yield at(0.58), "Smoothing the depth"
    sensor, model = recognise(capture, settings.depth)
    views, apart = check_agreement(depth, views, placed, camera)
    faults = [*apart, *check_scene(depth, views, placed, camera, model, alone)]
    scatter = burst_noise(len(capture.depth), spread, depth, views.labels, len(placed) + 1)
    moved = still_warning(capture.depth, views.labels, camera.fx, settings.depth)
    depth, views, noise = clean_views(
        depth, views, len(placed), camera, settings.depth, model, spread if len(capture.depth) > 1 else None
    )
    clock.lap("smoothing")

    yield at(0.83), "Triangulating the views"
    maps, patches = each(
        lambda work: work(),
        (
            lambda: view_maps(depth, views.labels, views.seen, camera, placed, noise),
            lambda: make_patches(depth, views, placed, noise, capture, settings.triangulation),
        ),
    )
    clock.lap("triangulation")
    blind = [  # the reason why a mirror shows nobody is told instead where it is known
        text for text in views.warnings
        if not any(text.startswith(f"{m.name}:") and quoted(m) in fault for m in placed for fault in faults)
    ]  # fmt: skip
    warnings = (*told, *((moved,) if moved else ()), *blind, *faults)
    return Scan(
        patches, maps, views.up, views.axis, views.floor, view_names(placed), placed, sensor, warnings, views.limits,
        scatter,
    )  # fmt: skip


def joining_steps(
    scan: Scan, settings: Settings, frame: str, clock: Clock
) -> Generator[tuple[float, str], None, Reconstruction]:
    """Patches → one closed mesh: the second half of the job."""
    yield 0.6, "Parting overlaps"
    patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
    clock.lap("overlap")

    yield 0.7, "Zippering the seams"
    open_mesh, seams, twin = zip_patches(patches, scan.maps, scan.up, scan.axis, scan.floor, settings.zipper)
    clock.lap("zippering")

    yield 0.78, "Comparing the seams"
    better = seams_aligned(scan, open_mesh, settings)
    if better is not None:
        scan = better
        patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
        open_mesh, seams, twin = zip_patches(patches, scan.maps, scan.up, scan.axis, scan.floor, settings.zipper)
    clock.lap("seams")

    yield 0.8, "Closing the mesh"
    closed, notes = close_mesh(open_mesh, scan.maps, scan.up, scan.floor, settings.closing, twin)
    clock.lap("closing")

    yield 0.95, "Checking the result"
    to_avatar = avatar_frame(closed, scan)
    mesh = closed.transformed(to_avatar)
    warnings = (*scan.warnings, *notes)
    report = _report(mesh, to_avatar, scan, patches, seams, warnings, clock)
    return Reconstruction(
        mesh if frame == "avatar" else closed, frame, to_avatar, report, warnings, tuple(patches), tuple(scan.mirrors)
    )


def seams_aligned(scan: Scan, mesh: Mesh, settings: Settings) -> Scan | None:
    """The scan with its mirrors where the seams of its zippered ``mesh`` want them; None when they stay."""

    def join(patches: list[Mesh], maps: ViewMaps) -> Mesh:
        parted = part_overlaps(patches, maps, settings.overlap)
        return zip_patches(parted, maps, scan.up, scan.axis, scan.floor, settings.zipper)[0]

    mirrors, notes = align_seams(
        scan.mirrors, scan.patches, scan.maps, mesh, join, settings.seams, settings.mirror.glass_offset
    )
    if not notes:
        return None
    motions = [
        reflection_matrix(new) @ reflection_matrix(old) for new, old in zip(mirrors, scan.mirrors, strict=True)
    ]  # fmt: skip
    patches, maps = move_views(scan.patches, scan.maps, mirrored_views(scan.maps), motions)
    return replace(scan, mirrors=mirrors, patches=patches, maps=maps, warnings=(*scan.warnings, *notes))


def check_frame(frame: str) -> None:
    if frame not in ("avatar", "camera"):
        raise ReconstructionError(f'frame must be "avatar" or "camera", got "{frame}"')


def place_mirrors(
    known: tuple[MirrorPicks | Mirror, ...], depth: np.ndarray, capture: Capture, settings: Settings
) -> tuple[list[Mirror], tuple[str, ...]]:
    """The mirrors that were picked or given, or else those that the depth map shows; and what to warn of."""
    camera, offset = capture.intrinsics, settings.mirror.glass_offset
    cloud = unproject(depth, camera)

    def place(one: MirrorPicks | Mirror) -> Mirror:
        if isinstance(one, Mirror):
            return one
        if one.frame_pixels is not None and len(one.frame_pixels) < 3:
            return find_mirror_at(one, depth, camera, settings.detection, offset)
        mirror, fault = None, None
        try:
            mirror = place_mirror(one, depth, camera, settings.mirror, cloud)
        except PicksDisagreeError as error:
            fault = error
        mirror = find_better_at(one, mirror, depth, camera, settings.detection, offset)
        if mirror is None:
            raise fault
        return mirror

    placed = [place(one) for one in known]
    warnings = list(moved_warnings([m for m in placed if m.source == "rig file"], depth, camera))
    warnings += [
        f"{m.name}: the plane through its picks does not look like a mirror's: hardly a frame stands in it, or what is "
        "seen in it would stand where the camera looks through; pick again, on its frame only"
        for k, m in enumerate(placed)
        if m.source == "picked" and contradicted(m, depth, camera, placed[:k] + placed[k + 1 :])
    ]
    if not known:
        placed = find_mirrors(depth, camera, capture.color, settings.detection, offset)
    if not placed:
        raise MirrorError(
            f"{capture.name}: no mirror was found: none is given, and no straight frame with the person's reflection "
            "in it is seen; pick points on each mirror's frame and save them in mirrors.json beside the capture, or "
            "elsewhere (option “mirrors”); a frame at least 3 cm wide and 10 cm off the wall is found by itself, and a "
            "mirror without one where the camera sees some of the same skin directly and in it"
        )
    placed, notes = align_reflections(placed, depth, camera, settings.alignment)
    placed = level_floor(placed, depth, camera, settings.floor)
    placed = agree(placed, depth, camera, settings.agreement)
    return placed, (*warnings, *notes, *frameless_notes(placed))


def clean_views(
    depth: np.ndarray,
    views: Views,
    mirrors: int,
    camera: Intrinsics,
    settings: DepthSettings,
    model: NoiseModel | None = None,
    spread: np.ndarray | None = None,
) -> tuple[np.ndarray, Views, np.ndarray]:
    """:func:`.clean_views.clean` over all views; returns the noise (N+1,) that was left, relative to z."""
    depth, labels, noise = clean(depth, views.labels, mirrors + 1, camera.fx, settings, model, spread)
    return depth, replace(views, labels=labels), noise


def make_patches(
    depth: np.ndarray,
    views: Views,
    mirrors: list[Mirror],
    noise: np.ndarray,
    capture: Capture,
    settings: TriangulationSettings,
) -> list[Mesh]:
    """Each view triangulated where the camera laid it, then flipped over its mirror: that reverses the winding."""
    camera = capture.intrinsics
    points = unproject(depth, camera)

    def make(view: int) -> Mesh:
        patch = triangulate_view(
            depth, views.labels, view, points, 1.0 / camera.fx, noise[view], capture.color, settings
        )
        if view > 0:
            patch = patch.transformed(reflection_matrix(mirrors[view - 1]))
            patch = replace(patch, triangles=np.ascontiguousarray(patch.triangles[:, ::-1]))
        return patch

    patches = each(make, range(len(mirrors) + 1))
    if not any(len(patch.triangles) for patch in patches):
        raise ReconstructionError(
            "the subject's readings are too scattered to connect; use a longer burst or come closer to the camera"
        )
    return patches


def avatar_frame(mesh: Mesh, views: Views | Scan) -> np.ndarray:
    """Camera frame → avatar frame (4, 4): Z up, facing −Y (towards the camera), soles on z = 0, between the feet x =
    y = 0. What is not on the floor has its lowest point there."""
    up = views.up
    away = views.axis - (views.axis @ up) * up
    away /= np.linalg.norm(away)
    rotation = np.stack((np.cross(away, up), away, up))
    vertices = transform(mesh.vertices, np.column_stack((rotation, np.zeros(3))))
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    if views.floor is not None and low < views.floor + 0.1 * (high - views.floor):  # else it is not on that floor
        low = views.floor
    feet = vertices[vertices[:, 2] <= low + 0.1 * (high - low)]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -0.5 * (feet.min(axis=0) + feet.max(axis=0))
    matrix[2, 3] = -low
    return matrix


class Clock:
    """Milliseconds of each stage, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + 1000.0 * (now - self._last)
        self._last = now


def view_names(mirrors: list[Mirror]) -> list[str]:
    return ["direct"] + [mirror.name for mirror in mirrors]


def _report(
    mesh: Mesh,
    to_avatar: np.ndarray,
    scan: Scan,
    patches: list[Mesh],
    seams: list[Seam],
    warnings: tuple[str, ...],
    clock: Clock,
) -> dict:
    checked = mesh_report(mesh)
    names = scan.names
    person = np.concatenate([patch.vertices for patch in patches])[::97]
    clock.lap("checking")
    return {
        "camera_to_avatar": to_avatar.tolist(),
        "sensor": scan.sensor,
        "mirrors": [
            {
                "name": m.name,
                "point": m.point.tolist(),
                "normal": m.normal.tolist(),
                "residual_mm": 1000.0 * m.residual,
                "points_used": m.points_used,
                "source": m.source,
                "refined": m.refined,
                "moved_by": list(m.moved_by),
                "moved_mm": 1000.0 * m.moved,
                "covariance": None if m.covariance is None else m.covariance.tolist(),
                "displacement_mm": None if m.covariance is None else 1000.0 * m.displacement(person),
            }
            for m in scan.mirrors
        ],
        "views": [
            {
                "name": name,
                "pixels": int((scan.maps.labels == k).sum()),
                "depth_m": None if np.isnan(scan.limits[k]).any() else scan.limits[k].tolist(),
                "frames": scan.noise[k].frames,
                "frame_noise_mm": _millimetres(scan.noise[k].frame),
                "expected_noise_mm": _millimetres(scan.noise[k].expected),
                "noise_mm": _millimetres(scan.noise[k].fused),
                "vertices": len(patch.vertices),
                "triangles": len(patch.triangles),
            }
            for k, (name, patch) in enumerate(zip(names, patches, strict=True))
        ],
        "seams": _seam_summary(seams, names),
        "mesh": {
            "vertices": len(mesh.vertices),
            "triangles": len(mesh.triangles),
            "watertight": checked["watertight"],
            "manifold": checked["manifold"],
            "components": checked["components"],
            "euler_characteristic": checked["euler_characteristic"],
            "self_intersections": checked["self_intersections"],
            "seam_triangles": int((mesh.kind == SEAM).sum()),
            "fill_triangles": int((mesh.kind == FILL).sum()),
            "volume_l": None if checked["volume_m3"] is None else 1000.0 * checked["volume_m3"],
            "height_m": float(np.ptp(mesh.vertices[:, 2])),
        },
        "timings_ms": {name: round(value, 2) for name, value in clock.laps.items()},
        "warnings": list(warnings),
    }


def _millimetres(value: float | None) -> float | None:
    return None if value is None else round(1000.0 * value, 3)


def _seam_summary(seams: list[Seam], names: list[str]) -> list[dict]:
    """One row a pair of views, seams weighed by their length."""
    rows = []
    for pair in sorted({seam.views for seam in seams}):
        mine = [seam for seam in seams if seam.views == pair]
        length = sum(seam.length for seam in mine)
        rows.append(
            {
                "between": [names[pair[0]] if pair[0] >= 0 else "made", names[pair[1]] if pair[1] >= 0 else "made"],
                "method": sorted({seam.method for seam in mine}),
                "length_m": length,
                "mean_gap_mm": 1000.0 * sum(s.mean_gap * s.length for s in mine) / length if length else 0.0,
                "max_gap_mm": 1000.0 * max(seam.max_gap for seam in mine),
            }
        )
    return rows
