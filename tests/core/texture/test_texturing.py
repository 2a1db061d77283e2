"""Texture against the truth: what cameras and mirrors show of painted bodies, and what they cannot show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, project
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point, raycast
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.numeric.srgb import from_linear, to_linear
from mirror_scan.core.texture import ColorView, TextureSettings, color_views, make_texture, texture_steps
from mirror_scan.core.texture.atlas import _sample_kernel, pad, spline_coefficients
from mirror_scan.core.texture.silhouette_registration import view_shifts
from mirror_scan.core.texture.surface_diffusion import diffuse, neighbours
from mirror_scan.core.texture.visibility import choose_views, seen_vertices, view_weights

trimesh = pytest.importorskip("trimesh")

LENS = Intrinsics(480, 400, 520.0, 520.0, 239.5, 199.5)
CAMERA = np.array(((1.0, 0, 0, 0.05), (0, 0, -1, 0), (0, 1, 0, 3.0), (0, 0, 0, 1)))  # from 3 m in front, at y = -3
TINTS = ((1.0, 1.0, 1.0), (0.7, 0.8, 0.75), (0.85, 0.72, 0.8))


@dataclass(frozen=True)
class Taken:
    """As much of a capture as is needed."""

    color: np.ndarray
    intrinsics: Intrinsics
    native_color: np.ndarray | None = None
    color_intrinsics: Intrinsics | None = None
    depth_to_color: np.ndarray | None = None


def blob() -> Mesh:
    """Two balls that have grown together, one hiding a part of the other."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.35)
    vertices = np.array(ball.vertices)
    vertices *= 1 + 0.35 * np.sin(5 * vertices[:, :1]) * np.cos(6 * vertices[:, 2:])
    return Mesh(vertices, np.array(ball.faces, np.int32))


def paint_of(points: np.ndarray) -> np.ndarray:
    """Colours that change slowly over the body."""
    return 130 + 60 * np.sin(points @ np.array(((6.0, 2, 1), (1, 5, 3), (2, -3, 4))).T)


def mirrors_behind():
    """Two that show the body from 115° to either side, out of 4.2 m."""
    found = []
    for name, angle in (("left", -115.0), ("right", 115.0)):
        image = np.array((4.2 * np.sin(np.radians(angle)), 0.0, 3.0 - 4.2 * np.cos(np.radians(angle))))
        found.append(plane_mirror(name, image / 2, -image))
    return tuple(found)


def photo(mesh: Mesh, mirrors, shift=(0.0, 0.0), back=(90.0, 110.0, 125.0), tints=TINTS, paint=paint_of) -> np.ndarray:
    """What the camera sees of the painted mesh, straight and in the mirrors, by rays."""
    tree = build_bvh(mesh.vertices, mesh.triangles)
    v, u = np.mgrid[0 : LENS.height, 0 : LENS.width].astype(float)
    rays = np.stack(((u - shift[0] - LENS.cx) / LENS.fx, (v - shift[1] - LENS.cy) / LENS.fy, np.ones_like(u)), -1)
    image = np.tile(np.array(back), (*u.shape, 1)) + 8 * np.sin(u / 7)[..., None] * np.cos(v / 5)[..., None]
    nearest = np.full(u.shape, np.inf)
    views = color_views(Taken(image.astype(np.uint8), LENS), mirrors, np.linalg.inv(CAMERA))
    for view, tint in zip(views, tints, strict=True):
        back_to = np.linalg.inv(view.from_avatar)
        t, triangle, _ = raycast(tree, back_to[:3, 3], rays.reshape(-1, 3) @ back_to[:3, :3].T)
        hit = (triangle >= 0) & (t < nearest.ravel())
        points = back_to[:3, 3] + t[hit, None] * (rays.reshape(-1, 3)[hit] @ back_to[:3, :3].T)
        light = to_linear(np.clip(paint(points), 0, 255) / 255) * tint
        image.reshape(-1, 3)[hit] = 255 * from_linear(light)
        nearest.reshape(-1)[hit] = t[hit]
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def colors_on(texture, mesh: Mesh, count: int = 4000):
    """Colours (N, 3) of random places of the skin, the places (N, 3), and their triangles."""
    rng = np.random.default_rng(3)
    triangle = rng.integers(0, len(mesh.triangles), count)
    shares = rng.dirichlet((1, 1, 1), count)
    points = np.einsum("nk,nkc->nc", shares, mesh.vertices[mesh.triangles[triangle]])
    at = np.einsum("nk,nkc->nc", shares, texture.uv[triangle].astype(float))
    size = len(texture.image)
    column, row = (np.clip(x * size, 0, size - 1).astype(int) for x in (at[:, 0], 1 - at[:, 1]))
    return texture.image[row, column].astype(float), points, triangle


