"""Where the picture ends: a body that a margin of any shape cuts off, and one that only stands near it."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.subject.image_border import cut_sides

H, W = 240, 320
ROWS, COLUMNS = np.mgrid[:H, :W].astype(float)
BODY = ((ROWS - 40) / 18) ** 2 + ((COLUMNS - 160) / 14) ** 2 < 1  # a head, a trunk with arms spread out, two legs
BODY |= (ROWS > 55) & (ROWS < 130) & (np.abs(COLUMNS - 160) < 30)
BODY |= (np.abs(ROWS - 75) < 8) & (np.abs(COLUMNS - 160) < 75)
BODY |= (ROWS >= 130) & (ROWS < 210) & (np.abs(np.abs(COLUMNS - 160) - 18) < 11)
TOP, BOTTOM, LEFT, RIGHT = 22, 209, 86, 234


def picture(seed=0, shadows=True):
    """The body before a wall and on a floor, with readings missing at random and in the shadow beside the body."""
    depth = np.where(BODY, 2.0, np.where(ROWS > 190, 1.6 + 90 / np.maximum(ROWS - 60, 1), 3.0))
    if shadows:
        depth[np.roll(BODY, -5, axis=1) & ~BODY] = 0
    depth[np.random.default_rng(seed).random(depth.shape) < 0.02] = 0
    return depth.astype(np.float32)


def hexagon(size):
    """Pixels outside of a hexagon with corners on the left and right, as a near-field depth mode has."""
    x, y = np.abs(COLUMNS - 160), np.abs(ROWS - 120)
    return (y > size) | (x + 0.577 * y > 1.5 * size)


MARGINS = {
    "rows at the top": (ROWS < TOP + 6, {"top"}),
    "many rows at the top": (ROWS < TOP + 40, {"top"}),
    "rows at the bottom": (ROWS > BOTTOM - 6, {"bottom"}),
    "columns at the left": (COLUMNS < LEFT + 8, {"left"}),
    "columns at the right": (COLUMNS > RIGHT - 8, {"right"}),
    "a frame": ((ROWS < TOP + 5) | (ROWS > BOTTOM - 5) | (COLUMNS < 20) | (COLUMNS > 300), {"top", "bottom"}),
    "a slanted edge": (ROWS < TOP + 8 + 0.15 * (COLUMNS - 160), {"top"}),
    "an edge bowed inwards": (ROWS < TOP + 8 - 30 * ((COLUMNS - 160) / 160) ** 2, {"top"}),
    "an edge bowed outwards": (ROWS > BOTTOM - 8 - 30 * ((COLUMNS - 160) / 160) ** 2, {"bottom"}),
    "a circle": (np.hypot(ROWS - 120, COLUMNS - 160) > 85, {"top", "bottom", "left", "right"}),
    "a hexagon": (hexagon(84), {"top", "bottom"}),
}


@pytest.mark.parametrize("name", MARGINS)
def test_a_margin_that_cuts_the_body_off(name):
    outside, sides = MARGINS[name]
    depth = np.where(outside, 0, picture())
    found = cut_sides(depth, BODY & (depth > 0))
    assert set(found) == sides
    assert all(margin > 3 for margin in found.values())


@pytest.mark.parametrize(("rows", "columns", "sides"), [
    (slice(30, None), slice(None), {"top"}), (slice(None, 200), slice(None), {"bottom"}),
    (slice(None), slice(95, None), {"left"}), (slice(None), slice(None, 225), {"right"}),
    (slice(60, 150), slice(None), {"top", "bottom"}), (slice(None), slice(None), set()),
])  # fmt: skip
def test_the_images_own_border(rows, columns, sides):
    depth = picture()[rows, columns]
    assert cut_sides(depth, BODY[rows, columns] & (depth > 0)) == dict.fromkeys(sides, 0)


@pytest.mark.parametrize("case", [
    "margin just above", "margin just below", "margin beside", "hexagon about it", "no background", "no room",
    "no wall and no floor", "dark hair", "dark shoes", "dark hair, no background", "a step below", "nobody",
])  # fmt: skip
def test_a_whole_body_is_not_cut(case):
    depth, body = picture(), BODY.copy()
    hair, shoes = BODY & (ROWS < 34), BODY & (ROWS > 200)
    unread = {
        "margin just above": ROWS < TOP - 5, "margin just below": ROWS > BOTTOM + 5,
        "margin beside": COLUMNS < LEFT - 6, "hexagon about it": hexagon(106),
        "no background": (ROWS < 190) & ~BODY, "no room": ~BODY, "no wall and no floor": ~BODY & (COLUMNS > 40),
        "dark hair": hair, "dark shoes": shoes, "dark hair, no background": hair | ((ROWS < 190) & ~BODY),
        "a step below": (ROWS > 214) & (COLUMNS < 150), "nobody": BODY,
    }[case]  # fmt: skip
    depth[unread] = 0
    assert cut_sides(depth, body & (depth > 0)) == {}
