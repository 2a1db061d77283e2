"""Patches of all views → one closed surface: zippering, closing, report."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..avatar.coordinate_frame import avatar_frame
from ..avatar.pose import SkinWeights
from ..avatar.skeleton import Skeleton
from ..capture import Capture
from ..checks.plausibility import ScanFacts, check_avatar
from ..checks.view_disagreement import check_seams
from ..closing.mesh_closing import close_mesh
from ..closing.reading_fit import fit_to_readings
from ..hole_filling.foot_hulls import foot_hulls
from ..light.surface_light import placed_readings
from ..mesh import Mesh, Texture
from ..mesh.soundness import mesh_report
from ..mirror_alignment.seam_alignment import align_seams, mirrored_views, move_views
from ..mirror_alignment.seam_glass import glass_by_seams, seen_through
from ..mirrors import Mirror
from ..mirrors.mirror import in_frame, reflection_matrix
from ..patches.overlap import part_overlaps
from ..views.view_maps import ViewMaps
from ..zippering.exposure import match_exposures
from ..zippering.seam_strips import Seam
from ..zippering.zipper import zip_patches
from .avatar_stages import Shot, avatar_steps, scaled, shares
from .report import make_report, scan_report
from .scan import Clock, KnownScene, Scan
from .settings import Settings

if TYPE_CHECKING:
    from ..measurements import Measurements

SCAN_SHARE = 0.6
"""Of the progress from capture to closed mesh: as far as the patches."""

_CURVED = 1.0
"""Where light comes two ways readings are missing round the flanks, which are never hollow: along the spine both ways
are as long, and it is read."""


@dataclass(frozen=True)
class Reconstruction:
    """What :func:`.reconstruction.reconstruct` made of a capture.

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
        What the user should know; also in ``report``. Those that carry more than their text are
        :class:`.notices.Notice`.
    patches : tuple of Mesh
        The views' patches as they went to the zipper, camera frame.
    mirrors : tuple of Mirror
        Camera frame.
    skeleton : Skeleton or None
        In ``frame``; None where none was asked for, or none was found.
    weights : SkinWeights or None
        Of the mesh's vertices, where there is a skeleton.
    texture : Texture or None
        Of the mesh's triangles, where one was asked for.
    measurements : Measurements or None
        Of the body, where they were asked for and it has a skeleton.
    scene : KnownScene or None
        What the next frame of a recording need not find again; its mirrors are ``mirrors``.
    """

    mesh: Mesh
    frame: str
    camera_to_avatar: np.ndarray
    report: dict
    warnings: tuple[str, ...] = field(default=())
    patches: tuple[Mesh, ...] = field(default=())
    mirrors: tuple[Mirror, ...] = field(default=())
    skeleton: Skeleton | None = None
    weights: SkinWeights | None = None
    texture: Texture | None = None
    measurements: Measurements | None = None
    scene: KnownScene | None = None


@dataclass(frozen=True)
class PlacedCapture:
    """A capture of a scan.

    Parameters
    ----------
    capture : Capture
    pose : np.ndarray [shape=(4, 4)]
        Rigid: the camera's frame → that of the scan.
    mirrors : int
        How many of the scan's mirrors are this camera's; they stand in the order of the cameras.
    """

    capture: Capture
    pose: np.ndarray
    mirrors: int


@dataclass(frozen=True)
class ClosedSurface:
    """What zippering and closing made of a scan, and how; ``mesh`` in the avatar frame, ``in_camera`` in the scan's."""

    mesh: Mesh
    in_camera: Mesh
    to_avatar: np.ndarray
    soundness: dict
    scan: Scan
    patches: list[Mesh]
    seams: list[Seam]
    warnings: tuple[str, ...]


def joining_steps(
    scan: Scan, cameras: Sequence[PlacedCapture], settings: Settings, frame: str, clock: Clock, known: bool = False
) -> Generator[tuple[float, str], None, Reconstruction]:
    """Patches → the avatar: the second half of the job. ``known``: the mirrors are, and are not judged by the seams."""
    end = shares(settings)["scan"][1]
    closed = yield from scaled(closing_steps(scan, settings, clock, known), (SCAN_SHARE * end, end))
    scan, to_avatar = closed.scan, closed.to_avatar
    of_scan = scan_report(scan, closed.patches, closed.seams, to_avatar)
    shots = _shots(scan, cameras, to_avatar)
    avatar = yield from avatar_steps(closed.mesh, shots, of_scan, settings, clock)
    if not settings.skeleton:  # it was of use for other parts only
        avatar = replace(avatar, skeleton=None, weights=None)
    soundness = closed.soundness if avatar.mesh is closed.mesh else mesh_report(avatar.mesh)
    clock.lap("checking")
    warnings = (*closed.warnings, *avatar.notices)
    report = make_report(of_scan, scan, avatar, soundness, warnings, clock)
    if frame == "camera":
        unchanged = avatar.mesh is closed.mesh
        avatar = avatar.transformed(np.linalg.inv(to_avatar))
        if unchanged:  # bit for bit as it was closed
            avatar = replace(avatar, mesh=closed.in_camera)
    return Reconstruction(
        avatar.mesh, frame, to_avatar, report, warnings, tuple(closed.patches), tuple(scan.mirrors),
        avatar.skeleton, avatar.weights, avatar.texture, avatar.measurements,
        None if scan.scene is None else replace(scan.scene, mirrors=tuple(scan.mirrors)),
    )  # fmt: skip


