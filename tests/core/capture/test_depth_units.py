"""Who decides the unit of depth: option, file, pattern, default; and what is no reading."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.folders.lens_file import lens_options
from mirror_scan.core.io.images import openimageio, write_png

WIDTH, HEIGHT = 200, 160
LENS = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": [160, 0, 0, 0, 160, 0, 99.5, 79.5, 1]}


def room(wall_mm=5200):
    """Depth (H, W) int64 [mm]: a person who stands on the floor before a slanting wall; 0 in a corner."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    floor = 1000 * 160 / np.maximum(v - 79.5, 1e-3)
    depth = np.minimum(floor, wall_mm + 2 * u + v)
    depth = np.where(person(), 2500 + 6 * np.abs(u - 100), depth)
    depth[:10, :10] = 0
    return np.rint(depth).astype(np.int64)


def person():
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return (np.abs(u - 100) < 18) & (v > 30) & (v < 144)


DEPTH = room()
BACKGROUND = (DEPTH == 0) | (DEPTH > 4500)
HOLLOW = np.where(BACKGROUND, 0, DEPTH)


def saved(folder, values, lens=LENS):
    """The path of a file that holds the values, the lens beside it."""
    np.save(folder / "depth.npy", values)
    if lens is not None:
        (folder / "intrinsic.json").write_text(json.dumps(lens))
    return folder / "depth.npy"


def assert_depth(capture, millimetres, apart=1.1e-3):
    np.testing.assert_allclose(capture.depth[0], np.asarray(millimetres) / 1000, atol=apart)


@pytest.mark.parametrize("background", [65504, 65535, 1e10, 3e38, np.inf, np.nan, -1, 0, 10_000, 1000])
@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("unit", [None, 1.0])
def test_background_of_virtual_depth_is_no_reading(tmp_path, background, kind, unit):
    with np.errstate(over="ignore"):
        values = np.where(BACKGROUND, background, DEPTH / 1000).astype(kind)
    capture = open_capture(saved(tmp_path, values), options=ReadOptions(depth_unit_m=unit))
    assert_depth(capture, HOLLOW, 3e-3)
    far = 10 < background < 1e9 and (kind != np.float16 or background < 65520)
    assert any("background" in note for note in capture.notes) == far


@pytest.mark.parametrize(
    ("background", "kind"),
    [(65535, np.uint16), (10_000, np.uint16), (-1, np.int16), (32767, np.int16), (2**31 - 1, np.int32),
     (2**32 - 1, np.uint32), (65504, np.float32), (1e10, np.float64)],
)  # fmt: skip
def test_background_behind_millimetres(tmp_path, background, kind):
    capture = open_capture(saved(tmp_path, np.where(BACKGROUND, background, DEPTH).astype(kind)))
    assert_depth(capture, HOLLOW)


def test_a_far_plane_takes_nothing_with_it(tmp_path):
    values = np.where(DEPTH > 5300, 10_000, DEPTH)  # some readings lie at more than half of it
    capture = open_capture(saved(tmp_path, values.astype(np.uint16)))
    assert_depth(capture, np.where(DEPTH > 5300, 0, DEPTH))
    assert (capture.depth > 5).any()


def test_two_backgrounds_averaged_edges_and_a_small_subject(tmp_path):
    values = np.where(person(), DEPTH / 1000, 65504)
    values[:, :30] = 1e6
    edges = np.flatnonzero(person().ravel())[::200]
    values.ravel()[edges] = 30_000 + edges
    depth = open_capture(saved(tmp_path, values)).depth[0]
    kept = person()
    kept.ravel()[edges] = False
    np.testing.assert_allclose(depth[kept], DEPTH[kept] / 1000, rtol=1e-6)
    assert not depth[~person()].any()


@pytest.mark.parametrize("suffix", [".exr", "half.exr", "layers.exr", ".tif", "int16.tif", "uint32.tif"])
def test_images_of_other_numbers(tmp_path, suffix):
    """Half floats, a renderer's channels, signed and 32-bit whole numbers: none is scaled on its way."""
    oiio = openimageio()
    path = tmp_path / f"a{suffix}"
    whole = "int" in suffix
    kind = {"half.exr": oiio.HALF, "int16.tif": oiio.INT16, "uint32.tif": oiio.UINT32}.get(suffix, oiio.FLOAT)
    channels = ("R", "G", "B", "A", "ViewLayer.Depth.Z") if "layers" in suffix else ("Z",)
    spec = oiio.ImageSpec(WIDTH, HEIGHT, len(channels), kind)
    spec.channelnames = channels
    values = np.zeros(
        (HEIGHT, WIDTH, len(channels)), {"int16.tif": np.int16, "uint32.tif": np.uint32}.get(suffix, "f4")
    )
    values[..., -1] = HOLLOW if whole else np.where(BACKGROUND, 65504, DEPTH / 1000)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(values) and output.close()
    (tmp_path / "intrinsic.json").write_text(json.dumps(LENS))
    assert_depth(open_capture(path), HOLLOW, 3e-3)


