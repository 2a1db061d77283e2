"""Colour cameras and their reflections in mirrors: what texture is taken from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..camera import Intrinsics, project
from ..errors import MirrorScanError
from ..mirrors import Mirror
from ..mirrors.glass_extent import glass_corners
from ..mirrors.mirror import reflection_matrix
from ..numeric.point_products import transform


@dataclass(frozen=True)
class ColorView:
    """One way in which a colour camera sees the subject: straight, or through a mirror.

    Parameters
    ----------
    name : str
        For messages.
    image : np.ndarray [shape=(H, W, 3), dtype=uint8]
        sRGB, of the whole camera; views of one camera share it.
    intrinsics : Intrinsics
        Of the image; a pinhole.
    from_avatar : np.ndarray [shape=(4, 4)]
        Mesh's frame → frame of the camera that sees the subject straight: of a mirror view the camera behind the
        mirror, whose determinant is negative.
    camera : np.ndarray [shape=(4, 4)]
        Mesh's frame → frame of the camera itself; of a straight view that is ``from_avatar``. What the camera sees
        straight hides mirrors behind it.
    outline : np.ndarray [shape=(K, 2)] or None
        Corners of the mirror's glass in the image [px]; None where nothing limits the view.
    """

    name: str
    image: np.ndarray
    intrinsics: Intrinsics
    from_avatar: np.ndarray
    camera: np.ndarray
    outline: np.ndarray | None = None

    def __post_init__(self) -> None:
        shape = (self.intrinsics.height, self.intrinsics.width, 3)
        if self.image.shape != shape or self.image.dtype != np.uint8:
            raise MirrorScanError(
                f"colour of view {self.name}: an image of shape {self.image.shape} and type {self.image.dtype} does "
                f"not fit intrinsics of {shape[1]}×{shape[0]} pixels and 8 bits"
            )
        if not self.intrinsics.is_pinhole:
            raise MirrorScanError(f"colour of view {self.name}: straighten the image first; its lens distorts")
        for matrix in (self.from_avatar, self.camera):
            if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
                raise MirrorScanError(f"colour of view {self.name}: its pose is no finite matrix of 4×4 numbers")

    @property
    def mirrored(self) -> bool:
        """Whether the view is a reflection."""
        return bool(np.linalg.det(self.from_avatar[:3, :3]) < 0)

    @property
    def projection(self) -> np.ndarray:
        """Mesh's frame → homogeneous pixels (3, 4)."""
        lens = self.intrinsics
        matrix = np.array(((lens.fx, 0.0, lens.cx), (0.0, lens.fy, lens.cy), (0.0, 0.0, 1.0)))
        return matrix @ self.from_avatar[:3]


class ColoredCapture(Protocol):
    """What is needed of a :class:`.capture.Capture`."""

    @property
    def color(self) -> np.ndarray | None:
        """Aligned to depth, or None."""
        ...

    @property
    def intrinsics(self) -> Intrinsics:
        """Of depth."""
        ...

    @property
    def native_color(self) -> np.ndarray | None:
        """The colour camera's own pixels, or None."""
        ...

    @property
    def color_intrinsics(self) -> Intrinsics | None:
        """Of those."""
        ...

    @property
    def depth_to_color(self) -> np.ndarray | None:
        """Frame of the depth camera → of the colour camera."""
        ...


def color_views(capture: ColoredCapture, mirrors: Sequence[Mirror], camera_to_avatar: np.ndarray) -> list[ColorView]:
    """The straight view and one through each mirror, of a capture's colour.

    The colour camera's own pixels are taken where the capture has them, else the colours that are aligned to depth.

    Parameters
    ----------
    capture : Capture
    mirrors : sequence of Mirror
        Frame of the depth camera.
    camera_to_avatar : np.ndarray [shape=(4, 4)]
        Frame of the depth camera → frame of the mesh.

    Returns
    -------
    list of ColorView
        Empty where the capture has no colour.
    """
    image, intrinsics, to_color = capture.color, capture.intrinsics, np.eye(4)
    if capture.native_color is not None and capture.color_intrinsics is not None:
        image, intrinsics = capture.native_color, capture.color_intrinsics
        to_color = np.eye(4) if capture.depth_to_color is None else np.asarray(capture.depth_to_color, np.float64)
    if image is None:
        return []
    to_camera = np.linalg.inv(camera_to_avatar)
    straight = to_color @ to_camera
    views = [ColorView("direct", image, intrinsics, straight, straight)]
    for mirror in mirrors:
        through = to_color @ reflection_matrix(mirror) @ to_camera
        outline = _outline(mirror, intrinsics, to_color)
        views.append(ColorView(mirror.name, image, intrinsics, through, straight, outline))
    return views


def _outline(mirror: Mirror, intrinsics: Intrinsics, to_color: np.ndarray) -> np.ndarray | None:
    """Corners (K, 2) of the glass in the colour image [px]; None where it is unlimited, or passes beside the camera."""
    corners = glass_corners(mirror)
    if corners is None:
        return None
    pixels = project(transform(mirror.point + corners @ mirror.basis[:, :2].T, to_color), intrinsics)
    return pixels if np.isfinite(pixels).all() else None
