"""How far an avatar from a planned rig would be off: noise, the mirrors' planes, light by two ways, and guessed area.

Each sample of the body has the error of the view that reads it best. Four parts add up as variances:

* noise of the sensor at the length of the way and the angle of the surface (:mod:`..camera.noise_models`), less what a
  burst and the surface's smoothness average out;
* the edge of a pixel: a reading comes from a little beside where it is placed, which counts on tilted surfaces;
* the mirror's plane, as well as its frame shows it with that noise;
* light that reaches the sample by two ways, where the sensor measures phase: the bias of two paths (Bhandari et al.
  2014), less what the reconstruction undoes.

What no view sees is filled by guess, which is the worse the farther the nearest reading is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import project
from ..camera.noise_models import SENSORS as NOISE_MODELS
from ..light.phase_response import CORRECTABLE, weighted_by_frequency
from ..mirrors.mirror import Mirror, reflection_moves
from ..simulation.optics import TRIPLES
from ..simulation.scene import FramedMirror, Rig
from ..simulation.sensors import Sensor, find_sensor
from .area_coverage import AreaCoverage, BodySamples

_MEAN_OF_NORMAL = np.sqrt(2.0 / np.pi)  # mean absolute value of a normal distribution of deviation 1
_BRIDGED = 0.5  # of the distance to the nearest reading, that a filled surface is off by
_BESIDE = 0.29  # a reading's place within its pixel, evenly spread: 1 / √12
_NEIGHBOURS = 9.0  # readings that agree on a surface, whose mean it becomes
_FIXED = {"stereo": 0.5, "pattern": 0.05}  # share of the noise's variance that no burst averages out; optics.real
_UNDONE = 0.8  # share of the two-way bias that the reconstruction takes back
_FRAMELESS = 0.012  # what a mirror without a frame may be misplaced by [m]
_PLANE_FLOOR = 0.0003  # glass and frame are no better planes than that, when all views have been fitted [m]
_SECTION = 400  # samples whose distances to all others are held at a time


@dataclass(frozen=True)
class PredictedError:
    """What is expected of the avatar's surface; millimetres, means over the whole area.

    Parameters
    ----------
    mean_mm : float
        Mean distance of the result from the body.
    noise_mm, plane_mm, light_mm : float
        Mean of each part alone, over what is seen: sensor and pixels, the mirrors' planes, light by two ways.
    guessed_mm : float
        What the area that no view sees adds to ``mean_mm``.
    lit_twice : float
        Share of the seen area that light reaches two ways, more than a fortieth as strong; 0 where the sensor does not
        mind.
    by_view : dict of str to float
        Mean error of what each view is the best for [mm]; NaN for a view that is never the best.
    """

    mean_mm: float
    noise_mm: float
    plane_mm: float
    light_mm: float
    guessed_mm: float
    lit_twice: float
    by_view: dict[str, float]


def predicted_error(body: BodySamples, covered: AreaCoverage, rig: Rig, real_light: bool = True) -> PredictedError:
    """The error that a scan of ``body`` with ``rig`` is expected to have.

    Parameters
    ----------
    body : BodySamples
    covered : AreaCoverage
        Of this body by this rig.
    rig : Rig
    real_light : bool
        Light that comes by two ways counts, where the sensor measures phase; False = as in an ideal simulation.

    Notes
    -----
    O(N · V) time, and O(N · unseen) for what is guessed.
    """
    sensor = find_sensor(rig.sensor)
    noise = _noise(covered, sensor, rig)
    plane = _plane_errors(body, covered, sensor, rig)
    light = np.zeros(noise.shape)
    lit_twice = 0.0
    if real_light and sensor.principle == "phase":
        left = (1.0 - _UNDONE) * np.abs(two_way_bias(covered, rig))
        light = np.minimum(left, CORRECTABLE) * covered.cosine  # readings that are worse are thrown away
        lit_twice = _lit_twice(covered)
    variance = np.where(covered.seen, noise**2 + plane**2 + light**2, np.inf)
    best = variance.argmin(axis=1)
    seen = covered.seen.any(axis=1)
    at = np.flatnonzero(seen), best[seen]
    error = np.zeros(len(seen))
    error[seen] = _MEAN_OF_NORMAL * np.sqrt(variance[at])
    error[~seen] = guessed(body.points[~seen], body.points[seen], error[seen], body.height)

    def alone(part: np.ndarray) -> float:
        return 1000.0 * _MEAN_OF_NORMAL * float(part[at].mean()) if seen.any() else 0.0

    by_view = {
        name: 1000.0 * float(error[seen & (best == k)].mean()) if (seen & (best == k)).any() else float("nan")
        for k, name in enumerate(covered.names)
    }
    from_guess = 1000.0 * float(error[~seen].sum() / len(error))
    return PredictedError(
        1000.0 * float(error.mean()), alone(noise), alone(plane), alone(light), from_guess, lit_twice, by_view
    )


def guessed(unseen: np.ndarray, seen: np.ndarray, error: np.ndarray, height: float) -> np.ndarray:
    """Error of a filled surface at points (U, 3) by their distance to the readings (S, 3) round it [m].

    A filling is off by about half the distance to the nearest reading: it bridges what it cannot know of, mostly
    between limbs and under arms. The ``error`` (S,) of that reading is added as it is. Where nothing is read, all is a
    fifth of the body's height off.
    """
    if not len(seen):
        return np.full(len(unseen), 0.2 * height)
    found = np.empty(len(unseen))
    for first in range(0, len(unseen), _SECTION):
        part = slice(first, first + _SECTION)
        squared = (unseen[part] ** 2).sum(axis=1)[:, None] + (seen**2).sum(axis=1) - 2.0 * _products(unseen[part], seen)
        nearest = squared.argmin(axis=1)
        distance = np.sqrt(np.maximum(np.take_along_axis(squared, nearest[:, None], axis=1)[:, 0], 0.0))
        found[part] = error[nearest] + _BRIDGED * distance
    return found


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Scalar products (A, B) of points, without BLAS, whose threads would be in the way of ours."""
    x, y, z = (one[:, axis, None] * other[None, :, axis] for axis in range(3))
    return x + y + z


