"""From the closed mesh to the avatar that was asked for: skeleton, measurements, fewer triangles, texture."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..avatar.pose import SkinWeights
from ..avatar.skeleton import Skeleton
from ..avatar.skin_weights import skinned_mesh
from ..capture import Capture
from ..errors import CaptureError, MirrorScanError, Notice, ReconstructionError
from ..mesh import Mesh, Texture
from ..mirrors import Mirror
from ..numeric.point_products import transform
from .settings import Settings

if TYPE_CHECKING:
    from ..measurements import Measurements
    from ..texture import TextureSummary
    from .scan import Clock

Result = TypeVar("Result")

COSTS = {"scan": 1.0, "skeleton": 5.0, "measure": 1.0, "triangles": 1.5, "texture": 8.0}
"""About how long each part of the job takes, as multiples of the scan's time; the progress is shared out by it."""


@dataclass(frozen=True)
class Shot:
    """One camera's capture with its mirrors, and where the camera stands.

    Parameters
    ----------
    capture : Capture
    mirrors : tuple of Mirror
        Camera frame.
    to_avatar : np.ndarray [shape=(4, 4)]
        Rigid: camera frame → avatar frame.
    """

    capture: Capture
    mirrors: tuple[Mirror, ...]
    to_avatar: np.ndarray


@dataclass(frozen=True)
class AvatarParts:
    """The avatar and what belongs to it, in the avatar frame; None is what was not asked for, or cannot be had.

    ``notices`` say why something that was asked for is missing, or what is wrong with it.
    """

    mesh: Mesh
    skeleton: Skeleton | None = None
    weights: SkinWeights | None = None
    measurements: Measurements | None = None
    texture: Texture | None = None
    summary: TextureSummary | None = None
    notices: tuple[Notice, ...] = ()

    def transformed(self, pose: np.ndarray) -> AvatarParts:
        """The avatar moved by a rigid ``pose`` (4, 4)."""
        return replace(
            self,
            mesh=self.mesh.transformed(pose),
            skeleton=None if self.skeleton is None else self.skeleton.transformed(pose),
            measurements=None if self.measurements is None else moved_measurements(self.measurements, pose),
        )


def check_wishes(captures: Sequence[Capture], settings: Settings) -> None:
    """Refuse a texture of captures without colour, before any work is done.

    Raises
    ------
    CaptureError
    """
    if settings.texture is not None and all(capture.color is None for capture in captures):
        raise CaptureError(
            "{name}: has no colour, so no texture can be made of it", name=captures[0].name, code="color"
        )


def shares(settings: Settings) -> dict[str, tuple[float, float]]:
    """From where to where each part of the job has the progress; parts that are not asked for have none."""
    asked = {
        "scan": True,
        "skeleton": needs_skeleton(settings),
        "measure": settings.measure,
        "triangles": settings.triangles is not None,
        "texture": settings.texture is not None,
    }
    wanted = [name for name in COSTS if asked[name]]
    ends = np.cumsum([COSTS[name] for name in wanted]) / sum(COSTS[name] for name in wanted)
    return dict(zip(wanted, zip([0.0, *ends[:-1].tolist()], ends.tolist(), strict=True), strict=True))


def needs_skeleton(settings: Settings) -> bool:
    """Whether joints are looked for: they are asked for, or what is asked for goes by them."""
    return settings.skeleton or settings.measure or (settings.texture is not None and not settings.views.object)


def scaled(
    steps: Generator[tuple[float, str], None, Result], part: tuple[float, float]
) -> Generator[tuple[float, str], None, Result]:
    """A job in pieces whose progress goes over ``part`` of the whole."""
    while True:
        try:
            fraction, message = next(steps)
        except StopIteration as done:
            return done.value
        yield part[0] + (part[1] - part[0]) * fraction, message


def avatar_steps(
    mesh: Mesh, shots: Sequence[Shot], of_scan: dict, settings: Settings, clock: Clock
) -> Generator[tuple[float, str], None, AvatarParts]:
    """A closed mesh in the avatar frame → what ``settings`` ask for; ``of_scan`` is :func:`.report.scan_report`."""
    part = shares(settings)
    avatar = AvatarParts(mesh)
    if needs_skeleton(settings):
        yield part["skeleton"][0], "Finding the skeleton"
        avatar = _with_skeleton(avatar, settings)
        clock.lap("skeleton")
    if settings.measure and avatar.skeleton is not None and avatar.weights is not None:
        yield part["measure"][0], "Measuring the body"
        avatar = _measured(avatar, of_scan)
        clock.lap("measurements")
    if settings.triangles is not None:
        yield part["triangles"][0], "Reducing the triangles"
        from ..decimation import decimate

        reduced = decimate(avatar.mesh, settings.triangles, weights=avatar.weights)
        notices = (*avatar.notices, *reduced.notes)
        avatar = replace(avatar, mesh=reduced.mesh, weights=reduced.weights, notices=notices)
        clock.lap("decimation")
    if settings.texture is not None:
        from ..texture import color_views, texture_steps

        views = [
            view if len(shots) == 1 else replace(view, name=f"{shot.capture.name}: {view.name}")
            for shot in shots for view in color_views(shot.capture, shot.mirrors, shot.to_avatar)
        ]  # fmt: skip
        steps = texture_steps(avatar.mesh, views, settings.texture, avatar.weights)
        texture, summary = yield from scaled(steps, part["texture"])
        avatar = replace(avatar, texture=texture, summary=summary)
        clock.lap("texture")
    return avatar


def _measured(avatar: AvatarParts, of_scan: dict) -> AvatarParts:
    """The avatar with its measurements, or with the reason why it has none."""
    from ..measurements import measure, view_errors

    assert avatar.skeleton is not None and avatar.weights is not None
    try:
        found = measure(avatar.mesh, avatar.skeleton, avatar.weights, view_errors(of_scan))
    except MirrorScanError as error:
        return replace(avatar, notices=(*avatar.notices, error.notice))
    return replace(avatar, measurements=found)


def moved_measurements(measurements: Measurements, pose: np.ndarray) -> Measurements:
    """Measurements whose tapes are moved by a rigid ``pose`` (4, 4)."""
    return {
        name: replace(found, loops=tuple(transform(loop, pose) for loop in found.loops))
        for name, found in measurements.items()
    }


def _with_skeleton(avatar: AvatarParts, settings: Settings) -> AvatarParts:
    """The avatar with joints and skin weights, or with the reason why it has none."""
    from ..avatar.joints.skeleton_search import find_skeleton

    try:
        if settings.views.object:
            raise ReconstructionError("skeleton: none, since the subject is an object and no person", code="no_person")
        skeleton = find_skeleton(avatar.mesh)
    except MirrorScanError as error:
        # a texture does without joints
        said = settings.skeleton or settings.measure
        return replace(avatar, notices=(*avatar.notices, error.notice)) if said else avatar
    mesh, weights = skinned_mesh(avatar.mesh, skeleton)
    return replace(avatar, mesh=mesh, skeleton=skeleton, weights=weights)
