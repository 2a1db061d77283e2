"""What a plan is written as: the drawing, the mirrors as a rig file, and a picture of the room."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..io.images import write_png
from ..mesh import Mesh
from ..mirrors.glass_extent import at_border
from ..mirrors.mirror import Mirror, oriented, plane_mirror
from ..mirrors.rig_file import RigFile, write_rig
from ..simulation.rays import look
from ..simulation.scene import Rig
from .placement_search import Placement
from .plan_drawing import write_plan_drawing

PLACED_TO = (np.radians(1.0), np.radians(1.0), 0.01)
"""How exactly people put up mirrors by tape: slopes [rad] and shift [m]."""
_HIGH = 480  # of the preview [px]
_GAP = 8


def planned_mirrors(rig: Rig) -> tuple[Mirror, ...]:
    """The rig's mirrors in the camera's frame, as certain as mirrors are that were put up by a tape measure."""
    to_camera = np.linalg.inv(rig.camera_to_avatar)
    found = []
    for mirror in rig.mirrors:
        _, up, normal = mirror.axes
        point = to_camera[:3, :3] @ np.array(mirror.centre) + to_camera[:3, 3]
        plane = plane_mirror(mirror.name, point, to_camera[:3, :3] @ normal)
        normal, basis = oriented(plane.normal, point, to_camera[:3, :3] @ -up)
        w, h = 0.5 * mirror.width, 0.5 * mirror.height
        placed = replace(
            plane, normal=normal, basis=basis, rectangle=np.array(((-w, w), (-h, h))), source="rig file",
            covariance=np.diag(np.square(PLACED_TO)), frame_ahead=mirror.frame_depth,
        )  # fmt: skip
        found.append(at_border(placed, rig.intrinsics, np.zeros((2, 2), np.bool_)))
    return tuple(found)


def write_planned_rig(path: str | os.PathLike, rig: Rig) -> None:
    """Write :func:`planned_mirrors` as a rig file, which ``--rig`` takes. Raises OutputError."""
    write_rig(path, RigFile(rig.intrinsics, planned_mirrors(rig)))


def plan_picture(rig: Rig, body: Mesh) -> np.ndarray:
    """What the camera sees, and the rig from above the camera's left (480, W, 3) uint8."""
    lens = rig.intrinsics
    seen = look(body, replace(rig, intrinsics=lens.scaled(round(_HIGH * lens.width / lens.height), _HIGH)))[0].color
    outside = replace(rig, room=None, **_beside(rig))
    gap = np.full((_HIGH, _GAP, 3), 255, np.uint8)
    return np.concatenate((seen, gap, look(body, outside)[0].color), axis=1)


def _beside(rig: Rig) -> dict:
    """A camera above and to the left of the rig that has all of it in its picture, as fields of a rig."""
    places = np.array([rig.camera, (0.0, 0.0, 1.7), *(mirror.centre for mirror in rig.mirrors)])
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    size = float(np.linalg.norm(np.ptp(places[:, :2], axis=0)))
    way = np.array((-0.62, -0.7, 0.62))
    eye = middle + (1.25 * size + 0.6) * way / np.linalg.norm(way)
    ahead = middle - eye
    return {
        "intrinsics": Intrinsics(_HIGH * 4 // 3, _HIGH, 560.0, 560.0, _HIGH * 2 / 3 - 0.5, _HIGH / 2 - 0.5),
        "camera": (float(eye[0]), float(eye[1]), float(eye[2])),
        "pan_deg": float(np.degrees(np.arctan2(ahead[0], ahead[1]))),
        "tilt_deg": float(np.degrees(np.arcsin(-ahead[2] / np.linalg.norm(ahead)))),
        "roll_deg": 0.0,
    }


def write_plan(placement: Placement, body: Mesh, folder: str | os.PathLike, title: str = "Rig plan") -> list[Path]:
    """Write plan.svg, rig.json and preview.png into a folder that exists; their paths. Raises OutputError."""
    folder = Path(folder)
    paths = [folder / name for name in ("plan.svg", "rig.json", "preview.png")]
    write_plan_drawing(paths[0], placement, title)
    write_planned_rig(paths[1], placement.rig)
    write_png(paths[2], plan_picture(placement.rig, body))
    return paths
