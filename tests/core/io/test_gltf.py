"""The glTF container: what is written comes back, by our reader and by trimesh's; damage is one line."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from mirror_scan.core.errors import CaptureError, OutputError
from mirror_scan.core.io.gltf import VERTICES, Gltf, read_gltf, write_gltf

ARRAYS = (
    np.arange(15, dtype=np.float32).reshape(5, 3),
    np.arange(5, dtype=np.int8) - 2,
    np.arange(9, dtype=np.uint8).reshape(3, 3),
    np.arange(8, dtype=np.uint16).reshape(2, 4),
    np.array([7, 70_000], np.uint32),
    np.arange(32, dtype=np.float32).reshape(2, 4, 4),
)


@pytest.mark.parametrize("target", [None, VERTICES])
def test_arrays_of_all_kinds_come_back(tmp_path, target):
    gltf = Gltf({"asset": {"version": "2.0"}, "extras": {"who": "Zoë"}})
    numbers = [gltf.add(array, target) for array in ARRAYS]
    write_gltf(tmp_path / "a.glb", gltf)
    again = read_gltf(tmp_path / "a.glb")
    assert again.content["extras"]["who"] == "Zoë"
    for number, array in zip(numbers, ARRAYS, strict=True):
        found = again.array(number)
        np.testing.assert_array_equal(found, array)
        assert found.dtype == array.dtype
        view = again.content["bufferViews"][number]
        assert view["byteOffset"] % 4 == 0  # what the specification asks of offsets and strides
        assert target is None or view.get("byteStride", array[0].nbytes) % 4 == 0


def test_matrices_stand_column_by_column():
    gltf = Gltf({})
    gltf.add(ARRAYS[-1])
    assert np.frombuffer(gltf.binary, np.float32)[:4].tolist() == [0.0, 4.0, 8.0, 12.0]


def test_bounds_are_those_of_what_is_stored():
    gltf = Gltf({})
    values = np.array([[0.1, -3.0, 5.0], [0.2, 4.0, -1.0]], np.float32)
    number = gltf.add(values, bounds=True)
    accessor = gltf.content["accessors"][number]
    assert np.float32(accessor["min"]).tolist() == values.min(axis=0).tolist()
    assert np.float32(accessor["max"]).tolist() == values.max(axis=0).tolist()


def test_numbers_gltf_does_not_have_are_refused():
    with pytest.raises(OutputError, match="float64"):
        Gltf({}).add(np.zeros(3))


def damaged(data: bytes) -> dict[str, bytes]:
    length = struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20 : 20 + length])
    content["accessors"][0]["count"] = 10**9
    far = Gltf(content, data[28 + length :])
    return {
        "empty": b"",
        "text": b"solid nothing, and so on and so forth",
        "version": data[:4] + struct.pack("<I", 1) + data[8:],
        "truncated": data[:-5],
        "json": data[:20] + b"[" * length + data[20 + length :],
        "count": far.to_bytes(),
    }


@pytest.mark.parametrize("case", ["empty", "text", "version", "truncated", "json", "count"])
def test_damage_is_told_in_one_line(tmp_path, case):
    gltf = Gltf({})
    gltf.add(ARRAYS[0])
    path = tmp_path / "a.glb"
    path.write_bytes(damaged(gltf.to_bytes())[case])
    with pytest.raises(CaptureError) as error:
        read_gltf(path).array(0)
    assert "\n" not in str(error.value)
