"""What of a body the views see."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.mesh import Mesh


def test_coverage_is_what_a_ray_sees(request):
    """On a ball before the camera: its near half is seen directly, what no view reaches is not."""
    from mirror_scan.core.simulation.coverage import coverage, shares
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate

    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    mesh = Mesh(np.array(ball.vertices) + (0, 0, 1.0), np.array(ball.faces, np.int32), None, None, None)
    alone = simulate(mesh, default_rig(sensor="ideal", mirrors=0, frames=1))
    view = coverage(alone)
    camera = np.array(alone.rig.camera)
    outward = ball.vertices / 0.3
    cosine = np.einsum("ij,ij->i", outward, camera - mesh.vertices)
    cosine /= np.linalg.norm(camera - mesh.vertices, axis=1)
    assert (view[cosine > 0.35] == 0).all() and (view[cosine < 0.2] == -1).all()
    seen = shares(view, mesh.vertices, mesh.triangles, 1)
    assert sum(seen) == pytest.approx(1) and 0.25 < seen[0] < 0.5
    with_mirrors = coverage(simulate(mesh, default_rig(sensor="ideal", mirrors=2, frames=1)))
    assert set(np.unique(with_mirrors)) >= {0, 1, 2} and (with_mirrors >= 0).mean() > seen[0] + 0.3
