"""The paper's second rival (3.2.2): three cameras round a person instead of two mirrors behind it.

One after the other or together, posed by a calibration board or by ICP; the floor they need; and what it costs when a
camera, or a mirror, is not where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ..capture import Capture
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..numeric.rotations import about_axis
from ..pipeline import Reconstruction, Settings, reconstruct
from ..pipeline.multi_camera import reconstruct_registered, reconstruct_views
from ..registration.pairwise import IcpSettings, find_backend
from ..simulation.optics import IDEAL, Optics
from ..simulation.scene import Rig, default_rig
from ..simulation.sensors import find_sensor
from ..simulation.simulate import Simulation, simulate
from .calibration_board import board_calibrated, pose_errors
from .results import keep
from .sway import swayed
from .turntable import DISTANCE, Row, as_lit, judged, picture

ANGLES = (0.0, 120.0, -120.0)
"""Where the cameras stand round the person, from its front [degrees]."""

PERSON = 1.9
"""Each camera stands as near as it sees all of a person so high [m]."""

SWAY = 0.0025
"""What the crown moves by while the cameras take their turns, a third of a second each [m]."""

SHIFTS = (0.0, 0.005, 0.01, 0.02, 0.04)
TURNS = (0.0, 0.25, 0.5, 1.0, 2.0)
"""By how much a camera or a mirror is misplaced [m], [degrees]."""

MIRRORS, IN_TURN, TOGETHER = "two mirrors", "three cameras in turn", "three cameras together"
KEPT_POSE, KEPT_PLANE, FOUND_AGAIN = "camera, pose as before", "mirror, plane as before", "mirror, found again"

_MARGIN = 1.05  # of what a camera must see, to what it sees
_ROOM = 0.6  # m round the person's middle that is theirs


@dataclass(frozen=True)
class Arrangement:
    """One row of the first table: ``row`` as of the turntable, and what it took.

    ``poses``: where they come from; ``floor`` [m]: width and depth of the rectangle round cameras, mirrors and person;
    ``unread``: share of what the cameras see of the person that gave no reading; ``shift`` and ``turn``: how wrong the
    worst pose is [m], [degrees], NaN where there is none.
    """

    row: Row
    poses: str
    floor: tuple[float, float]
    unread: float
    shift: float = np.nan
    turn: float = np.nan


@dataclass(frozen=True)
class Misplaced:
    """One row of the second table: what moved (``row.way``), by ``shift`` [m] and ``turn`` [degrees]."""

    row: Row
    shift: float
    turn: float


@dataclass(frozen=True)
class Outcome:
    """Both tables."""

    arrangements: list[Arrangement]
    misplaced: list[Misplaced]


def nearest(sensor: str) -> tuple[float, float]:
    """How far from the person a level camera stands that sees all of it, and how high [m]."""
    lens = find_sensor(sensor).intrinsics
    above, below = lens.cy / lens.fy, (lens.height - 1 - lens.cy) / lens.fy
    distance = _MARGIN * PERSON / (above + below)
    return max(distance, 1.2), PERSON * below / (above + below)


def camera_rigs(sensor: str, frames: int, seed: int, optics: Optics) -> list[Rig]:
    """A rig for each of the cameras, without mirrors; the first before the person."""
    distance, height = nearest(sensor)
    rigs = []
    for number, angle in enumerate(ANGLES):
        a = np.radians(angle)
        rig = default_rig(
            sensor, mirrors=0, frames=frames, seed=seed + number, camera_height=height, tilt_deg=0.0,
            subject_distance=distance,
        )  # fmt: skip
        place = (float(distance * np.sin(a)), float(-distance * np.cos(a)), height)
        rig = replace(as_lit(rig, optics), camera=place, pan_deg=-angle, room=(-4.5, 4.5, -4.5, 4.5, 2.8))
        rigs.append(rig)
    return rigs


def floor_needed(rigs: Sequence[Rig]) -> tuple[float, float]:
    """Width and depth [m] of the rectangle that holds cameras, mirrors with their frames, and the person."""
    points = [np.array([[_ROOM, _ROOM], [-_ROOM, -_ROOM]])]
    for rig in rigs:
        points.append(np.array([rig.camera[:2]]))
        for mirror in rig.mirrors:
            half = mirror.width / 2 + mirror.frame_width
            points.append(np.array(mirror.centre)[:2] + half * np.outer((1.0, -1.0), mirror.axes[0, :2]))
    width, depth = np.ptp(np.concatenate(points), axis=0)
    return float(width), float(depth)


def run(
    body: Mesh,
    sensor: str = "kinect_v1",
    frames: int = 10,
    seed: int = 0,
    optics: Optics = IDEAL,
    shifts: Sequence[float] = SHIFTS,
    turns: Sequence[float] = TURNS,
    progress: Callable[[float, str], None] | None = None,
    icp: IcpSettings = IcpSettings(),
) -> Outcome:
    """Both tables: arrangements, and what is misplaced.

    Parameters
    ----------
    body : Mesh
        Avatar frame.
    sensor, frames, seed, optics
        As in :func:`.turntable.run`.
    shifts, turns : sequence of float
        By how much something is misplaced [m], [degrees]: one at a time.
    icp : IcpSettings
        Without a package that registers, its rows say so.

    Raises
    ------
    MirrorScanError
        When the body cannot be scanned.
    """
    say = progress or (lambda share, text: None)
    say(0.0, "taking the snapshot")
    rig = as_lit(default_rig(sensor, subject_distance=DISTANCE, frames=frames, seed=seed), optics)
    shot = simulate(body, rig)
    found = [Arrangement(judged(MIRRORS, 0.0, body, lambda: reconstruct(shot.capture)), "–", floor_needed([rig]),
                         unread([shot]))]  # fmt: skip
    say(0.1, "scanning with three cameras")
    rigs = camera_rigs(sensor, frames, seed, optics)
    rng = np.random.default_rng([seed, 8])
    in_turn = [simulate(swayed(body, SWAY, rng), one) for one in rigs]
    together = [simulate(body, one, others=[other for other in rigs if other is not one]) for one in rigs]
    middle = np.array([0.0, 0.0, 0.5 * PERSON])
    true = [one.camera_to_avatar for one in rigs]
    board = board_calibrated(true, rigs[0].intrinsics, middle, rng)
    wrong = pose_errors(list(board), true, middle)
    for number, (name, made) in enumerate(((IN_TURN, in_turn), (TOGETHER, together))):
        say(0.2 + 0.2 * number, f"joining {name}")
        captures = named(made)
        lost, floor = unread(made), floor_needed(rigs)
        sway = SWAY if made is in_turn else 0.0
        row = judged(name, sway, body, partial(reconstruct_views, captures, list(board)))
        found.append(Arrangement(row, "board", floor, lost, *wrong))
        row = registered_row(name, sway, body, captures, icp)
        found.append(Arrangement(row, "ICP", floor, lost, *_registered_errors(row, true, middle)))
    say(0.6, "misplacing a camera and a mirror")
    return Outcome(found, misplaced(body, rig, shot, named(in_turn), true, shifts, turns, say))


def named(made: Sequence[Simulation]) -> list[Capture]:
    """The captures, named by where their cameras stand."""
    return [replace(one.capture, name=f"{angle:+.0f}°") for one, angle in zip(made, ANGLES, strict=True)]


def registered_row(name: str, sway: float, body: Mesh, captures: list[Capture], icp: IcpSettings) -> Row:
    """The captures without their poses; where no package registers them the row says so."""
    try:
        find_backend(icp.backend)
    except MirrorScanError as error:
        return Row(name, sway, None, {}, fault=str(error))
    return judged(name, sway, body, partial(reconstruct_registered, captures, 120.0, icp=icp))


def _registered_errors(row: Row, true: Sequence[np.ndarray], middle: np.ndarray) -> tuple[float, float]:
    """How wrong the poses are that registration found; NaN where it found none."""
    return (np.nan, np.nan) if row.poses is None else pose_errors(list(row.poses), true, middle)


def unread(made: Sequence[Simulation]) -> float:
    """Share of the pixels that show the person, directly or by one mirror, that have no reading in a frame."""
    seen = sum(float((one.truth.labels >= 0).sum()) for one in made)
    lost = sum(float(((one.capture.depth[0] == 0) & (one.truth.labels >= 0)).sum()) for one in made)
    return lost / max(seen, 1.0)


def misplaced(
    body: Mesh, rig: Rig, shot: Simulation, captures: list[Capture], true: Sequence[np.ndarray],
    shifts: Sequence[float], turns: Sequence[float], say: Callable[[float, str], None] = lambda share, text: None,
) -> list[Misplaced]:  # fmt: skip
    """The second of the cameras, which took their turns, or the first mirror of ``rig``, moved after it was calibrated.

    Sideways, or along the glass's normal, as that counts; and turned about the vertical. A camera's pose is taken from
    before, as no camera sees that another one moved. So is the mirror's plane; or its frame is found again in the
    picture, as we do it.
    """
    rows = []
    levels = [(shift, 0.0) for shift in shifts] + [(0.0, turn) for turn in turns if turn > 0]
    for number, (shift, turn) in enumerate(levels):
        say(0.6 + 0.35 * number / len(levels), f"misplaced by {1e3 * shift:g} mm, {turn:g}°")
        poses = [pose.copy() for pose in true]
        poses[1] = true[1] @ _bump(shift, turn)
        moved = simulate(body, with_moved_mirror(rig, shift, turn)).capture
        ways: dict[str, Callable[[], Reconstruction]] = {
            KEPT_POSE: partial(reconstruct_views, captures, poses),
            KEPT_PLANE: partial(reconstruct, moved, shot.truth.mirrors, as_given()),
            FOUND_AGAIN: partial(reconstruct, moved),
        }
        rows += [Misplaced(judged(way, 0.0, body, make), shift, turn) for way, make in ways.items()]
    return rows


def _bump(shift: float, turn: float) -> np.ndarray:
    """A camera's frame after it was pushed to its right [m] and turned about its vertical [degrees] (4, 4)."""
    moved = np.eye(4)
    moved[:3, :3] = about_axis(1, np.radians(turn))
    moved[0, 3] = shift
    return moved


