"""Motion files of five conventions, and the same through FBX, on bodies with a known rig: joints, palms, soles.

What the sources do is read off them by hand-written facts (which joint is which, which way is up), not by our own names
and axes. ``python -m benchmarks.rig_motion [BODY …]`` prints the table alone.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, Skeleton
from mirror_scan.core.io import read_mesh
from mirror_scan.core.motion import Clip, Motion, PoseFollower, read_bvh, retarget, sole_points

from .machine import say
from .results import Finding, Result, Table, number

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
BODIES = ("s020", "s006", "s025")
"""A bare man, a man in shoes, a boy."""
LIMITS = {"elbows and knees": (1.0, "°"), "palms": (5.0, "°"), "feet": (5.0, "°"), "in the floor": (5.0, "mm"),
          "slide": (10.0, "mm")}  # fmt: skip
MOST_MILLISECONDS = 1.0
_SIDES = ("Left", "Right")


@dataclass(frozen=True)
class Facts:
    """What somebody who looks at a file sees: names of arm, forearm, hand, fingers, thigh, shin, foot and toes.

    ``palm``: the palm's direction out of the left and the right hand in the rest pose, in the file's axes; or None,
    where knuckles of index and little finger tell it. ``hand``: the joint with which it turns.
    """

    limbs: str
    fingers: str
    palm: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    hand: str
    up: str = "y"


MIXAMO = "Arm ForeArm Hand UpLeg Leg Foot ToeBase"
FACTS = {
    "jumping_jacks_cmu": Facts("Shoulder Elbow Wrist Hip Knee Ankle Toe", "@Fingers", ((-1, 0, 0), (1, 0, 0)), "@hand"),
    "crouch_jump_zup": Facts(MIXAMO, "#HandEnd", ((0, 0, -1), (0, 0, -1)), "#Hand", "z"),
    "dance_rokoko_cm": Facts(MIXAMO, "#HandMiddle1", None, "#Hand"),
    "jumps_turn_cgspeed": Facts(MIXAMO, "@Fingers", ((0, -1, 0), (0, -1, 0)), "#FingerBase"),
    # Arms hang 45° out, thumbs ahead: square to the hand and to +Z.
    "squat_armsup_apose_m": Facts(MIXAMO, "mixamorig:#Hand_End", ((-0.8063, -0.5915, 0), (0.8361, -0.5484, 0)),
                                  "mixamorig:#Hand"),
}  # fmt: skip


class Body:
    """A body with its true skeleton and weights."""

    def __init__(self, name: str):
        folder = DATA / "rigged" / name
        self.vertices = read_mesh(folder / "body.ply").vertices
        stored = np.load(folder / "weights.npz")
        order = np.array([BONES.index(bone) for bone in stored["bones"]], dtype=np.uint8)
        self.weights = SkinWeights(order[stored["index"]], stored["weight"])
        joints = json.loads((folder / "joints.json").read_text())
        places = np.array([joints[bone] for bone in BONES])
        hands = [(BONES.index(f"{side}Hand"), BONES.index(f"{side}ForeArm")) for side in _SIDES]
        tips = [1.7 * places[hand] - 0.7 * places[before] for hand, before in hands]
        ends = [joints["HeadTop_End"], *tips, joints["LeftToe_End"], joints["RightToe_End"]]
        self.skeleton = Skeleton(places, np.array(ends), np.ones(len(BONES)))
        self.soles = sole_points(self.vertices, self.weights, self.skeleton)


def run(bodies: Sequence[str] = BODIES) -> Result:
    """Every file on every body; the worst of both sides and all frames."""
    if not (DATA / "motion").is_dir():
        say("No ../shared/data/motion beside the checkout: nothing is retargeted.")
        missing = [Finding(f"motion: {key} ≤ {limit:g} {unit}", "–", None) for key, (limit, unit) in LIMITS.items()]
        return Result([], missing)
    columns = (
        "file",
        "body",
        *(f"{name} [{unit}]" for name, (_, unit) in LIMITS.items()),
        "steps",
        "retargeted in [s]",
    )
    table = Table("Motion files retargeted", columns, left=2)
    worst = dict.fromkeys(LIMITS, 0.0)
    figures = [Body(name) for name in bodies]
    for name, motion in _motions():
        facts = FACTS[name.removesuffix(" (FBX)")]
        say(f"motion: {name}")
        for body_name, body in zip(bodies, figures, strict=True):
            start = time.perf_counter()
            clip = retarget(motion, body.skeleton, soles=body.soles)
            seconds = time.perf_counter() - start
            source = _Source(motion, facts, clip)
            step_slides = _slides(source, clip, body)
            measured = {
                "elbows and knees": _hinges(source, clip, body),
                "palms": _palms(source, clip, body),
                "feet": _feet(source, clip, body),
                "in the floor": _in_floor(clip, body),
                "slide": max(step_slides, default=0.0),
            }
            worst = {key: max(value, measured[key]) for key, value in worst.items()}
            cells = [number(value, 2 if key == "elbows and knees" else 1) for key, value in measured.items()]
            table.rows.append((name, body_name, *cells, str(len(step_slides)), number(seconds)))
    table.notes += [
        "Elbows and knees: the angle between both bones. Palms: the hand's direction and the palm's normal (not of FBX",
        "without a skin: it keeps no rest pose). Feet: the way from ankle to toes. A step: ankle and toes of the",
        "source rest; slide: how far the toes' joint gets meanwhile.",
    ]
    findings = [
        Finding(f"motion: {key} ≤ {limit:g} {unit}", f"{worst[key]:.2f} {unit}", worst[key] <= limit)
        for key, (limit, unit) in LIMITS.items()
    ]
    milliseconds = _live(figures[0])
    findings.append(Finding("live pose ≤ 1 ms a frame", f"{milliseconds:.2f} ms", milliseconds <= MOST_MILLISECONDS))
    return Result([table], findings)


def _motions():
    """Each file, and where bpy is installed the same through Blender's BVH importer and FBX exporter."""
    for path in sorted((DATA / "motion").glob("*.bvh")):
        motion = read_bvh(path)
        yield path.stem, motion
        if importlib.util.find_spec("bpy") is not None:
            yield f"{path.stem} (FBX)", through_fbx(path, motion, FACTS[path.stem].up)


