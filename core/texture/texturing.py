"""The whole way from a mesh and colour views to its texture, read top to bottom: :func:`texture_steps`."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..avatar.pose import SkinWeights
from ..errors import MirrorScanError
from ..mesh import Mesh, Texture
from ..mesh.half_edges import check_sheet, twins
from ..mesh.normals import triangle_normals, vertex_normals
from ..numeric.srgb import from_linear, to_linear
from .atlas import Shading, pad, paint
from .baked_light import light_factors
from .color_cameras import ColorView
from .seam_levelling import exposure_gains, gain_tables, level_seams
from .silhouette_registration import view_shifts
from .surface_diffusion import diffuse, neighbours
from .unwrapping import unwrap
from .visibility import Seen, choose_views, seen_vertices, view_weights


@dataclass(frozen=True)
class TextureSettings:
    """How a texture is made.

    Parameters
    ----------
    size : int
        Texels along the image's side, 256 to 8192.
    remove_light : bool
        Take out what light and shade the skin shows.
    register : bool
        Move each view's colours to where the mesh's outline says, where that is certain.
    level_seams : bool
        Bring views to one brightness and tint.
    padding : float
        How far islands' colours go on past their borders, in parts of the image's side.
    """

    size: int = 2048
    remove_light: bool = False
    register: bool = True
    level_seams: bool = True
    padding: float = 0.004

    def __post_init__(self) -> None:
        if not 256 <= self.size <= 8192:
            raise MirrorScanError(f"texture: {self.size} texels are no size for an image here; give 256 to 8192")
        if not 0.0 <= self.padding <= 0.02:
            raise MirrorScanError(f"texture: a padding of {self.padding} of the side is too much; give 0 to 0.02")


@dataclass(frozen=True)
class TextureSummary:
    """What a texture is like.

    Parameters
    ----------
    size : int
        Texels along a side.
    islands : int
    used_share : float
        Of the image, by the islands.
    seen_share : float
        Of the skin, whose colours are from a view; the others are filled from around.
    view_shares : dict
        Of the skin, by the name of the view its colours are from.
    gains : dict
        Of linear light, red, green and blue, a view.
    shifts : dict
        By how much a view's colours were found beside the mesh [px]; 0 where none was certain.
    texel_mm : float
        Side of a texel on the skin.
    """

    size: int
    islands: int
    used_share: float
    seen_share: float
    view_shares: dict[str, float]
    gains: dict[str, tuple[float, float, float]]
    shifts: dict[str, tuple[float, float]]
    texel_mm: float


def make_texture(
    mesh: Mesh,
    views: Sequence[ColorView],
    settings: TextureSettings = TextureSettings(),
    weights: SkinWeights | None = None,
) -> tuple[Texture, TextureSummary]:
    """A texture for a mesh, of all that colour cameras see of it.

    Parameters
    ----------
    mesh : Mesh
        Closed or not; edges with at most two triangles.
    views : sequence of ColorView
        In the mesh's frame; see :func:`.color_cameras.color_views`.
    settings : TextureSettings
    weights : SkinWeights, optional
        Of the mesh's vertices: islands then are regions of bones.

    Raises
    ------
    MirrorScanError
        When there is no view or nothing of the mesh is seen, or the mesh is no manifold.
    """
    steps = texture_steps(mesh, views, settings, weights)
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value


def texture_steps(
    mesh: Mesh,
    views: Sequence[ColorView],
    settings: TextureSettings = TextureSettings(),
    weights: SkinWeights | None = None,
) -> Generator[tuple[float, str], None, tuple[Texture, TextureSummary]]:
    """:func:`make_texture` in pieces: yields (fraction done, what comes next)."""
    if not views:
        raise MirrorScanError(
            "texture: the capture has no colour; record colour, or leave the texture out", code="color"
        )
    if not len(mesh.triangles):
        raise MirrorScanError("texture: the mesh has no triangles")
    if not np.isfinite(mesh.vertices).all():
        raise MirrorScanError("texture: a vertex of the mesh is not a finite number; remove it first")
    if weights is not None and len(weights.index) != len(mesh.vertices):
        raise MirrorScanError(
            f"texture: weights of {len(weights.index)} vertices do not belong to a mesh of {len(mesh.vertices)}"
        )
    twin = twins(mesh.triangles, len(mesh.vertices))
    check_sheet(mesh.triangles, twin, "texture")

    yield 0.0, "Unwrapping the mesh"
    uv, island = unwrap(mesh, weights, 0.5 * settings.padding)

    yield 0.45, "Finding what each view sees"
    shifts = view_shifts(mesh, views) if settings.register else np.zeros((len(views), 2))
    seen = seen_vertices(mesh, views, shifts)
    if not (seen.score > 0).any():
        raise MirrorScanError("texture: no view sees anything of the mesh; check that mesh and views are in one frame")

    yield 0.6, "Bringing views to one brightness"
    label = choose_views(seen, mesh.triangles, twin)
    weight = view_weights(label, seen, mesh.triangles)
    shading, gains = _shading(mesh, list(views), seen, weight, settings)

    yield 0.75, "Painting the texture"
    image, covered = paint(mesh.vertices, mesh.triangles, uv, settings.size, views, shifts, shading)
    used = float(covered.mean())
    pad(image, covered, max(1, round(settings.padding * settings.size)))
    texture = Texture(uv, image, island)
    return texture, _summary(mesh, views, texture, used, label, gains, shifts)


def _shading(
    mesh: Mesh, views: list[ColorView], seen: Seen, weight: np.ndarray, settings: TextureSettings
) -> tuple[Shading, np.ndarray]:
    """What texels are made of, and the views' gains (K, 3)."""
    count = len(mesh.vertices)
    light = _vertex_light(views, seen)
    colors = 255.0 * from_linear(light)
    gains = exposure_gains(views, seen, light) if settings.level_seams else np.ones((len(views), 3))
    table = gain_tables(gains)
    levels = np.empty((count, len(views), 3))
    for k in range(len(views)):
        for c in range(3):
            levels[:, k, c] = np.interp(colors[:, k, c], np.arange(256), table[k, c])
    graph = neighbours(mesh.triangles, count)
    offset = np.zeros((count, len(views), 3), np.float32)
    if settings.level_seams:
        offset = level_seams(graph, seen, levels, weight)
    own = weight[:, :-1]
    total = own.sum(axis=1)
    shown = ((levels + offset) * own[:, :, None]).sum(axis=1) / np.maximum(total, 1e-9)[:, None]
    # colours near an outline may be those of what is behind it
    trust = np.clip(total / 0.5, 0.0, 1.0) ** 2
    everywhere = np.ones(count, np.bool_)
    fill = diffuse(graph, shown, np.where(total > 0.02, _BORDER_PULL * trust, 0.0), everywhere, 120)
    factor = np.ones(count, np.float32)
    if settings.remove_light:
        normals = vertex_normals(mesh.vertices, mesh.triangles)
        factor = light_factors(graph, normals, levels + offset, seen.cosine, weight)
    return Shading(weight, offset, factor, fill.astype(np.float32), table), gains


