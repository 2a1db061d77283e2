"""What tasks give: plain records of arrays and of core's plain records, which any process can read."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...core.camera import Intrinsics
from ...core.errors import MirrorScanError
from ...core.mesh import Mesh, Texture

if TYPE_CHECKING:
    from ...core.avatar.pose import SkinWeights
    from ...core.avatar.skeleton import Skeleton
    from ...core.capture import Capture
    from ...core.measurements import Measurements

Result = TypeVar("Result")
Steps = Generator[tuple[float, str], None, Result]
"""What a task is: it yields (share, what it does), and returns its result."""


@dataclass(frozen=True)
class Cloud:
    """A capture's points.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3), dtype=float32]
        Camera frame [m].
    pixel : np.ndarray [shape=(N,), dtype=int32]
        Row · width + column of each.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
    intrinsics : Intrinsics
    info : dict
        name, format, path, frames, size, sensor, who names it, what it measures, and notes.
    """

    points: np.ndarray
    pixel: np.ndarray
    color: np.ndarray | None
    intrinsics: Intrinsics
    info: dict

    @property
    def depth(self) -> np.ndarray:
        """Depth map (H, W) float32 [m], 0 = no reading."""
        depth = np.zeros(self.intrinsics.height * self.intrinsics.width, np.float32)
        depth[self.pixel] = self.points[:, 2]
        return depth.reshape(self.intrinsics.height, self.intrinsics.width)

    def capture(self) -> Capture:
        """The capture that the points are of, as one frame."""
        from ...core.capture import Capture

        known = {key: str(self.info[key]) for key in ("name", "format", "sensor", "sensor_from") if key in self.info}
        return Capture(self.depth[None], self.color, self.intrinsics, **known)


@dataclass(frozen=True)
class Loaded:
    """A capture averaged to one depth map (H, W) [m], its pictures (H, W, 3) uint8, and what it says of mirrors."""

    depth: np.ndarray
    color: np.ndarray | None
    depth_picture: np.ndarray
    intrinsics: Intrinsics
    info: dict
    placement: np.ndarray
    mirrors: list[dict]
    seen: np.ndarray | None


@dataclass(frozen=True)
class Fitted:
    """Mirrors after a fit, and warnings about them.

    ``seen``: through which of them each pixel (H, W) was seen (0 directly, -1 unknown).
    """

    mirrors: list[dict]
    seen: np.ndarray | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Subject:
    """The capture sorted: maps (H, W); ``height`` [m] is above the floor, or the lowest point of the person."""

    seen: np.ndarray
    view: np.ndarray
    height: np.ndarray
    floor: bool
    clearance: float
    placement: np.ndarray
    pixels: list[int]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Built:
    """What of a reconstruction goes into the file; ``mirrors`` as they were in the end."""

    mesh: Mesh
    report: dict
    warnings: tuple[str, ...]
    mirrors: list[dict]


@dataclass(frozen=True)
class Scanned:
    """A capture with the mirrors it has or that were found, and the avatar; or why there is none."""

    loaded: Loaded
    built: Built | None
    problem: MirrorScanError | None


@dataclass(frozen=True)
class Checked:
    """What a mesh is (:func:`.soundness.mesh_report`) and its problems, as plain dicts."""

    report: dict
    problems: list[dict]


@dataclass(frozen=True)
class Rigged:
    """An avatar's mesh, fine enough to bend, with its skeleton and weights; all in the frame of the mesh [m]."""

    mesh: Mesh
    skeleton: Skeleton
    weights: SkinWeights
    texture: Texture | None = None


@dataclass(frozen=True)
class Source:
    """What an avatar was built from.

    Parameters
    ----------
    path, frames, reading
        As :func:`build_steps` takes them; an empty path says that ``cloud`` is all there is.
    mirrors : list of dict
        Records of the mirrors as they were in the end.
    placement : list
        (4, 4), rigid: camera frame → avatar frame.
    cloud : Cloud or None
    """

    path: str
    frames: int
    reading: dict
    mirrors: list[dict]
    placement: list
    cloud: Cloud | None


@dataclass(frozen=True)
class Textured:
    """A texture of an avatar's triangles, and what the report says of it."""

    texture: Texture
    summary: dict


@dataclass(frozen=True)
class Measured:
    """A body's measurements, and what the report says of them."""

    measurements: Measurements
    summary: dict


@dataclass(frozen=True)
class Simulated:
    """A virtual capture, and what of the body (V,) int8 each view sees best, with the shares of its surface."""

    loaded: Loaded
    coverage: np.ndarray
    shares: list[float]


@dataclass(frozen=True)
class RigChecked:
    """What a rig of objects would see of a body, plainly, and a small picture of what its camera sees.

    ``shares``: of the area, by view; ``parts``: of the area of head, hands and feet; ``views``: for each view its name,
    which parts are whole in it, and what to move; ``image`` (H, W, 3) uint8.
    """

    seen: float
    shares: dict[str, float]
    parts: dict[str, float]
    views: list[dict]
    error_mm: float
    light_mm: float
    lit_twice: float
    image: np.ndarray
