"""Mirrors without a frame that stand clear of any wall: planes from the figure that is seen twice.

Nothing of such a mirror is at its plane, so no depth reading shows where it is. What it shows does: somebody seen
directly and, farther off and the other way round, in the glass. The plane lies half way between the two; it is rotated
and shifted until the mirrored figure's skin coincides with that seen directly, each within the other's silhouette. Only
then is the glass looked for: on that plane the depth jumps along straight, upright lines on both sides of the figure. A
door with somebody behind it fails, since the two are not one body and its reflection.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..camera import RgbdImage
from ..mirrors import Mirror
from ..mirrors.frame_fit import fit_frame
from ..mirrors.glass_extent import with_outline
from ..mirrors.mirror import behind_glass, expected_error, person_before, reflection_shift
from ..mirrors.wall_behind_frame import on_wall
from ..numeric.kernels import njit
from ..numeric.point_products import lay_grid
from ..views.floor_and_vertical import find_floor
from .edge_segments import DetectionSettings
from .glass_outline import with_glass
from .mirror_verification import count_evidence, floor_drop, frame_edge_share, missing_reflection
from .mirrored_person import figure_surfaces, find_figures, fit_mirror_to_skin, is_one_body, search_mirror_plane
from .rectangle_hypotheses import Hypothesis

_UP = np.array((0.0, -1.0, 0.0))
_IMAGE_FARTHER = 0.7  # an image is so much farther off than the figure [m]
_WARN_ERROR = 0.006  # a mirror expected to misplace a person by more is warned of [m]


def find_frameless(image: RgbdImage, known: Iterable[Mirror] = (), most: int = 2) -> list[tuple[Mirror, bool]]:
    """Mirrors that only the figure in them reveals, besides those ``known``.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    most : int
        At most so many.

    Returns
    -------
    list of (Mirror, bool)
        ``source`` "found", not ``refined``; the covariance says how certain the plane is. True: something stands beside
        the glass near its plane. Without a frame there nothing would, so it is its frame, or the post of a door.

    Notes
    -----
    O(H W).
    """
    depth, intrinsics = image.depth, image.intrinsics
    stride = max(1, round(np.sqrt(depth.size / 80000.0)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in intrinsics.packed))
    points = cloud[thin > 0]
    ground = find_floor(points, _UP, 20.0) if len(points) else None
    if ground is None:
        return []
    up, floor, _ = ground
    known = list(known)
    objects, figures = find_figures(thin, cloud, up, floor, known)
    found: list[tuple[Mirror, bool]] = []
    pairs = [
        (one, reflection) for one in figures for reflection in figures
        if reflection.middle[2] > one.middle[2] + 0.5 * _IMAGE_FARTHER
        and np.linalg.norm(reflection.middle) > np.linalg.norm(one.middle) + _IMAGE_FARTHER
        and (one.cut or reflection.cut or abs(one.top - reflection.top) < 0.35)
    ]  # fmt: skip
    if pairs:
        objects = _widened_kernel(depth, thin, objects, stride)
    pairs.sort(key=lambda pair: -min(pair[0].count, pair[1].count))
    for one, reflection in pairs[:12]:
        if len(found) == most or behind_glass(reflection.middle[None], [mirror for mirror, _ in found])[0]:
            continue
        shown = figure_surfaces(image, one, reflection, objects)
        start = search_mirror_plane(image, one, reflection, shown, objects, up)
        mirror = start and fit_mirror_to_skin(start, shown, intrinsics)
        if mirror is None or not is_one_body(image, one, reflection, objects, mirror):
            continue
        glass = with_glass(image, mirror, reflection, objects, np.append(up, floor))
        if glass is not None:
            found.append(glass)
    return found


def frameless_notes(mirrors: list[Mirror]) -> tuple[str, ...]:
    """What the user should know of mirrors that were placed without a frame, and are uncertain."""
    bare = tuple(
        f"{m.name}: no frame is visible; its plane was computed from the person it shows, and its reflection may be "
        f"misplaced by {1000.0 * error:.0f} mm; strips of paper or tape, 3 cm wide, along its edges would reduce that"
        for m in mirrors
        if m.source == "found" and not m.refined and (error := expected_error(m)) > _WARN_ERROR
    )
    return bare + tuple(
        f"{m.name}: hangs on a wall, and no frame projects in front of the wall: the wall's plane was taken for the "
        "mirror's, and its reflection is misplaced by twice the distance from the wall to the glass; strips of paper "
        "or tape, 3 cm wide, on the edges of the glass would show where the glass is"
        for m in mirrors
        if m.refined and m.source != "rig file" and on_wall(m)
    )


@njit(cache=True, nogil=True)
def _widened_kernel(depth, thin, objects, stride):
    """The picture of objects (H, W) int32 for all pixels: a pixel is part of the object beside it in like depth."""
    height, width = depth.shape
    out = np.zeros((height, width), np.int32)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0:
                continue
            for k in range(4):
                i, j = min(v // stride + k // 2, objects.shape[0] - 1), min(u // stride + k % 2, objects.shape[1] - 1)
                if objects[i, j] and abs(thin[i, j] - z) < 0.02 + 0.005 * z * z:
                    out[v, u] = objects[i, j]
                    break
    return out


def overlaps(mirror: Mirror, others: Iterable[Mirror]) -> bool:
    """Whether it shares more than a quarter of the smaller one's place in the picture with one of the others."""
    mine = mirror.outline
    for other in others:
        its = other.outline
        assert mine is not None and its is not None
        size = np.minimum(mine.max(axis=0), its.max(axis=0)) - np.maximum(mine.min(axis=0), its.min(axis=0))
        smaller = min(np.prod(np.ptp(outline, axis=0)) for outline in (mine, its))
        if size.min() > 0 and np.prod(size) > 0.25 * smaller:
            return True
    return False


def find_verified_frameless(image: RgbdImage, known: list[Mirror], settings: DetectionSettings) -> list[Mirror]:
    """Mirrors that only the figure in them reveals, as far as the rest of what they show may be a reflection too.

    Where something stands beside the glass it must be a frame in its plane, to which the plane is then fitted.
    """
    intrinsics = image.intrinsics
    good = []
    for mirror, beside in find_frameless(image, known, settings.max_mirrors - len(known)):
        if beside:
            framed, person = fit_frame(image, mirror), person_before(mirror)
            if framed is None or reflection_shift(person, framed, mirror) > 3.0 * expected_error(mirror):
                continue
            mirror = with_outline(framed, intrinsics)
        assert mirror.rectangle is not None  # that of its glass
        guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
        if beside and frame_edge_share(image, guess, 0.2, known) < settings.min_rim:
            continue
        evidence = count_evidence(image, guess, floor_drop(image, mirror.basis))
        bad = evidence.violated > settings.max_violation * evidence.judged
        if evidence.shown >= 30 and not bad and not missing_reflection(image, mirror):
            good.append(mirror)
    return good