_BORDER_PULL = 0.3  # filled colours are drawn to those of seen vertices, of several at a time: skin has patterns


def _vertex_light(views: list[ColorView], seen: Seen) -> np.ndarray:
    """Linear light (V, K, 3) float64, 0..1, that each view shows of each vertex, between pixels in straight lines.

    A view from farther away blurs patterns; sums of light do not change by that, those of sRGB levels would.
    """
    light = np.zeros((*seen.score.shape, 3))
    table = to_linear(np.arange(256) / 255.0)
    for k, view in enumerate(views):
        rows = np.flatnonzero(seen.score[:, k] > 0)
        at = seen.pixels[rows, k].astype(np.float64)
        low = np.floor(at).astype(np.int64)
        share = at - low
        for dv in (0, 1):
            for du in (0, 1):
                w = np.abs(1 - du - share[:, 0]) * np.abs(1 - dv - share[:, 1])
                u = np.clip(low[:, 0] + du, 0, view.image.shape[1] - 1)
                v = np.clip(low[:, 1] + dv, 0, view.image.shape[0] - 1)
                light[rows, k] += w[:, None] * table[view.image[v, u]]
    return light


def _summary(mesh, views, texture, used, label, gains, shifts) -> TextureSummary:
    area = 0.5 * np.linalg.norm(triangle_normals(mesh.vertices, mesh.triangles), axis=1)
    whole = max(float(area.sum()), 1e-12)
    size = len(texture.image)
    return TextureSummary(
        size,
        int(texture.island.max()) + 1,
        used,
        float(area[label >= 0].sum() / whole),
        {view.name: float(area[label == k].sum() / whole) for k, view in enumerate(views)},
        {view.name: (float(gains[k, 0]), float(gains[k, 1]), float(gains[k, 2])) for k, view in enumerate(views)},
        {view.name: (float(shifts[k, 0]), float(shifts[k, 1])) for k, view in enumerate(views)},
        float(1e3 * np.sqrt(whole / max(used * size * size, 1.0))),
    )