def closing_steps(
    scan: Scan, settings: Settings, clock: Clock, known: bool = False
) -> Generator[tuple[float, str], None, ClosedSurface]:
    """Patches → one closed mesh that can be right. ``known``: the mirrors are, and are not judged by the seams.

    Raises
    ------
    ReconstructionError
        The result cannot be right; the message says the likely cause.
    """
    yield 0.0, "Cutting overlaps"
    patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
    clock.lap("overlap")

    yield 0.25, "Joining the views"
    open_mesh, seams, twin = _zippered(patches, scan, settings)
    clock.lap("zippering")

    yield 0.45, "Comparing the seams"
    if not known:
        scan, thick = glass_shown(scan, open_mesh, settings)
        aligned = None if thick else seams_aligned(scan, open_mesh, settings)
        scan = aligned or scan
        if thick or aligned is not None:
            patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
            open_mesh, seams, twin = _zippered(patches, scan, settings)
        faults = check_seams(scan.mirrors, scan.maps, open_mesh, scan.timed, scan.warnings)
        scan = replace(scan, warnings=(*scan.warnings, *faults))
    if settings.colors.exposure:
        open_mesh = match_exposures(open_mesh, np.linalg.det(scan.maps.to_view[:, :3, :3]) < 0)
    clock.lap("seams")

    yield 0.5, "Closing the mesh"
    closing = settings.closing if scan.lit_twice is None else replace(settings.closing, curved=_CURVED)
    closed, notes = close_mesh(open_mesh, scan.maps, scan.up, scan.floor, closing, twin)
    if scan.lit is not None:
        readings = placed_readings(scan.lit, scan.mirrors)
        closed = fit_to_readings(closed, readings, scan.up, scan.floor, free_space=scan.maps.free_space)
    clock.lap("closing")

    yield 0.87, "Checking the result"
    to_avatar = avatar_frame(closed.vertices, scan.up, scan.axis, scan.floor)
    mesh = closed.transformed(to_avatar)
    soundness = mesh_report(mesh, crossings=not known)
    check_avatar(mesh, soundness["volume_m3"], _facts(scan, settings, to_avatar), settings.views.object)
    clock.lap("checking")
    return ClosedSurface(mesh, closed, to_avatar, soundness, scan, patches, seams, (*scan.warnings, *notes))


def _shots(scan: Scan, cameras: Sequence[PlacedCapture], to_avatar: np.ndarray) -> list[Shot]:
    """What each camera took, with its own mirrors in its own frame."""
    shots, first = [], 0
    for camera in cameras:
        to_camera = np.linalg.inv(camera.pose)
        mirrors = tuple(in_frame(mirror, to_camera) for mirror in scan.mirrors[first : first + camera.mirrors])
        first += camera.mirrors
        shots.append(Shot(camera.capture, mirrors, to_avatar @ camera.pose))
    return shots


def _zippered(patches: list[Mesh], scan: Scan, settings: Settings) -> tuple[Mesh, list[Seam], np.ndarray]:
    """:func:`.zipper.zip_patches` with what a camera gave up of a person's feet made."""
    made = None
    if scan.lit_twice is not None and scan.floor is not None and not settings.views.object:
        made = foot_hulls(patches, scan.maps.free_space, scan.up, scan.floor)
    return zip_patches(patches, scan.maps, scan.up, scan.axis, scan.floor, settings.zipper, made)


def _facts(scan: Scan, settings: Settings, to_avatar: np.ndarray) -> ScanFacts:
    """What a result is judged by."""
    shown = set(np.unique(scan.maps.labels).tolist())
    return ScanFacts(
        # several cameras see a trunk, or anything else, as well
        stands=scan.floor is not None and len(scan.lenses) == 1,
        cut=scan.cut,
        distance=float(np.nanmin(scan.limits[:, 0])),
        highest=np.inf if scan.floor is None else settings.views.max_height,
        lenses=scan.lenses,
        mirrors=scan.mirrors,
        blind=[name for k, name in enumerate(scan.names) if k not in shown],
        warnings=scan.warnings,
        to_avatar=to_avatar,
    )


def glass_shown(scan: Scan, mesh: Mesh, settings: Settings) -> tuple[Scan, bool]:
    """The scan with glass as thick and bowed as the seams of its zippered ``mesh`` show, and whether they show it.

    Asked of cameras that measure time only. The mirrors are less certain where thick glass is neither shown nor
    excluded.
    """
    if scan.lit_twice is None and not scan.timed:
        return scan, False
    mirrors, notes = glass_by_seams(
        scan.mirrors,
        scan.maps,
        mesh,
        settings.seam_glass,
        scan.lit_twice is not None,
        scan.outline,
        scan.lenses[0] if scan.outline is not None else None,
        scan.patches,
    )
    if not notes:
        return replace(scan, mirrors=mirrors), False
    patches, maps = seen_through(scan.patches, scan.maps, scan.mirrors, mirrors)
    return replace(scan, mirrors=mirrors, patches=patches, maps=maps, warnings=(*scan.warnings, *notes)), True


def seams_aligned(scan: Scan, mesh: Mesh, settings: Settings) -> Scan | None:
    """The scan with its mirrors aligned by the seams of its zippered ``mesh``; None when they stay."""

    def join(patches: list[Mesh], maps: ViewMaps) -> Mesh:
        cut = part_overlaps(patches, maps, settings.overlap)
        return zip_patches(cut, maps, scan.up, scan.axis, scan.floor, settings.zipper)[0]

    mirrors, notes = align_seams(
        scan.mirrors, scan.patches, scan.maps, mesh, join, settings.seams, settings.mirror.behind_frame
    )
    if not notes:
        return None
    motions = [
        reflection_matrix(new) @ reflection_matrix(old) for new, old in zip(mirrors, scan.mirrors, strict=True)
    ]  # fmt: skip
    patches, maps = move_views(scan.patches, scan.maps, mirrored_views(scan.maps), motions)
    return replace(scan, mirrors=mirrors, patches=patches, maps=maps, warnings=(*scan.warnings, *notes))
