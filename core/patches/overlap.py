"""Where views see the same surface: blend them, keep the better view, leave a clean gap to zipper.

Time-of-flight and active-stereo cameras see up to 60° of the body both directly and in a mirror (structured light
loses what two patterns light, so there the patches do not overlap and this stage changes nothing).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mesh import Mesh
from ..mesh.normals import vertex_normals
from ..mesh.submesh import triangles_touching
from ..numeric.kernels import njit
from ..numeric.threads import each
from ..views.view_maps import ViewMaps, look_at
from .grid_triangulation import clean_patch
from .outline_clipping import clip, distance_to_zero, smooth_on_mesh, trim_outline
from .view_comparison import OverlapSettings, compare_views, own_confidence

_SMOOTH_ROUNDS = 3  # of the field that is cut along, and of the blending
_NOBODY_ELSE = 3.0  # most advantage [log confidence]: beyond the overlap, where smoothing leaves it positive
_RAGGED_SHARE = 0.005  # of a patch's vertices: where more are taken away, the outline is ragged and trimmed anew
_STRIPPED_SPECK = 12  # triangles of a piece that the stripping left over


def part_overlaps(patches: list[Mesh], maps: ViewMaps, settings: OverlapSettings = OverlapSettings()) -> list[Mesh]:
    """Blend the patches to one surface where they overlap, then cut each back to where it is the better view.

    The cut runs along the line where two views are equally good, moved half a gap back on either side, so both
    boundaries are smooth and run in parallel. Returns as many patches as given. O(V).
    """
    seen = [patch.vertices for patch in patches if len(patch.vertices)]
    center = np.concatenate(seen).mean(axis=0) if seen else None
    cut = each(lambda patch: _cut_back(patch, maps, settings, center), patches)
    return _strip_doubles(cut, maps, settings)


def _cut_back(patch: Mesh, maps: ViewMaps, settings: OverlapSettings, center: np.ndarray | None) -> Mesh:
    """The patch blended with the other views where they see the same skin, and cut to where it is the better one."""
    if not len(patch.triangles):
        return patch
    assert patch.view is not None  # each patch says its view
    normals = vertex_normals(patch.vertices, patch.triangles)
    own = own_confidence(patch, maps)
    advantage, shift = compare_views(patch.vertices, patch.view, normals, own, maps, settings, center)
    overlapped = np.isfinite(advantage)
    if not overlapped.any():
        return patch
    # all else is left as it is by the smoothing below
    near = _triangles_near(patch.triangles, overlapped, _SMOOTH_ROUNDS)
    vertices = patch.vertices
    if settings.blend:
        vertices = vertices + smooth_on_mesh(shift, near, _SMOOTH_ROUNDS)
    field = np.clip(np.where(overlapped, advantage, _NOBODY_ELSE), -_NOBODY_ELSE, _NOBODY_ELSE)
    field = smooth_on_mesh(field[:, None], near, _SMOOTH_ROUNDS)[:, 0]
    distance = distance_to_zero(field, vertices, near)
    edge = _median_edge(patch)
    return clip(replace(patch, vertices=vertices), distance, 0.5 * settings.gap * edge)


def _triangles_near(triangles: np.ndarray, chosen: np.ndarray, rings: int) -> np.ndarray:
    """Triangles (K, 3) within so many rings of the ``chosen`` vertices (V,) bool."""
    inside = chosen.copy()
    for _ in range(rings):
        inside[triangles.compress(triangles_touching(triangles, inside), axis=0)] = True
    return triangles.compress(triangles_touching(triangles, inside), axis=0)


def _strip_doubles(patches: list[Mesh], maps: ViewMaps, settings: OverlapSettings) -> list[Mesh]:
    """Take away what still lies over another patch, from the farther view first, so that no double layer is left.

    Smoothing the cut line and noise let a patch reach over its neighbour here and there; where both remain, their
    boundaries cross and no zipper can run between them.
    """
    kept = _kept_pixels(patches, maps)
    normals = each(lambda patch: vertex_normals(patch.vertices, patch.triangles), patches)
    suspects = each(
        lambda view: _covered(
            patches[view], normals[view], np.arange(len(patches[view].vertices)), kept, maps, settings
        ),
        range(len(patches)),
    )
    stripped = list(patches)
    changed = False
    for view in range(len(patches) - 1, -1, -1):
        patch = patches[view]
        over = suspects[view]
        if changed:  # less is kept of the views before: what lay over that does so no longer
            over = _covered(patch, normals[view], over, kept, maps, settings)
        if not len(over):
            continue
        changed = True
        covered = np.zeros(len(patch.vertices), np.bool_)
        covered[over] = True
        left = ~triangles_touching(patch.triangles, covered)
        assert patch.kind is not None
        patch = replace(patch, triangles=patch.triangles[left], kind=patch.kind[left])  # compacted by what follows
        if covered.sum() > _RAGGED_SHARE * len(covered):  # a ragged outline, not a few teeth
            patch = trim_outline(patch, 0.5)
        patch = clean_patch(patch, _STRIPPED_SPECK)
        stripped[view] = patch
        kept[kept == view] = -1
        _mark_kernel(patch.vertices, patch.view, maps.to_view, kept, maps.intrinsics)
    return stripped


def _covered(
    patch: Mesh, normals: np.ndarray, vertices: np.ndarray, kept: np.ndarray, maps: ViewMaps, settings: OverlapSettings
) -> np.ndarray:
    """Those of the ``vertices`` (K,) that lie over another view's ``kept`` pixels, or right beside one of them."""
    return vertices[
        _covered_kernel(
            vertices,
            patch.vertices,
            patch.view,
            normals,
            maps.to_view,
            maps.depth,
            kept,
            maps.normals,
            maps.intrinsics,
            settings.reach,
            maps.noise,
            0.5 * settings.gap,
        )
    ]


