"""Joints that other programs send over UDP, read without waiting and without threads.

A datagram is JSON or OSC; which of them, its first byte says. Nothing a sender sends can do harm: what is malformed is
counted and named, and the newest whole frame stays.

JSON, one object a datagram, one datagram a frame::

    {"joints": {"Hips": [0, 0, 0.95], "LeftArm": [0.2, 0, 1.4], …}}       names and places; null: not seen
    {"set": "azure_kinect", "joints": [[x, y, z], null, …]}               all joints of a known set, in its order
    {"joints": [[x, y, z], … 22 of them]}                                 our own 22, in the order of ``BONES``
    {"rotations": [[w, x, y, z], … 22 of them], "hips": [x, y, z]}        turns of our own 22 from the rest pose
    … "up": "y"                                                           which axis points up: x, y, z, -y …

Places may have any unit and, with names or a set, any axes; rotations and our own 22 joints are in the avatar frame
(metres, Z up, facing −Y).

OSC (Open Sound Control 1.0), messages or bundles; a bundle, or ``/frame`` after single messages, ends a frame::

    /joint  ,sfff   name x y z
    /joints ,sfff…  name of a set, then x y z of all its joints
    /up     ,s      axis
    /frame
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..avatar.pose import Pose
from ..avatar.skeleton import BONES, Skeleton
from ..errors import MirrorScanError, Notice
from ..numeric.rotations import from_quaternions
from .foot_lock import Soles
from .joint_names import JOINT_SETS
from .pose_follower import PoseFollower

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 39541
_LARGEST = 65535  # bytes of a datagram
_AT_ONCE = 512  # datagrams a read takes at most: a flood does not hold Blender up
_MOST_JOINTS = 400
_AXES = {
    sign + axis: (-1.0 if sign == "-" else 1.0) * np.eye(3)[place]
    for sign in ("", "+", "-")
    for place, axis in enumerate("xyz")
}


@dataclass(frozen=True)
class StreamFrame:
    """What was sent for one frame.

    Parameters
    ----------
    names : tuple of str or None
        Of the joints; None for our own 22.
    joints : np.ndarray [shape=(J, 3), dtype=float64] or None
        NaN where not seen.
    rotations : np.ndarray [shape=(22, 3, 3), dtype=float64] or None
    hips : np.ndarray [shape=(3,), dtype=float64] or None
    up : np.ndarray [shape=(3,), dtype=float64] or None
    """

    names: tuple[str, ...] | None
    joints: np.ndarray | None
    rotations: np.ndarray | None = None
    hips: np.ndarray | None = None
    up: np.ndarray | None = None


class LiveStream:
    """An open UDP port.

    Parameters
    ----------
    port : int
        0 takes a free one; ``port`` then says which.
    address : str, default=LOOPBACK
        Only programs on this computer can send to the loopback address. The user must name another one.

    Attributes
    ----------
    port : int
    frames, malformed : int
        How many whole frames came, and how many datagrams could not be read.
    problem : Notice or None
        What was wrong with the last of those.

    Raises
    ------
    MirrorScanError
        The port cannot be opened.
    """

    def __init__(self, port: int = DEFAULT_PORT, address: str = LOOPBACK) -> None:
        self.frames = self.malformed = 0
        self.problem: Notice | None = None
        self._parts: dict[str, np.ndarray] = {}
        self._up: np.ndarray | None = None
        try:
            family = socket.getaddrinfo(address, port, type=socket.SOCK_DGRAM)[0][0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            try:
                self._socket.setblocking(False)
                self._socket.bind((address, port))
            except BaseException:
                self._socket.close()
                raise
        except (OSError, OverflowError, UnicodeError) as error:
            raise MirrorScanError(
                "UDP port {port} of {address} cannot be opened ({reason}); close the program that uses it, or take "
                "another port",
                port=port,
                address=address,
                reason=getattr(error, "strerror", None) or str(error),
                code="stream",
            ) from error
        self.port = int(self._socket.getsockname()[1])

    def __enter__(self) -> LiveStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def reject(self, problem: Notice) -> None:
        """Count the frame that was read last as one that could not be: nobody knows its joints."""
        self.frames -= 1
        self.malformed += 1
        self.problem = problem

    def read(self) -> StreamFrame | None:
        """The newest frame that came since the last read, None without one. Never waits."""
        newest = None
        for _ in range(_AT_ONCE):
            try:
                datagram = self._socket.recv(_LARGEST)
            except BlockingIOError:
                break
            except OSError:  # Windows reports here that an earlier answer found no one
                continue
            try:
                frame = self._json(datagram) if datagram.lstrip()[:1] == b"{" else self._osc(datagram)
            except _MalformedError as error:
                self.malformed += 1
                self.problem = Notice("a message of the tracker cannot be read: {what}", what=str(error))
                continue
            if frame is not None:
                self.frames += 1
                newest = frame
        return newest

    def _json(self, datagram: bytes) -> StreamFrame:
        try:
            sent = json.loads(datagram)
        except (ValueError, RecursionError) as error:
            raise _MalformedError("it is no JSON") from error
        up = _axis(sent["up"]) if "up" in sent else None
        if "rotations" in sent:
            hips = sent.get("hips")
            return StreamFrame(
                None, None, _quaternions(sent["rotations"]), None if hips is None else _points([hips])[0]
            )
        joints = sent.get("joints")
        if isinstance(joints, dict):
            return StreamFrame(tuple(joints), _points(list(joints.values())), up=up)
        if not isinstance(joints, list):
            raise _MalformedError("it has neither joints nor rotations")
        return StreamFrame(*_of_set(sent.get("set"), _points(joints)), up=up)

    def _osc(self, datagram: bytes) -> StreamFrame | None:
        frame, bundled = None, datagram.startswith(b"#bundle\0")
        for address, values in _osc_messages(datagram):
            if address == "/joint":
                if len(values) != 4 or not isinstance(values[0], str):
                    raise _MalformedError("/joint takes a name and three numbers")
                if len(self._parts) >= _MOST_JOINTS:
                    raise _MalformedError("too many joints")
                self._parts[values[0]] = _points([values[1:]])[0]
            elif address == "/joints":
                if len(values) % 3 != 1:
                    raise _MalformedError("/joints takes the name of a set and three numbers a joint")
                points = _points([values[k : k + 3] for k in range(1, len(values), 3)])
                frame = StreamFrame(*_of_set(values[0], points), up=self._up)
            elif address == "/up":
                self._up = _axis(values[0] if values else None)
            elif address == "/frame":
                bundled = True
            else:
                raise _MalformedError(f"the address {address[:40]} is not known")
        if bundled and self._parts:
            frame = StreamFrame(tuple(self._parts), np.array(list(self._parts.values())), up=self._up)
            self._parts = {}
        return frame


class StreamFollower:
    """Poses of the frames of a stream, whatever joints they have.

    Parameters
    ----------
    skeleton, palms, soles
        As of :class:`.pose_follower.PoseFollower`.
    """

    def __init__(self, skeleton: Skeleton, palms: np.ndarray | None = None, soles: Soles | None = None) -> None:
        self._skeleton, self._palms, self._soles = skeleton, palms, soles
        self._names: tuple[str, ...] | None = None
        self._follower = PoseFollower(skeleton, palms=palms, soles=soles)

    def follow(self, frame: StreamFrame) -> Pose:
        """The pose of a frame.

        Raises
        ------
        MirrorScanError
            The names of its joints are not recognised.
        """
        if frame.names != self._names:
            self._follower = PoseFollower(self._skeleton, frame.names, frame.up, self._palms, self._soles)
            self._names = frame.names
        values = frame.joints if frame.rotations is None else frame.rotations
        assert values is not None
        return self._follower.follow(values, frame.hips)


class _MalformedError(Exception):
    """A datagram is not as the documentation has it."""


def _of_set(name: object, points: np.ndarray) -> tuple[tuple[str, ...] | None, np.ndarray]:
    """Names and joints of a set."""
    if name is not None and not (isinstance(name, str) and name in JOINT_SETS):
        raise _MalformedError(f"the set {str(name)[:40]} is not known; known are {', '.join(JOINT_SETS)}")
    names = None if name is None else JOINT_SETS[str(name)]
    expected = len(BONES) if names is None else len(names)
    if len(points) != expected:
        raise _MalformedError(f"{len(points)} joints came, {expected} are needed")
    return names, points


def _points(values: list) -> np.ndarray:
    """Points (J, 3); NaN for null and for what no body reaches."""
    if len(values) > _MOST_JOINTS:
        raise _MalformedError("too many joints")
    try:
        points = np.array([(np.nan,) * 3 if value is None else value for value in values], dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise _MalformedError("a place is not three numbers") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise _MalformedError("a place is not three numbers")
    return np.where(np.abs(points) < 1e7, points, np.nan)


def _quaternions(values: object) -> np.ndarray:
    """Rotations (22, 3, 3) of quaternions w x y z; NaN for null."""
    try:
        rows = [(np.nan,) * 4 if value is None else value for value in values]  # type: ignore[attr-defined]
        turns = np.array(rows, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise _MalformedError("a rotation is not four numbers") from error
    if turns.shape != (len(BONES), 4):
        raise _MalformedError(f"rotations are {len(BONES)} times w x y z")
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    turns = np.where((length > 1e-6) & (length < 1e6), turns, np.nan)
    return from_quaternions(turns[:, [1, 2, 3, 0]])


def _axis(name: object) -> np.ndarray:
    if not isinstance(name, str) or name.lower() not in _AXES:
        raise _MalformedError("up is one of x, y, z, -x, -y, -z")
    return _AXES[name.lower()]


def _osc_messages(data: bytes, depth: int = 0) -> Iterator[tuple[str, list]]:
    """Address and arguments of each message of a packet (OSC 1.0)."""
    if data.startswith(b"#bundle\0"):
        at = 16
        if len(data) < at:
            raise _MalformedError("an OSC bundle is cut off")
        while at < len(data):
            if at + 4 > len(data) or depth > 8:
                raise _MalformedError("an OSC bundle is cut off")
            size = int(struct.unpack_from(">i", data, at)[0])
            if size <= 0 or at + 4 + size > len(data):
                raise _MalformedError("an OSC bundle is cut off")
            yield from _osc_messages(data[at + 4 : at + 4 + size], depth + 1)
            at += 4 + size
        return
    address, at = _osc_text(data, 0)
    if not address.startswith("/"):
        raise _MalformedError("it is neither JSON nor OSC")
    tags, at = _osc_text(data, at) if at < len(data) else (",", at)
    values: list = []
    for tag in tags[1:]:
        if tag == "s":
            text, at = _osc_text(data, at)
            values.append(text)
        elif tag in "fidh":
            size = 4 if tag in "fi" else 8
            if at + size > len(data):
                raise _MalformedError("an OSC message is cut off")
            values.append(struct.unpack_from({"f": ">f", "i": ">i", "d": ">d", "h": ">q"}[tag], data, at)[0])
            at += size
        elif tag in "TFN":
            values.append({"T": True, "F": False, "N": None}[tag])
        else:
            raise _MalformedError(f"OSC arguments of type {tag} are not read")
    yield address, values


def _osc_text(data: bytes, at: int) -> tuple[str, int]:
    """A text that ends with zeros up to a multiple of 4, and where it ends."""
    end = data.find(b"\0", at)
    if end < 0:
        raise _MalformedError("it is neither JSON nor OSC")
    try:
        return data[at:end].decode("utf-8"), (end // 4 + 1) * 4
    except UnicodeDecodeError as error:
        raise _MalformedError("it is neither JSON nor OSC") from error
