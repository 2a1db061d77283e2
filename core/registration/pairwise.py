"""Two views registered by their surfaces: point-to-plane ICP of small_gicp or Open3D, neither of them ours.

Chen and Medioni, "Object modelling by registration of multiple range images", 1992, with the reach of a pair made
smaller from stage to stage. The packages are optional: ``pip install mirror_scan[registration]``.
"""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import MirrorScanError, ReconstructionError

BACKENDS = ("small_gicp", "open3d")
"""Packages that can do it, the first that is installed does."""

_FEWEST = 50  # points that a view must have, and pairs that a result must rest on
_NEIGHBOURS = 12  # of a point, that its normal is fitted to


@dataclass(frozen=True)
class IcpSettings:
    """How two views are registered.

    Parameters
    ----------
    spacing : float
        Points are thinned to one in a cube of this size [m].
    reach : tuple of float
        How far apart the points of a pair may be, stage by stage [m].
    iterations : int
        At most, in each stage.
    backend : str
        One of :data:`BACKENDS`, or ``"auto"``: the first that is installed.
    """

    spacing: float = 0.01
    reach: tuple[float, ...] = (0.15, 0.06, 0.025, 0.012)
    iterations: int = 30
    backend: str = "auto"


@dataclass(frozen=True)
class Registration:
    """How one view lies on another.

    Parameters
    ----------
    pose : np.ndarray [shape=(4, 4)]
        Rigid: the frame of the source → that of the target.
    residual : float
        Root mean square of the pairs' distances along the target's normals [m].
    overlap : float
        Share of the source's points that have a partner within the last reach.
    """

    pose: np.ndarray
    residual: float
    overlap: float

    def misfit(self, reach: float) -> float:
        """Root mean square distance [m] where a point without a partner counts as ``reach`` away."""
        return float(np.sqrt(self.overlap * self.residual**2 + (1.0 - self.overlap) * reach**2))


def find_backend(wanted: str = "auto") -> str:
    """The package that registers: ``wanted``, or the first of :data:`BACKENDS` that is installed and starts.

    Raises
    ------
    MirrorScanError
        When it is not installed, does not start, or is not known.
    """
    if wanted != "auto" and wanted not in BACKENDS:
        raise MirrorScanError(
            f"registration: there is no package “{wanted}” for it; choose one of {', '.join(BACKENDS)}"
        )
    broken = None
    for name in BACKENDS if wanted == "auto" else (wanted,):
        if importlib.util.find_spec(name) is None:
            continue
        try:
            importlib.import_module(name)
        except (ImportError, OSError) as error:  # open3d needs libraries for windows that servers often lack
            broken = MirrorScanError(
                "registration: {name} is installed, but it does not start ({error}); install it again, or {other} "
                "instead",
                name=name, error=error, other=next(one for one in BACKENDS if one != name),
            )  # fmt: skip
        else:
            return name
    if broken is not None:
        raise broken
    if wanted != "auto":
        raise MirrorScanError(
            "registration: {name} is not installed; install it with “pip install {name}”", name=wanted
        )
    raise MirrorScanError(
        "registration: captures without poses are registered by small_gicp or open3d, and neither is installed; "
        "install one with “pip install small_gicp”, or give the cameras' poses with --poses"
    )


def register(
    source: np.ndarray, target: np.ndarray, initial: np.ndarray | None = None, settings: IcpSettings = IcpSettings()
) -> Registration:
    """Register the points of two views.

    Parameters
    ----------
    source, target : np.ndarray [shape=(N, 3)], [shape=(M, 3)]
        Surface points, each in its own frame [m].
    initial : np.ndarray [shape=(4, 4)], optional
        A first guess of source → target; by default the frames are taken to be one.
    settings : IcpSettings

    Raises
    ------
    MirrorScanError
        When no package is installed that does it, or a view has almost no points.
    ReconstructionError
        When they have nothing in common.
    """
    name = find_backend(settings.backend)
    clouds = []
    for points, which in ((source, "first"), (target, "second")):
        points = np.ascontiguousarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < _FEWEST or not np.isfinite(points).all():
            raise MirrorScanError(
                "registration: the {which} of two views is no list of at least {fewest} finite points; leave that "
                "capture out",
                which=which, fewest=_FEWEST,
            )  # fmt: skip
        clouds.append(points)
    pose = np.eye(4) if initial is None else np.array(initial, dtype=np.float64)
    found = (_by_small_gicp if name == "small_gicp" else _by_open3d)(clouds[0], clouds[1], pose, settings)
    if not np.isfinite(found.pose).all():
        raise ReconstructionError(
            "registration: two views have no surface in common where they are taken to be; check the order of the "
            "captures and the angle between them"
        )
    return found


def _by_small_gicp(source: np.ndarray, target: np.ndarray, pose: np.ndarray, settings: IcpSettings) -> Registration:
    package: Any = importlib.import_module("small_gicp")
    fixed, tree = package.preprocess_points(target, settings.spacing, _NEIGHBOURS)
    moving, _ = package.preprocess_points(source, settings.spacing, _NEIGHBOURS)
    pairs, error = 0, np.inf
    for reach in settings.reach:
        result = package.align(
            fixed, moving, tree, init_T_target_source=pose, registration_type="PLANE_ICP",
            max_correspondence_distance=reach, max_iterations=settings.iterations, rotation_epsilon=5e-5,
            translation_epsilon=5e-5,
        )  # fmt: skip
        pose, pairs, error = np.array(result.T_target_source), int(result.num_inliers), float(result.error)
        if pairs < _FEWEST:
            return _nothing_in_common()
    # its factors give half the squared distance
    return Registration(_rigid(pose), float(np.sqrt(2.0 * error / pairs)), pairs / moving.size())


def _by_open3d(source: np.ndarray, target: np.ndarray, pose: np.ndarray, settings: IcpSettings) -> Registration:
    package: Any = importlib.import_module("open3d")
    icp = package.pipelines.registration
    moving, fixed = (
        package.geometry.PointCloud(package.utility.Vector3dVector(points)).voxel_down_sample(settings.spacing)
        for points in (source, target)
    )
    fixed.estimate_normals(package.geometry.KDTreeSearchParamKNN(_NEIGHBOURS))
    criteria = icp.ICPConvergenceCriteria(1e-9, 1e-9, settings.iterations)
    result = None
    for reach in settings.reach:
        result = icp.registration_icp(
            moving, fixed, reach, pose, icp.TransformationEstimationPointToPlane(), criteria
        )  # fmt: skip
        pose = np.array(result.transformation)
        if len(result.correspondence_set) < _FEWEST:
            return _nothing_in_common()
    assert result is not None  # there is a stage
    mine, theirs = np.asarray(result.correspondence_set).T
    points, there = np.asarray(moving.points)[mine] @ pose[:3, :3].T + pose[:3, 3], np.asarray(fixed.points)[theirs]
    along = ((points - there) * np.asarray(fixed.normals)[theirs]).sum(axis=1)
    return Registration(_rigid(pose), float(np.sqrt(np.mean(along**2))), len(mine) / len(moving.points))


def _nothing_in_common() -> Registration:
    return Registration(np.full((4, 4), np.nan), np.inf, 0.0)


def _rigid(pose: np.ndarray) -> np.ndarray:
    """The pose with its rotation made exact."""
    left, _, right = np.linalg.svd(pose[:3, :3])
    exact = pose.copy()
    exact[:3, :3], exact[3] = left @ right, (0.0, 0.0, 0.0, 1.0)
    return exact