@pytest.fixture(scope="module")
def scene():
    mesh, mirrors = blob(), mirrors_behind()
    image = photo(mesh, mirrors)
    views = color_views(Taken(image, LENS), mirrors, np.linalg.inv(CAMERA))
    texture, summary = make_texture(mesh, views, TextureSettings(size=1024))
    return mesh, views, texture, summary


def test_views_are_cameras_and_their_reflections(scene):
    """A mirror's camera sees a point where the camera sees its reflection, also of a camera beside."""
    _, mirrors = scene[0], mirrors_behind()
    beside = np.eye(4)
    beside[:3, 3] = (0.03, -0.01, 0.02)
    image = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    views = color_views(Taken(image, LENS, image, LENS, beside), mirrors, np.linalg.inv(CAMERA))
    points = np.random.default_rng(0).normal(0, 0.3, (50, 3))
    before = points @ CAMERA[:3, :3].T + CAMERA[:3, 3]
    for view, mirror in zip(views, (None, *mirrors), strict=True):
        real = before if mirror is None else reflect(before, mirror)
        pixels = project(real + beside[:3, 3], LENS)
        homogeneous = points @ view.projection[:, :3].T + view.projection[:, 3]
        np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], pixels, atol=1e-8)
        assert view.mirrored == (mirror is not None)
    framed = replace(mirrors[0], rectangle=np.array(((-0.4, 0.4), (-0.8, 0.8))))
    (outline,) = [
        v.outline for v in color_views(Taken(image, LENS, image, LENS, beside), [framed], np.eye(4)) if v.mirrored
    ]
    corner = framed.point + framed.basis[:, :2] @ (-0.4, -0.8)
    np.testing.assert_allclose(outline[0], project(corner + beside[:3, 3], LENS), atol=1e-8)
    assert color_views(Taken(None, LENS), mirrors, np.eye(4)) == []


def test_vertices_are_seen_where_rays_reach_them(scene):
    mesh, views, _, _ = scene
    seen = seen_vertices(mesh, views, np.zeros((len(views), 2)))
    tree = build_bvh(mesh.vertices, mesh.triangles)
    for k, view in enumerate(views):
        eye = np.linalg.inv(view.from_avatar)[:3, 3]
        t, _, _ = raycast(tree, eye, mesh.vertices - eye)
        assert (t[seen.score[:, k] > 0] > 1 - 0.02).all(), "hidden vertices are taken"
        np.testing.assert_allclose(
            seen.pixels[:, k],
            project(mesh.vertices @ view.from_avatar[:3, :3].T + view.from_avatar[:3, 3], LENS),
            atol=1e-3,
        )
    # not of a mirror what the body itself hides of it: rays of the camera meet the body first
    rays = np.column_stack(((seen.pixels[:, 1] - (LENS.cx, LENS.cy)) / (LENS.fx, LENS.fy), np.ones(len(mesh.vertices))))
    back = np.linalg.inv(views[0].from_avatar)
    _, met, _ = raycast(tree, back[:3, 3], rays @ back[:3, :3].T)
    assert not ((met >= 0) & (seen.score[:, 1] > 0)).any()


def test_the_texture_shows_what_was_painted(scene):
    mesh, views, texture, summary = scene
    got, points, triangle = colors_on(texture, mesh)
    seen = seen_vertices(mesh, views, np.zeros((len(views), 2)))
    shown = (seen.score[mesh.triangles] > 0).all(axis=1).any(axis=1)[triangle]
    error = np.abs(got - paint_of(points))
    assert error[shown].mean() < 4 and np.quantile(error[shown], 0.95) < 12
    assert error[~shown].mean() < 40, "filled from around"
    assert summary.size == 1024 and summary.islands == texture.island.max() + 1
    assert 0.9 > summary.seen_share > 0.6 and summary.used_share > 0.4
    for k, view in enumerate(views):
        np.testing.assert_allclose(summary.gains[view.name], 1 / np.array(TINTS[k]), rtol=0.04)