def _noise(covered: AreaCoverage, sensor: Sensor, rig: Rig) -> np.ndarray:
    """Deviation of the surface along its normal [m] (N, V), by the sensor's noise and the size of its pixels."""
    sigma = reading_noise(covered.z, sensor, rig)
    sine = np.sqrt(1.0 - covered.cosine**2)
    pixel = covered.z / rig.intrinsics.fx * sensor.cell
    angle = np.arccos(covered.cosine)
    jitter = sensor.lateral_jitter[0] + sensor.lateral_jitter[1] * angle / np.maximum(0.5 * np.pi - angle, 0.05)
    beside = pixel * np.hypot(_BESIDE, jitter / np.sqrt(rig.frames)) * sine
    return np.hypot(sigma * covered.cosine, beside) / np.sqrt(_NEIGHBOURS)


def reading_noise(z: np.ndarray, sensor: Sensor, rig: Rig) -> np.ndarray:
    """Deviation of the mean of a burst at ``z`` [m], along the ray."""
    variance = 0.0005**2  # millimetres, rounded, and what else a burst does not show
    model = NOISE_MODELS.get(rig.sensor)
    if model is not None:
        one = np.asarray(model.sigma(z, rig.intrinsics.fx), dtype=np.float64) ** 2
    else:
        one = (sensor.axial_noise[0] + sensor.axial_noise[1] * np.asarray(z) ** 2) ** 2
    fixed = _FIXED.get(sensor.principle, 0.0) if rig.optics.correlated_noise else 0.0
    return np.sqrt(variance + one * (fixed + (1.0 - fixed) / rig.frames))


def _plane_errors(body: BodySamples, covered: AreaCoverage, sensor: Sensor, rig: Rig) -> np.ndarray:
    """What each mirror's plane is misplaced by moves its view's readings, along their normals [m] (N, V)."""
    errors = np.zeros(covered.seen.shape)
    for view, mirror in enumerate(rig.mirrors, start=1):
        placed = Mirror(mirror.name, np.array(mirror.centre), mirror.axes[2], mirror.axes.T)
        moves = np.einsum("ncj,nc->nj", reflection_moves(placed, body.points), _mirrored_normals(body.normals, mirror))
        covariance = plane_covariance(mirror, sensor, rig)
        errors[:, view] = np.sqrt(np.einsum("ni,ij,nj->n", moves, covariance, moves))
    return errors


