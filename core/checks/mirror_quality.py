"""How good a placed mirror is: judged by the camera's noise, by whether it stands upright, and by what it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera import RgbdImage, unproject
from ..camera.noise_models import SENSORS, NoiseModel
from ..capture import MirrorPicks
from ..errors import MirrorError, Notice
from ..mirror_alignment.frame_shape import frame_shape, honest_error
from ..mirror_detection.mirror_at_picks import contradicted, glass_evidence
from ..mirror_detection.mirror_verification import Evidence
from ..mirrors import Mirror
from ..mirrors.mirror import expected_error
from ..mirrors.picked_mirror import MirrorSettings, place_mirror
from ..mirrors.wall_behind_frame import on_wall
from ..views.floor_and_vertical import find_floor

GOOD, USABLE, WRONG = "good", "usable", "wrong"


@dataclass(frozen=True)
class QualitySettings:
    """Where good ends, and usable.

    Parameters
    ----------
    good_error, usable_error : float
        Expected error of the reflection of a person 1.5 m in front of the mirror, see :func:`.mirror.expected_error`,
        up to which it is good, and usable [m].
    good_residual, usable_residual : float
        Root mean square distance of the frame's readings from its plane that even a camera without noise may have [m].
    good_noises, usable_noises : float
        How many times the camera's noise it may be, where that is more.
    lean, lean_unseen : float
        Of a mirror that stands: angle between its plane and the vertical, where a floor tells it, and where the camera
        is taken to stand level for want of one [degrees].
    fewest_shown : int
        Of every third reading in its glass, as many must lie on something that is seen directly as well. Where no
        mirror shows so many, nobody is there: that is no mirror's fault.
    """

    good_error: float = 0.003
    usable_error: float = 0.03
    good_residual: float = 0.005
    usable_residual: float = 0.012
    good_noises: float = 1.0
    usable_noises: float = 3.0
    lean: float = 30.0
    lean_unseen: float = 50.0
    fewest_shown: int = 15


@dataclass(frozen=True)
class MirrorQuality:
    """What a mirror is worth.

    Parameters
    ----------
    word : {"good", "usable", "wrong"}
    reason : Notice or None
        What is not good about it, and what to do; None when it is good.
    error : float
        Expected error of the reflection of a person 1.5 m in front of it [m]; 0 for a plane that was given.
    noise : float
        Standard deviation of a reading at the mirror's distance [m]: the camera's, or as its frame shows; 0 = unknown.
    """

    word: str
    reason: Notice | None
    error: float
    noise: float


def judge_mirrors(
    image: RgbdImage,
    mirrors: Sequence[Mirror],
    picks: Sequence[MirrorPicks | None] = (),
    sensor: str = "",
    settings: QualitySettings = QualitySettings(),  # noqa: B008 - frozen
) -> list[MirrorQuality]:
    """What each placed mirror is worth, before anything is built with it.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    mirrors : sequence of Mirror
        On their frames' planes, camera frame.
    picks : sequence of MirrorPicks or None, optional
        What each was placed by, if anything.
    sensor : str
        A name of :data:`.noise_models.SENSORS`; of any other camera the noise is what the frames show.
    """
    up, known = _vertical(image)
    model = SENSORS.get(sensor)
    told = [*picks, *([None] * (len(mirrors) - len(picks)))]
    evidence = [glass_evidence(image, mirror) for mirror in mirrors]
    shows = [_shows_somebody(seen, settings) for seen in evidence]
    empty = not any(shows)  # a rig, perhaps, and nobody in it
    found = []
    for k, mirror in enumerate(mirrors):
        others = [*mirrors[:k], *mirrors[k + 1 :]]
        noise = _noise(image, mirror, model)
        error = expected_error(honest_error(image, mirror)[0])
        lean = float(np.degrees(np.arcsin(min(abs(float(mirror.normal @ up)), 1.0))))
        wrong: Notice | None
        if lean > (settings.lean if known else settings.lean_unseen):
            wrong = Notice(
                "{name}: does not stand upright: it leans by {lean:.0f}°, as a floor or a table does; find the "
                "mirrors, or pick points on its frame",
                name=mirror.name, lean=lean, mirrors=[mirror.name],
            )  # fmt: skip
        else:
            wrong = _contradiction(image, mirror, others) or _about_frame(mirror, error, noise, settings)
            if wrong is None and not empty and not shows[k]:
                wrong = Notice(
                    "{name}: the person is not seen in it, as in another mirror; turn it until the camera sees the "
                    "person's back in it, or remove it from the list",
                    name=mirror.name, mirrors=[mirror.name],
                )  # fmt: skip
        points = told[k]
        if wrong is not None and points is not None:
            wrong = swapped_points(image, points, settings) or wrong
        if wrong is not None:
            found.append(MirrorQuality(WRONG, wrong, error, noise))
            continue
        doubt = _doubt(mirror, error, noise, settings)
        if empty and evidence[k] is not None:
            doubt = Notice(
                "{name}: nobody is seen in it, nor in another mirror; that does for a rig file, but an avatar needs "
                "the person's back in it",
                name=mirror.name, mirrors=[mirror.name],
            )  # fmt: skip
        found.append(MirrorQuality(GOOD if doubt is None else USABLE, doubt, error, noise))
    return found


def swapped_points(
    image: RgbdImage,
    picks: MirrorPicks,
    settings: QualitySettings = QualitySettings(),  # noqa: B008 - frozen
) -> Notice | None:
    """What to say of points that mean no mirror, but one that stands and shows somebody with rows and columns swapped.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    picks : MirrorPicks
        Points of a mirror that is wrong, or cannot be placed.
    """
    if picks.frame_pixels is None or len(picks.frame_pixels) < 3:
        return None
    pixels = np.asarray(picks.frame_pixels, np.float64)[:, ::-1]
    size = image.intrinsics.width, image.intrinsics.height
    if (pixels < 0).any() or (pixels > np.array(size) - 1).any():
        return None
    try:
        with np.errstate(divide="ignore", invalid="ignore"):  # a plane through the camera, which no mirror has
            mirror = place_mirror(image, MirrorPicks(picks.name, pixels), MirrorSettings())
    except MirrorError:
        return None
    if not (np.isfinite(mirror.normal).all() and np.isfinite(mirror.point).all()):
        return None
    up, known = _vertical(image)
    leans = abs(float(mirror.normal @ up)) > np.sin(np.radians(settings.lean if known else settings.lean_unseen))
    if leans or not _shows_somebody(glass_evidence(image, mirror), settings):
        return None
    if _contradiction(image, mirror, ()) is not None:
        return None
    return Notice(
        "{name}: rows and columns of its points are swapped: a point is [column, row], counted from the image's left "
        "and top; find the mirrors, or pick points on its frame",
        name=picks.name, mirrors=[picks.name],
    )  # fmt: skip


def _vertical(image: RgbdImage) -> tuple[np.ndarray, bool]:
    """Up in the camera frame, and whether a floor shows it."""
    level = np.array((0.0, -1.0, 0.0))
    found = find_floor(unproject(image.depth, image.intrinsics)[image.depth > 0], level)
    return (level, False) if found is None else (found[0], True)


def _noise(image: RgbdImage, mirror: Mirror, model: NoiseModel | None) -> float:
    """Standard deviation of a reading on the mirror's frame [m]; 0 when nothing tells it.

    That of a single frame of the camera, or of this capture where it is more: noise that is alike from frame to frame,
    as stereo's is, does not average out, and neighbours that err alike do not show it.
    """
    shape = frame_shape(image, mirror) if mirror.covariance is not None else None
    by_frame = 0.0 if shape is None else shape.noise
    return max(by_frame, 0.0 if model is None else float(model.sigma(abs(mirror.point[2]), image.intrinsics.fx)))


def _shows_somebody(evidence: Evidence | None, settings: QualitySettings) -> bool:
    """Whether enough of what is seen in a mirror lies, flipped over its plane, on what the camera sees as well."""
    return evidence is None or evidence.shown >= settings.fewest_shown  # of a glass that is not known nothing is said


def _contradiction(image: RgbdImage, mirror: Mirror, others: Sequence[Mirror]) -> Notice | None:
    """What the picture has against a mirror that stands, if anything."""
    if mirror.source == "found" or not contradicted(image, mirror, others):
        return None
    return Notice(
        "{name}: this is no mirror: almost no frame lies in its plane, or what is seen in it would be where the camera "
        "sees empty space; find the mirrors, or pick points on its frame only",
        name=mirror.name, mirrors=[mirror.name],
    )  # fmt: skip


def _about_frame(mirror: Mirror, error: float, noise: float, settings: QualitySettings) -> Notice | None:
    """What is wrong with the plane of a mirror's frame, if anything."""
    if mirror.residual > max(settings.usable_residual, settings.usable_noises * noise):
        return Notice(
            "{name}: its points do not lie in one plane; pick points on its frame, not on the glass and not on the "
            "wall",
            name=mirror.name, mirrors=[mirror.name],
        )  # fmt: skip
    if error > settings.usable_error and not (_frameless(mirror) or on_wall(mirror)):
        return Notice(
            "{name}: how it stands is too uncertain: what is seen in it may be off by {error:.0f} mm; pick points on "
            "all four sides of its frame",
            name=mirror.name, error=1e3 * min(error, 1.0), mirrors=[mirror.name],
        )  # fmt: skip
    return None


