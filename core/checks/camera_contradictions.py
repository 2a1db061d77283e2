"""Cameras that contradict each other: one sees the subject where another one sees that there is nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import Notice, ReconstructionError
from ..mesh import Mesh
from ..numeric.point_products import transform
from ..subject.connected_pixels import dilated
from ..views.view_maps import ViewMaps

OUTSIDE = 0.05
"""What one camera shows of the subject may stick out of its outline in another by this much [m]."""

BEFORE = 0.06
"""It may stand before the surface that another one reads by this much [m]."""

_SAME_SUBJECT = 0.8
"""Where cameras place the subject farther from each other, they see two subjects or their poses are wrong [m]."""

_DENIED, _HARDLY_DENIED = 0.2, 0.06
"""Of what one camera shows of the subject another may deny less; more is an error, or reported [share]."""

_NEAREST = 0.1  # m: what is nearer to a camera is not projected
_SAMPLES, _FEWEST = 4000, 200  # points of the subject that are asked, at most and at least


def check_cameras(
    patches: Sequence[Sequence[Mesh]],
    maps: Sequence[ViewMaps],
    poses: Sequence[np.ndarray],
    names: Sequence[str],
    axes: np.ndarray,
) -> list[Notice]:
    """A warning of poses that are a little off.

    Parameters
    ----------
    patches, maps, poses
        As of :func:`contradicted_shares`.
    names : sequence of str
        Of the cameras.
    axes : np.ndarray [shape=(N, 3)]
        Where each camera sees the subject, in the frame they share, without the height [m].

    Raises
    ------
    ReconstructionError
        Cameras contradict each other. Where all others agree it names the one that does not.
    """
    if len(maps) < 2:
        return []
    apart = np.linalg.norm(axes[:, None] - axes, axis=-1)
    shares = contradicted_shares(patches, maps, poses)
    shares = np.maximum(shares, shares.T)
    who, others = _odd_one(np.maximum(apart / _SAME_SUBJECT, shares / _DENIED), names)
    if apart.max() > _SAME_SUBJECT:
        raise ReconstructionError(
            "{who}: the subject stands {aside:.2f} m from where {others} it; check the poses (camera frame → common "
            "frame, metres), and that all captures show the same subject standing still",
            who=who, others=others, aside=apart.max(),
        )  # fmt: skip
    if shares.max() > _DENIED:
        raise ReconstructionError(
            "{who}: {share:.0%} of the subject is where {others} nothing; check the poses (camera frame → common "
            "frame, metres), and that all captures show the same subject standing still",
            who=who, others=others, share=shares.max(),
        )  # fmt: skip
    if shares.max() > _HARDLY_DENIED:
        who, others = _odd_one(shares / _HARDLY_DENIED, names)
        return [
            Notice(
                "{who}: {share:.0%} of the subject is where {others} nothing; the poses are a little off, or the "
                "subject moved from one capture to the next: calibrate the poses again",
                who=who, others=others, share=shares.max(),
            )
        ]  # fmt: skip
    return []


def contradicted_shares(
    patches: Sequence[Sequence[Mesh]], maps: Sequence[ViewMaps], poses: Sequence[np.ndarray]
) -> np.ndarray:
    """How much of what each camera shows of the subject another one denies.

    A camera denies a point of the subject that it would see outside of the subject's outline, before what it reads
    there, or before the subject's own surface.

    Parameters
    ----------
    patches : sequence of sequence of Mesh
        Of the views of each camera, in its frame.
    maps : sequence of ViewMaps
        One a camera, in its frame.
    poses : sequence of np.ndarray [shape=(4, 4)]
        Rigid: each camera frame → the frame they share.

    Returns
    -------
    np.ndarray [shape=(N, N)]
        [i, j]: the share of what i shows, as far as it lies in j's image, that j denies; 0 where j sees almost nothing
        of it.

    Notes
    -----
    O(N H W + N² · 4000).
    """
    shares = np.zeros((len(maps), len(maps)))
    points = []
    for mine, pose in zip(patches, poses, strict=True):
        vertices = np.concatenate([patch.vertices for patch in mine])
        points.append(transform(vertices[:: len(vertices) // _SAMPLES + 1], pose))
    for j, (seen, pose) in enumerate(zip(maps, poses, strict=True)):
        direct = seen.labels == 0
        if not direct.any():
            continue
        fx, fy, cx, cy = seen.intrinsics[0]
        outline = dilated(seen.labels, int(np.ceil(OUTSIDE * fx / np.median(seen.depth[direct]))))
        height, width = direct.shape
        for i, cloud in enumerate(points):
            if i == j:
                continue
            x, y, z = transform(cloud, np.linalg.inv(pose)).T
            before = z > _NEAREST
            x, y, z = x[before], y[before], z[before]
            u, v = np.rint(x / z * fx + cx).astype(np.int64), np.rint(y / z * fy + cy).astype(np.int64)
            inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
            u, v, z = u[inside], v[inside], z[inside]
            if len(z) < _FEWEST:
                continue
            empty = ~outline[v, u] & (seen.through[v, u] == 0) & (seen.clear[v, u] > z + BEFORE)
            empty |= direct[v, u] & (seen.depth[v, u] > z + BEFORE)
            shares[i, j] = empty.mean()
    return shares


def _odd_one(contradiction: np.ndarray, names: Sequence[str]) -> tuple[Notice, Notice]:
    """Who contradicts which others (N, N) by more than 1: the camera without which nobody does, else a pair."""
    wrong = contradiction > 1.0
    count = len(names)
    odd = [k for k in range(count) if count > 2 and not np.delete(np.delete(wrong, k, 0), k, 1).any()]
    if len(odd) == 1:
        return Notice.of(names[odd[0]]), Notice("the other cameras see")
    i, j = map(int, np.unravel_index(np.argmax(contradiction), contradiction.shape))
    pair = Notice("{one} and {other}, one of the two", one=names[min(i, j)], other=names[max(i, j)])
    return pair, Notice("the other sees")