def test_views_meet_without_a_step(scene):
    mesh, views, texture, _ = scene
    seen = seen_vertices(mesh, views, np.zeros((len(views), 2)))
    label = choose_views(seen, mesh.triangles, twins(mesh.triangles, len(mesh.vertices)))
    got, points, triangle = colors_on(texture, mesh, 60000)
    error = (got - paint_of(points)).mean(axis=1)
    cell = np.floor(points / 0.06).astype(int) @ (1, 1000, 1000000)
    steps = []
    for one in np.unique(cell):
        own, views_here = error[cell == one], label[triangle[cell == one]]
        sides = [own[views_here == k] for k in range(3) if (views_here == k).sum() > 20]
        steps += [abs(sides[0].mean() - other.mean()) for other in sides[1:]]
    assert len(steps) > 5 and np.mean(steps) < 2.5


def test_colours_are_registered_to_the_outline():
    mesh, mirrors = blob(), mirrors_behind()
    image = photo(mesh, mirrors, shift=(3.0, -2.0))
    views = color_views(Taken(image, LENS), mirrors, np.linalg.inv(CAMERA))
    np.testing.assert_allclose(view_shifts(mesh, views), np.tile((3.0, -2.0), (3, 1)), atol=0.6)


def test_colours_stay_where_the_outline_cannot_be_told():
    """The wall has the body's own colours."""
    mesh = blob()
    image = photo(mesh, (), tints=TINTS[:1])
    rng = np.random.default_rng(0)
    body = image[150:250, 200:280].reshape(-1, 3)
    image = body[rng.integers(0, len(body), image.shape[:2])]
    views = color_views(Taken(image, LENS), (), np.linalg.inv(CAMERA))
    assert (view_shifts(mesh, views) == 0).all()


def test_all_corners_of_a_triangle_are_shown_by_its_view(scene):
    mesh, views, _, _ = scene
    seen = seen_vertices(mesh, views, np.zeros((len(views), 2)))
    label = choose_views(seen, mesh.triangles, twins(mesh.triangles, len(mesh.vertices)))
    weight = view_weights(label, seen, mesh.triangles)
    np.testing.assert_allclose(weight.sum(axis=1), 1, atol=1e-6)
    for k in range(len(views)):
        assert (seen.score[mesh.triangles[label == k], k] > 0).all()
        assert (seen.score[weight[:, k] > 0, k] > 0).all()


def test_diffusion_solves_its_equations():
    mesh = blob()
    rng = np.random.default_rng(1)
    count = len(mesh.vertices)
    graph = neighbours(mesh.triangles, count)
    target, pull = rng.normal(size=(count, 2)), np.where(rng.random(count) < 0.2, 0.5, 0.01)
    member = mesh.vertices[:, 2] > -0.1
    got = diffuse(graph, target, pull, member, 400)
    start, heads = graph
    tail = np.repeat(np.arange(count), np.diff(start))
    inner = member[tail] & member[heads]
    laplace = np.diag(pull)
    np.add.at(laplace, (tail[inner], tail[inner]), 1.0)
    np.add.at(laplace, (tail[inner], heads[inner]), -1.0)
    rows = np.flatnonzero(member)
    exact = np.linalg.solve(laplace[np.ix_(rows, rows)], pull[rows, None] * target[rows])
    np.testing.assert_allclose(got[rows], exact, atol=1e-4)
    assert (got[~member] == 0).all()


