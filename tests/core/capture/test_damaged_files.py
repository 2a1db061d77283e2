"""Damaged and hostile captures: always our error naming the file, never a crash, a hang, or memory without measure.

``MIRROR_SCAN_FUZZ_CASES`` sets how many mutations are tried (20 000 before a release); the seed is fixed, and a case is
repeated by its number alone.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import time
import tracemalloc

import numpy as np
import pytest
import writers
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import Capture, ReadOptions, open_capture
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.errors import CaptureError, MirrorScanError
from mirror_scan.core.io.images import openimageio, write_png
from writers import DEPTH, saved

CASES = int(os.environ.get("MIRROR_SCAN_FUZZ_CASES", "300"))
SLOWEST_S = 5.0  # of the processor: a case that takes this long hangs; honest ones take milliseconds
INTERESTING = (0, 1, 0x7F, 0x80, 0xFF)
SIDECAR = '{"width":64,"height":48,"intrinsic_matrix":[60,0,0,0,61,0,31.5,24,1]}'


def image_file(path, pixels, kind):
    oiio = openimageio()
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 1 if pixels.ndim == 2 else 3, kind)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(pixels.reshape(*pixels.shape[:2], -1)) and output.close()
    return path.read_bytes()


@pytest.fixture(scope="module")
def corpus(tmp_path_factory):
    """Name -> path of an honest capture, a file or a folder."""
    root = tmp_path_factory.mktemp("honest")
    oiio = openimageio()
    depth, color = writers.scene()
    frames = [depth, depth + np.uint16(3)]
    jpeg = image_file(root / "any.jpg", color, oiio.UINT8)
    cloud = writers.cloud_of(depth, 60.0, 61.0, 31.5, 24.0)
    grid_depth, grid_color = writers.scene(160, 120)
    grid = writers.cloud_of(grid_depth, 150.0, 150.0, 80.0, 59.5)
    small, _ = writers.scene(320, 288)
    azure = writers.calibration()
    files = {
        "a.mkv": writers.mkv([small], bytes(32 * 24 * 4), azure, color_size=(32, 24)),
        "mjpg.mkv": writers.mkv([small], jpeg, azure, color_kind=b"MJPG", color_size=(64, 48)),
        "live.mkv": writers.mkv([small, small], calibration=azure, live=True),
        "a.bag": writers.realsense_bag(frames, color, intrinsics=(0.1, 0.01, 0, 0, 0)),
        "bz2.bag": writers.realsense_bag(frames, color, "bz2"),
        "open.bag": writers.realsense_bag(
            frames, color, indexed=False, model="Inverse Brown Conrady", intrinsics=(0.1,) * 5
        ),
        "t.oni": writers.oni(frames, color, b"16zT", properties=[writers.oni_number("xnMirror", 1)]),
        "p.oni": writers.oni(frames, jpeg, b"16zP", color_codec=b"JPEG", old=True),
        "ascii.pcd": writers.pcd(cloud, color, "ascii"),
        "binary.pcd": writers.pcd(cloud, color, "binary"),
        "lzf.pcd": writers.pcd(cloud, color, "binary_compressed"),
        "ascii.ply": writers.ply(grid, grid_color, "ascii"),
        "big.ply": writers.ply(grid, grid_color, "binary_big_endian"),
        "range.ply": writers.ply(grid, grid_color, "binary_little_endian", True),
    }
    try:
        files["lz4.bag"] = writers.realsense_bag(frames, color, "lz4")
        lidar, _ = writers.scene(256, 192)
        files["a.r3d"] = writers.r3d([lidar / np.float32(1000)], jpeg, np.full(lidar.shape, 2, np.uint8))
    except ImportError:
        pass
    found = {}
    for name, data in files.items():
        (root / name).write_bytes(data)
        found[name] = root / name
    write_npz(
        root / "a.npz", Capture(np.divide(frames, 1000, dtype=np.float32), color, Intrinsics(64, 48, 60, 61, 31, 24))
    )
    found["a.npz"] = root / "a.npz"
    camera, larger = Intrinsics(64, 48, 60, 61, 31, 24), np.repeat(np.repeat(color, 2, axis=0), 2, axis=1)
    seen = {"color_intrinsics": camera.scaled(128, 96), "native_color": larger, "depth_to_color": np.eye(4)}
    write_npz(root / "own.npz", Capture(np.divide(frames, 1000, dtype=np.float32), color, camera, **seen))
    found["own.npz"] = root / "own.npz"
    big, big_color = writers.scene(640, 480)
    raw = np.clip(big // 3 + 200, 0, 2047).astype(np.uint16)
    found["fakenect"] = writers.fakenect(root / "fakenect", [raw], big_color, (120.0, 0.1042, 7.5, 2.3, 200))
    found["tum"] = writers.tum(root / "tum", [big], big_color)
    found["sun"] = writers.sun(root / "sun", depth, color)
    found["stray"] = writers.stray(root / "stray", [depth], np.full(depth.shape, 2, np.uint8))
    found["a.db3"] = writers.realsense_db3(root / "a.db3", frames, color)
    for name in ("grabber", "rgbd", "larger", "exr", "tiff", "npy", "pgm"):
        (root / name).mkdir()
        found[name] = root / name
    (root / "grabber" / "s_depth.pclzf").write_bytes(writers.pclzf(depth, "depth16"))
    (root / "grabber" / "s_rgb.pclzf").write_bytes(writers.pclzf(color, "rgb24"))
    (root / "grabber" / "s.xml").write_text(writers.pclzf_xml(61.0, 32.0, 24.0))
    for folder, image in (("rgbd", color), ("larger", larger)):
        for name in ("depth", "color"):
            (root / folder / name).mkdir()
        write_png(root / folder / "depth" / "0.png", depth)
        write_png(root / folder / "color" / "0.png", image)
    place = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.02, 0, 0, 1]
    about = {"width": 128, "height": 96, "intrinsic_matrix": [120, 0, 0, 0, 122, 0, 63, 48, 1], "depth_to_color": place}
    (root / "larger" / "color_intrinsic.json").write_text(json.dumps(about))
    (root / "rgbd" / "mirrors.json").write_text(
        '{"mirrors": [{"name": "a", "frame_pixels": [[1, 2], [3, 4], [5, 7]]}]}'
    )
    for name in ("rgbd", "larger", "exr", "tiff", "npy", "pgm"):
        (root / name / "intrinsic.json").write_text(SIDECAR)
    image_file(root / "exr" / "a_depth.exr", (depth / np.float32(1000)), oiio.FLOAT)
    image_file(root / "tiff" / "a_depth.tif", depth, oiio.UINT16)
    np.save(root / "npy" / "a.npy", np.array(frames))
    (root / "pgm" / "a.pgm").write_bytes(b"P5 64 48 65535\n" + depth.astype(">u2").tobytes())
    for name in ("exr", "tiff", "npy", "pgm"):  # the folder is only there for the intrinsics
        found[name] = next(p for p in (root / name).iterdir() if p.suffix != ".json")
    return found


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """One to eight changes; half of them near the start, where headers are."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if not out:
            break
        reach = len(out) if rng.random() < 0.5 else min(len(out), 600)
        at = int(rng.integers(reach))
        kind = rng.integers(8)
        if kind == 0:
            out[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            out[at] = INTERESTING[int(rng.integers(len(INTERESTING)))]
        elif kind == 2:
            out[at : at + 4] = int(rng.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 65536))).to_bytes(4, "little")
        elif kind == 3:
            del out[at : at + int(rng.integers(1, 40))]
        elif kind == 4:
            out[at:at] = rng.bytes(int(rng.integers(1, 40)))
        elif kind == 5:
            del out[at:]
        elif kind == 6:
            start = int(rng.integers(len(out)))
            out[at:at] = out[start : start + int(rng.integers(1, 200))]
        else:
            out[at : at + 8] = b"9" * 8
    return bytes(out)


