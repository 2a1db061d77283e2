"""A plan to print: the room from above, to scale, with tape marks, distances and angles, as one SVG page of A4.

All marks are given by their distances from two walls, so that a tape measure is all that is needed.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

import numpy as np

from ..io.atomic_files import replacing
from ..simulation.scene import FramedMirror, Rig
from .placement_search import Placement, footprint

PAGE = (297.0, 210.0)
"""A4, landscape [mm]."""
SCALES = (10, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300, 500)
"""1 : so many; the first that the room fits with is taken."""

_AREA = (14.0, 22.0, 172.0, 166.0)  # left, top, width, height of the drawing on the page [mm]
_TABLE = 196.0  # where the table begins [mm]
_INK, _SOFT, _GLASS, _MARK = "#1d2733", "#7a8ea3", "#2f7fb8", "#c2410c"


@dataclass(frozen=True)
class TapeMark:
    """A cross of tape on the floor.

    Parameters
    ----------
    letter : str
        On the plan and in the table.
    place : np.ndarray [shape=(2,)]
        x, y in the rig's frame [m].
    from_left, from_near : float
        Distances from the left wall, as the camera sees the room, and from the wall behind the camera [m].
    what : str
        What stands there.
    """

    letter: str
    place: np.ndarray
    from_left: float
    from_near: float
    what: str


def tape_marks(placement: Placement) -> list[TapeMark]:
    """The marks of camera, person and both ends of each mirror, lettered in this order."""
    rig = placement.rig
    assert rig.room is not None  # find_placement gives walls
    places: list[tuple[np.ndarray, str]] = [
        (np.array(rig.camera[:2]), "camera, below the lens"),
        (np.zeros(2), "person, between the feet"),
    ]
    for mirror in rig.mirrors:
        left, right = footprint(mirror)[:2]
        if left[0] > right[0]:
            left, right = right, left
        places += [(left, f"{mirror.name} mirror, left end of its front"), (right, f"{mirror.name} mirror, right end")]
    return [
        TapeMark(chr(ord("A") + k), place, float(place[0] - rig.room[0]), float(place[1] - rig.room[2]), what)
        for k, (place, what) in enumerate(places)
    ]


def mirror_angle(mirror: FramedMirror) -> float:
    """By how much a mirror is turned from facing the wall behind the camera [degrees]; right end nearer = negative."""
    return float(np.degrees(np.arctan2(mirror.normal[0], -mirror.normal[1])))


def angle_in_words(mirror: FramedMirror) -> str:
    """How a mirror is turned, in words."""
    angle = mirror_angle(mirror)
    if abs(angle) < 0.25:
        return "parallel to the wall behind the camera"
    edge = "right" if angle < 0 else "left"
    return f"{abs(angle):.1f}° to the wall behind the camera, its {edge} end nearer to it"


@dataclass
class _Page:
    """Elements of the page, in millimetres."""

    elements: list[str] = field(default_factory=list)

    def line(self, one, other, color: str = _INK, width: float = 0.25, dash: str = "") -> None:
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.elements.append(
            f'<line x1="{one[0]:.2f}" y1="{one[1]:.2f}" x2="{other[0]:.2f}" y2="{other[1]:.2f}" stroke="{color}" '
            f'stroke-width="{width:g}"{dashed}/>'
        )

    def polygon(self, places, fill: str, stroke: str = "none", width: float = 0.25, opacity: float = 1.0) -> None:
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in places)
        self.elements.append(
            f'<polygon points="{points}" fill="{fill}" fill-opacity="{opacity:g}" stroke="{stroke}" '
            f'stroke-width="{width:g}"/>'
        )

    def text(
        self, place, text: str, size: float = 3.2, anchor: str = "start", color: str = _INK, turn: float = 0.0,
        bold: bool = False, halo: bool = False,
    ) -> None:  # fmt: skip
        x, y = place
        turned = f' transform="rotate({turn:.1f} {x:.2f} {y:.2f})"' if turn else ""
        weight = ' font-weight="bold"' if bold else ""
        about = f'x="{x:.2f}" y="{y:.2f}" font-size="{size:g}" text-anchor="{anchor}"{weight}{turned}'
        if halo:  # a text of its own: not every program knows paint-order
            border = 'fill="white" stroke="white" stroke-width="1.1" stroke-linejoin="round"'
            self.elements.append(f"<text {about} {border}>{escape(text)}</text>")
        self.elements.append(f'<text {about} fill="{color}">{escape(text)}</text>')


@dataclass(frozen=True)
class _Scale:
    """From the rig's frame [m] to the page [mm]; the camera at the foot of the page, its right to the right."""

    one_to: int
    x0: float
    y1: float
    left: float
    top: float

    def __call__(self, place) -> np.ndarray:
        return np.array(
            (
                self.left + 1000.0 * (place[0] - self.x0) / self.one_to,
                self.top + 1000.0 * (self.y1 - place[1]) / self.one_to,
            )
        )