@pytest.mark.parametrize("pixels, least", [(3.5, 0.93), (5.0, 0.98), (9.0, 0.995)])
def test_waves_of_a_few_pixels_keep_their_contrast(pixels, least):
    """Pixels are means over their squares; a wave between them comes back nearly whole, and in its place."""
    turns = 2 * np.pi / pixels
    edge = np.arange(61) - 0.5
    mean = (np.cos(turns * edge[:-1]) - np.cos(turns * edge[1:])) / turns
    image = 128 + 100 * np.repeat(np.repeat(mean[None], 50, axis=0)[:, :, None], 3, axis=2)
    at = np.random.default_rng(0).uniform(10, 40, (500, 2))
    for levels, points in ((image, at), (np.swapaxes(image, 0, 1), at[:, ::-1])):
        found = np.zeros((len(at), 3), np.float32)
        homogeneous = np.column_stack((points, np.ones(len(at)))).astype(np.float32)
        _sample_kernel(spline_coefficients(levels.astype(np.float32)), homogeneous, found)
        waves = np.column_stack((np.sin(turns * at[:, 0]), np.cos(turns * at[:, 0])))
        contrast, beside = np.linalg.lstsq(waves, (found[:, 0] - 128.0) / 100.0, rcond=None)[0]
        assert least < contrast < 1.01 and abs(beside) < 0.01
    flat = spline_coefficients(np.full((9, 12, 3), 77, np.float32))
    np.testing.assert_allclose(flat, 77, rtol=1e-5)


def test_padding_grows_islands_by_its_width():
    image = np.zeros((40, 40, 3), np.uint8)
    covered = np.zeros((40, 40), bool)
    covered[18:22, 18:22] = True
    image[covered] = (200, 100, 50)
    image[0, 0], covered[0, 0] = (10, 20, 30), True
    pad(image, covered, 5)
    assert (image[18, 13] == (200, 100, 50)).all() and (image[5, 0] == (10, 20, 30)).all()
    mean = np.rint((16 * np.array((200, 100, 50)) + (10, 20, 30)) / 17)
    assert (image[30, 30] == mean).all(), "far away: the mean"


def test_progress_is_told_and_what_is_wrong_is_said(scene):
    mesh, views, _, _ = scene
    told = list(texture_steps(mesh, views, TextureSettings(size=256)))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions) and fractions[0] == 0 and all(message for _, message in told)
    with pytest.raises(MirrorScanError, match="no colour"):
        make_texture(mesh, [])
    with pytest.raises(MirrorScanError, match="no view sees anything"):
        away = np.diag((1.0, -1.0, -1.0, 1.0)) @ CAMERA
        make_texture(mesh, [replace(views[0], from_avatar=away, camera=away)])
    with pytest.raises(MirrorScanError, match="no size for an image"):
        TextureSettings(size=100_000)
    with pytest.raises(MirrorScanError, match="does not fit intrinsics"):
        ColorView("x", np.zeros((3, 3, 3), np.uint8), LENS, CAMERA, CAMERA)
    broken = replace(mesh, triangles=np.concatenate((mesh.triangles, mesh.triangles[:1])))
    with pytest.raises(MirrorScanError, match="share an edge"):
        make_texture(broken, views)


def test_light_is_taken_out_and_two_colours_of_skin_stay():
    """Light from one side, and a lamp at the camera: both depend on how the skin is turned, and one on who looks."""
    mesh, mirrors = blob(), mirrors_behind()
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    tree = build_bvh(mesh.vertices, mesh.triangles)

    def own(points):
        return np.where(points[:, 2:] > 0.02, (190.0, 150.0, 120.0), (90.0, 110.0, 140.0))

    def lit(points):
        _, triangle, _ = closest_point(tree, points)
        turned = normals[mesh.triangles[triangle]].mean(axis=1)
        return own(points) * (0.75 + 0.25 * turned @ (0.6, -0.5, 0.62))[:, None]

    image = photo(mesh, mirrors, tints=((1.0,) * 3,) * 3, paint=lit)
    views = color_views(Taken(image, LENS), mirrors, np.linalg.inv(CAMERA))
    seen = seen_vertices(mesh, views, np.zeros((3, 2)))
    spread = []
    for remove in (False, True):
        texture, _ = make_texture(mesh, views, TextureSettings(size=1024, remove_light=remove))
        got, points, triangle = colors_on(texture, mesh)
        shown = (seen.score[mesh.triangles] > 0).all(axis=1).any(axis=1)[triangle] & (
            np.abs(points[:, 2] - 0.02) > 0.02
        )
        ratio = np.log((got / own(points))[shown].mean(axis=1))
        spread.append(ratio.std())
    assert spread[1] < 0.35 * spread[0]