def attempt(path, named, options, allowed):
    """Open; True when it was refused by our error. Asserts everything this module is about."""
    tracemalloc.reset_peak()
    begin = time.process_time()
    try:
        capture = open_capture(path, options=options)
        refused = False
        assert capture.depth.dtype == np.float32 and capture.depth.ndim == 3
        assert np.isfinite(capture.depth).all() and capture.depth.min() >= 0
        assert capture.intrinsics.is_pinhole
        assert capture.color is None or capture.color.shape == (*capture.depth.shape[1:], 3)
        own, camera = capture.native_color, capture.color_intrinsics
        assert (own is None) == (capture.color is None or not options.native_color) == (camera is None)
        assert own is None or (camera.is_pinhole and own.shape == (camera.height, camera.width, 3))
    except MirrorScanError as error:
        refused = True
        assert str(named) in str(error) and "\n" not in str(error) and len(str(error)) < 700, str(error)
    assert time.process_time() - begin < SLOWEST_S
    peak = tracemalloc.get_traced_memory()[1]
    assert peak <= allowed, f"{peak} bytes, allowed {allowed}"
    return refused


def test_mutations(corpus, tmp_path):
    # Kernels are compiled and libraries loaded before memory is measured.
    for path in corpus.values():
        open_capture(path, options=ReadOptions(native_color=True))
    allowed = {}
    tracemalloc.start()
    try:
        for name, path in corpus.items():
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            open_capture(path, options=ReadOptions(native_color=True))
            allowed[name] = 4 * (tracemalloc.get_traced_memory()[1] - before) + 4_000_000
        names = sorted(corpus)
        refused, problems = 0, []
        for case in range(CASES):
            rng = np.random.default_rng((20260101, case))
            name = names[case % len(names)]
            honest = corpus[name]
            root = honest if honest.is_dir() else honest.parent
            single = honest.is_file() and honest.suffix in (
                ".mkv",
                ".bag",
                ".oni",
                ".pcd",
                ".ply",
                ".r3d",
                ".npz",
                ".db3",
            )
            if single:
                target = path = tmp_path / honest.name
                source = honest
            else:
                copy = tmp_path / root.name
                if not copy.exists():
                    shutil.copytree(root, copy)
                inner = sorted(p for p in root.rglob("*") if p.is_file())
                source = inner[int(rng.integers(len(inner)))]
                target = copy / source.relative_to(root)
                path = copy if honest.is_dir() else copy / honest.name
            target.write_bytes(mutated(source.read_bytes(), rng))
            options = ReadOptions(
                color=bool(rng.random() < 0.9), min_confidence=int(rng.integers(3)), native_color=bool(case % 2)
            )
            before = tracemalloc.get_traced_memory()[0]
            try:
                refused += attempt(path, tmp_path, options, before + allowed[name])
            except Exception as problem:  # all are gathered, so that one run tells of every weak reader
                problems.append(f"case {case} of {name}: {type(problem).__name__}: {str(problem)[:300]}")
            target.write_bytes(source.read_bytes())
    finally:
        tracemalloc.stop()
    assert not problems, "\n".join(problems[:20])
    assert refused > 0.3 * CASES  # else the mutations are too gentle to mean anything