def _doubt(mirror: Mirror, error: float, noise: float, settings: QualitySettings) -> Notice | None:
    """Why a mirror is no more than usable, if it is."""
    if error > settings.good_error and _frameless(mirror):
        return Notice(
            "{name}: no frame is seen, and what is seen in it may be off by {error:.0f} mm; strips of paper or tape, "
            "3 cm wide, along its edges make it better",
            name=mirror.name, error=1e3 * min(error, 1.0), mirrors=[mirror.name],
        )  # fmt: skip
    if error > settings.good_error and on_wall(mirror):
        return Notice(
            "{name}: hangs on a wall, and how far its glass lies in front of the wall is not seen; strips of paper or "
            "tape, 3 cm wide, along its edges make it better",
            name=mirror.name, mirrors=[mirror.name],
        )  # fmt: skip
    if mirror.residual > max(settings.good_residual, settings.good_noises * noise):
        return Notice(
            "{name}: its frame is noisy or bent; a longer recording, or points on all four sides of the frame, make it "
            "better",
            name=mirror.name, mirrors=[mirror.name],
        )  # fmt: skip
    if error > settings.good_error:
        return Notice(
            "{name}: what is seen in it may be off by {error:.0f} mm; a longer recording makes it better",
            name=mirror.name, error=1e3 * error, mirrors=[mirror.name],
        )  # fmt: skip
    return None


def _frameless(mirror: Mirror) -> bool:
    """Whether a mirror was found by what it shows, without a frame."""
    return mirror.source == "found" and not mirror.refined
