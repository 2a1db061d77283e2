"""Mirrors, floor and light of a recording, found once: from some of its frames, which must agree.

Each of the sampled frames is a snapshot in which the whole pipeline places the mirrors. What does not move is averaged
over them before; who moves is in each as he stood. The median of the planes is what all frames are made with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import unproject
from ..capture import Capture, MirrorPicks
from ..depth.burst_fusion import fuse_burst
from ..depth.depth_map import one_depth_map
from ..depth.settings import DepthSettings
from ..errors import CaptureError, MirrorScanError, Notice, ReconstructionError
from ..light.phase_response import PhaseResponse, nonnegative_least_squares
from ..mirrors import Mirror
from ..mirrors.mirror import moved, person_before, reflection_shift
from ..pipeline import KnownScene, Reconstruction, Settings, reconstruct
from ..views.floor_and_vertical import Ground, find_ground
from ..views.ray_sorting import sort_rays
from .recording import Recording

SAMPLES = 5
"""Frames that the rig is placed with, unless told otherwise."""

_STATIC = DepthSettings(burst_tolerance=0.01, burst_share=0.6)  # readings of the same surface; most samples show it
_STILL = 2.5  # times what readings of the room typically spread by, relative to z²: more, and something moved
_SAME = 4.0  # times that spread, within which a reading is of the room
_RATIOS = np.array((0.02, 0.05, 0.1, 0.2, 0.4, 0.8))  # of light of two ways, by which responses are compared
_LONGER = np.arange(0.03, 4.0, 0.05)  # and by how much one way is longer [m]
_CORRECTABLE, _ALIKE = 0.03, 0.0003  # biases that are corrected at all, and what they may differ by [m]


@dataclass(frozen=True)
class SequenceRig:
    """What holds for all frames of a recording.

    Parameters
    ----------
    scene : KnownScene
        Mirrors, floor, sensor and light.
    to_avatar : np.ndarray [shape=(4, 4)]
        Rigid: camera frame → the frame of all meshes: Z up, facing the camera, floor at z = 0.
    background : np.ndarray [shape=(H, W), dtype=float32]
        Depth of what does not move [m]; 0 elsewhere.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        A frame's colours, whose exposure all frames get.
    placed_with : tuple of int
        Numbers of the frames that agreed.
    spread : dict of str to float
        By mirror: how far the samples' planes displace a person from where the median does, root mean square [m].
    warnings : tuple of str
        What the samples were warned of, each once.
    """

    scene: KnownScene
    to_avatar: np.ndarray
    background: np.ndarray
    color: np.ndarray | None
    placed_with: tuple[int, ...]
    spread: dict[str, float]
    warnings: tuple[str, ...] = ()


def place_rig(
    recording: Recording,
    picks: tuple[MirrorPicks | Mirror, ...] | None = None,
    settings: Settings = Settings(),
    samples: int = SAMPLES,
    progress: Callable[[float, str], None] | None = None,
) -> SequenceRig:
    """The rig of a recording, from ``samples`` of its frames.

    Parameters
    ----------
    recording : Recording
    picks : tuple of MirrorPicks or Mirror, optional
        As :func:`..pipeline.reconstruct` has them.
    settings : Settings
        As for one snapshot.
    samples : int
        How many frames, evenly over the recording.
    progress : callable(fraction, message), optional

    Raises
    ------
    MirrorScanError
        No sampled frame can be reconstructed; the error is the first one's.

    Notes
    -----
    Holds the depth of ``samples`` frames.
    """
    numbers, captures, faults = [], [], []
    for number in recording.sample(samples):
        try:
            captures.append(recording.read(number))
            numbers.append(number)
        except MirrorScanError as fault:
            faults.append(fault)
    if not captures:
        raise faults[0]
    raw = captures
    background, captures = still_averaged(captures)
    results: list[tuple[int, Reconstruction]] = []
    plain = replace(settings, skeleton=False, measure=False, triangles=None, texture=None)
    for place, (number, capture) in enumerate(zip(numbers, captures, strict=True)):
        if progress is not None:
            progress(place / len(captures), f"Placing the mirrors: frame {number}")
        try:
            results.append((number, reconstruct(capture, picks, plain)))
        except MirrorScanError as fault:
            faults.append(fault)
    if not results:
        raise faults[0]
    rig = _agreed(results, background, captures[0].color)
    ground = replace(rig.scene.ground, noise=_floor_noise(raw, list(rig.scene.mirrors), settings))
    return replace(rig, scene=replace(rig.scene, ground=ground))


def still_averaged(captures: Sequence[Capture]) -> tuple[np.ndarray, list[Capture]]:
    """What stands still in all captures, averaged; and the captures with it in place of their own readings.

    Parameters
    ----------
    captures : sequence of Capture
        Of one camera that did not move; the first depth frame of each is taken.

    Returns
    -------
    background : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 where something moved, or most captures have no reading.
    captures : list of Capture
        Of one depth frame each.

    Raises
    ------
    CaptureError
        The captures are of different sizes.
    """
    if len({capture.depth.shape[1:] for capture in captures}) > 1:
        sizes = ", ".join(sorted({f"{c.depth.shape[2]}×{c.depth.shape[1]}" for c in captures}))
        raise CaptureError("the frames are of different sizes ({sizes} pixels); record anew", sizes=sizes)
    depth = np.stack([capture.depth[0] for capture in captures])
    if len(depth) < 3:  # two cannot outvote one
        return np.zeros(depth.shape[1:], np.float32), [replace(c, depth=c.depth[:1]) for c in captures]
    fused, spread = fuse_burst(depth, _STATIC)
    known = (fused > 0) & (spread > 0)
    relative = np.where(known, spread / np.maximum(fused, 1e-6), 0.0)
    usual = float(np.median(relative[known])) if known.any() else 0.0
    limit = _STILL * usual
    still = known & (relative <= limit)
    background = np.where(still, fused, np.float32(0.0))
    return background, [
        replace(capture, depth=np.where(still & (np.abs(frame - fused) < _SAME * usual * fused), fused, frame)[None])
        for capture, frame in zip(captures, depth, strict=True)
    ]


def _floor_noise(captures: Sequence[Capture], mirrors: list[Mirror], settings: Settings) -> float:
    """Standard deviation of a frame's own readings of the floor [m]: those that were averaged are better."""
    found = []
    for capture in captures:
        points = unproject(one_depth_map(capture, settings.depth)[0], capture.intrinsics)
        seen, points = sort_rays(points, mirrors, settings.views.depth_limit, settings.views.near)
        found.append(find_ground(points, seen, mirrors).noise)
    return float(np.median(found))