SIGNATURES = [
    b"PK\x03\x04", b"\x1a\x45\xdf\xa3", b"#ROSBAG V2.0\n", b"NI10\1\0\1\0\0\0\0\0", b"# .PCD v0.7\n",
    b"VERSION 0.7\nFIELDS ", b"ply\nformat ascii 1.0\n", b"ply\nformat binary_little_endian 1.0\nelement vertex ",
    b"PCLZF", b"P5 ", b"P5 640 480 65535\n", b"\x93NUMPY\1\0", b"II*\0", b"MM\0*", b"v/1\1\2\0\0\0",
    b"\x89PNG\r\n\x1a\n",
    b"SQLite format 3\0", b"",
]  # fmt: skip


@settings(
    max_examples=max(100, CASES // 10), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.sampled_from(SIGNATURES), st.binary(max_size=300) | st.text(max_size=300).map(str.encode))
def test_anything_after_a_signature(tmp_path, signature, rest):
    path = tmp_path / "anything"
    path.write_bytes(signature + rest)
    with pytest.raises(MirrorScanError) as caught:
        open_capture(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


numbers = st.one_of(st.integers(-5, 5), st.integers(), st.floats(), st.booleans(), st.none(), st.text(max_size=5))
json_values = st.recursive(
    numbers, lambda v: st.lists(v, max_size=9) | st.dictionaries(st.text(max_size=5), v, max_size=4)
)


@settings(max_examples=max(60, CASES // 20), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(["w", "h", "dw", "dh", "K", "perFrameIntrinsicCoeffs", "fps"]), json_values))
def test_any_metadata_of_a_phone(tmp_path, about):
    (tmp_path / "depth").mkdir(exist_ok=True)
    (tmp_path / "metadata").write_text(json.dumps(about))
    with pytest.raises(MirrorScanError, match="exactly|" + tmp_path.name):
        open_capture(tmp_path)


@settings(max_examples=max(60, CASES // 20), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["WIDTH", "HEIGHT", "POINTS", "FIELDS", "SIZE", "TYPE", "COUNT", "DATA"]), st.text(max_size=20))
def test_any_value_in_a_header(tmp_path, key, value):
    depth, color = writers.scene(16, 12)
    data = writers.pcd(writers.cloud_of(depth, 20.0, 20.0, 8.0, 6.0), color, "binary")
    lines = data.split(b"\n", 11)
    lines = [f"{key} {value}".encode() if line.startswith(key.encode()) else line for line in lines]
    path = tmp_path / "a.pcd"
    path.write_bytes(b"\n".join(lines))
    try:
        open_capture(path)
    except MirrorScanError as error:
        assert str(path) in str(error)


def test_a_forged_size_is_never_allocated(tmp_path):
    """Headers that promise gigabytes are refused before anything is made."""
    import tracemalloc

    header = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4000\nHEIGHT 4000\nPOINTS 16000000\nDATA binary_compressed\n"
    forged = {
        "a.pcd": header + struct.pack("<II", 10, 192_000_000) + b"0123456789",
        "b.npy": b"\x93NUMPY\1\0\x76\0"
        + b"{'descr': '<u2', 'fortran_order': False, 'shape': (9000, 9000, 9000), }".ljust(117) + b"\n",
        "c.bag": writers.realsense_bag([DEPTH], compression="none").replace(b"size=", b"size=\xff\xff\xff", 1)[: 3000],
        "d.pgm": b"P5 30000 30000 65535\n1234",
        "e.pclzf": struct.pack("<5sII16sII", b"PCLZF", 8000, 8000, b"depth16".ljust(16), 20, 128_000_000) + bytes(20),
    }  # fmt: skip
    for name, data in forged.items():
        path = saved(tmp_path, name, data)
        tracemalloc.start()
        with pytest.raises(CaptureError, match=name) as caught:
            open_capture(path)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000, name
        tracemalloc.stop()
        assert "\n" not in str(caught.value)
