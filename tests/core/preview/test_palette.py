"""Colours of views, kinds and depth."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.preview import palette


def test_colours_go_by_number():
    views, kinds = palette.VIEW_PALETTE, palette.KIND_PALETTE
    shown = palette.view_colors(np.array([0, 1, -1, len(views)], np.int8))
    np.testing.assert_array_equal(shown, [views[0], views[1], palette.MADE, views[0]])
    np.testing.assert_array_equal(palette.kind_colors(np.array([2, 0], np.int8)), [kinds[2], kinds[0]])
    depth = np.array([[0, 1.0], [2.0, 3.0]])
    picture = palette.depth_colors(depth)
    assert (picture[0, 0] == 0).all() and picture[0, 1, 0] > 200 and picture[1, 1, 0] < 90
    assert (palette.depth_colors(np.zeros((2, 2))) == 0).all()
    part = palette.sort_parts(np.array([-1, -1, 0, 1, 0], np.int8), np.array([1.0, 0.001, 1.0, 3.0, 1.0]),
                              np.array([2.0, 2, 2, 2, 9]), 0.01, 2.4, 5.0)  # fmt: skip
    assert part.tolist() == [0, 1, 2, 0, 3]
