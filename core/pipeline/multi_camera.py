"""Several captures of one subject, with or without mirrors: from known poses, or registered.

:func:`reconstruct_views` and :func:`reconstruct_registered`.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np

from ..capture import Capture, MirrorPicks
from ..capture.camera_poses import check_pose
from ..checks.camera_contradictions import check_cameras
from ..errors import CaptureError, Notice, ReconstructionError
from ..mesh.triangle_mesh import merge
from ..mirrors.mirror import in_frame
from ..numeric.blas_threads import one_blas_thread
from ..numeric.point_products import transform
from ..registration.pairwise import IcpSettings, find_backend
from ..registration.turntable import RegisteredViews, SubjectView, register_turntable
from ..views.view_maps import stack_maps
from .avatar_stages import check_wishes, shares
from .lines_of_sight import Figures, check_meeting_point, check_way_round, meeting_point_of
from .reconstruction import Progress, check_frame, finish
from .scan import Clock, Scan, scan_steps
from .settings import Settings
from .surface import SCAN_SHARE, PlacedCapture, Reconstruction, joining_steps

MAX_VIEWS = 127
"""Views are numbered in one signed byte."""

DEFAULTS = Settings()

_SAME_FLOOR = 0.04
"""Floors of two cameras that differ more than this in height under the subject are reported [m]."""

_SAME_UP = 3.0
"""Verticals of two cameras that differ more than this are reported [degrees]."""


def reconstruct_views(
    captures: Sequence[Capture],
    poses: Sequence[np.ndarray],
    mirrors: Sequence[tuple[MirrorPicks, ...] | None] | None = None,
    settings: Settings = DEFAULTS,
    progress: Progress | None = None,
    frame: str = "avatar",
) -> Reconstruction:
    """Several captures of one still subject, taken from known poses → one closed, coloured avatar.

    Parameters
    ----------
    captures : sequence of Capture
        One a camera; the first looks at the subject's front. Cameras may differ in make and resolution.
    poses : sequence of np.ndarray [shape=(4, 4)]
        Rigid: each camera frame → a frame they all share, any [m].
    mirrors : sequence of (tuple of MirrorPicks or None), optional
        What is known of each camera's mirrors; None: what its capture holds. Unlike in
        :func:`.reconstruction.reconstruct` mirrors are not searched for: a camera without any is the common case here.
    settings, progress, frame
        As in :func:`.reconstruction.reconstruct`; the "camera" frame is the first camera's.

    Raises
    ------
    CaptureError, MirrorError, ReconstructionError
        The input or the scene is at fault; the message says what to do.
    """
    return finish(reconstruction_views_steps(captures, poses, mirrors, settings, frame), progress)


def reconstruction_views_steps(
    captures: Sequence[Capture],
    poses: Sequence[np.ndarray],
    mirrors: Sequence[tuple[MirrorPicks, ...] | None] | None = None,
    settings: Settings = DEFAULTS,
    frame: str = "avatar",
) -> Generator[tuple[float, str], None, Reconstruction]:
    """:func:`reconstruct_views` in pieces, as :func:`.reconstruction.reconstruction_steps`."""
    check_frame(frame)
    if not captures or len(poses) != len(captures):
        raise CaptureError(f"{len(captures)} capture(s) come with {len(poses)} pose(s); give one pose for each capture")
    check_wishes(captures, settings)
    names = _distinct([capture.name for capture in captures])
    to_world = [check_pose(pose, name) for pose, name in zip(poses, names, strict=True)]
    to_first = [np.linalg.inv(to_world[0]) @ pose for pose in to_world]
    known = _known_mirrors(captures, mirrors)
    clock = Clock()
    figures = Figures(captures, known, settings)
    meeting_point = meeting_point_of(to_first, figures, settings)
    scans, whole = [], SCAN_SHARE * shares(settings)["scan"][1]
    for k, (capture, pose) in enumerate(zip(captures, to_first, strict=True)):
        meeting = None if meeting_point is None else transform(meeting_point[None], np.linalg.inv(pose))[0]
        part = (whole * k / len(captures), whole * (k + 1) / len(captures))
        alone = len(captures) == 1
        try:
            placed = figures.mirrors(k)
            with one_blas_thread():
                scan = yield from scan_steps(capture, placed, settings, clock, part, meeting, find=False, alone=alone)
        except ReconstructionError as error:
            if meeting_point is not None:
                check_way_round(to_world, figures)
                check_meeting_point(meeting_point, to_first, figures, names)
            raise (
                ReconstructionError("{camera}: {error}", camera=names[k], error=error) if not alone else error
            ) from None
        scans.append(scan)
    try:
        joined = join_scans(scans, to_first, names)
    except ReconstructionError:
        check_way_round(to_world, figures)
        raise
    cameras = [
        PlacedCapture(capture, pose, len(scan.mirrors))
        for capture, pose, scan in zip(captures, to_first, scans, strict=True)
    ]
    with one_blas_thread():
        return (yield from joining_steps(joined, cameras, settings, frame, clock))


def reconstruct_registered(
    captures: Sequence[Capture],
    step: float | None = None,
    mirrors: Sequence[tuple[MirrorPicks, ...] | None] | None = None,
    settings: Settings = DEFAULTS,
    progress: Progress | None = None,
    frame: str = "avatar",
    icp: IcpSettings = IcpSettings(),
) -> Reconstruction:
    """Several captures of one subject without poses → one closed, coloured avatar.

    Parameters
    ----------
    captures : sequence of Capture
        In the order in which they were taken; the first shows the subject's front.
    step : float, optional
        By how much the subject turned to its left from one capture to the next [degrees], or the camera went round it
        with the clock, seen from above; negative the other way. Without, once round evenly, whichever way fits.
    mirrors, settings, progress, frame
        As in :func:`reconstruct_views`.
    icp : IcpSettings

    Raises
    ------
    MirrorScanError
        No package is installed that registers views.
    CaptureError, MirrorError, ReconstructionError
        The input is at fault, or the captures contradict each other; the message says what to do.
    """
    return finish(registered_views_steps(captures, step, mirrors, settings, frame, icp), progress)


def registered_views_steps(
    captures: Sequence[Capture],
    step: float | None = None,
    mirrors: Sequence[tuple[MirrorPicks, ...] | None] | None = None,
    settings: Settings = DEFAULTS,
    frame: str = "avatar",
    icp: IcpSettings = IcpSettings(),
) -> Generator[tuple[float, str], None, Reconstruction]:
    """:func:`reconstruct_registered` in pieces, as :func:`.reconstruction.reconstruction_steps`."""
    check_frame(frame)
    if len(captures) < 2:
        raise CaptureError(f"{len(captures)} capture(s) cannot be registered with each other; give two or more")
    check_wishes(captures, settings)
    names = _distinct([capture.name for capture in captures])
    known = _known_mirrors(captures, mirrors)
    find_backend(icp.backend)  # before work that would be in vain
    clock = Clock()
    scans, whole = [], SCAN_SHARE * shares(settings)["scan"][1]
    for k, (capture, picks) in enumerate(zip(captures, known, strict=True)):
        part = (0.8 * whole * k / len(captures), 0.8 * whole * (k + 1) / len(captures))
        try:
            with one_blas_thread():
                scans.append((yield from scan_steps(capture, picks, settings, clock, part, find=False, alone=False)))
        except ReconstructionError as error:
            raise ReconstructionError("{camera}: {error}", camera=names[k], error=error) from None
    yield 0.8 * whole, "Registering the captures"
    with one_blas_thread():
        registered = register_turntable([subject_view(scan) for scan in scans], step, icp)
    clock.lap("registration")
    joined = join_scans(scans, list(registered.poses), names)
    joined = replace(joined, warnings=(*joined.warnings, *registered.notes))
    cameras = [
        PlacedCapture(capture, pose, len(scan.mirrors))
        for capture, pose, scan in zip(captures, registered.poses, scans, strict=True)
    ]
    with one_blas_thread():
        made = yield from joining_steps(joined, cameras, settings, frame, clock)
    return replace(made, report={**made.report, "registration": registration_report(registered, names)})


def _known_mirrors(
    captures: Sequence[Capture], mirrors: Sequence[tuple[MirrorPicks, ...] | None] | None
) -> list[tuple[MirrorPicks, ...]]:
    """Of each capture the mirrors that are given for it, else its own; refuses more views than can be numbered."""
    known = [
        tuple(capture.mirrors if mirrors is None or (picks := mirrors[k]) is None else picks)
        for k, capture in enumerate(captures)
    ]
    views = len(captures) + sum(map(len, known))
    if views > MAX_VIEWS:
        raise CaptureError(f"{views} views are more than the {MAX_VIEWS} that can be joined; leave some captures out")
    return known


def subject_view(scan: Scan) -> SubjectView:
    """What a scan shows of the subject, for registration."""
    seen = merge(scan.patches)
    return SubjectView(seen.vertices, seen.triangles, scan.up, scan.floor)


def registration_report(registered: RegisteredViews, names: Sequence[str]) -> dict:
    """What was found of captures without poses: plain Python values.

    ``residual_mm`` is the root mean square of all pairs; a pair's ``corrected_mm`` and ``corrected_deg`` say by how
    much the other pairs moved it.
    """
    return {
        "residual_mm": 1e3 * registered.residual,
        "angles_deg": registered.angles.tolist(),
        "camera_to_first": registered.poses.tolist(),
        "pairs": [
            {
                "between": [names[one], names[other]],
                "residual_mm": 1e3 * found.residual,
                "overlap": found.overlap,
                "corrected_mm": 1e3 * float(shift),
                "corrected_deg": float(np.degrees(turn)),
            }
            for (one, other), found, shift, turn in zip(
                registered.pairs, registered.registrations, registered.shifted, registered.turned, strict=True
            )
        ],
    }


def join_scans(scans: Sequence[Scan], poses: Sequence[np.ndarray], names: Sequence[str]) -> Scan:
    """What several cameras saw, in one frame: views numbered through, vertical and floor agreed upon.

    Parameters
    ----------
    scans : sequence of Scan
        Each in its camera's frame.
    poses : sequence of np.ndarray [shape=(4, 4)]
        Each camera's frame → the common frame.
    names : sequence of str
        Of the cameras.

    Raises
    ------
    ReconstructionError
        The cameras do not see the same subject where the poses say it is.
    """
    warnings = [
        Notice("{camera}: {warning}", camera=name, warning=text)
        for name, scan in zip(names, scans, strict=True) for text in scan.warnings
    ]  # fmt: skip
    axes = np.array([transform(scan.axis[None], pose)[0] for scan, pose in zip(scans, poses, strict=True)])
    weights = np.array([float((scan.maps.labels >= 0).sum()) for scan in scans])
    floor_known = np.array([scan.floor is not None for scan in scans])
    ups = np.array([pose[:3, :3] @ scan.up for scan, pose in zip(scans, poses, strict=True)])
    chosen = floor_known if floor_known.any() else np.ones(len(scans), np.bool_)
    up = np.average(ups[chosen], axis=0, weights=weights[chosen])
    up /= np.linalg.norm(up)
    axis = np.average(axes, axis=0, weights=weights)
    warnings += check_cameras(
        [scan.patches for scan in scans], [scan.maps for scan in scans], poses, names, axes - np.outer(axes @ up, up)
    )
    floor = None
    if floor_known.any():
        # each camera's floor, as high as it is under the subject
        heights = np.array(
            [
                (axis @ up) - (axis @ u - (scan.floor + u @ pose[:3, 3]))
                for scan, pose, u, seen in zip(scans, poses, ups, floor_known, strict=True)
                if seen
            ]
        )
        floor = float(np.average(heights, weights=weights[floor_known]))
        tilt = np.degrees(np.arccos(np.clip((ups[floor_known] * up).sum(axis=1), -1, 1)))
        height_gap = np.abs(heights - np.median(heights))
        if tilt.max() > _SAME_UP or height_gap.max() > _SAME_FLOOR:
            worst = np.flatnonzero(floor_known)[int(np.argmax(np.maximum(tilt / _SAME_UP, height_gap / _SAME_FLOOR)))]
            warnings.append(
                Notice(
                    "{name}: its floor does not agree with the other cameras' (up to {tilt:.1f}° tilted, {higher:.0f} "
                    "mm higher or lower); seams may show steps: calibrate the poses again",
                    name=names[worst], tilt=tilt.max(), higher=1e3 * height_gap.max(),
                )
            )  # fmt: skip
    patches, first = [], 0
    for scan, pose in zip(scans, poses, strict=True):
        for patch in scan.patches:
            moved = patch.transformed(pose)
            assert moved.view is not None  # each patch says its view
            patches.append(replace(moved, view=(moved.view + first).astype(np.int8)))
        first += len(scan.patches)
    return Scan(
        patches,
        stack_maps([scan.maps for scan in scans], list(poses)),
        up,
        axis,
        floor,
        [f"{name}: {view}" if len(scan.names) > 1 else name for name, scan in zip(names, scans, strict=True)
         for view in scan.names],
        [replace(in_frame(mirror, pose), name=f"{name}: {mirror.name}")
         for name, scan, pose in zip(names, scans, poses, strict=True) for mirror in scan.mirrors],
        ", ".join(dict.fromkeys(scan.sensor for scan in scans)),
        tuple(warnings),
        np.concatenate([scan.limits for scan in scans]),
        tuple(noise for scan in scans for noise in scan.noise),
        tuple(lens for scan in scans for lens in scan.lenses),
        tuple({side: None for scan in scans for side in scan.cut}),
        _lit_twice(scans, weights),
        tuple(one for scan in scans for one in scan.principles),
    )  # fmt: skip


def _lit_twice(scans: Sequence[Scan], weights: np.ndarray) -> tuple[float, float] | None:
    """Shares of all cameras' readings that light of two ways reached, and that were corrected; None if none were."""
    shares = np.array([scan.lit_twice or (0.0, 0.0) for scan in scans])
    if all(scan.lit_twice is None for scan in scans):
        return None
    lit, corrected = np.average(shares, axis=0, weights=weights)
    return float(lit), float(corrected)


def _distinct(names: list[str]) -> list[str]:
    """Names with a number added where several are the same."""
    return [name if names.count(name) == 1 else f"{name} {names[:k].count(name) + 1}" for k, name in enumerate(names)]