def _kept_pixels(patches: list[Mesh], maps: ViewMaps) -> np.ndarray:
    """View (H, W) int8 of each pixel whose vertex is still in its patch, -1 elsewhere."""
    kept = np.full(maps.depth.shape, -1, np.int8)
    for patch in patches:
        if len(patch.triangles):
            _mark_kernel(patch.vertices, patch.view, maps.to_view, kept, maps.intrinsics)
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_kernel(vertices, view, to_view, kept, intrinsics):
    for i in range(len(vertices)):
        v, u, _ = look_at(vertices, i, to_view, view[i], kept, intrinsics)
        if v >= 0:
            kept[int(v + 0.5), int(u + 0.5)] = view[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _covered_kernel(
    chosen, vertices, view, vertex_normals, to_view, depth, kept, normals, intrinsics, reach, noise, margin
):
    covered = np.zeros(len(chosen), np.bool_)
    for at in range(len(chosen)):
        i = chosen[at]
        for k in range(len(to_view)):
            if k == view[i]:
                continue
            v, u, z = look_at(vertices, i, to_view, k, depth, intrinsics)
            if v < 1 or u < 1 or v > depth.shape[0] - 2 or u > depth.shape[1] - 2:
                continue
            y0, x0 = int(v + 0.5), int(u + 0.5)
            fx, fy, cx, cy = intrinsics[k, 0], intrinsics[k, 1], intrinsics[k, 2], intrinsics[k, 3]
            px, py = (u - cx) / fx, (v - cy) / fy
            inside = True
            for dv in range(-1, 2):
                for du in range(-1, 2):
                    y, x = y0 + dv, x0 + du
                    if kept[y, x] != k:
                        inside = False
                        continue
                    # beside the other patch: nearer to one of its vertices than the distance of its pixels
                    d = depth[y, x]
                    ex, ey = (x - cx) / fx * d - px * z, (y - cy) / fy * d - py * z
                    if ex * ex + ey * ey + (d - z) ** 2 < (margin * d / fx) ** 2:
                        covered[at] = True
            if not inside or covered[at]:
                continue
            agree = cosine = 0.0
            for c in range(3):
                agree += normals[y0, x0, c] * vertex_normals[i, c]
                cosine += (to_view[k, 0, c] * px + to_view[k, 1, c] * py + to_view[k, 2, c]) * normals[y0, x0, c]
            if agree > 0.0 and abs((depth[y0, x0] - z) * cosine) < reach + 3.0 * noise[k] * z:
                covered[at] = True
    return covered


def _median_edge(mesh: Mesh) -> float:
    some = mesh.triangles[:: len(mesh.triangles) // 3000 + 1]
    return float(np.median(np.linalg.norm(mesh.vertices[some[:, 0]] - mesh.vertices[some[:, 1]], axis=1)))