def _mirrored_normals(normals: np.ndarray, mirror: FramedMirror) -> np.ndarray:
    normal = mirror.axes[2]
    return normals - 2.0 * (normals @ normal)[:, None] * normal


def plane_covariance(mirror: FramedMirror, sensor: Sensor, rig: Rig) -> np.ndarray:
    """How certain a mirror's plane is, fitted to what the camera reads of its frame (3, 3).

    Of its slopes along the mirror's right and up [rad], and of its shift along the normal [m], about its centre. Least
    squares over the pixels of the frame within the image; a mirror without one is known to some millimetres.
    """
    pose, lens = rig.camera_to_avatar, rig.intrinsics
    right, up, normal = mirror.axes
    w, h = 0.5 * (mirror.width + mirror.frame_width), 0.5 * (mirror.height + mirror.frame_width)
    along = np.linspace(-1.0, 1.0, 41)
    ones = np.ones(len(along))
    x = w * np.concatenate((along, along, ones, -ones))
    y = h * np.concatenate((ones, -ones, along, along))
    length = np.repeat((2.0 * w, 2.0 * h), 2 * len(along)) / len(along)  # of frame that each place stands for [m]
    there = (np.array(mirror.centre) + x[:, None] * right + y[:, None] * up - pose[:3, 3]) @ pose[:3, :3]
    u, v = project(there, lens).T
    read = (u >= 0) & (v >= 0) & (u < lens.width) & (v < lens.height)
    there, x, y, length = there[read], x[read], y[read], length[read]
    floor = np.diag((_PLANE_FLOOR / w, _PLANE_FLOOR / h, _PLANE_FLOOR)) ** 2
    prior = np.diag((_FRAMELESS / w, _FRAMELESS / h, _FRAMELESS)) ** 2
    if mirror.frame_width <= 0 or not len(x):
        return prior
    distance = np.linalg.norm(there, axis=1)
    facing = np.abs(there @ (pose[:3, :3].T @ normal)) / distance
    pixels = mirror.frame_width * length * (lens.fx / there[:, 2]) ** 2 * facing
    weight = pixels / (reading_noise(there[:, 2], sensor, rig) * facing) ** 2
    rows = np.stack((x, y, np.ones(len(x))), axis=1)
    information = np.einsum("n,ni,nj->ij", weight, rows, rows)
    return np.linalg.inv(information + np.linalg.inv(prior)) + floor


def two_way_bias(covered: AreaCoverage, rig: Rig) -> np.ndarray:
    """How much too far each view of a camera that measures phase reads the samples, before anything is undone [m].

    The sources are the camera's light directly and by way of each mirror; each view reads the phase of their sum over
    the way back by its own. (N, V); 0 where a view does not see the sample.
    """
    reflectivity = np.array([1.0, *(mirror.reflectivity for mirror in rig.mirrors)])
    strength = covered.light * reflectivity
    bias = np.zeros(covered.seen.shape)
    frequencies = rig.optics.frequencies if rig.optics.multipath else TRIPLES[3 if rig.sensor == "kinect_v2" else 0]
    response = weighted_by_frequency(tuple(1e6 * f for f in frequencies))
    for view in range(bias.shape[1]):
        others = np.delete(strength, view, axis=1)
        at = np.flatnonzero(covered.seen[:, view] & (others.sum(axis=1) > 0))
        if not len(at):
            continue
        own = strength[at, view][:, None]
        ratio = others[at] / own
        longer = np.delete(covered.length, view, axis=1)[at] - covered.length[at, view][:, None]
        bias[at, view] = response.bias(ratio, longer)
    return bias


def _lit_twice(covered: AreaCoverage) -> float:
    """Share of the seen area whose best-lit way is not the only one that counts."""
    seen = covered.seen.any(axis=1)
    strongest = covered.light.max(axis=1)
    rest = covered.light.sum(axis=1) - strongest
    return float((rest[seen] > 0.025 * strongest[seen]).mean()) if seen.any() else 0.0
