"""Which of the floor's readings tell what a camera makes of light that comes two ways."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.light.floor_light import _about_frames
from mirror_scan.core.light.irradiance import through_glass


def test_what_a_frame_may_hide_or_be_is_left_out(seen):
    """Against where the true glass ends: no point whose light passes the frame, or that lies on it, is kept."""
    one = seen("azure_kinect", ("multipath",))
    rng = np.random.default_rng(2)
    points = rng.uniform((-2.0, -1.2, 1.0), (2.0, 1.2, 4.0), (20_000, 3))
    left_out = _about_frames(points, one.mirrors)
    for mirror in one.mirrors:
        inner, outer = (through_glass(points, mirror, margin) for margin in (0.05, -0.05))
        assert left_out[inner != outer].all()
        on_frame = mirror.point + mirror.basis[:, 0] * (mirror.rectangle[0, 1] + 0.03) + 0.02 * mirror.normal
        assert _about_frames(on_frame[None], one.mirrors).all()
    assert 0.1 < left_out.mean() < 0.5