def shifted(millimetres, low):
    return ((millimetres << 3) | low).astype(np.uint16)


@pytest.mark.parametrize("player", range(8))
@pytest.mark.parametrize("stored", ["file", "folder", "wide"])
def test_kinect_sdk_depth_with_players(tmp_path, player, stored):
    values = shifted(DEPTH, np.where(person(), player, 0))
    path = saved(tmp_path, values.astype(np.int32) if stored == "wide" else values)
    if stored == "folder":
        (tmp_path / "depth").mkdir()
        write_png(tmp_path / "depth" / "000000.png", shifted(DEPTH, 0))  # nobody is tracked yet
        write_png(tmp_path / "depth" / "000001.png", values)
        path = tmp_path
    for capture in (open_capture(path), open_capture(path, options=ReadOptions(depth_unit_m=0.000125))):
        for frame in capture.depth:
            np.testing.assert_allclose(frame, DEPTH / 1000, atol=1.1e-3)
    assert any(("player" if player else "SUN RGB-D") in note for note in open_capture(path, "0").notes + open_capture(
        path).notes)  # fmt: skip


@pytest.mark.parametrize("player", [0, 1])
def test_what_kinect_sdk_does_not_know_is_no_reading(tmp_path, player):
    values = shifted(np.where(DEPTH > 5000, 8191, DEPTH), np.where(person(), player, 0))
    assert_depth(open_capture(saved(tmp_path, values)), np.where(DEPTH > 5000, 0, DEPTH))


def test_unknown_distance_and_a_player_apart_from_all_else(tmp_path):
    around = person() ^ (np.roll(person(), 6, 1) | np.roll(person(), -6, 1) | np.roll(person(), 6, 0) | person())
    values = shifted(np.where(around, 8191, DEPTH), np.where(person(), 2, 0))
    assert_depth(open_capture(saved(tmp_path, values)), np.where(around, 0, DEPTH))


@pytest.mark.parametrize("farther", [0, 2500, 3500, 6000])
def test_rotated_bits_of_a_large_room(tmp_path, farther):
    depth = np.where(DEPTH > 0, DEPTH + farther, 0)
    rotated = ((depth << 3) | (depth >> 13)).astype(np.uint16)
    capture = open_capture(saved(tmp_path, rotated))
    assert_depth(capture, depth)
    assert any("SUN RGB-D" in note for note in capture.notes)


def test_rotated_bits_of_a_wall_where_they_change(tmp_path):
    depth = 8192 + np.random.default_rng(0).normal(0, 60, (HEIGHT, WIDTH)).astype(np.int64)
    assert_depth(open_capture(saved(tmp_path, ((depth << 3) | (depth >> 13)).astype(np.uint16))), depth)


def test_five_thousand_to_a_metre(tmp_path):
    assert_depth(open_capture(saved(tmp_path, (5 * DEPTH).astype(np.uint16))), DEPTH)
    write_png(tmp_path / "a.png", (5 * DEPTH).astype(np.uint16))
    assert_depth(open_capture(tmp_path / "a.png"), DEPTH)


