"""Tasks of an avatar that was built: skeleton, texture, measurements, fewer triangles, motion, garments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import MirrorScanError
from ...core.mesh import Mesh, Texture
from .captures import READING, opened
from .mirror_records import mirror_of
from .results import Measured, Rigged, Source, Steps, Textured

if TYPE_CHECKING:
    from ...core.avatar.avatar_file import Avatar
    from ...core.avatar.garment import Garment
    from ...core.avatar.pose import SkinWeights
    from ...core.avatar.skeleton import Skeleton
    from ...core.decimation import Reduced
    from ...core.motion import Clip, Motion, Soles


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
        capture = opened(source.path, source.frames, "", source.reading, native_color=True)
    else:
        capture = source.cloud.capture()
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
