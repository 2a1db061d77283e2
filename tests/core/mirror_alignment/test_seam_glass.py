"""Thick and bowed glass shown by seams: synthetic ones, those of a virtual rig, and mirrors that must stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirror_alignment import seam_glass
from mirror_scan.core.mirror_alignment.seam_glass import SeamGlassSettings, _touching, glass_by_seams, seen_through
from mirror_scan.core.mirror_alignment.seam_offsets import SeamPieces
from mirror_scan.core.mirrors.curved_glass import REFRACTION, behind_front, flattened, thickness_moves
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect, reflection_matrix
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.scan import Clock, scan_steps
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.views.view_maps import NOTHING_SEEN
from mirror_scan.core.zippering.zipper import zip_patches


def mirror(side):
    """0.9 m beside the line of sight, 3 m away, turned to where the camera sees itself beside a person."""
    name = "right" if side > 0 else "left"
    glass = plane_mirror(name, np.array((0.9 * side, 0.0, 3.0)), np.array((-0.64 * side, 0.0, -0.77)))
    return replace(glass, source="picked", rectangle=np.array(((-0.4, 0.4), (-0.9, 0.9))))


MIRRORS = [mirror(1), mirror(-1)]


def maps_of(mirrors):
    """Of a camera with these mirrors; they show nothing."""
    to_view = np.stack([np.eye(4), *(reflection_matrix(m) for m in mirrors)])
    return replace(NOTHING_SEEN, to_view=to_view, intrinsics=np.repeat(NOTHING_SEEN.intrinsics, len(to_view), axis=0))


def seams(mirrors, thickness, count=40, noise=0.001, seed=0):
    """Pieces of seams along a person's sides, whose mirrored ends lie where glass so thick sets them."""
    rng = np.random.default_rng(seed)
    parts = []
    for view, glass in enumerate(mirrors, start=1):
        high = np.column_stack(
            (rng.uniform(-0.3, 0.3, count), rng.uniform(-0.8, 0.8, count), rng.uniform(2.4, 2.6, count))
        )
        along = np.column_stack(
            (rng.normal(0.0, 1.0, count), 0.2 * rng.normal(size=count), rng.normal(0.0, 0.4, count))
        )
        along /= np.linalg.norm(along, axis=1)[:, None]
        moves = thickness_moves(glass, reflect(high, glass), True)  # of the place, for each metre that is undone
        offset = -thickness * np.einsum("nc,nc->n", moves, along) + rng.normal(0.0, noise, count)
        views = np.column_stack((np.zeros(count, int), np.full(count, view)))
        parts.append((high, high, views, along, offset, np.full(count, 0.02), np.zeros(count), np.zeros(count, bool)))
    return SeamPieces(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def asked(monkeypatch, pieces, mirrors=None, settings=None, maps=None):
    mirrors = MIRRORS if mirrors is None else mirrors
    monkeypatch.setattr(seam_glass, "seam_pieces", lambda mesh, maps: pieces)
    return glass_by_seams(mirrors, maps_of(mirrors) if maps is None else maps, None, settings)


@pytest.mark.parametrize("thickness", [0.003, 0.005, 0.007])
def test_the_thickness_of_synthetic_seams(monkeypatch, thickness):
    """Drawn a little to what mirrors are sold as; some pieces belong to nothing."""
    pieces = seams(MIRRORS, thickness)
    pieces.offset[::9] += 0.05
    placed, notes = asked(monkeypatch, pieces)
    found = [m.glass_thickness for m in placed]
    assert found[0] == found[1] and found[0] == pytest.approx(thickness, abs=0.0013)
    assert len(notes) == 1 and "“right” and “left”" in notes[0]
    for old, new in zip(MIRRORS, placed, strict=True):
        assert (new.point - old.point) @ old.normal == pytest.approx(-found[0] / REFRACTION, abs=1e-4)


@pytest.mark.parametrize("thickness", [0.0, -0.004, 0.001])
def test_thin_glass_stays_thin(monkeypatch, thickness):
    """Also where what mirrors show is too near, which no glass does."""
    for seed in range(5):
        placed, notes = asked(monkeypatch, seams(MIRRORS, thickness, seed=seed))
        assert notes == () and all(a is b for a, b in zip(placed, MIRRORS, strict=True))


def test_seams_that_say_nothing(monkeypatch):
    """Few pieces, or such as scatter by far more than glass does."""
    assert asked(monkeypatch, seams(MIRRORS, 0.005, count=5))[1] == ()
    for noise in (0.003, 0.01, 0.03):
        assert all(asked(monkeypatch, seams(MIRRORS, 0.0, noise=noise, seed=seed))[1] == () for seed in range(8)), noise
    assert asked(monkeypatch, seams(MIRRORS, 0.005), settings=SeamGlassSettings(use=False))[1] == ()


def test_what_is_known_is_not_asked(monkeypatch):
    """Of mirrors whose thickness is known, or that were given as they are, or with a second camera."""
    pieces = seams(MIRRORS, 0.005)
    assert asked(monkeypatch, pieces, [replace(m, glass_thickness=0.003) for m in MIRRORS])[1] == ()
    assert asked(monkeypatch, pieces, [replace(m, source="given") for m in MIRRORS])[1] == ()
    half = [MIRRORS[0], replace(MIRRORS[1], source="rig file")]
    placed, notes = asked(monkeypatch, pieces, half)
    assert placed[0].glass_thickness > 0.003 and placed[1] is half[1]
    assert len(notes) == 1 and "left" not in notes[0]
    maps = maps_of(MIRRORS)
    two = replace(maps, to_view=np.concatenate((maps.to_view, np.eye(4)[None])))
    assert asked(monkeypatch, pieces, maps=two)[1] == ()


@pytest.mark.parametrize("thickness", [0.0, 0.005])
@pytest.mark.parametrize("bowed", [(True, False), (True, True), (False, False)])
def test_a_bow_that_a_frame_shows_is_the_glass_s_where_seams_say_so(monkeypatch, bowed, thickness):
    """Each frame shows one; only that of ``bowed`` mirrors is their glass's, which may be thick as well."""
    framed = [replace(m, frame_bow=(0.0, 0.0, 0.0, 0.006)) for m in MIRRORS]
    pieces = seams(MIRRORS, thickness, count=60)
    for view, (glass, is_bowed) in enumerate(zip(framed, bowed, strict=True), start=1):
        if is_bowed:
            mine = pieces.views[:, 1] == view
            real = reflect(flattened(reflect(pieces.high[mine], glass), replace(glass, sag=0.006)), glass)
            pieces.offset[mine] -= np.einsum("nc,nc->n", real - pieces.high[mine], pieces.along[mine])
    placed, notes = asked(monkeypatch, pieces, framed)
    for mirror, is_bowed in zip(placed, bowed, strict=True):
        assert mirror.sag == (0.006 if is_bowed else 0.0) and ("bow" in mirror.moved_by) == is_bowed
        assert mirror.glass_thickness == pytest.approx(thickness, abs=0.0013)
    assert len(notes) == sum(bowed) + (thickness > 0.0)


def test_patches_go_where_the_glass_shows_them():
    """Vertex by vertex; what did not change stays the same array."""
    points = np.random.default_rng(0).uniform((-0.3, -0.8, 2.4), (0.3, 0.8, 2.6), (50, 3))
    patches = [Mesh(points, np.array([(0, 1, 2)], np.int32)) for _ in range(3)]
    after = [behind_front(MIRRORS[0], 0.005), MIRRORS[1]]
    placed, maps = seen_through(patches, maps_of(MIRRORS), MIRRORS, after)
    assert placed[0].vertices is points and placed[2].vertices is points
    expected = points + 0.005 * thickness_moves(MIRRORS[0], reflect(points, MIRRORS[0]), True)
    np.testing.assert_allclose(placed[1].vertices, expected, atol=3e-5)
    before = transform(points, maps_of(MIRRORS).to_view[1])
    off = np.linalg.norm(transform(placed[1].vertices, maps.to_view[1]) - before, axis=1)
    assert off.max() < 0.2 * np.linalg.norm(placed[1].vertices - points, axis=1).max(), "as far as a rigid motion can"


@pytest.mark.parametrize("thickness", [0.008, 0.005, 0.0])
def test_seams_and_outline_of_a_virtual_rig(person, thickness):
    """Where light comes two ways."""
    rig = with_real_optics(default_rig("azure_kinect", frames=8, seed=1), effects=("multipath",))
    rig = replace(
        rig, intrinsics=rig.intrinsics.scaled(480, 432),
        mirrors=tuple(replace(m, glass_thickness=thickness) for m in rig.mirrors),
    )  # fmt: skip
    capture = simulate(person, rig).capture
    steps = scan_steps(capture, capture.mirrors, Settings(), Clock(), (0.0, 1.0))
    try:
        while True:
            next(steps)
    except StopIteration as done:
        scan = done.value
    assert scan.lit_twice is not None
    mesh = zip_patches(part_overlaps(scan.patches, scan.maps), scan.maps, scan.up, scan.axis, scan.floor)[0]
    through = [(m, view) for view, m in enumerate(scan.mirrors, start=1)]
    touching, blur = _touching(through, scan.maps, scan.outline, scan.lenses[0], SeamGlassSettings())
    print(f"\n{1000 * thickness:.0f} mm: {1000 * touching:.1f} +- {1000 * blur:.1f} mm by the outline")
    assert abs(touching - thickness) < 2.0 * blur < 0.0025
    placed, notes = glass_by_seams(scan.mirrors, scan.maps, mesh, outline=scan.outline, intrinsics=scan.lenses[0])
    if thickness:
        assert notes and all(m.glass_thickness == pytest.approx(thickness, abs=0.0015) for m in placed)
    else:
        assert notes == ()
