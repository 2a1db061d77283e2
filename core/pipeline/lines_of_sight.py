"""Where several cameras look, and so where the subject is meant to stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import RgbdImage
from ..capture import Capture, MirrorPicks
from ..depth.depth_map import one_depth_map
from ..errors import ReconstructionError
from ..mirrors import Mirror
from ..numeric.point_products import transform
from ..subject.subject_search import figures_at
from .mirror_placement import first_mirrors
from .settings import Settings

_CLEARLY = 2.0
"""Without a camera whose pose is wrong the others see so much more of a figure than without another one."""

_WIDE = 0.13
"""Lines of sight that meet at less than 30° say little of where along them the subject stands (1 − cos 30°)."""

_FARTHEST, _PLACE_STEP = 6.0, 0.1
"""So far from a camera a subject is looked for on its line of sight, and at places so far apart [m]."""


def lines_of_sight_crossing(poses: Sequence[np.ndarray]) -> np.ndarray | None:
    """The point nearest to all cameras' optical axes; None for one camera, or for parallel axes.

    Parameters
    ----------
    poses : sequence of np.ndarray [shape=(4, 4)]
        Camera frame → the frame of the answer.
    """
    middle, _, spread = _nearest_to_lines_of_sight(poses)
    return middle if spread > 1e-2 else None


def _nearest_to_lines_of_sight(poses: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """A point (3,) nearest to all optical axes, the direction (3,) in which they leave it open, and how little.

    0 is parallel: then the direction is the axes' own, and the point is right across from the cameras' middle.
    """
    A, b = np.zeros((3, 3)), np.zeros(3)
    middle = np.mean([pose[:3, 3] for pose in poses], axis=0)
    for pose in poses:
        P = np.eye(3) - np.outer(pose[:3, 2], pose[:3, 2])
        A += P
        b += P @ (pose[:3, 3] - middle)
    values, vectors = np.linalg.eigh(A)
    open_way = values < 1e-9
    along = np.divide(vectors.T @ b, values, out=np.zeros(3), where=~open_way)
    return middle + vectors @ along, vectors[:, 0], float(values[0])


class Figures:
    """What each camera sees standing at some places, asked only where it is in doubt where the subject stands."""

    def __init__(
        self, captures: Sequence[Capture], known: Sequence[tuple[MirrorPicks | Mirror, ...]], settings: Settings
    ) -> None:
        self._captures, self._known, self._settings = captures, known, settings
        self._seen: dict[int, tuple[RgbdImage, list[Mirror]]] = {}

    def __len__(self) -> int:
        return len(self._captures)

    def mirrors(self, camera: int) -> tuple[MirrorPicks | Mirror, ...]:
        """What is known of a camera's mirrors: placed, where that was needed, but not yet aligned."""
        return tuple(self._seen[camera][1]) if camera in self._seen else self._known[camera]

    def at(self, camera: int, places: np.ndarray) -> np.ndarray:
        """How large (K,) the figure is that the camera sees at places (K, 3) in its frame [m²]; 0 = none."""
        if camera not in self._seen:
            capture, picks, settings = self._captures[camera], self._known[camera], self._settings
            depth, _ = one_depth_map(capture, settings.depth)
            mirrors = first_mirrors(picks, depth, capture, settings) if picks else []
            self._seen[camera] = RgbdImage(depth, capture.intrinsics), mirrors
        return figures_at(*self._seen[camera], places, self._settings.views)


def meeting_point_of(poses: Sequence[np.ndarray], figures: Figures, settings: Settings) -> np.ndarray | None:
    """Where the cameras look, and so where the subject is meant to stand; None for one camera.

    Lines of sight that cross at a wide angle say it. Cameras that face each other, or look the same way, have a line in
    common: of the places on it the one counts where all of them see a figure.
    """
    if len(poses) < 2:
        return None
    middle, direction, spread = _nearest_to_lines_of_sight(poses)
    if spread > _WIDE:
        return middle
    inverses = [np.linalg.inv(pose) for pose in poses]
    places = middle + np.arange(-_FARTHEST, _FARTHEST, _PLACE_STEP)[:, None] * direction
    z = np.array([transform(places, inverse)[:, 2] for inverse in inverses])
    places = places[(z > settings.depth.min_depth).all(axis=0) & (z < _FARTHEST).all(axis=0)]
    areas = np.ones(len(places))
    for camera, inverse in enumerate(inverses):
        areas *= figures.at(camera, transform(places, inverse))
    if areas.max(initial=0.0) > 0:
        return places[int(np.argmax(areas))]
    return lines_of_sight_crossing(poses)


def _common_figure(poses: Sequence[np.ndarray], figures: Figures, without: int = -1) -> float:
    """How large [m²] the figure is where lines of sight cross, to the camera that sees least of it."""
    cameras = [k for k in range(len(poses)) if k != without]
    place = lines_of_sight_crossing([poses[k] for k in cameras])
    if place is None:
        return 0.0
    return min(figures.at(k, transform(place[None], np.linalg.inv(poses[k])))[0] for k in cameras)


def check_way_round(poses: Sequence[np.ndarray], figures: Figures) -> None:
    """Refuse poses that do not fit the captures when their inverses do.

    Raises
    ------
    ReconstructionError
    """
    if len(poses) > 2 and _common_figure([np.linalg.inv(pose) for pose in poses], figures) > 0:
        raise ReconstructionError(
            "the poses are the wrong way round: they take the common frame to each camera's; give the inverse of each, "
            "camera frame → common frame"
        )


def check_meeting_point(
    place: np.ndarray,
    poses: Sequence[np.ndarray],
    figures: Figures,
    names: Sequence[str],
) -> None:
    """Refuse poses by which not every camera sees somebody at the ``place`` (3,) where they look.

    Raises
    ------
    ReconstructionError
        It names the camera without which the others would agree.
    """
    if min(figures.at(k, transform(place[None], np.linalg.inv(pose)))[0] for k, pose in enumerate(poses)) > 0:
        return
    if len(poses) > 2:
        areas = np.array([_common_figure(poses, figures, k) for k in range(len(poses))])
        odd = int(np.argmax(areas))
        if areas[odd] > _CLEARLY * np.delete(areas, odd).max():
            raise ReconstructionError(
                "{name}: nobody stands where all other cameras see the subject; check this camera's pose (camera frame "
                "→ common frame, metres), and that its picture shows the subject",
                name=names[odd],
                code="nobody",
            )
    raise ReconstructionError(
        "by their poses the cameras do not look at one subject: nobody stands where the lines of sight of {names} "
        "meet; check the poses (camera frame → common frame, metres, not the inverse), and that all captures show "
        "the same subject",
        names=_listed(names),
        code="nobody",
    )


def _listed(names: Sequence[str]) -> str:
    return " and ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else names[0]
