"""BVH files (Biovision hierarchy): a skeleton and its joint angles a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import MirrorScanError
from ..io.atomic_files import replacing
from ..numeric.rotations import euler_zyx, from_euler
from .motion import Motion, posed

_LARGEST = 2_000_000_000  # bytes; a BVH of an hour at 120 frames a second has a quarter of that
_HIGHEST = 1e9  # of a place, in any unit, and of an angle
_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")


@dataclass
class _Joint:
    """A joint of the hierarchy while it is read."""

    name: str
    parent: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


def read_bvh(path: Path | str, rate: float | None = None) -> Motion:
    """The motion of a BVH file; ``rate`` [frames a second] stands in for the file's own frame time.

    End sites become joints named after their parent with ``_End``. Position channels replace a joint's offset, as all
    known programs write them. A frame count that does not fit the frames is put right when whole frames are there.

    Raises
    ------
    MirrorScanError
        The file cannot be read, is no BVH, or is damaged: file, line, what to do.
    """
    path = Path(path)
    lines = _lines(path)
    joints, at = _hierarchy(path, lines)
    values, rate = _frames(path, lines, at, sum(len(joint.channels) for joint in joints), rate)
    parents = np.array([joint.parent for joint in joints])
    rest = np.array([joint.offset for joint in joints], dtype=np.float64)
    for place, parent in enumerate(parents):
        if parent >= 0:
            rest[place] += rest[parent]
    turns = np.tile(np.eye(3), (len(values), len(joints), 1, 1))
    moves = np.full((len(values), len(joints), 3), np.nan)
    column = 0
    for place, joint in enumerate(joints):
        own = values[:, column : column + len(joint.channels)]
        column += len(joint.channels)
        spun = [k for k, channel in enumerate(joint.channels) if channel.endswith("rotation")]
        turns[:, place] = from_euler("".join(joint.channels[k][0] for k in spun), np.radians(own[:, spun]))
        for k, channel in enumerate(joint.channels):
            if channel.endswith("position"):
                moves[:, place, "XYZ".index(channel[0])] = own[:, k]
    rotations, positions = posed(parents, rest, turns, moves)
    return Motion(path.name, tuple(joint.name for joint in joints), parents, positions, rotations, rest, rate)


def write_bvh(path: Path | str, motion: Motion) -> None:
    """Write a motion with rotations: positions of the roots, angles about Z, Y, X; joints ``…_End`` as end sites."""
    if motion.rotations is None or motion.rest is None:
        raise MirrorScanError(
            "{name}: BVH holds rotations, and this motion has only positions", name=motion.name, code="motion"
        )
    children: dict[int, list[int]] = {}
    for joint, parent in enumerate(motion.parents):
        children.setdefault(int(parent), []).append(joint)
    rest, out, order = motion.rest, ["HIERARCHY"], []

    def write(joint: int, depth: int) -> None:
        pad, parent = "  " * depth, int(motion.parents[joint])
        offset = rest[joint] - (rest[parent] if parent >= 0 else 0)
        end = joint not in children and motion.joints[joint].endswith("_End")
        kind = "End Site" if end else f"{'ROOT' if parent < 0 else 'JOINT'} {motion.joints[joint]}"
        out.extend([f"{pad}{kind}", f"{pad}{{", f"{pad}  OFFSET {' '.join(f'{value:.9g}' for value in offset)}"])
        if not end:
            order.append(joint)
            places = "Xposition Yposition Zposition " if parent < 0 else ""
            out.append(f"{pad}  CHANNELS {6 if parent < 0 else 3} {places}Zrotation Yrotation Xrotation")
            for child in children.get(joint, []):
                write(child, depth + 1)
        out.append(f"{pad}}}")

    for root in children[-1]:
        write(root, 0)
    columns = []
    for joint in order:
        parent = motion.parents[joint]
        if parent < 0:
            columns.append(motion.positions[:, joint])
        turn = motion.rotations[:, joint]
        turn = turn if parent < 0 else np.swapaxes(motion.rotations[:, parent], -1, -2) @ turn
        columns.append(np.degrees(euler_zyx(turn)))
    out.extend(["MOTION", f"Frames: {len(motion)}", f"Frame Time: {1 / motion.rate:.9g}"])
    out.extend(" ".join(f"{value:.9g}" for value in row) for row in np.concatenate(columns, axis=1))
    with replacing(Path(path)) as temporary:
        temporary.write_text("\n".join(out) + "\n", encoding="utf-8")


def _lines(path: Path) -> list[list[str]]:
    """Words of each line."""
    try:
        if path.stat().st_size > _LARGEST:
            raise MirrorScanError("{path}: larger than 2 GB; cut the motion into parts", path=path, code="motion")
        text = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise MirrorScanError("{path}: cannot be read ({reason})", path=path, reason=reason, code="motion") from error
    if text.startswith((b"\xff\xfe", b"\xfe\xff")):
        decoded = text.decode("utf-16", errors="replace")
    else:
        decoded = text.decode("utf-8-sig", errors="replace")
    return [line.split() for line in decoded.splitlines()]


def _hierarchy(path: Path, lines: list[list[str]]) -> tuple[list[_Joint], int]:
    """The joints, and the line after MOTION."""
    first = next((words for words in lines if words), [""])
    if first[0].upper() != "HIERARCHY":
        raise MirrorScanError("{path}: is no BVH file (it does not begin with HIERARCHY)", path=path, code="motion")
    joints: list[_Joint] = []
    open_joints: list[int] = []
    expected = None  # the joint whose opening brace has not come yet
    # Braces may stand at the end of a line.
    for number, words in enumerate(lines):
        while words:
            key = words[0].upper()
            if key == "MOTION":
                if open_joints or not joints:
                    raise _damaged(path, number, "MOTION comes before the skeleton is complete")
                return joints, number + 1
            if key in ("HIERARCHY", "{", "}"):
                if key == "{":
                    if expected is None:
                        raise _damaged(path, number, "a brace opens nothing")
                    open_joints.append(expected)
                    expected = None
                elif key == "}":
                    if not open_joints:
                        raise _damaged(path, number, "a brace closes nothing")
                    open_joints.pop()
                words = words[1:]
                continue
            brace = next((k for k, word in enumerate(words) if word in "{}"), len(words))
            _statement(path, number, words[:brace], joints, open_joints)
            if key in ("ROOT", "JOINT", "END"):
                expected = len(joints) - 1
            words = words[brace:]
    raise MirrorScanError("{path}: has no MOTION; it is cut off or holds only a skeleton", path=path, code="motion")


def _statement(path: Path, number: int, words: list[str], joints: list[_Joint], open_joints: list[int]) -> None:
    """One line of the hierarchy: a joint, its offset or its channels."""
    key = words[0].upper()
    if key in ("ROOT", "JOINT", "END"):
        parent = open_joints[-1] if open_joints else -1
        if (key == "ROOT") != (parent < 0):
            raise _damaged(path, number, f"{words[0]} stands in the wrong place")
        name = f"{joints[parent].name}_End" if key == "END" else " ".join(words[1:])
        joints.append(_Joint(name, parent))
        return
    if not open_joints:
        raise _damaged(path, number, f"“{words[0]}” is not known here")
    joint = joints[open_joints[-1]]
    if key == "OFFSET":
        offset = _numbers(path, number, words[1:])
        if len(offset) != 3:
            raise _damaged(path, number, f"an OFFSET has 3 numbers, not {len(offset)}")
        if not max(map(abs, offset)) < _HIGHEST or any(map(math.isnan, offset)):
            raise _damaged(path, number, "this OFFSET is not possible")
        joint.offset = (offset[0], offset[1], offset[2])
    elif key == "CHANNELS":
        named = {channel.upper(): channel for channel in _CHANNELS}
        channels = [named.get(word.upper(), "") for word in words[2:]]
        if not words[1:] or words[1] != str(len(channels)) or "" in channels or len(set(channels)) < len(channels):
            raise _damaged(path, number, "these CHANNELS are not possible")
        joint.channels = channels
    else:
        raise _damaged(path, number, f"“{words[0]}” is not known here")


def _frames(path: Path, lines: list[list[str]], at: int, width: int, rate: float | None) -> tuple[np.ndarray, float]:
    """Values (F, width) and the rate."""
    if width == 0:
        raise MirrorScanError(
            "{path}: its joints have no channels; export it again with rotations", path=path, code="motion"
        )
    stated, seconds = None, None
    while at < len(lines) and (not lines[at] or lines[at][0][:1].isalpha()) and seconds is None:
        words = " ".join(lines[at]).replace(":", ": ").split()
        if words and words[0].upper().startswith("FRAMES"):
            stated = _numbers(path, at, words[-1:])[0]
        elif len(words) > 1 and words[0].upper() == "FRAME":
            seconds = _numbers(path, at, words[-1:])[0]
        elif words and words[0].upper() not in ("NAN", "INF"):
            raise _damaged(path, at, f"“{words[0]}” is not known here")
        at += 1
    if stated is None or seconds is None:
        raise MirrorScanError(
            "{path}: Frames or Frame Time is missing after MOTION; export it again", path=path, code="motion"
        )
    if rate is None and not 1e-4 <= seconds <= 10:
        raise _damaged(path, at - 1, f"a frame time of {seconds:g} s is not possible; write the seconds a frame lasts")
    rows = [number for number in range(at, len(lines)) if lines[number]]
    flat, wrong = [], 0
    for number in rows:
        own = _numbers(path, number, lines[number])
        wrong = wrong or (number + 1 if len(own) != width else 0)
        flat.extend(own)
    values = np.array(flat, dtype=np.float64)
    if wrong and len(values) == stated * width:
        wrong = 0  # all numbers are there, only broken into other lines
    if rows and wrong == rows[-1] + 1 and len(rows) > 1:  # a last frame that was cut off
        values, wrong = values[: (len(rows) - 1) * width], 0
    if wrong:
        count = len(lines[wrong - 1])
        raise _damaged(path, wrong - 1, f"a frame has {width} numbers, not {count}")
    if len(values) < width:
        raise MirrorScanError("{path}: holds no whole frame; export it again", path=path, code="motion")
    bad = np.flatnonzero(~(np.abs(values) < _HIGHEST))  # true for NaN too
    if len(bad):
        line = rows[min(int(bad[0]) // width, len(rows) - 1)]
        raise _damaged(path, line, f"a value of {values[bad[0]]:g} is not possible")
    return values.reshape(-1, width), rate or 1 / seconds


def _numbers(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        bad = next(word for word in words if not _is_number(word))
        if _is_number(bad.replace(",", ".")):
            raise _damaged(path, number, f"“{bad}” has a decimal comma; export it again with points") from error
        raise _damaged(path, number, f"“{bad}” is no number") from error


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _damaged(path: Path, number: int, what: str) -> MirrorScanError:
    return MirrorScanError("{path}, line {line}: {what}", path=path, line=number + 1, what=what, code="motion")