def with_moved_mirror(rig: Rig, shift: float, turn: float) -> Rig:
    """The rig with its first mirror moved along its normal [m] and turned about the vertical [degrees]."""
    first, *others = rig.mirrors
    normal = first.axes[2]
    centre = tuple((np.array(first.centre) + shift * normal).tolist())
    turned = tuple((about_axis(2, np.radians(turn)) @ normal).tolist())
    return replace(rig, mirrors=(replace(first, centre=centre, normal=turned), *others))


def as_given() -> Settings:
    """Settings by which no mirror is moved from where it is said to be."""
    plain = Settings()
    off = {
        name: replace(getattr(plain, name), use=False)
        for name in ("alignment", "floor", "agreement", "own_reflection", "bow", "thickness", "seams", "seam_glass")
    }
    return replace(plain, **off, person=replace(plain.person, use=False))


# --- telling ---------------------------------------------------------------------------------------------------------


def table(outcome: Outcome) -> list[str]:
    """Both tables as lines of text, and in sentences where the snapshot wins and loses."""
    lines = [
        "                         poses      floor, m    m²   unread   wrong by     to the body, mm  of the body, mm",
        "                                                         %   mm      °      mean     95 %    mean     95 %",
    ]
    for one in outcome.arrangements:
        width, depth = one.floor
        wrong = "   –      –" if np.isnan(one.shift) else f"{1e3 * one.shift:4.1f}{one.turn:7.2f}"
        space = f"{width:6.2f} × {depth:4.2f}{width * depth:6.1f}{100 * one.unread:8.1f}  {wrong}"
        lines.append(f"{one.row.way:<24} {one.poses:<6}{space}{_figures(one.row)}")
    lines += ["", "misplaced by            mm       °   what moved                  to the body, mm  of the body, mm"]
    for other in outcome.misplaced:
        lines.append(f"{1e3 * other.shift:26.1f}{other.turn:8.2f}   {other.row.way:<24}{_figures(other.row)}")
    return [*lines, *verdict(outcome)]