def _agreed(
    results: Sequence[tuple[int, Reconstruction]], background: np.ndarray, color: np.ndarray | None
) -> SequenceRig:
    """The median of what the samples found; those that found other mirrors than most do not count."""
    names = Counter(tuple(sorted(m.name for m in result.mirrors)) for _, result in results).most_common(1)[0][0]
    chosen = [(number, r) for number, r in results if tuple(sorted(m.name for m in r.mirrors)) == names]
    scenes = [r.scene for _, r in chosen if r.scene is not None]
    if not scenes:
        raise ReconstructionError("no frame of the recording shows the rig; record again")
    order = [m.name for m in scenes[0].mirrors]
    framed = tuple(_median_mirror([_named(s.framed, name) for s in scenes]) for name in order)
    mirrors = tuple(_median_mirror([_named(s.mirrors, name) for s in scenes]) for name in order)
    spread = {m.name: _spread(m, [_named(s.mirrors, m.name) for s in scenes]) for m in mirrors}
    feet = [np.linalg.inv(r.camera_to_avatar)[:3, 3] for _, r in chosen]
    ground, to_avatar = _median_ground([s.ground for s in scenes], feet)
    lit = sum(s.lit_twice for s in scenes) * 2 > len(scenes)
    responses = [s.response for s in scenes if s.lit_twice and s.response is not None]
    scene = replace(
        scenes[0], framed=framed, mirrors=mirrors, ground=ground, lit_twice=lit,
        response=mean_response(responses) if lit and responses else None,
        principle=next(s.principle for s in scenes if s.lit_twice == lit), subject=np.median(feet, axis=0),
    )  # fmt: skip
    warnings = _of_most([r.warnings for _, r in chosen])
    if len(chosen) < len(results):
        warnings.append(
            Notice(
                "{count} of {all} sampled frames show other mirrors than the rest; they do not count",
                count=len(results) - len(chosen), all=len(results),
            )
        )  # fmt: skip
    return SequenceRig(
        scene, to_avatar, background, color, tuple(number for number, _ in chosen), spread, tuple(warnings)
    )


