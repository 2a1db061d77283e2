"""Texture of patterned bodies before mirrors of different tint, against the true pattern and against vertex colours.

Colour images are ray cast here, independently of the virtual rig: as wide as depth, twice and four times, with and
without colour that is 2 px of the depth map and 30 ms off. ``python -m benchmarks.look_texture [BODY …]`` prints the
tables alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skin_weights import strongest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import Mesh, Texture
from mirror_scan.core.mesh.bvh import build_bvh, closest_point, raycast
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import plane_mirror, reflection_matrix
from mirror_scan.core.numeric.srgb import from_linear, to_linear
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.preview.mesh_views import SIDES, render_views
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.texture import ColorView, TextureSettings, color_views, make_texture
from mirror_scan.core.texture.unwrapping.islands import flipped_count
from mirror_scan.core.texture.visibility import choose_views, seen_vertices

from .machine import say
from .results import Finding, Result, Table, limits_table, number
from .rig_weights import FOLDER
from .rig_weights import Rig as Body

BODIES = ("s020", "s011")
PERIODS = (0.008, 0.016, 0.032)
"""Of the pattern's three waves [m]."""
TINTS = ((1.0, 1.0, 1.0), (0.80, 0.86, 0.80), (0.88, 0.82, 0.80))
"""Of linear light: straight, and by each mirror."""
OFF_PX, OFF_M = 2.0, 0.0009
"""Colour that is off: its image shifted [px of the depth map]; the body swayed for 30 ms at 30 mm a second [m]."""
_WAVES = np.array(((0.58, 0.55, 0.60), (-0.62, 0.60, 0.50), (0.55, -0.60, 0.58)))
_POINTS = 400_000
_SIDE_POINTS = 60  # of a cell on either side of a border between views, for a step there to count


def pattern(points: np.ndarray) -> np.ndarray:
    """Colour (N, 3) of a body at points (N, 3) of its skin: waves of three lengths, and a broad one, 0..255."""
    color = np.full(points.shape, (150.0, 128.0, 112.0))
    for period, wave in zip(PERIODS, _WAVES, strict=True):
        color += 26.0 * np.sin(2 * np.pi / period * (points @ (wave / np.linalg.norm(wave))))[:, None]
    color += np.array((12.0, -10.0, 8.0)) * np.sin(points @ (9.0, 7.0, 5.0))[:, None]
    return color


def wave(points: np.ndarray) -> np.ndarray:
    """The shortest of the waves alone (N,), -1..1."""
    direction = _WAVES[0] / np.linalg.norm(_WAVES[0])
    return np.sin(2 * np.pi / PERIODS[0] * (points @ direction))


@dataclass(frozen=True)
class Case:
    """A body, its avatar, and where cameras stand."""

    name: str
    body: Mesh
    mesh: Mesh
    weights: SkinWeights | None
    rig: Rig
    mirrors: tuple[Mirror, ...]  # as the avatar's reconstruction has them, camera frame
    camera_to_avatar: np.ndarray


def scanned(name: str) -> Case:
    """The avatar of a body, as it comes out of the virtual rig."""
    truth = Body(name)
    rig = default_rig(seed=3)
    simulation = simulate(truth.body, rig)
    made = reconstruct(simulation.capture, settings=replace(Settings(), skeleton=True))
    return Case(name, truth.body, made.mesh, made.weights, rig, made.mirrors, made.camera_to_avatar)


def exact(name: str) -> Case:
    """The body itself in place of its avatar, and the true mirrors."""
    truth = Body(name)
    rig = default_rig(seed=3)
    mirrors = []
    to_camera = np.linalg.inv(rig.camera_to_avatar)
    for m in rig.mirrors:
        right, up, normal = m.axes
        point = to_camera[:3, :3] @ np.array(m.centre) + to_camera[:3, 3]
        made = plane_mirror(m.name, point, to_camera[:3, :3] @ normal)
        mirrors.append(replace(made, rectangle=np.array(((-m.width / 2, m.width / 2), (-m.height / 2, m.height / 2)))))
    weights = None
    if truth.dense.any():
        weights = strongest(truth.dense)
    return Case(name, truth.body, truth.body, weights, rig, tuple(mirrors), rig.camera_to_avatar)


