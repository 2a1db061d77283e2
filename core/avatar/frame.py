"""The avatar frame: Z up, facing −Y, soles on z = 0."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..mesh import Mesh
from ..numeric.point_products import transform

if TYPE_CHECKING:
    from ..pipeline.scan import Scan
    from ..subject.subject_views import Views


def avatar_frame(mesh: Mesh, views: Views | Scan) -> np.ndarray:
    """Camera frame → avatar frame (4, 4): Z up, facing −Y (towards the camera), soles on z = 0, between the feet x =
    y = 0. What is not on the floor has its lowest point there."""
    up = views.up
    away = views.axis - (views.axis @ up) * up
    away /= np.linalg.norm(away)
    rotation = np.stack((np.cross(away, up), away, up))
    vertices = transform(mesh.vertices, np.column_stack((rotation, np.zeros(3))))
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    if views.floor is not None and low < views.floor + 0.1 * (high - views.floor):  # else it is not on that floor
        low = views.floor
    feet = vertices[vertices[:, 2] <= low + 0.1 * (high - low)]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -0.5 * (feet.min(axis=0) + feet.max(axis=0))
    matrix[2, 3] = -low
    return matrix
