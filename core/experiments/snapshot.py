"""What the experiments with virtual captures share: one view of a body as a mesh, raw and cleaned, and its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, unproject
from ..depth.clean_views import clean
from ..depth.depth_map import one_depth_map
from ..depth.noise_estimate import measure_noise
from ..depth.sensor_recognition import recognise
from ..depth.settings import DepthSettings
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mirrors.mirror import reflection_matrix
from ..mirrors.picked_mirror import place_mirror
from ..patches.grid_triangulation import triangulate_view
from ..preview.mesh_views import draw_text, render_views
from ..simulation.simulate import Simulation
from .results import distance_colors

WAYS = ("raw", "cleaned")
"""``raw``: the mean of the burst's readings at each pixel, as the paper has it; ``cleaned``: as we reconstruct."""

_OWN = 0.3  # m: a reading farther from the body than this is of something else


def patch(made: Simulation, view: int, way: str, readable: np.ndarray | None = None) -> Mesh:
    """The mesh of one view of a simulation, avatar frame; a reflected one is placed where the body is.

    Parameters
    ----------
    made : Simulation
    view : int
        0 direct, n through mirror n; its true plane is used, so that what is lost is lost in reflection.
    way : str
        One of ``WAYS``.
    readable : np.ndarray [shape=(H, W), dtype=bool] or None
        Pixels whose readings are kept; all by default.

    Raises
    ------
    MirrorScanError
        When no part of the body is seen there.
    """
    capture, truth = made.capture, made.truth
    camera = capture.intrinsics
    burst = capture.depth if readable is None else np.where(readable, capture.depth, np.float32(0))
    mine = truth.labels == view
    settings = DepthSettings()
    own = mine & (np.abs(burst - truth.sight.depth.astype(np.float32)) < _OWN)  # each frame's own outliers left out
    if not own.any():
        raise MirrorScanError("the camera sees nothing of the body there; choose a body of human size")
    if way == "raw":
        count = own.sum(axis=0)
        depth = np.divide(np.where(own, burst, 0).sum(axis=0), count, where=count > 0, out=np.zeros(mine.shape))
        depth = depth.astype(np.float32)
        labels = np.where(depth > 0, 0, -1).astype(np.int8)
        noise = measure_noise(depth, labels, 1)
    else:
        _, model = recognise(capture, settings)
        depth, spread = one_depth_map(replace(capture, depth=burst), settings)
        near = np.abs(depth - truth.sight.depth) < _OWN
        labels = np.where(mine & near & (depth > 0), 0, -1).astype(np.int8)
        depth, labels, noise = clean(depth, labels, 1, camera.fx, settings, model, spread if len(burst) > 1 else None)
    mesh = triangulate_view(depth, labels, 0, unproject(depth, camera), 1.0 / camera.fx, noise[0])
    if view > 0:
        mirror = place_mirror(
            RgbdImage(depth, camera), truth.mirrors[view - 1]
        )  # its plane is known: nothing is fitted
        mesh = mesh.transformed(reflection_matrix(mirror))
        mesh = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))
    return mesh.transformed(truth.camera_to_avatar)


def distance_picture(
    meshes: Sequence[Mesh],
    references: Sequence[Mesh],
    titles: Sequence[str],
    side: tuple[float, float, float],
    full: float,
    heading: str,
    columns: int,
) -> np.ndarray:
    """Meshes side by side, coloured by their distance to a reference: blue on it, red ``full`` metres off or more."""
    panels = []
    for mesh, reference, title in zip(meshes, references, titles, strict=True):
        colors = distance_colors(mesh, reference, full)
        panel = render_views(mesh, colors, [side], 300, 480).copy()
        draw_text(panel, title, 12, 24, size=16, color=(60, 62, 68))
        panels.append(panel)
    rows = [np.hstack(panels[i : i + columns]) for i in range(0, len(panels), columns)]
    band = np.full((44, rows[0].shape[1], 3), 255, np.uint8)
    draw_text(band, heading, 16, 29, size=18, color=(60, 62, 68))
    return np.concatenate((band, *rows))