def photographed(case: Case, scale: int, off: bool, grain: int = 0) -> tuple[np.ndarray, Intrinsics]:
    """The colour image of a case, ``scale`` times as wide as depth: four rays a pixel, grain of 1.5 levels."""
    depth_lens = case.rig.intrinsics
    lens = depth_lens.scaled(depth_lens.width * scale, depth_lens.height * scale)
    shift = OFF_PX * scale if off else 0.0
    body = case.body if not off else replace(case.body, vertices=case.body.vertices + (OFF_M, 0.0, 0.0))
    tree = build_bvh(np.ascontiguousarray(body.vertices, np.float64), np.ascontiguousarray(body.triangles, np.int32))
    rng = np.random.default_rng(grain)
    v, u = np.mgrid[0 : lens.height, 0 : lens.width]
    image = 118.0 + 40.0 * np.sin(u / (9.0 * scale))[..., None] * np.cos(v / (13.0 * scale))[..., None]
    image = np.repeat(image, 3, axis=2) + (0.0, 10.0, 20.0)
    to_camera = np.linalg.inv(case.rig.camera_to_avatar)
    poses = [to_camera]
    for m in case.rig.mirrors:
        normal = to_camera[:3, :3] @ m.axes[2]
        point = to_camera[:3, :3] @ np.array(m.centre) + to_camera[:3, 3]
        poses.append(reflection_matrix(plane_mirror(m.name, point, normal)) @ to_camera)
    for k in (*range(1, len(poses)), 0):  # the body itself stands in front of its reflections
        _lay(image, body, tree, poses[k], lens, shift, case.rig, None if k == 0 else k - 1, TINTS[k])
    image += 1.5 * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), lens


def _lay(image, body, tree, pose, lens, shift, rig, mirror, tint) -> None:
    """Draw one view of the body into the image, in place."""
    points = body.vertices @ pose[:3, :3].T + pose[:3, 3]
    at = points[:, :2] / points[:, 2:] * (lens.fx, lens.fy) + (lens.cx + shift, lens.cy)
    low = np.maximum(np.floor(at.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(at.max(axis=0)).astype(int) + 2, (lens.width, lens.height))
    u, v = (a.ravel() for a in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])))
    total, hits = np.zeros((len(u), 3)), np.zeros(len(u))
    back = np.linalg.inv(pose)
    moved = OFF_M if shift else 0.0
    for du, dv in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
        rays = np.column_stack(((u + du - shift - lens.cx) / lens.fx, (v + dv - lens.cy) / lens.fy, np.ones(len(u))))
        t, triangle, _ = raycast(tree, back[:3, 3], rays @ back[:3, :3].T)
        hit = triangle >= 0
        if mirror is not None:
            hit &= _through(rays, rig, mirror)
        place = back[:3, 3] + t[hit, None] * (rays[hit] @ back[:3, :3].T) - (moved, 0.0, 0.0)
        total[hit] += to_linear(np.clip(pattern(place), 0, 255) / 255.0) * tint
        hits += hit
    some = hits > 0
    share = (hits[some] / 4)[:, None]
    before = to_linear(np.clip(image[v[some], u[some]], 0, 255) / 255.0)
    image[v[some], u[some]] = 255.0 * from_linear(total[some] / 4 + (1 - share) * before)


def _through(rays: np.ndarray, rig: Rig, k: int) -> np.ndarray:
    """Which rays of the camera, bool (N,), meet the glass of mirror k."""
    m = rig.mirrors[k]
    pose = rig.camera_to_avatar
    direction = rays @ pose[:3, :3].T
    right, up, normal = m.axes
    offset = np.array(m.centre) - pose[:3, 3]
    t = (offset @ normal) / (direction @ normal)
    place = t[:, None] * direction - offset
    return (t > 0) & (np.abs(place @ right) < m.width / 2) & (np.abs(place @ up) < m.height / 2)


def views_of(case: Case, image: np.ndarray, lens: Intrinsics) -> list[ColorView]:
    """Its colour views by what the reconstruction knows."""
    capture = _Stored(image, lens, image, lens, np.eye(4))
    return color_views(capture, case.mirrors, case.camera_to_avatar)


@dataclass(frozen=True)
class _Stored:
    color: np.ndarray
    intrinsics: Intrinsics
    native_color: np.ndarray
    color_intrinsics: Intrinsics
    depth_to_color: np.ndarray


