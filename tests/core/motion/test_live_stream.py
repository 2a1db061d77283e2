"""Joints over UDP: whole frames, JSON and OSC, and nothing a sender sends can do harm."""

from __future__ import annotations

import json
import socket
import struct
import time

import numpy as np
import pytest
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import JOINT_SETS, LiveStream, StreamFollower, read_bvh, retarget, write_bvh
from motion_figures import angles, apart, gymnastics, skeleton
from scipy.spatial.transform import Rotation


@pytest.fixture
def stream():
    with LiveStream(port=0) as opened:
        yield opened


def _send(stream, *datagrams: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in datagrams:
            sender.sendto(datagram, ("127.0.0.1", stream.port))
    time.sleep(0.02)  # loopback delivers at once; slow machines may need a moment


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return data + b"\0" * (-len(data) % 4)


def _message(address: str, *values) -> bytes:
    tags = "," + "".join("s" if isinstance(value, str) else "f" for value in values)
    packed = b"".join(_text(value) if isinstance(value, str) else struct.pack(">f", value) for value in values)
    return _text(address) + _text(tags) + packed


def _bundle(*parts: bytes) -> bytes:
    return _text("#bundle") + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(part)) + part for part in parts)


def test_a_file_played_as_if_it_were_live(tmp_path, stream):
    write_bvh(tmp_path / "live.bvh", gymnastics(40))
    motion = read_bvh(tmp_path / "live.bvh")
    person = skeleton()
    follower = StreamFollower(person)
    truth = retarget(motion, person, lock_feet=False)
    for row in range(len(motion)):
        joints = {name: place.tolist() for name, place in zip(motion.joints, motion.positions[row], strict=True)}
        _send(stream, json.dumps({"joints": joints, "up": "y"}).encode())
        frame = stream.read()
        assert frame is not None
        pose = follower.follow(frame)
        for bone in ("LeftForeArm", "RightForeArm", "LeftLeg", "RightLeg", "LeftArm", "RightUpLeg"):
            at = BONES.index(bone)
            along = person.tails()[at] - person.joints[at]
            first = angles(pose.rotations[at] @ along, truth.rotations[row, at] @ along)
            assert first < 4, bone  # turned to the front by joints here, by the hips' rotation there
    assert (stream.frames, stream.malformed, stream.problem) == (len(motion), 0, None)


def test_osc_bundles_are_frames_and_single_messages_end_with_frame(stream):
    parts = [_message("/joint", bone, 0.1 * k, 0.2, 1.0) for k, bone in enumerate(BONES)]
    _send(stream, _bundle(_message("/up", "-y"), *parts))
    frame = stream.read()
    assert frame.names == BONES and frame.joints.shape == (22, 3)
    np.testing.assert_allclose(frame.joints[:, 0], 0.1 * np.arange(22), atol=1e-6)
    np.testing.assert_array_equal(frame.up, [0, -1, 0])
    _send(stream, *parts[:5])
    assert stream.read() is None
    _send(stream, *parts[5:], _message("/frame"))
    assert stream.read().joints.shape == (22, 3)
    numbers = [float(k) for k in range(75)]
    _send(stream, _bundle(_bundle(_message("/joints", "kinect_v2", *numbers))))
    frame = stream.read()
    assert frame.names == JOINT_SETS["kinect_v2"] and frame.joints[24, 2] == 74


def test_quaternions_sets_and_missing_joints(stream):
    turns = Rotation.random(22, random_state=4)
    sent = np.roll(turns.as_quat(), 1, axis=1).tolist()
    sent[3] = None
    _send(stream, json.dumps({"rotations": sent, "hips": [1, 2, 3]}).encode())
    frame = stream.read()
    keep = np.arange(22) != 3
    assert apart(frame.rotations[keep], turns.as_matrix()[keep]).max() < 1e-4 and np.isnan(frame.rotations[3]).all()
    pose = StreamFollower(skeleton()).follow(frame)
    assert np.isfinite(pose.rotations).all()
    _send(stream, json.dumps({"set": "azure_kinect", "joints": [None] * 31 + [[0, 1e30, 0]]}).encode())
    frame = stream.read()
    assert np.isnan(frame.joints[:31]).all() and np.isnan(frame.joints[31, 1])