def _scale_of(rig: Rig) -> _Scale:
    assert rig.room is not None
    x0, x1, y0, y1, _ = rig.room
    left, top, wide, high = _AREA
    for one_to in SCALES:
        across, along = 1000.0 * (x1 - x0) / one_to, 1000.0 * (y1 - y0) / one_to
        if across <= wide and along <= high:
            break
    return _Scale(one_to, x0, y1, left + 0.5 * (wide - across), top + 0.5 * (high - along))


def plan_drawing(placement: Placement, title: str = "Rig plan") -> str:
    """The plan as SVG text, valid XML; the same for the same placement."""
    rig = placement.rig
    page, at = _Page(), _scale_of(rig)
    marks = tape_marks(placement)
    _draw_room(page, rig, at)
    _draw_view(page, rig, at)
    _draw_distances(page, rig, at)
    _draw_mirrors(page, rig, at)
    _draw_person(page, at)
    _draw_camera(page, rig, at)
    _draw_marks(page, marks, at)
    _draw_scale_bar(page, at)
    _draw_table(page, placement, marks, title, at)
    width, height = PAGE
    head = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}" font-family="sans-serif">'
    )
    about = f"<title>{escape(title)}</title>"
    paper = f'<rect width="{width:g}" height="{height:g}" fill="white"/>'
    return "\n".join([head, about, paper, *page.elements, "</svg>"]) + "\n"


def write_plan_drawing(path: str | os.PathLike, placement: Placement, title: str = "Rig plan") -> None:
    """Write :func:`plan_drawing`; what was there is replaced only by a complete file. Raises OutputError."""
    with replacing(path) as temporary:
        temporary.write_text(plan_drawing(placement, title), encoding="utf-8")


def _draw_room(page: _Page, rig: Rig, at: _Scale) -> None:
    assert rig.room is not None
    x0, x1, y0, y1, _ = rig.room
    corners = [at((x0, y0)), at((x1, y0)), at((x1, y1)), at((x0, y1))]
    page.polygon(corners, "#fbfcfd", _INK, 0.9)
    for metre in range(1, math.ceil(x1 - x0)):
        page.line(at((x0 + metre, y0)), at((x0 + metre, y1)), "#e3e9ef", 0.15)
    for metre in range(1, math.ceil(y1 - y0)):
        page.line(at((x0, y0 + metre)), at((x1, y0 + metre)), "#e3e9ef", 0.15)
    middle = 0.5 * (at((x0, y1)) + at((x1, y1)))
    page.text(middle - (0, 2.0), f"{x1 - x0:.2f} m", anchor="middle")
    side = 0.5 * (at((x0, y0)) + at((x0, y1)))
    page.text(side - (2.0, 0), f"{y1 - y0:.2f} m", anchor="middle", turn=-90.0)
    page.text(0.5 * (at((x0, y0)) + at((x1, y0))) + (0, 4.6), "wall behind the camera", 2.8, "middle", _SOFT)
    right = 0.5 * (at((x1, y0)) + at((x1, y1))) + (4.0, 0)
    page.text(right, "right wall", 2.8, "middle", _SOFT, turn=-90.0)


def _draw_view(page: _Page, rig: Rig, at: _Scale) -> None:
    """The camera's field of view, as far as the walls."""
    assert rig.room is not None
    lens = rig.intrinsics
    eye = np.array(rig.camera[:2])
    ends = []
    for u in (0.0, lens.width - 1.0):
        angle = math.atan2(u - lens.cx, lens.fx) + math.radians(rig.pan_deg)
        ends.append(eye + _to_wall(eye, np.array((math.sin(angle), math.cos(angle))), rig.room))
    x0, x1, y0, y1, _ = rig.room
    between = []  # corners of the room within the field of view, from left to right
    for x, y in ((x0, y0), (x0, y1), (x1, y1), (x1, y0)):
        side = math.atan2(x - eye[0], y - eye[1]) - math.radians(rig.pan_deg)
        side = (side + math.pi) % (2.0 * math.pi) - math.pi
        if math.atan2(-lens.cx, lens.fx) < side < math.atan2(lens.width - 1.0 - lens.cx, lens.fx):
            between.append((side, at((x, y))))
    corners = [corner for _, corner in sorted(between, key=lambda pair: pair[0])]
    page.polygon([at(eye), at(ends[0]), *corners, at(ends[1])], "#f2c94c", opacity=0.14)


