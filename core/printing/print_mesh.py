"""An avatar made into what is printed: scaled, standing flat, on a plate, hollow.

The plate is joined exactly, without a library for solids: what of the body is below the plate's upper side is cut away,
and the plate's upper side has holes of the shape of the cut. So body and plate are one closed surface, and the body
above keeps every triangle and colour. The same is done with drain holes in the flat bottom. The cavity of a hollow
print comes from distances on a grid, so that it cannot cut itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.bvh import build_bvh
from ..mesh.soundness import connectivity, volume
from .cavity import cavity_field, cavity_surface, drains, drill, grid_around, moved_off, solid_points
from .plane_cut import cut_above
from .polygons import convex_hull, fill
from .print_settings import PrintSettings

_MM = 1000.0  # in a metre
_SINK = 0.006  # of the height: how far the soles stand in the plate, or are cut flat
_MOST_SINK, _PLATE_SHARE = 1.5, 0.5  # [mm], and of the plate's thickness
_MARGIN = 0.04  # of the height
_GREY = 190
_ROUND = 48  # corners of a circle


class _Part(NamedTuple):
    """Vertices (V, 3) [mm], triangles (T, 3), and colours (V, 3) if the mesh has them."""

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray | None


def prepare_print(mesh: Mesh, settings: PrintSettings = PrintSettings()) -> Mesh:
    """What is to be printed: one closed surface that stands on z = 0.

    Parameters
    ----------
    mesh : Mesh
        Closed, Z up [m].
    settings : PrintSettings
        Size, plate, wall and drain holes.

    Returns
    -------
    Mesh
        At the size of the print, in metres as everything in core; STL and 3MF files are in millimetres. Colours where
        ``mesh`` has them, plate and cavity grey. A hollow print's inner surface is a piece of its own that looks
        inwards.

    Raises
    ------
    MirrorScanError
        When the mesh is open or inside out, a wall leaves no room for a hollow, or no drain hole fits.
    """
    settings.check()
    report = connectivity(mesh)
    if not report["watertight"]:
        raise MirrorScanError(
            "the mesh has {count} open or branching edges, and only a closed one can be printed; close it first",
            count=report["boundary_edges"] + report["nonmanifold_edges"],
        )
    if volume(mesh) <= 0:
        raise MirrorScanError("the mesh is inside out; turn its faces around first")
    vertices = _MM * (mesh.vertices - (0, 0, mesh.vertices[:, 2].min()))
    tall = float(np.ptp(vertices[:, 2]))
    vertices = vertices * (settings.height_mm / tall if settings.height_mm else settings.scale)
    height = float(np.ptp(vertices[:, 2]))
    part = _Part(vertices, np.asarray(mesh.triangles, np.int32), mesh.colors)
    if settings.base_mm or settings.drain_mm:
        part, bottom = _flat_bottom(part, height, settings)
    else:
        bottom = None
    if settings.wall_mm:
        part = _hollow(part, bottom, settings)
    elif bottom is not None:
        part = _capped(part, bottom, [])
    vertices = part.vertices - (0, 0, part.vertices[:, 2].min())
    return Mesh(vertices / _MM, part.triangles, part.colors)


def _flat_bottom(part: _Part, height: float, settings: PrintSettings) -> tuple[_Part, list[np.ndarray]]:
    """The body cut flat, on a plate if wanted, open at the bottom; and the bottom's rings, counter-clockwise."""
    sink = min(_SINK * height, _MOST_SINK, *((_PLATE_SHARE * settings.base_mm,) if settings.base_mm else ()))
    cut = cut_above(part.vertices, part.triangles, sink)
    colors = None
    if part.colors is not None:
        one, other = (part.colors[cut.ends[:, k]].astype(float) for k in range(2))
        colors = np.rint(one + cut.share[:, None] * (other - one)).astype(np.uint8)
    body = _Part(cut.vertices, cut.triangles, colors)
    if not settings.base_mm:
        return body, cut.loops
    margin = settings.margin_mm or _MARGIN * height
    angle = 2 * np.pi * np.arange(_ROUND) / _ROUND
    circle = margin * np.column_stack((np.cos(angle), np.sin(angle)))
    feet = part.vertices[part.vertices[:, 2] <= sink + 0.02 * height, :2]
    outline = convex_hull((convex_hull(feet)[:, None] + circle).reshape(-1, 2))
    n, first = len(outline), len(body.vertices)
    top, bottom = first + np.arange(n), first + n + np.arange(n)
    vertices = np.concatenate((
        body.vertices,
        np.column_stack((outline, np.full(n, sink))),
        np.column_stack((outline, np.full(n, sink - settings.base_mm))),
    ))  # fmt: skip
    upper = fill(vertices[:, :2], [top, *(loop[::-1] for loop in cut.loops)])
    around = np.roll(np.arange(n), -1)
    sides = np.concatenate((
        np.column_stack((bottom, bottom[around], top[around])), np.column_stack((bottom, top[around], top))
    ))  # fmt: skip
    triangles = np.concatenate((body.triangles, upper, sides)).astype(np.int32)
    return _Part(vertices, triangles, _greyed(colors, 2 * n)), [bottom]


def _capped(part: _Part, rings: list[np.ndarray], holes: list[np.ndarray]) -> _Part:
    """The bottom closed within its ``rings`` and around ``holes``, both in the direction of the triangles there."""
    cap = fill(part.vertices[:, :2], [*rings, *holes])
    return part._replace(triangles=np.concatenate((part.triangles, cap[:, ::-1])).astype(np.int32))


def _hollow(part: _Part, bottom: list[np.ndarray] | None, settings: PrintSettings) -> _Part:
    """The part with a cavity, drained through its bottom if wanted."""
    wall, radius = settings.wall_mm, settings.drain_mm / 2
    closed = part if bottom is None else _capped(part, bottom, [])
    grid = grid_around(closed.vertices, wall)
    solid = solid_points(closed.vertices, closed.triangles, grid)
    tree = build_bvh(closed.vertices, closed.triangles)
    field = cavity_field(tree, wall, grid, solid)
    found = np.empty((0, 3))
    level = float(closed.vertices[:, 2].min())
    if radius:
        found = drains(tree, grid, solid, field, level, radius, wall)
        if not len(found):
            raise MirrorScanError(
                "no drain hole of {width:g} mm fits through the feet; take a smaller one, a thinner wall or a plate",
                width=settings.drain_mm,
            )
        drill(field, grid, found, radius)
    inner = cavity_surface(field, grid, wall, level if radius else None)
    if inner is None:
        raise MirrorScanError(
            "a wall of {wall:g} mm leaves no hollow in a print of this size; take a thinner wall or print it solid",
            wall=wall,
        )
    inner = moved_off(inner, tree, grid, wall, found, radius)
    holes: list[np.ndarray] = []
    first = len(part.vertices)
    if radius:
        cut = cut_above(inner.vertices, inner.triangles, level)
        inner, holes = Mesh(cut.vertices, cut.triangles), [first + loop[::-1] for loop in cut.loops]
    part = _Part(
        np.concatenate((part.vertices, inner.vertices)),
        np.concatenate((part.triangles, first + inner.triangles[:, ::-1])).astype(np.int32),
        _greyed(part.colors, len(inner.vertices)),
    )
    return part if bottom is None else _capped(part, bottom, holes)


def _greyed(colors: np.ndarray | None, count: int) -> np.ndarray | None:
    """Colours with ``count`` greys behind them."""
    return None if colors is None else np.concatenate((colors, np.full((count, 3), _GREY, np.uint8)))