def _of_most(warnings: Sequence[Sequence[str]]) -> list[str]:
    """What more than half of the samples are warned of, in the words of the first."""
    first: dict[tuple, str] = {}
    count: Counter[tuple] = Counter()
    for of_sample in warnings:
        kinds = {(Notice.of(text).template, Notice.of(text).mirrors): text for text in of_sample}
        count.update(kinds.keys())
        first = kinds | first
    return [first[kind] for kind in first if 2 * count[kind] > len(warnings)]


def _named(mirrors: Sequence[Mirror], name: str) -> Mirror:
    return next(m for m in mirrors if m.name == name)


def _median_mirror(placed: Sequence[Mirror]) -> Mirror:
    """One mirror where most say that it is: the median of slopes, shift, bow and thickness of several."""
    people = person_before(placed[0])
    apart = np.array([[reflection_shift(people, one, other) for other in placed] for one in placed])
    middle = placed[int(np.argmin(apart.sum(axis=1)))]
    a, b, n = middle.basis.T
    steps = []
    for m in placed:
        along = float(m.normal @ n)
        steps.append((-(m.normal @ a) / along, -(m.normal @ b) / along, m.normal @ (m.point - middle.point) / along))
    return replace(
        moved(middle, np.median(steps, axis=0)),
        sag=float(np.median([m.sag for m in placed])),
        glass_thickness=float(np.median([m.glass_thickness for m in placed])),
    )


def _spread(middle: Mirror, placed: Sequence[Mirror]) -> float:
    """How far the reflections of a person in several mirrors are from that in their median [m]."""
    people = person_before(middle)
    return float(np.sqrt(np.mean([reflection_shift(people, middle, m) ** 2 for m in placed])))


def _median_ground(grounds: Sequence[Ground], feet: Sequence[np.ndarray]) -> tuple[Ground, np.ndarray]:
    """Vertical and floor where most say they are, and camera frame → avatar frame (4, 4)."""
    up = np.median([g.up for g in grounds], axis=0)
    up /= np.linalg.norm(up)
    on_floor = [
        foot if g.floor is None else foot - (foot @ g.up - g.floor) * g.up
        for g, foot in zip(grounds, feet, strict=True)
    ]
    middle = np.median(on_floor, axis=0)
    heights = [point @ up for point, g in zip(on_floor, grounds, strict=True) if g.floor is not None]
    floor = float(np.median(heights)) if heights else None
    away = middle - (middle @ up) * up
    away /= np.linalg.norm(away)
    to_avatar = np.eye(4)
    to_avatar[:3, :3] = np.stack((np.cross(away, up), away, up))
    to_avatar[:3, 3] = -to_avatar[:3, :3] @ middle
    to_avatar[2, 3] = -(floor if floor is not None else float(middle @ up))
    apart = [g.disagreement_deg for g in grounds if g.disagreement_deg is not None]
    return (
        Ground(
            up, floor, float(np.median([g.noise for g in grounds])), float(np.median(apart)) if apart else None
        ),
        to_avatar,
    )  # fmt: skip


def mean_response(responses: Sequence[PhaseResponse]) -> PhaseResponse:
    """The response that predicts the mean of what several predict, with as few frequencies as that takes.

    Each frequency costs time with every reading of every frame. Of those of all responses the one that explains the
    most of what is left is added, and all weights are fitted anew, until what is left is less than noise.
    """
    frequencies, place = np.unique(np.concatenate([r.frequencies for r in responses]), return_inverse=True)
    weights = np.bincount(place, np.concatenate([r.weights for r in responses])) / len(responses)
    ratio, longer = (grid.reshape(-1, 1) for grid in np.meshgrid(_RATIOS, _LONGER))
    table = np.column_stack([PhaseResponse(f, np.ones(1)).bias(ratio, longer) for f in frequencies[:, None]])
    mean = table @ weights
    asked = np.abs(mean) < _CORRECTABLE  # larger ones are never corrected
    table, mean = table[asked], mean[asked]
    gram, moment = table.T @ table, table.T @ mean
    few, chosen = np.zeros(len(frequencies)), np.zeros(len(frequencies), np.bool_)
    while not chosen.all() and np.abs(table @ few - mean).max(initial=0.0) > _ALIKE:
        chosen[np.argmax(np.where(chosen, -np.inf, moment - gram @ few))] = True
        few[chosen] = nonnegative_least_squares(gram[np.ix_(chosen, chosen)], moment[chosen])
    if chosen.all():
        return PhaseResponse(frequencies, weights)
    return PhaseResponse(frequencies[few > 0], few[few > 0])