def test_only_the_newest_frame_counts_and_reading_never_waits(stream):
    start = time.perf_counter()
    assert stream.read() is None
    assert time.perf_counter() - start < 0.05
    _send(stream, *(json.dumps({"joints": [[k, 0, 0]] * 22}).encode() for k in range(6)))
    assert stream.read().joints[0, 0] == 5
    assert stream.frames == 6


@pytest.mark.parametrize(
    ("datagram", "what"),
    [
        (b"", "neither JSON nor OSC"),
        (b"hello", "neither JSON nor OSC"),
        (b"{", "no JSON"),
        (b"{" + b'"a":{' * 3000, "no JSON"),
        (b"{}", "neither joints nor rotations"),
        (b'{"joints": "all"}', "neither joints nor rotations"),
        (b'{"joints": [[1, 2]]}', "not three numbers"),
        (b'{"joints": [[1, 2, "x"]]}', "not three numbers"),
        (b'{"joints": [[1, 2, 3]]}', "1 joints came, 22 are needed"),
        (b'{"joints": {"Hips": 5}}', "not three numbers"),
        (b'{"set": "octopus", "joints": [[1, 2, 3]]}', "octopus is not known"),
        (b'{"set": {"a": 1}, "joints": [[1, 2, 3]]}', "not known"),
        (b'{"rotations": 7}', "four numbers"),
        (b'{"rotations": [[1, 0, 0, 0]]}', "22 times w x y z"),
        (b'{"joints": {"Hips": [1, 2, 3]}, "up": "sky"}', "up is one of"),
        (b'{"joints": ' + json.dumps([[0, 0, 0]] * 500).encode() + b"}", "too many joints"),
        (_text("/joint") + _text(",sfff") + b"\0\0", "neither JSON nor OSC|cut off"),
        (_message("/joint", "Hips", 1.0), "a name and three numbers"),
        (_message("/joints", "kinect_v2", 1.0), "1.5|three numbers|joints"),
        (_message("/unknown"), "address /unknown is not known"),
        (_text("/joint") + _text(",b") + b"\0\0\0\4abcd", "type b are not read"),
        (_text("#bundle") + b"\0" * 8 + struct.pack(">i", 4000) + b"abcd", "cut off"),
        (_text("#bundle") + b"\0" * 8 + struct.pack(">i", -4) + b"abcd", "cut off"),
        (_text("#bundle") + b"\0\0", "neither JSON nor OSC|cut off"),
        (b"\xff\xfe\0\0" * 9, "neither JSON nor OSC"),
    ],
)
def test_malformed_datagrams_are_counted_and_told(stream, datagram, what):
    _send(stream, datagram, json.dumps({"joints": [[1, 0, 0]] * 22}).encode())
    frame = stream.read()
    assert frame is not None and frame.joints[0, 0] == 1
    assert stream.malformed == 1
    import re

    assert re.search(what, str(stream.problem))


def test_noise_of_every_kind_is_survived(stream):
    rng = np.random.default_rng(9)
    whole = [_bundle(*(_message("/joint", bone, 1.0, 2.0, 3.0) for bone in BONES)),
             json.dumps({"rotations": [[1, 0, 0, 0]] * 22}).encode()]  # fmt: skip
    for _ in range(300):
        data = bytearray(whole[rng.integers(2)])
        for _ in range(rng.integers(1, 8)):
            data[rng.integers(len(data))] = rng.integers(256)
        _send_quickly(stream, bytes(data[: rng.integers(1, len(data) + 1)]))
        frame = stream.read()
        assert frame is None or frame.names is None or len(frame.names) == len(frame.joints)


def _send_quickly(stream, datagram: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(datagram, ("127.0.0.1", stream.port))


def test_the_port_is_the_loopback_s_and_a_taken_one_is_told(stream):
    assert stream._socket.getsockname()[0] == "127.0.0.1"
    with pytest.raises(MirrorScanError, match=f"UDP port {stream.port} of 127.0.0.1 cannot be opened"):
        LiveStream(port=stream.port)
    for port, address in ((70000, "127.0.0.1"), (0, "no.such.host.invalid")):
        with pytest.raises(MirrorScanError, match="cannot be opened"):
            LiveStream(port=port, address=address)