def _figures(row: Row) -> str:
    if row.mesh is None:
        return f"   no avatar: {row.fault}"
    d = row.distances
    return (
        f"{d['accuracy_mean']:9.2f}{d['accuracy_p95']:9.2f}{d['complete_mean']:8.2f}{d['complete_p95']:9.2f}"
        f"{'   warned' if row.warned else ''}"
    )


def verdict(outcome: Outcome) -> list[str]:
    """Where the snapshot wins and loses, from the numbers alone."""
    ours, *theirs = outcome.arrangements
    area = ours.floor[0] * ours.floor[1]
    lines = []
    for one in theirs:
        size = one.floor[0] * one.floor[1]
        which = "no avatar" if one.row.mesh is None else f"mean error {one.row.error:.2f} mm"
        lines.append(
            f"{one.row.way}, poses by {one.poses}: {which} against {ours.row.error:.2f} mm of the snapshot, on "
            f"{size:.1f} m² against {area:.1f} m²"
        )
    for way in (KEPT_POSE, KEPT_PLANE, FOUND_AGAIN):
        mine = [one for one in outcome.misplaced if one.row.way == way]
        if not mine:
            continue
        still = next((one.row.error for one in mine if one.shift == 0 and one.turn == 0), np.nan)
        worst = [max(moved, key=lambda one: max(one.shift, one.turn))
                 for moved in ([one for one in mine if one.shift > 0], [one for one in mine if one.turn > 0])
                 if moved]  # fmt: skip
        costs = [f"{'no avatar' if one.row.mesh is None else f'{one.row.error:.2f} mm'} at {1e3 * one.shift:g} mm, "
                 f"{one.turn:g}°" for one in worst]  # fmt: skip
        lines.append(f"{way}: {still:.2f} mm where nothing moved, {'; '.join(costs)}")
    return lines


