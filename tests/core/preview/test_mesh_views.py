"""Pictures: silhouettes of known size, sides the right way round, holes and kinds to be seen."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError, OutputError
from mirror_scan.core.io.images import read_image
from mirror_scan.core.mesh import FILL, SEAM, Mesh
from mirror_scan.core.preview.mesh_views import BACKGROUND, SIDES, draw_text, render_preview, render_views
from textured import textured_ball

trimesh = pytest.importorskip("trimesh")


def ball(keep=slice(None), colors=None, kind=None) -> Mesh:
    mesh = trimesh.creation.icosphere(4, 0.5)
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces[keep], np.int32), colors, None, kind)


def shown(picture):
    return (picture != BACKGROUND).any(axis=-1)


def test_silhouette_has_the_size_and_place_of_a_disc():
    picture = render_views(ball(), None, [(1, 2, 3)], 300, 200)
    assert picture.shape == (200, 300, 3) and picture.dtype == np.uint8
    mask = shown(picture)
    radius = 0.94 * 200 / 2
    assert mask.sum() == pytest.approx(np.pi * radius**2, rel=0.03)
    v, u = np.nonzero(mask)
    assert u.mean() == pytest.approx(149.5, abs=0.5) and v.mean() == pytest.approx(99.5, abs=0.5)
    assert picture[60, 120].mean() > picture[150, 190].mean() + 20  # lit from the upper left


def test_sides_are_the_persons_own_and_up_is_up():
    ball_ = ball()
    colors = np.full((len(ball_.vertices), 3), 128, np.uint8)
    colors[ball_.vertices[:, 0] > 0.3] = 250, 0, 0  # a person facing -Y has +X on the left hand
    colors[ball_.vertices[:, 2] > 0.4] = 0, 0, 250
    strip = render_views(ball_, colors, list(SIDES.values()), 100, 100).astype(int)
    red = strip[..., 0] - strip[..., 2] > 60
    front, left, back, right = (red[:, 100 * k : 100 * k + 100] for k in range(4))
    assert left[50, 50] and not right.any()
    assert front[:, 60:].any() and not front[:, :40].any()  # seen from the front, the left hand is on the right
    assert back[:, :40].any() and not back[:, 60:].any()
    blue = strip[..., 2] - strip[..., 0] > 60
    assert blue[:20].any() and not blue[30:].any()
    above = render_views(ball_, colors, [(0, 0, 1)], 100, 100).astype(int)
    assert (above[50, 50, 2] - above[50, 50, 0]) > 60 and (above[50, 85, 0] - above[50, 85, 2]) > 60


def test_a_hole_shows_the_inside():
    whole = ball()
    centre = whole.vertices[whole.triangles].mean(axis=1)
    open_ball = ball(centre[:, 1] > -0.45)
    seen = render_views(open_ball, None, [(0, -1, 0), (0, 1, 0)], 120, 120).astype(int)
    violet = seen[..., 2] - seen[..., 1] > 10
    assert violet[60, 60] and not violet[:, 120:].any()


def test_preview_sheet(tmp_path):
    kind = np.zeros(len(ball().triangles), np.int8)
    centre = ball().vertices[ball().triangles].mean(axis=1)
    kind[np.abs(centre[:, 0]) < 0.05] = SEAM
    kind[centre[:, 2] > 0.4] = FILL
    green = np.tile(np.uint8([40, 160, 60]), (len(ball().vertices), 1))
    render_preview(ball(kind=kind, colors=green), tmp_path / "a.png")
    sheet = read_image(tmp_path / "a.png").astype(int)
    assert sheet.shape == (1400, 1600, 3)
    upper, lower = sheet[60:700], sheet[700:1340]
    red = lower[..., 0] - lower[..., 1] > 80
    blue = lower[..., 2] - lower[..., 0] > 80
    assert red[:, 150:250].any() and red[:, 950:1050].any() and blue.any()
    assert not (upper[..., 0] - upper[..., 1] > 80).any() and (upper[..., 1] - upper[..., 0] > 40).any()
    for column in range(4):
        assert shown(sheet[:60, 400 * column : 400 * column + 400]).any()  # captions
    assert shown(sheet[1340:]).any()  # legend


def test_a_skeleton_adds_a_row(tmp_path):
    """Left bones are blue and right of the picture's middle; with arms up the body is taller."""
    from mirror_scan.core.avatar.pose import SkinWeights
    from mirror_scan.core.simulation.mannequin import rigged_mannequin

    body, skeleton = rigged_mannequin(resolution=0.018)
    nearest = np.linalg.norm(body.vertices[:, None] - 0.5 * (skeleton.joints + skeleton.tails())[None], axis=2)
    index, weight = np.zeros((len(body.vertices), 4), np.uint8), np.zeros((len(body.vertices), 4), np.float32)
    index[:, 0], weight[:, 0] = nearest.argmin(axis=1), 1.0
    render_preview(body, tmp_path / "a.png", skeleton, SkinWeights(index, weight))
    sheet = read_image(tmp_path / "a.png").astype(int)
    assert sheet.shape == (2100, 1600, 3)
    bones = sheet[1460:, :400]
    blue, orange = bones[..., 2] - bones[..., 0] > 80, bones[..., 0] - bones[..., 2] > 80
    assert np.nonzero(blue)[1].mean() > 220 and np.nonzero(orange)[1].mean() < 180
    rows = [np.nonzero(shown(sheet[1460:, 400 * k : 400 * k + 400]).any(axis=1))[0] for k in range(4)]
    assert np.ptp(rows[2]) > 1.3 * np.ptp(rows[1])


def test_bad_requests(tmp_path):
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    with pytest.raises(MirrorScanError, match="no triangles"):
        render_preview(empty, tmp_path / "a.png")
    with pytest.raises(MirrorScanError, match="direction"):
        render_views(ball(), None, [(0, 0, 0)], 10, 10)
    with pytest.raises(MirrorScanError, match="colours"):
        render_views(ball(), np.zeros((5, 3), np.uint8), [(1, 0, 0)], 10, 10)
    with pytest.raises(MirrorScanError, match="lower-case"):
        draw_text(np.zeros((9, 9, 3), np.uint8), "Ö", 0, 0, 9, (0, 0, 0))
    with pytest.raises(OutputError):
        render_preview(ball(), tmp_path / "missing" / "a.png")
    assert not list(tmp_path.iterdir())


def test_a_texture_is_shown_where_it_lies():
    """Each triangle of a ball has its own colour in the image: the picture is that of colours by triangle."""
    mesh, texture, colors = textured_ball()
    shown = render_views(mesh, None, [(0, -1, 0)], 160, 160, texture=texture)
    plain = render_views(mesh, colors, [(0, -1, 0)], 160, 160)
    apart = np.abs(shown.astype(int) - plain).max(axis=2)
    assert np.median(apart[40:120, 40:120]) <= 1 and (apart <= 2).mean() > 0.9
    with pytest.raises(MirrorScanError, match="texture of 79 triangles"):
        render_views(
            mesh, None, [(0, -1, 0)], 20, 20, texture=type(texture)(texture.uv[1:], texture.image, texture.island)
        )
