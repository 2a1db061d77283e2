"""Light that reaches a point by several ways, and the one distance that a time-of-flight camera makes of it.

A point of skin is lit by the camera's own light and by its image in each mirror. All of it returns into the pixel that
looks at the point: a phase-measuring camera reads the phase of the sum,

    S(f) = Σ_s ρ_s max(cos θ_s, 0) V_s / r_s² · exp(i 2π f (r_s + r_v) / c),

over the sources s at (folded) distances r_s, with the way r_v back to the view. Albedo and the way back are the same
for all sources and cancel out of the phase. Light by way of other surfaces is left out, and light by two mirrors:
it reaches only what the camera sees as an image of an image, too. Bhandari et al. 2014; Freedman et al. 2014 (SRA).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics
from .optics import Optics
from .rays import Sight
from .scene import FramedMirror, Rig, apparent_depth, bow, glass_delay

LIGHT = 299_792_458.0
"""Its speed [m/s]."""
REACH = 15.0
"""Distances that a camera tries when it chooses wrap numbers end here [m]: they repeat after c / 2 · 10 MHz."""


@dataclass(frozen=True)
class Paths:
    """By which ways a pixel's point is lit; N pixels, S sources.

    Parameters
    ----------
    strength : np.ndarray [shape=(N, S), dtype=float64]
        ρ cos θ / r² of each source; 0 = it does not reach the point.
    source : np.ndarray [shape=(N, S), dtype=float64]
        Ways r_s from the light to the point [m].
    back : np.ndarray [shape=(N,), dtype=float64]
        Way r_v from the point to the camera [m], with what light spent within the surface.
    own : np.ndarray [shape=(N,), dtype=float64]
        Strength of the source that takes the same way as the view.
    """

    strength: np.ndarray
    source: np.ndarray
    back: np.ndarray
    own: np.ndarray


def paths(sight: Sight, light: np.ndarray, rig: Rig, at: np.ndarray, within: np.ndarray | None = None) -> Paths:
    """The ways by which the pixels ``at`` are lit.

    Parameters
    ----------
    sight : Sight
    light : np.ndarray [shape=(H, W, 1 + M)]
        From :func:`.rays.lit`, for a light at the camera.
    rig : Rig
    at : np.ndarray [shape=(H, W), dtype=bool]
        Pixels wanted.
    within : np.ndarray [shape=(H, W)] or None
        How far light went into the surface before it returned [m]; the distance is longer by that.

    Returns
    -------
    Paths
        With S = M + 2 sources: direct, by each mirror, and the view's own, which is taken out of the others. An image
        of an image is lit by its own way as well as by the direct one and by each mirror.
    """
    eye, point = rig.camera_to_avatar[:3, 3], sight.point[at]
    source = np.column_stack(
        [np.linalg.norm(point - eye, axis=1), *(_way_by_mirror(m, eye, point) for m in rig.mirrors)]
    )
    reflectivity = np.array([1.0, *(m.reflectivity for m in rig.mirrors)])
    geometric = sight.depth[at] * ray_lengths(rig.intrinsics)[at]
    there = geometric + sight.delay[at]
    back = there if within is None else there + 2.0 * within[at]
    view, bounces = sight.view[at].astype(np.intp), sight.bounces[at]
    strength = light[at] * reflectivity
    once = np.flatnonzero(bounces <= 1)
    strength[once, view[once]] = 0.0
    # What the other mirrors of an image of an image give back is taken to be what the first does.
    own = np.cos(sight.incidence[at].astype(np.float64)) * reflectivity[view] ** bounces / geometric**2
    return Paths(np.column_stack((strength, own)), np.column_stack((source, there)), back, own)


def _way_by_mirror(mirror: FramedMirror, eye: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Optical length from ``eye`` by way of a mirror to each point (N,) [m].

    A reflecting surface that lies w in front of the mirror's plane shortens the way by 2 w cos θ, to the first order
    in w (Fermat: a shift along the surface counts in the second).
    """
    right, up, normal = mirror.axes
    centre = np.array(mirror.centre)
    height = (eye - centre) @ normal
    image = eye - 2.0 * height * normal
    away = point - image
    length = np.linalg.norm(away, axis=1)
    if mirror.sag == (0.0, 0.0) and mirror.glass_thickness == 0.0:
        return length
    across = away @ normal
    share = height / np.where(across > 0, across, 1.0)
    on_glass = image + share[:, None] * away - centre
    cosine = np.clip(across / length, 0.0, 1.0)
    front = bow(mirror, on_glass @ right, on_glass @ up) - apparent_depth(mirror.glass_thickness, cosine)
    return np.where(across > 0, length - 2.0 * front * cosine + glass_delay(mirror.glass_thickness, cosine), length)


def ray_lengths(intrinsics: Intrinsics) -> np.ndarray:
    """Length of each pixel's ray to the plane z = 1 (H, W)."""
    x = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    y = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    return np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)