def write_results(outcome: Outcome, body: Mesh, folder: Path) -> tuple[list[Path], str]:
    """Write table.csv, result.png and, when matplotlib is there, plot.png into a folder that exists.

    Returns and raises as :func:`.results.keep`.
    """
    colors = {KEPT_POSE: "tab:red", KEPT_PLANE: "tab:orange", FOUND_AGAIN: "tab:blue"}

    def draw(by_shift, by_turn) -> None:
        for axes, kind, scale, label in ((by_shift, "shift", 1e3, "shift [mm]"), (by_turn, "turn", 1.0, "turn [°]")):
            other = "turn" if kind == "shift" else "shift"
            for way, color in colors.items():
                mine = [one for one in outcome.misplaced if one.row.way == way and getattr(one, other) == 0]
                made = [one for one in mine if one.row.mesh is not None]
                axes.plot([scale * getattr(one, kind) for one in made], [one.row.error for one in made], "o-",
                          color=color, label=way)  # fmt: skip
                failed = [scale * getattr(one, kind) for one in mine if one.row.mesh is None]
                axes.plot(failed, np.zeros(len(failed)), "x", color=color)
            axes.set(xlabel=f"{label}, × = no avatar", ylabel="mean error [mm]", ylim=(0, None))
            axes.grid(alpha=0.3)
            axes.legend()

    shown = picture([one.row for one in outcome.arrangements], body)
    return keep(folder, cells(outcome), shown, draw, 2, (10.4, 4.0))


def cells(outcome: Outcome) -> list[list]:
    """One table of both, headings first; what a row does not say is empty."""
    names = ("accuracy_mean", "accuracy_p95", "complete_mean", "complete_p95")
    found: list[list] = [
        ["way", "poses", "width_m", "depth_m", "unread_share", "pose_error_mm", "pose_error_deg", "shift_mm",
         "turn_deg", *(f"{name}_mm" for name in names), "warned", "fault"]
    ]  # fmt: skip

    def figures(row: Row) -> list:
        values = [f"{row.distances[name]:.4f}" if row.mesh is not None else "" for name in names]
        return [*values, int(row.warned), row.fault]

    for one in outcome.arrangements:
        wrong = ["", ""] if np.isnan(one.shift) else [f"{1e3 * one.shift:.3f}", f"{one.turn:.4f}"]
        sizes = [f"{value:.3f}" for value in one.floor]
        found.append([one.row.way, one.poses, *sizes, f"{one.unread:.4f}", *wrong, "", "", *figures(one.row)])
    for other in outcome.misplaced:
        moved = [f"{1e3 * other.shift:g}", f"{other.turn:g}"]
        found.append([other.row.way, "", "", "", "", "", "", *moved, *figures(other.row)])
    return found
