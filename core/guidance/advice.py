"""What to do now, in plain words and with an arrow: :class:`Advice`, and how it follows from the live picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera import RgbdImage
from ..camera.noise_models import NoiseModel
from ..checks.scene_advice import Finding, Move, scene_findings
from ..errors import Notice
from ..mirrors import Mirror
from ..subject.subject_views import Views
from .posture import level_right, posture_of
from .standing_place import nearest_place

NOTES = ("plane_uncertain", "no_floor", "leaning", "same_side", "side_unseen", "unread")
"""Kinds that are said, and do not keep the burst from being taken: who stands there cannot follow them."""

KINDS = (
    "mirrors_missing", "nobody", "two_people", "camera_moved", "mirror_moved", "moving", "step", "feet_hidden",
    "arms_close", "head_cut", "feet_cut", "side_cut", "aside", "not_shown", "mirror_small", "glass_edge", "image_edge",
    "far", "body_hides", "arms_hide", "blocked", *NOTES,
)  # fmt: skip
"""All kinds of advice; ``--ignore`` of the command line takes them."""

_BY_STEPPING = (
    "side_cut", "head_cut", "feet_cut", "aside", "not_shown", "glass_edge", "image_edge", "body_hides", "arms_hide",
    "mirror_small", "far", "unread",
)  # fmt: skip
"""What another place to stand may cure."""

SHORTEST_STEP = 0.1
"""Nobody is asked to step less [m]."""

_HEEDED = 0.05  # m: parts of a step that are said


@dataclass(frozen=True)
class Arrow:
    """An arrow in the scene.

    Parameters
    ----------
    start, direction : np.ndarray [shape=(3,)]
        Camera frame [m], and a unit vector.
    length : float
        [m]
    """

    start: np.ndarray
    direction: np.ndarray
    length: float

    @property
    def end(self) -> np.ndarray:
        """Its tip (3,), camera frame [m]."""
        return self.start + self.length * self.direction


@dataclass(frozen=True)
class Advice:
    """One thing to do.

    Parameters
    ----------
    code : str
        Of :data:`KINDS`.
    text : str
        What is wrong and what to do.
    arrow : Arrow or None
        What goes where.
    severity : str
        ``warning``: the picture waits for it; ``note``: it does not.
    where : str
        The mirror it is about; empty for none.
    what : str
        What is to be moved: ``subject``, ``arms``, ``mirror``, ``camera``, or empty.
    angle_deg : float
        By how much that is to be turned; 0 = only moved.
    """

    code: str
    text: str
    arrow: Arrow | None = None
    severity: str = "warning"
    where: str = ""
    what: str = ""
    angle_deg: float = 0.0

    @property
    def key(self) -> tuple[str, str]:
        """What makes it the same advice from frame to frame, whatever its figures."""
        return self.code, self.where


def arrow_of(start: np.ndarray, shift: np.ndarray) -> Arrow | None:
    """The arrow along a shift [m]; None where that is nothing."""
    length = float(np.linalg.norm(shift))
    return None if length < 1e-6 else Arrow(np.asarray(start, np.float64), shift / length, length)


def advise(image: RgbdImage, views: Views, mirrors: Sequence[Mirror], model: NoiseModel | None = None) -> list[Advice]:
    """What to do about how the subject, the mirrors and the camera stand; empty when all is well.

    The subject is asked to move first: where a place is found at which every mirror shows it whole, that is all that is
    said of what the mirrors cut off. Else the rig is to be changed.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading; may be thinned.
    views : Views
        Of :func:`..subject.subject_search.find_subject`.
    mirrors : sequence of Mirror
    model : NoiseModel or None
        Of the camera, where it is known.
    """
    findings = scene_findings(image, views, list(mirrors), model, search=False)
    advices = _all_of(views, findings)
    if any(one.code in _BY_STEPPING and not _by_tilting(one) for one in advices):
        most = np.inf if model is None else 1.25 * model.max_range
        step = nearest_place(views, mirrors, image.intrinsics, most)
        if step is not None and np.linalg.norm(step) >= SHORTEST_STEP:
            return [_stepping(views, step), *(one for one in advices if one.code not in _BY_STEPPING)]
    if any(one.kind in ("body_hides", "arms_hide") for one in findings):  # then it is the mirror that is to be moved
        return _all_of(views, scene_findings(image, views, list(mirrors), model))
    return advices


def _all_of(views: Views, findings: Sequence[Finding]) -> list[Advice]:
    """Advice on how the subject stands, and of each finding."""
    return [*_of_posture(views, findings), *map(_of_finding, findings)]


def _by_tilting(advice: Advice) -> bool:
    """Whether to tilt the camera is enough."""
    return advice.code in ("head_cut", "feet_cut") and advice.what == "camera"


def _of_finding(finding: Finding) -> Advice:
    move: Move | None = finding.move
    severity = "note" if finding.kind in NOTES else "warning"
    if move is None:
        return Advice(finding.kind, finding.text, None, severity, finding.mirror)
    arrow = arrow_of(move.start, move.shift)
    return Advice(finding.kind, finding.text, arrow, severity, finding.mirror, move.what, move.angle_deg)


def step_text(step: np.ndarray, up: np.ndarray, place: np.ndarray) -> Notice:
    """A level step (3,) [m] of who stands at a place (3,) and faces the camera, in words."""
    right = level_right(up, place)
    ahead = np.cross(up, right)
    ways = (
        (float(step @ right), Notice("to your left"), Notice("to your right")),  # who faces the camera
        (float(step @ ahead), Notice("away from the camera"), Notice("towards the camera")),
    )
    moves = [
        Notice("{distance:.0f} cm {way}", distance=100 * abs(by), way=one if by > 0 else other)
        for by, one, other in ways
        if abs(by) > _HEEDED
    ]
    if len(moves) == 2:
        return Notice("{one} and {other}", one=moves[0], other=moves[1])
    return moves[0]


def _stepping(views: Views, step: np.ndarray) -> Advice:
    text = Notice("step {way}; there all mirrors show you whole", way=step_text(step, views.up, views.axis))
    start = views.axis if views.floor is None else views.axis + (views.floor - views.axis @ views.up) * views.up
    return Advice("step", text, arrow_of(start, step), what="subject")


def _of_posture(views: Views, findings: Sequence[Finding]) -> list[Advice]:
    """Arms at the body, feet out of sight."""
    posture = posture_of(views)
    if posture is None:
        return []
    advices = []
    if posture.feet_hidden and all(one.kind != "feet_cut" for one in findings):
        text = Notice(
            "your feet are hidden up to {height:.0f} cm above the floor; take away what stands in front of them",
            height=100 * posture.lowest,
        )
        foot = (
            posture.middle + (views.floor - posture.middle @ views.up) * views.up if views.floor is not None else None
        )
        arrow = None if foot is None else arrow_of(foot + 0.4 * views.up, -0.4 * views.up)
        advices.append(Advice("feet_hidden", text, arrow, what="subject"))
    close = posture.arms_close
    if close.any():
        side = int(np.argmin(posture.reach))
        which = (
            Notice("your arms") if close.all() else Notice("your right arm") if side == 0 else Notice("your left arm")
        )
        text = Notice(
            "hold {which} further out, the hands about {distance:.0f} cm further from the hips",
            which=which, distance=100 * posture.arms_out()[side],
        )  # fmt: skip
        way = (-1.0 if side == 0 else 1.0) * posture.right
        arrow = arrow_of(posture.hands[side], posture.arms_out()[side] * way)
        advices.append(Advice("arms_close", text, arrow, what="arms"))
    return advices


class SteadyAdvice:
    """Advice that does not flicker: what most of the last moments say, in the words of the last of them.

    Parameters
    ----------
    within_s : float
        How long a moment counts [s]; advice comes and goes with half of that.
    """

    def __init__(self, within_s: float = 0.5) -> None:
        self._within = within_s
        self._heard: list[tuple[float, dict[tuple[str, str], Advice]]] = []
        self._shown: list[tuple[str, str]] = []

    def hear(self, advices: Sequence[Advice], seconds: float) -> tuple[Advice, ...]:
        """What to show now, after what one more frame says.

        Parameters
        ----------
        advices : sequence of Advice
            Of the frame.
        seconds : float
            When that was, by any clock that only goes forward.
        """
        now = {one.key: one for one in advices}
        self._heard = [(when, one) for when, one in self._heard if when > seconds - self._within]
        self._heard.append((seconds, now))
        newest: dict[tuple[str, str], Advice] = {}
        count: dict[tuple[str, str], int] = {}
        for _, one in self._heard:
            newest |= one
            for key in one:
                count[key] = count.get(key, 0) + 1
        steady = [key for key in newest if 2 * count[key] > len(self._heard)]
        kept = [key for key in self._shown if key in steady]
        self._shown = kept + [key for key in now if key in steady and key not in kept]
        self._shown += [key for key in steady if key not in self._shown]
        return tuple(sorted((newest[key] for key in self._shown), key=lambda one: one.severity != "warning"))
