"""Pictures of a mesh without a graphics driver: orthographic views by ray casting, and the preview sheet."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import MirrorScanError
from ..io.images import write_png
from ..mesh import FILL, KIND_NAMES, SEAM, SURFACE, Mesh, Texture
from ..mesh.bvh import Bvh, build_bvh, raycast
from ..mesh.normals import triangle_normals, vertex_normals
from ..numeric.srgb import from_linear, to_linear
from .posed_views import POSES, posed_meshes

if TYPE_CHECKING:
    from ..avatar.pose import SkinWeights
    from ..avatar.skeleton import Skeleton

KIND_COLORS = {SURFACE: (206, 206, 209), SEAM: (222, 30, 36), FILL: (52, 112, 220)}
"""sRGB each kind of triangle is shown in."""

SIDES = {"front": (0, -1, 0), "left side": (1, 0, 0), "back": (0, 1, 0), "right side": (-1, 0, 0)}
"""Where the viewer stands, in the avatar frame; left and right are the person's own."""

BACKGROUND = (236, 237, 239)
INSIDE = (84, 66, 96)  # the inner side of the surface, seen through a hole
INK = (60, 62, 68)
NEUTRAL = (196, 190, 184)  # a mesh that carries no colours

_PANEL = (400, 640)  # width, height of one view on the sheet [px]
_BAND = 60  # captions above, legend below [px]
_FILLED = 0.94  # of a panel, by the mesh
# Towards the lights, in the viewer's right, up, back; and how bright each is.
_LIGHTS = (((-0.42, 0.55, 0.72), 0.82), ((0.75, 0.10, 0.65), 0.16))
_AMBIENT = 0.10


def render_views(
    mesh: Mesh,
    colors: np.ndarray | None,
    directions: Sequence[Sequence[float]],
    width: int,
    height: int,
    up: Sequence[float] = (0.0, 0.0, 1.0),
    texture: Texture | None = None,
) -> np.ndarray:
    """Orthographic pictures of a mesh side by side, all to one scale that fits the largest.

    Outlines and colour borders are sampled four times a pixel. About 0.4 µs a pixel; memory 200 bytes a pixel of
    one view and 300 bytes a triangle.

    Parameters
    ----------
    mesh : Mesh
    colors : np.ndarray [shape=(V, 3) or (T, 3), dtype=uint8] or None
        sRGB by vertex (blended across triangles) or by triangle; None for one neutral colour. When V equals T
        they are taken as by vertex.
    directions : sequence of (3,)
        From the mesh towards the viewer, one a picture, any length; ``SIDES`` has the four of the avatar frame.
    width, height : int
        Of each picture [px].
    up : (3,)
        What shall point up in the pictures; (0, -1, 0) for the camera frame.
    texture : Texture, optional
        Of the mesh's triangles; shown in place of ``colors``, each pixel sampled four times.

    Returns
    -------
    np.ndarray [shape=(height, width * len(directions), 3), dtype=uint8]

    Raises
    ------
    MirrorScanError
        When the mesh has no triangles, is not finite, or an argument does not fit.
    """
    return _render(mesh, [colors if texture is None else texture], directions, width, height, up)[0][0]