SOUND = {
    "millimetres": DEPTH.astype(np.uint16),
    "millimetres as real numbers": DEPTH.astype(np.float32),
    "a wall seen squarely": np.where(person(), 1500, 4000).astype(np.uint16),
    "the same in metres": np.where(person(), 1.5, 4.0).astype(np.float32),
    "a far wall seen squarely": np.where(person(), 3.5, 6.5).astype(np.float32),
    "one distance": np.full((HEIGHT, WIDTH), 2400, np.uint16),
    "one distance, real": np.full((HEIGHT, WIDTH), 2.4, np.float32),
    "steps of a centimetre": (DEPTH // 10 * 10).astype(np.uint16),
    "steps of 5 mm": (DEPTH // 5 * 5).astype(np.uint16),
    "steps of 8 mm": (DEPTH // 8 * 8).astype(np.uint16),
    "signed": DEPTH.astype(np.int16),
    "64 bits": DEPTH,
    "the other byte order": DEPTH.astype(">u2"),
    "columns first": np.asfortranarray(DEPTH.astype(np.uint16)),
    "a single channel": DEPTH.astype(np.uint16)[..., None],
    "two frames": np.stack((DEPTH, DEPTH)).astype(np.uint16),
}


@pytest.mark.parametrize("case", SOUND)
def test_sound_depth_is_what_it_was(tmp_path, case):
    values = SOUND[case]
    capture = open_capture(saved(tmp_path, values))
    plain = values.reshape(-1, HEIGHT, WIDTH)[0].astype(np.float64)
    assert_depth(capture, plain * (1 if plain.max() > 100 else 1000), 1e-6)
    assert [note for note in capture.notes if "real numbers taken" not in note] == []


@pytest.mark.parametrize("kind", [np.float32, np.uint16])
def test_the_order_option_file_evidence_default(tmp_path, kind):
    values = (DEPTH / 1000).astype(np.float32) if kind == np.float32 else DEPTH.astype(np.uint16)

    def factor(lens, **options):
        depth = open_capture(saved(tmp_path, values, lens), options=ReadOptions(**options)).depth[0]
        return float(np.median(depth[DEPTH > 0] / DEPTH[DEPTH > 0])) * 1000

    own = 1 if kind == np.float32 else 1000  # units in a metre
    assert factor(LENS) == pytest.approx(1)  # nobody wrote a unit
    assert factor(LENS | {"depth_scale": own}) == pytest.approx(1)
    assert factor(LENS | {"depth_scale": 5000}) == pytest.approx(own / 5000)  # somebody did
    assert factor(LENS | {"depth_scale": 0.00025}) == pytest.approx(own * 0.00025)
    assert factor(LENS | {"depth_scale": 5000}, depth_unit_m=1 / own) == pytest.approx(1)
    other = tmp_path / "other.json"
    other.write_text(json.dumps(LENS | {"depth_scale": 2000}))
    assert factor(LENS | {"depth_scale": 5000}, **lens_options(other)) == pytest.approx(own / 2000)
    assert factor(LENS, **lens_options(other), depth_unit_m=1 / own) == pytest.approx(1)
    other.write_text(json.dumps(LENS))
    assert factor(LENS | {"depth_scale": 5000}, **lens_options(other)) == pytest.approx(own / 5000)


def test_the_same_order_in_folders(tmp_path):
    (tmp_path / "depth").mkdir()
    write_png(tmp_path / "depth" / "0.png", (5 * DEPTH).astype(np.uint16))
    (tmp_path / "intrinsic.json").write_text(json.dumps(LENS))
    capture = open_capture(tmp_path)
    assert_depth(capture, DEPTH)
    assert any("TUM" in note for note in capture.notes)
    (tmp_path / "intrinsic.json").write_text(json.dumps(LENS | {"depth_scale": 1000}))
    capture = open_capture(tmp_path)
    assert_depth(capture, 5 * DEPTH)
    assert len(capture.notes) == 1 and "by their pattern it is 0.0002 m" in capture.notes[0]
    assert_depth(open_capture(tmp_path, options=ReadOptions(depth_unit_m=0.0002)), DEPTH)


@pytest.mark.parametrize(
    ("values", "scale", "likely"),
    [((DEPTH / 1000).astype(np.float32), 1000, "1 m"), (shifted(DEPTH, 0), 1000, "0.000125 m"),
     (DEPTH.astype(np.uint16), 1, "0.001 m"), (DEPTH.astype(np.uint16), 1000, ""), (DEPTH.astype(np.float32), 1000, ""),
     ((10 * DEPTH).clip(0, 65535).astype(np.uint16), 10_000, ""), ((5 * DEPTH).astype(np.uint16), 5000, "")],
)  # fmt: skip
def test_a_unit_in_the_file_that_cannot_be_is_doubted(tmp_path, values, scale, likely):
    """It is used all the same: the file comes before the pattern."""
    capture = open_capture(saved(tmp_path, values, LENS | {"depth_scale": scale}))
    np.testing.assert_allclose(capture.depth[0], values / scale, rtol=1e-6)
    assert [f"by their pattern it is {likely}" in note for note in capture.notes] == [True] * bool(likely)
