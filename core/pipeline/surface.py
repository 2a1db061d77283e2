"""Patches of all views → one closed surface: zippering, closing, report."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace

import numpy as np

from ..avatar.coordinate_frame import avatar_frame
from ..avatar.pose import SkinWeights
from ..avatar.skeleton import Skeleton
from ..avatar.skin_weights import skinned_mesh
from ..checks.plausibility import ScanFacts, check_avatar
from ..checks.view_disagreement import check_seams
from ..closing.mesh_closing import close_mesh
from ..errors import MirrorScanError, Notice
from ..hole_filling.foot_hulls import foot_hulls
from ..mesh import Mesh, Texture
from ..mirror_alignment.seam_alignment import align_seams, mirrored_views, move_views
from ..mirror_alignment.seam_glass import glass_by_seams, seen_through
from ..mirrors import Mirror
from ..mirrors.mirror import reflection_matrix
from ..patches.overlap import part_overlaps
from ..views.view_maps import ViewMaps
from ..zippering.exposure import match_exposures
from ..zippering.seam_strips import Seam
from ..zippering.zipper import zip_patches
from .report import make_report
from .scan import Clock, Scan
from .settings import Settings

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


def joining_steps(
    scan: Scan, settings: Settings, frame: str, clock: Clock
) -> Generator[tuple[float, str], None, Reconstruction]:
    """Patches → one closed mesh: the second half of the job."""
    yield 0.6, "Cutting overlaps"
    patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
    clock.lap("overlap")

    yield 0.7, "Zippering the seams"
    open_mesh, seams, twin = _zippered(patches, scan, settings)
    clock.lap("zippering")

    yield 0.78, "Comparing the seams"
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

    yield 0.8, "Closing the mesh"
    closing = settings.closing if scan.lit_twice is None else replace(settings.closing, curved=_CURVED)
    closed, notes = close_mesh(open_mesh, scan.maps, scan.up, scan.floor, closing, twin)
    clock.lap("closing")

    yield 0.95, "Checking the result"
    to_avatar = avatar_frame(closed.vertices, scan.up, scan.axis, scan.floor)
    mesh = closed.transformed(to_avatar)
    warnings = (*scan.warnings, *notes)
    skeleton = weights = None
    if settings.skeleton:
        yield 0.96, "Finding the skeleton"
        skeleton, reasons = _skeleton_of(mesh, settings)
        warnings = (*warnings, *reasons)
        if skeleton is not None:
            mesh, weights = skinned_mesh(mesh, skeleton)
        clock.lap("skeleton")
    report = make_report(mesh, to_avatar, scan, patches, seams, warnings, clock, skeleton)
    litres = report["mesh"]["volume_l"]
    facts = _facts(scan, settings, to_avatar)
    check_avatar(mesh, None if litres is None else 1e-3 * litres, facts, settings.views.object)
    if frame == "camera":
        to_camera = np.linalg.inv(to_avatar)
        mesh = closed if skeleton is None else mesh.transformed(to_camera)
        skeleton = None if skeleton is None else skeleton.transformed(to_camera)
    return Reconstruction(
        mesh, frame, to_avatar, report, warnings, tuple(patches), tuple(scan.mirrors), skeleton, weights
    )


def _skeleton_of(mesh: Mesh, settings: Settings) -> tuple[Skeleton | None, tuple[Notice, ...]]:
    """The skeleton of an avatar, or why it has none."""
    from ..avatar.joints.skeleton_search import find_skeleton

    if settings.views.object:
        return None, (Notice("skeleton: none, since the subject is an object and no person"),)
    try:
        return find_skeleton(mesh), ()
    except MirrorScanError as error:
        return None, (error.notice,)


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