def render_preview(
    mesh: Mesh,
    path: str | os.PathLike,
    skeleton: Skeleton | None = None,
    weights: SkinWeights | None = None,
    texture: Texture | None = None,
) -> None:
    """Write the preview sheet: front, left side, back and right side; above by capture colours, below by kind.

    With a skeleton a third row shows it, and the avatar in three poses.

    Parameters
    ----------
    mesh : Mesh
        In the avatar frame. Without colours the upper row is of one neutral colour; without kinds all is surface.
    path : path
        Ends in .png; 1600×1400 px, 2100 with a skeleton. A file already there is replaced only when the new one is
        complete.
    skeleton, weights : Skeleton and SkinWeights, optional
        Of the mesh.
    texture : Texture, optional
        Of the mesh's triangles: the upper row shows it.

    Raises
    ------
    MirrorScanError
        When the mesh has no triangles or is not finite.
    OutputError
        When the file cannot be written.
    """
    kind = np.zeros(len(mesh.triangles), np.int8) if mesh.kind is None else mesh.kind
    by_kind = np.array([KIND_COLORS[k] for k in sorted(KIND_COLORS)], np.uint8)[kind]
    rows, inside = _render(mesh, [mesh.colors if texture is None else texture, by_kind], list(SIDES.values()), *_PANEL)
    width = rows[0].shape[1]
    band = np.full((_BAND, width, 3), BACKGROUND, np.uint8)
    sheet = np.concatenate((band, *rows, band))
    for column, name in enumerate(SIDES):
        draw_text(sheet, name, (column + 0.5) * _PANEL[0], 0.68 * _BAND, size=26, color=INK, centred=True)
    legend = [(KIND_NAMES[k], KIND_COLORS[k]) for k in sorted(KIND_COLORS)]
    if inside:
        legend.append(("inside seen through a hole", INSIDE))
    x, base = 40.0, len(sheet) - 0.36 * _BAND
    for name, color in legend:
        sheet[int(base) - 18 : int(base) + 2, int(x) : int(x) + 20] = color
        x = draw_text(sheet, name, x + 32, base, size=22, color=INK) + 44
    if skeleton is not None and weights is not None:
        captions = np.full((_BAND, width, 3), BACKGROUND, np.uint8)
        for column, name in enumerate(POSES):
            draw_text(captions, name, (column + 0.5) * _PANEL[0], 0.68 * _BAND, size=26, color=INK, centred=True)
        shown = zip(posed_meshes(mesh, skeleton, weights), POSES.values(), strict=True)
        row = [render_views(posed, posed.colors, [seen], *_PANEL) for posed, seen in shown]
        sheet = np.concatenate((sheet, captions, np.concatenate(row, axis=1)))
    write_png(path, sheet)