def through_fbx(path: Path, motion: Motion, up: str) -> Motion:
    """The file imported into Blender, exported as FBX and read again."""
    import bpy
    from mirror_scan.mirror_scan_addon.scene.fbx_motion import read_fbx_motion

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        axes = {"axis_forward": "Y", "axis_up": "Z"} if up == "z" else {"axis_forward": "-Z", "axis_up": "Y"}
        bpy.ops.import_anim.bvh(filepath=str(path), update_scene_fps=True, **axes)
        bpy.context.scene.frame_end = len(motion)  # the importer leaves 250
        file = str(Path(folder) / "motion.fbx")
        bpy.ops.export_scene.fbx(filepath=file, add_leaf_bones=False, bake_anim_simplify_factor=0)
        return read_fbx_motion(file)


class _Source:
    """A motion seen through the facts about it, turned as the clip is."""

    def __init__(self, motion: Motion, facts: Facts, clip: Clip):
        self.motion, self.facts, self.turned = motion, facts, clip.turned
        parts = ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")
        prefix = "mixamorig:" if any(joint.startswith("mixamorig:") for joint in motion.joints) else ""
        self.places = {
            f"{side}{part}": motion.joints.index(f"{prefix}{side}{own}")
            for side in _SIDES
            for part, own in zip(parts, facts.limbs.split(), strict=True)
        }
        for side in _SIDES:
            for part, own in (("Tip", facts.fingers), ("Palm", facts.hand)):
                known = {joint.lower(): place for place, joint in enumerate(motion.joints)}
                name = own.replace("#", side).replace("@", side[0])
                self.places[side + part] = known[name.lower()]
        self.positions = motion.positions @ clip.turned.T

    def way(self, start: str, end: str) -> np.ndarray:
        ways = self.positions[:, self.places[end]] - self.positions[:, self.places[start]]
        return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def _angles(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.degrees(np.arctan2(across, (first * second).sum(axis=-1)))


def _limbs() -> list[tuple[str, str, str]]:
    chains = (("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot"))
    return [tuple(side + part for part in chain) for side in _SIDES for chain in chains]  # type: ignore[misc]


def _hinges(source: _Source, clip: Clip, body: Body) -> float:
    joints, worst = clip.joints(body.skeleton), 0.0
    for upper, middle, end in _limbs():
        first, second, third = (joints[:, BONES.index(bone)] for bone in (upper, middle, end))
        ours = _angles(second - first, third - second)
        theirs = _angles(source.way(upper, middle), source.way(middle, end))
        worst = max(worst, float(np.abs(ours - theirs).max()))
    return worst


def _palms(source: _Source, clip: Clip, body: Body) -> float:
    """Thumbs of our rest pose point ahead: palms are square to the hand and to −Y."""
    worst = 0.0
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        hand = BONES.index(f"{side}Hand")
        along = body.skeleton.tails()[hand] - body.skeleton.joints[hand]
        normal = sign * np.cross(along, [0, -1, 0])
        ways = source.way(f"{side}Hand", f"{side}Tip")
        worst = max(worst, float(_angles(clip.rotations[:, hand] @ along, ways).max()))
        place = source.places[f"{side}Palm"]
        if source.facts.palm is None:
            joints = source.motion.joints
            index, little = (source.positions[:, joints.index(f"{side}Hand{finger}1")] for finger in ("Index", "Pinky"))
            normals = sign * np.cross(ways, index - little)
        elif source.motion.up is not None:
            continue  # an FBX without a skin knows no rest pose
        else:
            rotations = source.motion.rotations[:, place]
            normals = (
                rotations @ np.array(source.facts.palm[0 if side == "Left" else 1], dtype=np.float64) @ source.turned.T
            )
        worst = max(worst, float(_angles(clip.rotations[:, hand] @ normal, normals).max()))
    return worst


def _feet(source: _Source, clip: Clip, body: Body) -> float:
    joints, worst = clip.joints(body.skeleton), 0.0
    for side in _SIDES:
        ours = joints[:, BONES.index(f"{side}ToeBase")] - joints[:, BONES.index(f"{side}Foot")]
        worst = max(worst, float(_angles(ours, source.way(f"{side}Foot", f"{side}ToeBase")).max()))
    return worst


def _in_floor(clip: Clip, body: Body) -> float:
    """How deep the skin is in the floor at most [mm]."""
    low = body.vertices[:, 2] < 0.25 * np.ptp(body.vertices[:, 2])
    vertices, weights = body.vertices[low], SkinWeights(body.weights.index[low], body.weights.weight[low])
    depths = [
        -skinned(vertices, weights, bone_matrices(body.skeleton, clip.pose(f)))[:, 2].min() for f in range(len(clip))
    ]
    return 1000 * max(0.0, float(max(depths)))


def _slides(source: _Source, clip: Clip, body: Body) -> list[float]:
    """Of each step, how far the toes' joint gets from where it is at its beginning [mm]."""
    joints, slides = clip.joints(body.skeleton), []
    ours, theirs = (np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1).mean() for places in (
        joints[:, [BONES.index(bone) for bone in ("LeftUpLeg", "LeftLeg", "LeftFoot")]],
        source.positions[:, [source.places[bone] for bone in ("LeftUpLeg", "LeftLeg", "LeftFoot")]]))  # fmt: skip
    for side in _SIDES:
        foot, toe = (source.positions[:, source.places[side + part]] * (ours / theirs) for part in ("Foot", "ToeBase"))
        speeds = [np.linalg.norm(np.gradient(place, axis=0), axis=1) * clip.rate for place in (foot, toe)]
        rests = (speeds[0] < 0.25) & (speeds[1] < 0.15) & (toe[:, 2] < np.quantile(toe[:, 2], 0.02) + 0.15)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], rests, [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            if last - first >= 5:
                way = joints[first:last, BONES.index(f"{side}ToeBase"), :2]
                slides.append(1000 * float(np.linalg.norm(way - way[0], axis=1).max()))
    return slides


def _live(body: Body) -> float:
    """Milliseconds a pose, the median of a played file."""
    clip = retarget(read_bvh(DATA / "motion" / "dance_rokoko_cm.bvh"), body.skeleton)
    follower, times = PoseFollower(body.skeleton), []
    for joints in clip.joints(body.skeleton):
        start = time.perf_counter()
        follower.follow(joints)
        times.append(time.perf_counter() - start)
    return 1000 * float(np.median(times))


if __name__ == "__main__":
    result = run(sys.argv[1:] or BODIES)
    for shown in result.tables:
        print(f"\n{shown.text()}")
    for finding in result.findings:
        print(finding.limit, finding.measured, finding.passed)