def sampled(texture: Texture, triangle: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """The texture's colours (N, 3) at points of triangles, between texels in straight lines."""
    size = len(texture.image)
    at = np.einsum("nk,nkc->nc", shares, texture.uv[triangle].astype(np.float64))
    x, y = at[:, 0] * size - 0.5, (1 - at[:, 1]) * size - 0.5
    u, v = np.floor(x).astype(int), np.floor(y).astype(int)
    out = np.zeros((len(at), 3))
    for dv in (0, 1):
        for du in (0, 1):
            w = np.abs(1 - du - (x - u)) * np.abs(1 - dv - (y - v))
            out += w[:, None] * texture.image[np.clip(v + dv, 0, size - 1), np.clip(u + du, 0, size - 1)]
    return out


@dataclass(frozen=True)
class Measured:
    """PSNR of texture and vertex colours [dB], contrast of the shortest wave, step over borders of views [levels]."""

    psnr: float
    vertex_psnr: float
    contrast: float
    step: float


class Judge:
    """Points on the avatar's skin that some view sees, and what they truly look like."""

    def __init__(self, case: Case, views: Sequence[ColorView]):
        mesh = case.mesh
        rng = np.random.default_rng(1)
        corners = mesh.vertices[mesh.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        seen = seen_vertices(mesh, views, np.zeros((len(views), 2))).score
        shown = (seen[mesh.triangles] > 0).all(axis=1).any(axis=1)
        self.triangle = rng.choice(len(area), _POINTS, p=area * shown / (area * shown).sum())
        self.shares = rng.dirichlet((1, 1, 1), _POINTS)
        self.points = np.einsum("nk,nkc->nc", self.shares, corners[self.triangle])
        tree = build_bvh(case.body.vertices, case.body.triangles)
        to_truth = case.rig.camera_to_avatar @ np.linalg.inv(case.camera_to_avatar)
        placed = self.points @ to_truth[:3, :3].T + to_truth[:3, 3]
        self.true = closest_point(tree, placed)[2]
        self.color = np.clip(pattern(self.true), 0, 255)
        self.wave = wave(self.true)
        self.case = case

    def measure(self, texture: Texture, vertex_colors: np.ndarray, label: np.ndarray) -> Measured:
        """How near ``texture`` comes, and vertex colours (V, 3)."""
        got = sampled(texture, self.triangle, self.shares)
        corners = self.case.mesh.triangles[self.triangle]
        by_vertex = np.einsum("nk,nkc->nc", self.shares, vertex_colors[corners].astype(np.float64))
        plain = self.color.mean(axis=1) - 26.0 * self.wave
        left = got.mean(axis=1) - plain
        contrast = float((left * self.wave).mean() / (26.0 * (self.wave**2).mean()))
        return Measured(psnr(got, self.color), psnr(by_vertex, self.color), contrast, self.step(got, label))

    def step(self, got: np.ndarray, label: np.ndarray) -> float:
        """Mean step over borders between views, of what differs from the truth [levels].

        Means over cells of 10 cm that both views have a part of: over shorter ones waves that lie a little beside the
        truth would not cancel.
        """
        error = (got - self.color).mean(axis=1)
        own = label[self.triangle]
        cell = np.floor(self.points / 0.10).astype(np.int64) @ (1, 1000, 1000000)
        _, cell = np.unique(cell, return_inverse=True)
        steps, weights = [], []
        views = int(label.max()) + 1
        table = np.zeros((cell.max() + 1, views))
        count = np.zeros_like(table)
        np.add.at(table, (cell[own >= 0], own[own >= 0]), error[own >= 0])
        np.add.at(count, (cell[own >= 0], own[own >= 0]), 1)
        for a in range(views):
            for b in range(a + 1, views):
                both = (count[:, a] > _SIDE_POINTS) & (count[:, b] > _SIDE_POINTS)
                steps += np.abs(table[both, a] / count[both, a] - table[both, b] / count[both, b]).tolist()
                weights += np.minimum(count[both, a], count[both, b]).tolist()
        return float(np.average(steps, weights=weights)) if steps else 0.0


def psnr(got: np.ndarray, true: np.ndarray) -> float:
    return float(10 * np.log10(255.0**2 / np.mean((np.clip(got, 0, 255) - true) ** 2)))


def vertex_colors(case: Case, views: Sequence[ColorView]) -> np.ndarray:
    """What the avatar's vertices are coloured with today: the best view's pixel, a gain a mirror known (V, 3)."""
    seen = seen_vertices(case.mesh, views, np.zeros((len(views), 2)))
    best = seen.score.argmax(axis=1)
    rows = np.arange(len(best))
    u, v = np.rint(seen.pixels[rows, best]).astype(int).T
    image = views[0].image
    color = image[np.clip(v, 0, image.shape[0] - 1), np.clip(u, 0, image.shape[1] - 1)]
    light = to_linear(color / 255.0) / np.array(TINTS)[best]
    return 255.0 * from_linear(np.clip(light, 0, 1))


@dataclass(frozen=True)
class Made:
    """A texture, how it measures, and how long it took, warm [s]."""

    texture: Texture
    measured: Measured
    islands: int
    used: float
    flipped: int
    seconds: float


def made(case: Case, scale: int, off: bool, size: int = 2048, again: bool = False) -> Made:
    """The texture of a case from a colour image ``scale`` times as wide as depth."""
    views = views_of(case, *photographed(case, scale, off))
    before = vertex_colors(case, views if scale == 1 else views_of(case, *photographed(case, 1, off)))
    seen = seen_vertices(case.mesh, views, np.zeros((len(views), 2)))
    label = choose_views(seen, case.mesh.triangles, twins(case.mesh.triangles, len(case.mesh.vertices)))
    settings = TextureSettings(size=size)
    texture, summary = make_texture(case.mesh, views, settings, case.weights)
    seconds = float("nan")
    if again:
        start = time.perf_counter()
        make_texture(case.mesh, views, settings, case.weights)
        seconds = time.perf_counter() - start
    judge = Judge(case, views)
    return Made(
        texture, judge.measure(texture, before, label), summary.islands, summary.used_share,
        flipped_count(texture.uv), seconds,
    )  # fmt: skip


LIMITS = {(2, False): (4.0, 0.0), (4, False): (8.0, 0.7), (4, True): (4.0, 0.5)}
"""Least gain over vertex colours [dB] and least contrast, by size and whether colour is off."""


def run(bodies: Sequence[str] = BODIES, pictures: Path | None = None) -> Result:
    """All bodies, each with colour of three sizes, true and off."""
    table = Table(
        "Texture of patterned avatars, skin that some view sees: PSNR [dB], contrast of 8 mm waves, step between views",
        (
            "body",
            "colour",
            "vertex colours",
            "texture",
            "gain",
            "contrast",
            "step",
            "islands",
            "used",
            "flipped",
            "2 K [s]",
        ),
        left=2,
    )
    result = Result([table], [])
    if not FOLDER.is_dir():
        table.notes.append("left out: no bodies with a rig")
        return result
    for name in bodies:
        case = scanned(name)
        for scale, off in ((1, False), (2, False), (4, False), (4, True)):
            say(f"texture: {name}, colour {scale} ×{', off' if off else ''}")
            one = made(case, scale, off, again=scale == 4 and not off)
            m = one.measured
            what = f"{scale} × depth{', 2 px and 30 ms off' if off else ''}"
            table.rows.append((
                name, what, number(m.vertex_psnr, 1), number(m.psnr, 1), number(m.psnr - m.vertex_psnr, 1),
                number(m.contrast), number(m.step, 1), str(one.islands), f"{100 * one.used:.0f} %", str(one.flipped),
                number(one.seconds, 1) if one.seconds == one.seconds else "–",
            ))  # fmt: skip
            if (scale, off) in LIMITS:
                gain, contrast = LIMITS[scale, off]
                result.findings.append(Finding(
                    f"{name}, colour {what}: at least {gain:g} dB over vertex colours, contrast {contrast:g}, step at "
                    "most 2 levels, 40 islands, 55 % used, none flipped",
                    f"{m.psnr - m.vertex_psnr:.1f} dB, {m.contrast:.2f}, {m.step:.1f}, {one.islands}, "
                    f"{100 * one.used:.0f} %, {one.flipped}",
                    m.psnr - m.vertex_psnr >= gain and m.contrast >= contrast and (off or m.step <= 2.0)
                    and one.islands <= 40 and one.used >= 0.55 and one.flipped == 0,
                ))  # fmt: skip
            if pictures is not None:
                sides = render_views(case.mesh, None, list(SIDES.values()), 400, 800, texture=one.texture)
                write_png(pictures / f"texture_{name}_{scale}{'_off' if off else ''}.png", sides)
    return result


def tables(quick: bool) -> Result:
    """All there is, or one body."""
    return run(BODIES[:1] if quick else BODIES)


if __name__ == "__main__":
    found = run(sys.argv[1:] or BODIES)
    for each_table in (*found.tables, limits_table(found.findings)):
        print(each_table.text())