def _to_wall(eye: np.ndarray, way: np.ndarray, room: tuple[float, float, float, float, float]) -> np.ndarray:
    reach = np.inf
    for axis in range(2):
        if way[axis]:
            wall = room[2 * axis + (1 if way[axis] > 0 else 0)]
            reach = min(reach, (wall - eye[axis]) / way[axis])
    return reach * way


def _draw_distances(page: _Page, rig: Rig, at: _Scale) -> None:
    """Lines from the camera to the person and by the middle of each mirror, with their lengths on the floor."""
    eye = np.array(rig.camera[:2])
    pairs = [(eye, np.zeros(2))]
    for mirror in rig.mirrors:
        middle = np.array(mirror.centre[:2])
        pairs += [(eye, middle), (middle, np.zeros(2))]
    for k, (one, other) in enumerate(pairs):
        page.line(at(one), at(other), _SOFT, 0.2, "1.6 1")
        start, end = at(one), at(other)
        share = 0.36 if k and one is eye else 0.5  # lines meet at the camera and at the person
        place = start + share * (end - start)
        turn = math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
        turn = turn - 180.0 if turn > 90.0 else turn + 180.0 if turn < -90.0 else turn
        page.text(place, f"{np.linalg.norm(other - one):.2f} m", 2.8, "middle", _INK, turn, halo=True)


def _draw_mirrors(page: _Page, rig: Rig, at: _Scale) -> None:
    for mirror in rig.mirrors:
        stands = [at(place) for place in footprint(mirror)]
        page.polygon([stands[0], stands[1], stands[3], stands[2]], _INK, _INK, 0.3)
        right, _, normal = mirror.axes
        middle = np.array(mirror.centre[:2])
        half = 0.5 * mirror.width * right[:2]
        page.line(at(middle - half), at(middle + half), _GLASS, 1.1)
        away = at(middle) - at(middle + normal[:2])
        place = at(middle) + 7.5 * away / np.linalg.norm(away)
        # turned by what it is on the plan, with its wall as the base line
        page.text(
            place, f"{mirror.name}, {abs(mirror_angle(mirror)):.1f}°", 3.0, "middle", _GLASS, bold=True, halo=True
        )


def _draw_person(page: _Page, at: _Scale) -> None:
    around = np.linspace(0.0, 2.0 * np.pi, 49)
    body = np.stack((0.24 * np.cos(around), 0.14 * np.sin(around)), axis=1)
    page.polygon([at(place) for place in body], "#d9e2ec", _INK, 0.3)
    page.polygon([at((-0.05, -0.15)), at((0.05, -0.15)), at((0.0, -0.25))], _INK)


def _draw_camera(page: _Page, rig: Rig, at: _Scale) -> None:
    pan = math.radians(rig.pan_deg)
    right, ahead = np.array((math.cos(pan), -math.sin(pan))), np.array((math.sin(pan), math.cos(pan)))
    case = ((-0.07, -0.1), (0.07, -0.1), (0.07, 0.0), (-0.07, 0.0))
    for shape in (case, ((0.0, -0.02), (-0.06, 0.07), (0.06, 0.07))):
        page.polygon([at(np.array(rig.camera[:2]) + x * right + y * ahead) for x, y in shape], _INK)


def _draw_marks(page: _Page, marks: list[TapeMark], at: _Scale) -> None:
    for mark in marks:
        x, y = at(mark.place)
        page.line((x - 1.8, y), (x + 1.8, y), _MARK, 0.5)
        page.line((x, y - 1.8), (x, y + 1.8), _MARK, 0.5)
        page.text((x + 2.0, y + 4.2), mark.letter, 3.6, color=_MARK, bold=True, halo=True)


