"""Thick and bowed glass shown by seams: synthetic ones, those of a virtual rig, and mirrors that must stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mirror_alignment import seam_glass
from mirror_scan.core.mirror_alignment.seam_glass import SeamGlassSettings, _touching, glass_by_seams, seen_through
from mirror_scan.core.mirror_alignment.seam_offsets import SeamPieces
from mirror_scan.core.mirrors.curved_glass import REFRACTION, behind_front, flattened, thickness_moves
from mirror_scan.core.mirrors.mirror import moved, person_before, plane_mirror, reflect, reflection_matrix
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.scan import Clock, scan_steps
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.views.silhouette_contact import Outline
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


def scan_of(person, thickness, sag=(0.0, 0.0)):
    """Of a virtual rig whose mirrors are so thick and so bowed along their height, where light comes two ways."""
    rig = with_real_optics(default_rig("azure_kinect", frames=8, seed=1), effects=("multipath",))
    rig = replace(
        rig, intrinsics=rig.intrinsics.scaled(480, 432),
        mirrors=tuple(
            replace(m, glass_thickness=t, sag=(0.0, s)) for m, t, s in zip(rig.mirrors, thickness, sag, strict=True)
        ),
    )  # fmt: skip
    simulation = simulate(person, rig)
    steps = scan_steps(simulation.capture, simulation.capture.mirrors, Settings(), Clock(), (0.0, 1.0))
    try:
        while True:
            next(steps)
    except StopIteration as done:
        scan = done.value
    mesh = zip_patches(part_overlaps(scan.patches, scan.maps), scan.maps, scan.up, scan.axis, scan.floor)[0]
    return scan, mesh, simulation


@pytest.mark.parametrize("thickness", [0.008, 0.005, 0.0])
def test_seams_and_outline_of_a_virtual_rig(person, thickness):
    """Where light comes two ways."""
    scan, mesh, _ = scan_of(person, (thickness, thickness))
    assert scan.lit_twice is not None
    through = [(m, view) for view, m in enumerate(scan.mirrors, start=1)]
    touching, blur = _touching(through, scan.maps, scan.outline, scan.lenses[0], SeamGlassSettings())
    print(f"\n{1000 * thickness:.0f} mm: {1000 * touching:.1f} +- {1000 * blur:.1f} mm by the outline")
    assert abs(touching - thickness) < 2.0 * blur < 0.0025
    placed, notes = glass_by_seams(scan.mirrors, scan.maps, mesh, outline=scan.outline, intrinsics=scan.lenses[0])
    if thickness:
        assert notes and all(m.glass_thickness == pytest.approx(thickness, abs=0.0015) for m in placed)
    else:
        assert notes == ()


@pytest.mark.parametrize("thickness", [(0.0035, 0.0065), (0.006, 0.004)])
def test_each_mirror_of_a_virtual_rig_has_its_own_thickness(person, thickness):
    """What they show comes nearer to the truth than by seams alone, and about as near as is said."""
    scan, mesh, simulation = scan_of(person, thickness)
    true = [
        replace(m, point=np.array(t.point), normal=np.array(t.normal), sag=0.0, glass_thickness=thick)
        for m, t, thick in zip(scan.mirrors, simulation.truth.mirrors, thickness, strict=True)
    ]  # fmt: skip
    off = []
    for patches in (None, scan.patches):
        placed, notes = glass_by_seams(
            scan.mirrors, scan.maps, mesh, None, True, scan.outline, scan.lenses[0], patches
        )  # fmt: skip
        assert notes
        found = []
        for glass, real in zip(placed, true, strict=True):
            standing = person_before(real)
            seen = reflect(standing, real)  # where thin glass shows them
            for _ in range(20):
                seen += reflect(standing - seam_glass._placed(seen, real), replace(real, point=np.zeros(3)))
            moves = seam_glass._placed(seen, glass) - standing
            found.append(float(np.linalg.norm(moves.mean(axis=0))))
            print(f"\n{1000 * found[-1]:.1f} mm, said {1000 * glass.displacement(standing):.1f}, "
                  f"{1000 * glass.glass_thickness:.1f} mm thick")  # fmt: skip
            if patches is not None:
                assert found[-1] < 2.0 * glass.displacement(standing)
        off.append(found)
    alone, together = np.sqrt(np.square(off).mean(axis=1))
    assert together < alone


CAMERA = Intrinsics(640, 576, 504.0, 504.0, 319.5, 287.5)
POST = np.array((0.0, 0.0, 2.4)), 0.15
"""Middle and radius of an upright post, as wide as a trunk [m]."""


def post():
    """Its upright sides as a mesh, facing outwards, and its outline; 1.4 m high."""
    (x, _, z), radius = POST
    turn, high = np.linspace(0.0, 2.0 * np.pi, 181)[:-1], np.linspace(-0.7, 0.7, 71)
    ring = np.column_stack((x + radius * np.sin(turn), z - radius * np.cos(turn)))
    vertices = np.array([(a, y, b) for y in high for a, b in ring])
    n = len(turn)
    k = (np.arange(len(high) - 1)[:, None] * n + np.arange(n)).ravel()
    after = k - k % n + (k + 1) % n
    triangles = np.concatenate((np.column_stack((k, after, after + n)), np.column_stack((k, after + n, k + n))))
    out = vertex_normals(vertices, triangles.astype(np.int32)) @ np.array((1.0, 0.0, 0.0))
    if out @ (vertices[:, 0] - x) < 0.0:
        triangles = triangles[:, ::-1]
    reach = CAMERA.fx * np.tan(np.arcsin(radius / z))
    shape = CAMERA.height, CAMERA.width
    ends = [np.full(shape, CAMERA.cx + side * (reach + seam_glass._ENDS_BIAS)) for side in (1.0, -1.0)]
    outline = Outline((0, 0), ends[0], ends[1], np.zeros(shape), 0.0)
    return Mesh(vertices, np.ascontiguousarray(triangles, np.int32)), outline


def half_of(mesh, glass):
    """What a mirror shows of it: all that faces the mirror."""
    toward = vertex_normals(mesh.vertices, mesh.triangles) @ -glass.normal < 0.2
    return replace(mesh, triangles=mesh.triangles[toward[mesh.triangles].all(axis=1)])


def as_thin_and_flat(vertices, real, taken):
    """Where ``vertices`` (N, 3), seen in the ``real`` glass, seem to be by the thin and flat one they are taken for."""
    seem = vertices.copy()
    for _ in range(20):
        seem += vertices - seam_glass._placed(reflect(seem, taken), real)
    return seem


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("unknown", "off"), [(0, 0.002), (0, -0.003), (2, 0.002), (2, -0.003), (4, 0.0015), (4, -0.0015)]
)  # fmt: skip
def test_the_outline_tells_what_its_mirror_is_off(side, unknown, off):
    """One slope, the shift or the thickness [rad, m], where that alone is not known; by a post that is seen exactly."""
    mesh, outline = post()
    settings = SeamGlassSettings(each=0.002 if unknown == 4 else 1e-6)
    spread = np.full(3, 1e-6)
    if unknown < 3:
        spread[unknown] = 0.004
    taken = replace(mirror(side), covariance=np.diag(spread**2))
    step = np.zeros(3)
    if unknown < 3:
        step[unknown] = off
    real = behind_front(moved(taken, step), settings.usual + (off if unknown == 4 else 0.0))
    shown = half_of(mesh, taken)
    shown = replace(shown, vertices=as_thin_and_flat(shown.vertices, real, taken))
    flat, bent = seam_glass._touched(taken, shown, outline, CAMERA, settings)
    assert flat is bent  # its frame shows no bow
    error = float(np.sqrt(flat.covariance[unknown, unknown]))
    print(f"\n{1000 * off:+.1f}: {1000 * flat.step[unknown]:+.2f} +- {1000 * error:.2f}")
    assert abs(flat.step[unknown] - off) < 0.4 * abs(off) and abs(flat.step[unknown] - off) < 2.0 * error


@pytest.mark.parametrize("unknown", range(5))
def test_the_ends_move_as_their_derivatives_say(unknown):
    """With slopes, shift, sag and thickness, against small steps of each; the upper half of a post."""
    mesh, outline = post()
    glass = behind_front(replace(mirror(1), sag=0.001), 0.005)
    shown = reflect(as_thin_and_flat(mesh.vertices, glass, mirror(1)), mirror(1))
    size = (1e-4, 1e-4, 1e-4, 2e-4, 2e-4)[unknown]
    if unknown < 3:
        other = moved(glass, size * np.eye(3)[unknown])
    elif unknown == 3:
        other = replace(glass, sag=glass.sag + size)
    else:
        other = replace(glass, point=glass.point - size / REFRACTION * glass.normal, glass_thickness=0.005 + size)
    faces = half_of(mesh, glass).triangles
    faces = faces[(mesh.vertices[faces, 1] < 0.0).all(axis=1)]
    ends = [seam_glass._ends(m, seam_glass._placed(shown, m), faces, outline, CAMERA) for m in (glass, other)]
    assert min(len(e.gaps) for e in ends) > 100
    closed = (np.median(ends[0].gaps) - np.median(ends[1].gaps)) / size
    expected = np.median(ends[0].jacobian[:, unknown])
    print(f"\n{closed:.1f} px a metre or radian, expected {expected:.1f}")
    assert closed == pytest.approx(expected, rel=0.1) and abs(expected) > 20.0
