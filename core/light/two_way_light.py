"""Light that comes two ways into a camera that measures phase: predicted, corrected where it can be, else thrown away.

A point of skin that is lit directly and by way of a mirror returns light of both ways into each pixel that sees it. A
camera that measures phase reads the phase of the sum: somewhere between the two ways. Geometry gives how strong each
way is (:mod:`.irradiance`); how the camera turns that into a distance (:mod:`.phase_response`) is learnt from the
floor, whose place is known (:mod:`.floor_light`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage
from ..errors import MirrorScanError
from ..mirrors import Mirror
from ..subject.subject_views import Views
from .evidence import FEWEST, agreement, loses_its_pattern
from .falsified_readings import ghosts, without_contradicted
from .floor_light import correct_floor, floor_readings
from .limb_correction import correct_limbs
from .lit_scene import LitScene
from .phase_response import NOTICEABLE, PhaseResponse, weighted_by_frequency

TWO_WAYS = ("auto", "on", "off")

_MOST_AGREEING = 0.25  # share of the readings looked at that may agree with light that comes one way
_MOST_AGREEING_PHASE = 0.33  # the same of a camera that is known to measure phase
_CERTAINLY = 0.5  # of them, that agree: light comes one way
_CLEARLY_EXPLAINED = 0.25  # of the floor's bias, that shows two ways by itself: at most 0.15 where light comes one way
_LEAST_EXPLAINED = 0.15  # share of the floor's bias that a response must explain
_CORRECTED = 0.0005  # more was taken off a reading that counts as corrected [m]


@dataclass(frozen=True)
class LightSettings:
    """What to do about light that comes two ways.

    Parameters
    ----------
    two_ways : str
        "auto": undone where readings show it, in cameras that measure phase or may; "on": the camera is taken to
        measure phase, whatever its file says; "off": never looked for.
    frequencies : tuple of float
        Of the camera's modulation [MHz], from 1 to 1000, where they are known; else they are learnt from the floor.
        Who gives them says that the camera measures phase.
    """

    two_ways: str = "auto"
    frequencies: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.two_ways not in TWO_WAYS:
            raise MirrorScanError(f"light: two_ways is “{self.two_ways}”; choose {', '.join(TWO_WAYS)}")
        if not all(1.0 <= f <= 1000.0 for f in self.frequencies):
            raise MirrorScanError(f"light: frequencies = {self.frequencies}; give them in MHz, from 1 to 1000")

    @property
    def phase_said(self) -> bool:
        """Whether these settings say that the camera measures phase."""
        return self.two_ways == "on" or bool(self.frequencies)


DEFAULTS = LightSettings()


@dataclass(frozen=True)
class TwoWayLight:
    """What light that comes two ways did to a depth map, undone.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Corrected z [m]; what is not to be trusted still stands in it.
    spoiled : np.ndarray [shape=(H, W), dtype=bool]
        Readings that are not to be trusted: another way's light is the stronger, or too strong to correct.
    lit_twice_share, corrected_share : float
        Shares of the subject's readings that the light of another way reaches noticeably, and that were corrected.
    response : PhaseResponse or None
        What the camera makes of such light; None when it could not be learnt, so that nothing was corrected.
    """

    depth: np.ndarray
    spoiled: np.ndarray
    lit_twice_share: float
    corrected_share: float
    response: PhaseResponse | None


def shows_two_way_light(image: RgbdImage, views: Views, mirrors: list[Mirror], phase: bool = False) -> bool:
    """Whether readings that the camera's direct light must dominate are astray in the mirrors: missing, or ghosts.

    Where that is not clear, the floor of a camera that measures phase says it.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    views : Views
        Of these readings, with these mirrors.
    mirrors : list of Mirror
    phase : bool
        The camera is known to measure phase.

    Notes
    -----
    Looks at a few thousand pixels.
    """
    if not mirrors:
        return False
    scene = LitScene(image, views, mirrors)
    agreeing, counted, _ = agreement(scene)
    if counted < FEWEST or agreeing > _CERTAINLY * counted or loses_its_pattern(scene):
        return False
    if agreeing < (_MOST_AGREEING_PHASE if phase else _MOST_AGREEING) * counted:
        return True
    if not phase:
        return False
    floor = floor_readings(scene, views.floor_noise)
    return floor is not None and floor.explained >= _CLEARLY_EXPLAINED


def undo_two_way_light(
    image: RgbdImage,
    views: Views,
    mirrors: list[Mirror],
    noise: float,
    settings: LightSettings = DEFAULTS,
    phase: bool = False,
    response: PhaseResponse | None = None,
) -> TwoWayLight | None:
    """Readings that the light of mirrors falsifies are corrected or marked.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    views : Views
        Of these readings, with these mirrors.
    mirrors : list of Mirror
        Where their frames are: what is seen twice would have misled their alignment.
    noise : float
        Standard deviation of a reading of the floor [m].
    settings : LightSettings
    phase : bool
        The camera is known to measure phase; else its readings must show it.
    response : PhaseResponse, optional
        What the camera makes of such light, where another snapshot has shown it; by default the floor does.

    Returns
    -------
    TwoWayLight or None
        None when nothing but a lost pattern shows it: that falsifies no reading.

    Notes
    -----
    Path model after Bhandari et al. 2014 and Freedman et al. 2014. O(H W).
    """
    scene = LitScene(image, views, mirrors)
    if response is None and settings.frequencies:
        response = weighted_by_frequency(tuple(1e6 * f for f in settings.frequencies))
    floor = None if response is not None and phase else floor_readings(scene, noise)
    shown = floor is not None and floor.explained >= _LEAST_EXPLAINED
    if not (phase or shown or agreement(scene)[2] >= FEWEST):
        return None
    if response is None and floor is not None and (phase or shown):
        response = floor.response
    limbs = correct_limbs(scene, response)
    trusted, depth = without_contradicted(scene, limbs), limbs.depth
    spoiled = ((scene.labels >= 0) & ~trusted) | ghosts(scene, depth, trusted)
    correct_floor(scene, response, depth, spoiled)
    kept = trusted[limbs.rows, limbs.columns]
    return TwoWayLight(
        depth, spoiled, float(((limbs.total > NOTICEABLE) | ~kept).mean()),
        float((kept & (np.abs(limbs.bias) > _CORRECTED)).mean()), response,
    )  # fmt: skip


def without_falsified_floor(image: RgbdImage, views: Views, mirrors: list[Mirror]) -> RgbdImage:
    """The depth without the floor's readings that light of two ways falsifies: they stick to feet, or hide a person.

    Of ``views`` only the direct one must have found the subject.
    """
    spoiled = np.zeros(image.depth.shape, np.bool_)
    correct_floor(LitScene(image, views, mirrors), None, image.depth.copy(), spoiled)
    return image.with_depth(np.where(spoiled, np.float32(0.0), image.depth))


def without_spoiled(views: Views, spoiled: np.ndarray) -> Views:
    """The views without readings that are not to be trusted: they show nothing, not even that space is empty."""
    return replace(
        views,
        labels=np.where(spoiled, np.int8(-1), views.labels),
        seen=np.where(spoiled, np.int8(-1), views.seen),
    )