def _draw_scale_bar(page: _Page, at: _Scale) -> None:
    metre = 1000.0 / at.one_to
    left, y = _AREA[0], PAGE[1] - 8.0
    for k in range(2):
        part = [(left + 0.5 * k * metre, y), (left + 0.5 * (k + 1) * metre, y)]
        page.polygon([*part, (part[1][0], y + 1.5), (part[0][0], y + 1.5)], _INK if k == 0 else "white", _INK, 0.2)
    page.text(
        (left + metre + 2.0, y + 1.9), f"1 m at 1 : {at.one_to}, printed on A4 without fitting it to the page", 2.8
    )


def _draw_table(page: _Page, placement: Placement, marks: list[TapeMark], title: str, at: _Scale) -> None:
    rig, room = placement.rig, placement.room
    page.text((_AREA[0], 12.0), title, 6.0, bold=True)
    size = " × ".join(f"{round(value, 2):g}" for value in (room.width, room.depth, room.height))
    page.text((_TABLE, 12.0), f"room {size} m, {rig.sensor}", 3.2, color=_SOFT)
    y = 22.0
    page.text((_TABLE, y), "Tape marks", 4.0, bold=True)
    y += 5.4
    for x, words in ((_TABLE + 6.0, "left wall"), (_TABLE + 24.0, "camera wall")):
        page.text((x, y), words, 2.8, color=_SOFT)
    for mark in marks:
        y += 5.0
        page.text((_TABLE, y), mark.letter, 3.6, color=_MARK, bold=True)
        page.text((_TABLE + 17.0, y), f"{mark.from_left:.2f} m", 3.2, "end")
        page.text((_TABLE + 37.0, y), f"{mark.from_near:.2f} m", 3.2, "end")
        page.text((_TABLE + 42.0, y), mark.what, 2.7)
    y += 9.0
    page.text((_TABLE, y), "Heights and angles", 4.0, bold=True)
    for line in heights_in_words(rig):
        y += 4.8
        page.text((_TABLE, y), line, 2.9)
    y += 9.0
    page.text((_TABLE, y), "What to expect", 4.0, bold=True)
    for line in expectation_in_words(placement):
        y += 4.8
        page.text((_TABLE, y), line, 2.9)


def heights_in_words(rig: Rig) -> list[str]:
    """Short lines: how high and how tilted the camera is, and how each mirror stands."""
    way = "down" if rig.tilt_deg >= 0 else "up"
    tilt = "level" if abs(rig.tilt_deg) < 0.25 else f"tilted {way} by {abs(rig.tilt_deg):.1f}°"
    lines = [f"camera: lens {rig.camera[2]:.2f} m above the floor, {tilt}"]
    if abs(rig.pan_deg) >= 0.25:
        side = "right" if rig.pan_deg > 0 else "left"
        lines.append(f"    turned {abs(rig.pan_deg):.1f}° to the {side} from straight ahead")
    if abs(rig.roll_deg) >= 0.25:
        way = "clockwise" if rig.roll_deg > 0 else "anticlockwise"
        lines.append(f"    rolled {abs(rig.roll_deg):.1f}° {way}, seen from behind it")
    for mirror in rig.mirrors:
        _, up, normal = mirror.axes
        lower = mirror.centre[2] - 0.5 * mirror.height * up[2]
        lean = math.degrees(math.atan2(normal[2], math.hypot(*normal[:2])))
        stands = "upright" if abs(lean) < 0.25 else "leaning"
        size = f"{round(mirror.width, 3):g} × {round(mirror.height, 3):g} m"
        lines.append(f"{mirror.name} mirror: {size}, {stands}, glass from {lower:.2f} m up")
        if stands == "leaning":
            lines.append(f"    its top {'back' if lean > 0 else 'forward'} by {abs(lean):.1f}°")
        lines.append(f"    {angle_in_words(mirror)}")
    return lines


def expectation_in_words(placement: Placement) -> list[str]:
    """Short lines: what is seen, and how far off the avatar is expected to be."""
    coverage, error = placement.coverage, placement.error
    parts = coverage.by_part
    lines = [
        f"seen: {coverage.share:.0%} of the body",
        "of " + ", of ".join(f"{name} {share:.0%}" for name, share in parts.items() if not math.isnan(share)),
        f"mean error of the avatar: about {error.mean_mm:.1f} mm",
    ]
    if error.lit_twice > 0:
        lines.append(f"light by two ways: on {error.lit_twice:.0%} of the body, {error.light_mm:.1f} mm")
    return lines