def phasors(strength: np.ndarray, length: np.ndarray, frequencies: tuple[float, ...]) -> np.ndarray:
    """Sum over the paths of ``strength · exp(i 2π f length / c)``.

    Parameters
    ----------
    strength, length : np.ndarray [shape=(N, S)]
        ``length`` [m] to the point and back.
    frequencies : tuple of float
        [MHz]

    Returns
    -------
    np.ndarray [shape=(F, N), dtype=complex128]
    """
    turns = 2e6 * np.pi / LIGHT
    return np.array([(strength * np.exp(1j * turns * f * length)).sum(axis=1) for f in frequencies])


def decode(signal: np.ndarray, frequencies: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """One distance of the phases at several frequencies, as a camera makes it.

    The wrap numbers are those whose distances agree best; the distance is their mean, weighted by f² because the
    error of a distance is that of its phase over f. Exact where there is one path and the distance is less than
    c / 2 g, g the largest frequency that divides all (at most 15 m). O(N · F · wraps) time.

    Parameters
    ----------
    signal : np.ndarray [shape=(F, N), dtype=complex]
    frequencies : tuple of float
        [MHz]

    Returns
    -------
    distance : np.ndarray [shape=(N,), dtype=float64]
        Half the way there and back [m].
    spread : np.ndarray [shape=(N,), dtype=float64]
        By how much the frequencies disagree: largest less smallest of their distances [m].
    """
    period = LIGHT / (2e6 * np.array(frequencies))[:, None]
    phase = np.mod(np.angle(signal) / (2.0 * np.pi), 1.0)
    weight = np.array(frequencies)[:, None] ** 2
    best = np.full(signal.shape[1], np.inf)
    distance = np.zeros(signal.shape[1])
    # A set of wrap numbers that agrees is met from each of its members; the first in turn need not meet it.
    for reference in range(len(frequencies)):
        for wrap in range(int(np.ceil(REACH / period[reference, 0]))):
            there = (phase[reference] + wrap) * period[reference]
            candidates = (phase + np.rint(there / period - phase)) * period
            spread = candidates.max(axis=0) - candidates.min(axis=0)
            better = spread < best - 1e-9
            if better.any():
                mean = (weight * candidates).sum(axis=0) / weight.sum()
                distance[better], best[better] = mean[better], spread[better]
    return distance, best


def by_one_way(sight: Sight, rig: Rig, within: np.ndarray) -> np.ndarray:
    """What a camera that times light reads where it comes by one way: later by glass and skin (H, W), z [m]."""
    late = sight.delay + within
    return np.where(sight.depth > 0, sight.depth + late / ray_lengths(rig.intrinsics), 0.0)


def by_phase(sight: Sight, light: np.ndarray, rig: Rig, optics: Optics, within: np.ndarray | None = None) -> np.ndarray:
    """What a phase-measuring camera reads where light comes by several ways.

    Parameters
    ----------
    sight, light, rig, optics
        ``light`` from :func:`.rays.lit`, for a light at the camera.
    within : np.ndarray [shape=(H, W)] or None
        How far light goes into each surface [m].

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float64]
        z [m]; 0 where the pixel is given up. Pixels with one path keep their true depth to the last bit.
    """
    depth = by_one_way(sight, rig, np.zeros(sight.depth.shape) if within is None else within)
    at = _lit_otherwise(sight, light)
    ways = paths(sight, light, rig, at, within)
    distance, spread = decode(
        phasors(ways.strength, ways.source + ways.back[:, None], optics.frequencies), optics.frequencies
    )
    kept = np.where(spread <= optics.disagreement, distance, 0.0)
    depth[at] = kept / ray_lengths(rig.intrinsics)[at]
    return depth


def by_pulse(sight: Sight, light: np.ndarray, rig: Rig, width: float, within: np.ndarray | None = None) -> np.ndarray:
    """What a camera reads that times pulses ``width`` [m] long (half the way there and back).

    Peaks that are further apart than the pulse is long stay apart and the strongest counts. Nearer ones merge: what
    is read is their centre of mass. So the reading is off by at most half the difference of the ways, either way.

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float64]
        z [m]; pixels with one path keep their true depth.
    """
    depth = by_one_way(sight, rig, np.zeros(sight.depth.shape) if within is None else within)
    at = _lit_otherwise(sight, light)
    ways = paths(sight, light, rig, at, within)
    half = (ways.source + ways.back[:, None]) / 2.0
    peak = np.take_along_axis(half, ways.strength.argmax(axis=1)[:, None], axis=1)
    merged = np.where(np.abs(half - peak) <= width, ways.strength, 0.0)
    distance = (merged * half).sum(axis=1) / merged.sum(axis=1)
    depth[at] = distance / ray_lengths(rig.intrinsics)[at]
    return depth


def _lit_otherwise(sight: Sight, light: np.ndarray) -> np.ndarray:
    """Pixels whose point is lit by another way than the view's own (H, W)."""
    own = (np.arange(light.shape[-1]) == sight.view[..., None]) & (sight.bounces <= 1)[..., None]
    return (sight.depth > 0) & ((light > 0) & ~own).any(axis=-1)