def _render(mesh, colorings, directions, width, height, up=(0.0, 0.0, 1.0)) -> tuple[list[np.ndarray], bool]:
    """A strip of pictures for each colouring, the rays cast once for all; and whether any ray met an inner side."""
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    triangles = np.ascontiguousarray(mesh.triangles, np.int32)
    if not len(triangles):
        raise MirrorScanError("picture: the mesh has no triangles to show")
    if width < 1 or height < 1 or not len(directions):
        raise MirrorScanError(f"picture: {len(directions)} views of {width}×{height} px make no picture")
    paints: list[_Paint] = [_paint_of(coloring, len(vertices), len(triangles)) for coloring in colorings]
    by_triangle = [paint.code for paint in paints if paint.code is not None]
    everywhere = any(paint.texture is not None for paint in paints)
    tree = build_bvh(vertices, triangles)
    axes = [_axes(direction, up) for direction in directions]
    used = vertices[np.unique(triangles)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    spread = [np.ptp((used - centre) @ np.asarray(a)[:2].T, axis=0) for a in axes]
    extent = np.maximum(np.max(spread, axis=0), 1e-9)
    pixel = float(max(extent[0] / (_FILLED * width), extent[1] / (_FILLED * height)))
    smooth = vertex_normals(vertices, triangles)
    flat = triangle_normals(vertices, triangles)
    strips: list[list[np.ndarray]] = [[] for _ in colorings]
    inside = False
    for right, upward, back in axes:
        view = np.stack((right, upward, back))
        box = (used - centre) @ view.T
        low, high = box.min(axis=0), box.max(axis=0)
        # the middle of what this view shows goes to the middle of its picture
        middle = centre + (low + high) / 2 @ view
        start = middle + back * (high[2] - low[2] + pixel)
        x, y = np.meshgrid((np.arange(width) - (width - 1) / 2), (height - 1) / 2 - np.arange(height))
        first = _Samples(tree, triangles, start, view, x.ravel(), y.ravel(), pixel, smooth, flat)
        fine = np.flatnonzero(_borders(first, by_triangle, (height, width), pixel) | (first.hit & everywhere))
        quarters = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
        refined = [
            _Samples(tree, triangles, start, view, x.ravel()[fine] + u, y.ravel()[fine] + v, pixel, smooth, flat)
            for u, v in quarters
        ]
        inside |= bool(first.inner.any())
        for strip, paint in zip(strips, paints, strict=True):
            picture = first.shade(paint)
            if len(fine):
                picture[fine] = sum(part.shade(paint) for part in refined) / len(refined)
            strip.append(_encode(picture).reshape(height, width, 3))
    return [np.concatenate(strip, axis=1) for strip in strips], inside


class _Paint(NamedTuple):
    """What a surface is coloured with: linear light a vertex or a triangle, or a texture.

    ``code`` is one number a triangle's colour, where colours are by triangle.
    """

    linear: np.ndarray
    by_vertex: bool
    texture: Texture | None
    code: np.ndarray | None


def _paint_of(coloring: np.ndarray | Texture | None, n_vertices: int, n_triangles: int) -> _Paint:
    if isinstance(coloring, Texture):
        if coloring.uv.shape != (n_triangles, 3, 2):
            raise MirrorScanError(
                f"picture: a texture of {len(coloring.uv)} triangles does not belong to a mesh of {n_triangles}"
            )
        return _Paint(np.empty((0, 3)), False, coloring, None)
    colors = np.tile(np.array(NEUTRAL, np.uint8), (n_vertices, 1)) if coloring is None else np.asarray(coloring)
    if colors.shape not in ((n_vertices, 3), (n_triangles, 3)):
        raise MirrorScanError(
            f"picture: colours of shape {colors.shape} belong neither to the {n_vertices} vertices "
            f"nor to the {n_triangles} triangles"
        )
    by_vertex = len(colors) == n_vertices
    return _Paint(_decode(colors), by_vertex, None, None if by_vertex else colors.astype(np.int64) @ (65536, 256, 1))


def _axes(direction, up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and towards-the-viewer of a picture, unit vectors."""
    back, up = np.asarray(direction, np.float64), np.asarray(up, np.float64)
    if back.shape != (3,) or up.shape != (3,) or not np.isfinite(back).all() or not np.any(back) or not np.any(up):
        raise MirrorScanError(f"picture: {tuple(direction)} is no direction to look from")
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-6 * np.linalg.norm(up):
        # straight from above or below: the avatar's front to the foot of the picture
        right = np.cross(np.roll(up, -1), back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back


class _Samples:
    """What one ray at each of N places of the picture hits, with the light that falls there."""

    def __init__(self, tree: Bvh, triangles, start, view, x, y, pixel, smooth, flat):
        origins = start + pixel * (x[:, None] * view[0] + y[:, None] * view[1])
        t, self.triangle, uv = raycast(tree, origins, -view[2])
        self.hit = self.triangle >= 0
        self.depth = t
        self._at = self.triangle[self.hit]
        self._weights = np.column_stack((1 - uv.sum(axis=1), uv))[self.hit]
        inner = flat[self._at] @ view[2] < 0
        self.inner = np.zeros(len(t), np.bool_)
        self.inner[self.hit] = inner
        self._corners = triangles[self._at]
        normal = self._blend(smooth)
        normal /= np.maximum(np.sqrt(np.einsum("nx,nx->n", normal, normal)), 1e-12)[:, None]
        normal[inner] *= -1
        normal = normal @ view.T
        self._light = np.full((len(normal), 1), _AMBIENT)
        for towards, strength in _LIGHTS:
            towards = np.asarray(towards) / np.linalg.norm(towards)
            # wrapped around a little past the terminator, which softens it
            self._light[:, 0] += strength * np.maximum((normal @ towards + 0.15) / 1.15, 0.0)

    def _blend(self, values: np.ndarray) -> np.ndarray:
        """Values (V, 3) of the vertices at the places hit."""
        return sum(self._weights[:, k, None] * values[self._corners[:, k]] for k in range(3))

    def _look_up(self, uv: np.ndarray, image: np.ndarray) -> np.ndarray:
        """Linear light of the places hit, between the texels of ``image`` (S, S, 3) uint8 in straight lines."""
        place = sum(self._weights[:, k, None] * uv[self._at, k] for k in range(3))
        size = len(image)
        x, y = place[:, 0] * size - 0.5, (1.0 - place[:, 1]) * size - 0.5
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        light = np.zeros((len(place), 3))
        for down in (0, 1):
            for right in (0, 1):
                share = np.abs(1 - right - (x - column)) * np.abs(1 - down - (y - row))
                texel = image[np.clip(row + down, 0, size - 1), np.clip(column + right, 0, size - 1)]
                light += share[:, None] * _decode(texel)
        return light

    def shade(self, paint: _Paint) -> np.ndarray:
        """Linear light (N, 3) float64 that comes from the places, of a surface so coloured."""
        result = np.empty((len(self.hit), 3))
        result[:] = _decode(np.array(BACKGROUND, np.uint8))
        if paint.texture is not None:
            albedo = self._look_up(paint.texture.uv, paint.texture.image)
        else:
            albedo = self._blend(paint.linear) if paint.by_vertex else paint.linear[self._at]
        albedo[self.inner[self.hit]] = _decode(np.array(INSIDE, np.uint8))
        result[self.hit] = albedo * self._light
        return result


def _borders(first: _Samples, by_triangle, shape, pixel) -> np.ndarray:
    """Pixels (height * width,) bool next to an outline, a step in depth or a change of a triangle's colour code."""
    depth = np.where(first.hit, first.depth, 1e9).reshape(shape)
    key = np.where(first.inner, -2, -1).reshape(shape)
    for code in by_triangle:
        key = key * 16777216 + np.where(first.hit, code[first.triangle], 0).reshape(shape)
    border = np.zeros(shape, np.bool_)
    for axis in (0, 1):
        change = (np.abs(np.diff(depth, axis=axis)) > 6 * pixel) | (np.diff(key, axis=axis) != 0)
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        border[tuple(ahead)] |= change
        border[tuple(behind)] |= change
    return border.ravel()


def _decode(colors: np.ndarray) -> np.ndarray:
    """Linear light of sRGB bytes."""
    return to_linear(np.arange(256) / 255)[colors]


def _encode(linear: np.ndarray) -> np.ndarray:
    """SRGB bytes of linear light, brightest parts cut."""
    steps = np.clip(linear, 0.0, 1.0) * 4095
    table = from_linear(np.arange(4096) / 4095)
    return (table * 255 + 0.5).astype(np.uint8)[(steps + 0.5).astype(np.int16)]


# Captions. OpenImageIO's own text needs FreeType, which the one inside Blender is built without; so letters are
# strokes of ours, lower case, on a grid with the base line at 0, x-height 4, ascenders at 6, descenders at -2.


def _arc(cx, cy, rx, ry, begin, end) -> list[tuple[float, float]]:
    angle = np.radians(np.linspace(begin, end, max(4, int(abs(end - begin) / 15))))
    return list(zip(cx + rx * np.cos(angle), cy + ry * np.sin(angle), strict=True))


_BOWL = _arc(1.5, 2, 1.5, 2, 0, 360)
_SHOULDER = [(0, 2.2), *_arc(1.5, 2.5, 1.5, 1.5, 180, 0), (3, 0)]
_GLYPHS: dict[str, tuple[float, list[list[tuple[float, float]]]]] = {  # width, strokes
    " ": (1.2, []),
    "a": (3, [_BOWL, [(3, 4), (3, 0)]]),
    "b": (3, [_BOWL, [(0, 6), (0, 0)]]),
    "c": (2.7, [_arc(1.5, 2, 1.5, 2, 50, 310)]),
    "d": (3, [_BOWL, [(3, 6), (3, 0)]]),
    "e": (3, [[(0, 2), *_arc(1.5, 2, 1.5, 2, 0, 315)]]),
    "f": (2, [[*_arc(1.9, 5, 1, 1, 70, 180), (0.9, 0)], [(0, 4), (2, 4)]]),
    "g": (3, [_BOWL, [(3, 4), *_arc(1.5, -0.6, 1.5, 1.4, 0, -150)]]),
    "h": (3, [[(0, 6), (0, 0)], _SHOULDER]),
    "i": (0, [[(0, 4), (0, 0)], [(0, 5.6), (0, 5.7)]]),
    "j": (1, [[(1, 4), *_arc(0, -1, 1, 1, 0, -90)], [(1, 5.6), (1, 5.7)]]),
    "k": (2.7, [[(0, 6), (0, 0)], [(2.5, 4), (0, 1.7)], [(0.9, 2.5), (2.7, 0)]]),
    "l": (0, [[(0, 6), (0, 0)]]),
    "m": (
        5,
        [
            [(0, 4), (0, 0)],
            [(0, 2.2), *_arc(1.25, 2.7, 1.25, 1.3, 180, 0), (2.5, 0)],
            [(2.5, 2.2), *_arc(3.75, 2.7, 1.25, 1.3, 180, 0), (5, 0)],
        ],
    ),
    "n": (3, [[(0, 4), (0, 0)], _SHOULDER]),
    "o": (3, [_BOWL]),
    "p": (3, [_BOWL, [(0, 4), (0, -2)]]),
    "q": (3, [_BOWL, [(3, 4), (3, -2)]]),
    "r": (1.9, [[(0, 4), (0, 0)], [(0, 2.2), *_arc(1.5, 2.5, 1.5, 1.5, 180, 75)]]),
    "s": (2.6, [[*_arc(1.3, 3.02, 1.15, 0.98, 35, 270), *_arc(1.3, 1.02, 1.3, 1.02, 90, -145)]]),
    "t": (2, [[(0.8, 5.4), *_arc(1.7, 0.95, 0.9, 0.95, 180, 285)], [(0, 4), (1.9, 4)]]),
    "u": (3, [[(0, 4), *_arc(1.5, 1.5, 1.5, 1.5, 180, 360), (3, 1.8)], [(3, 4), (3, 0)]]),
    "v": (3, [[(0, 4), (1.5, 0), (3, 4)]]),
    "w": (4.4, [[(0, 4), (1.1, 0), (2.2, 4), (3.3, 0), (4.4, 4)]]),
    "x": (2.8, [[(0, 4), (2.8, 0)], [(2.8, 4), (0, 0)]]),
    "y": (3, [[(0, 4), (1.5, 0)], [(3, 4), (0.75, -2)]]),
    "z": (2.7, [[(0, 4), (2.7, 4), (0, 0), (2.7, 0)]]),
}
_GAP = 1.35  # between letters


def draw_text(
    image: np.ndarray, text: str, x: float, y: float, size: float, color: Sequence[int], centred: bool = False
) -> float:
    """Write a line of lower-case letters and spaces into ``image`` (H, W, 3) uint8, in place.

    Parameters
    ----------
    x, y : float
        Where the base line begins, or its middle when ``centred`` [px].
    size : float
        Height of an ascender [px].
    color : (3,)
        sRGB.

    Returns
    -------
    float
        Where the text ends [px].

    Raises
    ------
    MirrorScanError
        When a letter has no shape here.
    """
    missing = sorted(set(text) - set(_GLYPHS))
    if missing:
        raise MirrorScanError(f"caption {text!r}: there are no shapes for {missing}; use lower-case letters and spaces")
    unit = size / 6
    ends = np.cumsum([_GLYPHS[letter][0] + _GAP for letter in text]) - _GAP
    length = float(ends[-1]) * unit if text else 0.0
    x = x - length / 2 if centred else x
    height, width = image.shape[:2]
    pen = 0.42 * unit  # half a stroke's width
    for letter, end in zip(text, ends, strict=True):
        glyph_width, strokes = _GLYPHS[letter]
        left = x + (end - glyph_width) * unit
        u0, u1 = max(int(left - 2 * unit), 0), min(int(left + (glyph_width + 2) * unit) + 1, width)
        v0, v1 = max(int(y - 8 * unit), 0), min(int(y + 4 * unit) + 1, height)
        if u0 >= u1 or v0 >= v1 or not strokes:
            continue
        u, v = np.meshgrid(np.arange(u0, u1), np.arange(v0, v1))
        nearest = np.full(u.shape, np.inf)
        for stroke in strokes:
            path = np.asarray(stroke, np.float64) * (unit, -unit) + (left, y)
            for a, b in zip(path[:-1], path[1:], strict=True):
                d = b - a
                s = ((u - a[0]) * d[0] + (v - a[1]) * d[1]) / max(float(d @ d), 1e-12)
                s = np.clip(s, 0, 1)
                nearest = np.minimum(nearest, np.hypot(u - a[0] - s * d[0], v - a[1] - s * d[1]))
        cover = np.clip(0.5 + pen - nearest, 0, 1)[..., None]
        patch = image[v0:v1, u0:u1]
        image[v0:v1, u0:u1] = (patch * (1 - cover) + np.asarray(color) * cover + 0.5).astype(np.uint8)
    return x + length
