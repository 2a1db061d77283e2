"""Colours near a view's outline, taken from farther inside: a colour image never fits its depth to the pixel.

Calibration, parallax, exposure times and the blur of lens and JPEG put a real camera's colour some pixels beside the
depth, so that the outermost readings carry the colour of the wall behind. Seams and fills start from these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

_AROUND = 12  # colours of body and background are compared as far as this from the outline [px]
_PLAIN = 4  # readings at either end of such a profile that must show one colour
_CONTRAST = 80.0  # least difference of the two colours [sRGB levels, length over the channels]
_UNEVEN = 0.35  # of the contrast: most that a colour may change within an end
_FEW = 40  # profiles: fewer say nothing
_ROUNDS = 12  # of reweighting
_STEP = 0.4  # of the contrast, at least so much of it within three pixels
_MIXED = 0.03  # of the contrast a pixel: where the colour changes less, an edge's blur ends
_OWN_SHIFT = 20.0  # profiles that a view's own shift needs to count as much as that of all views
_SIDE = 15  # profiles on either side of the body, left and right or above and below, that show a shift along it
_BALANCE = 0.25  # of the other side's, at least so many
_ACROSS = 0.7  # of a direction, at least this component
_NEAREST = 1.0  # smaller shifts are left [px]
_FARTHEST = 8.0  # largest shift that is believed [px]
_WORST = 0.9  # quantile of the profiles; the rest is patterns
_MOST_SPREAD = 3.0  # what does not fit the shift is allowed for up to this [px]
_SHALLOW = 4  # steps from the outline that show its direction [px]
_SLANT = 0.25  # of a step a pixel: where the distance to the outline rises less, its direction is not known


@dataclass(frozen=True)
class ColorSettings:
    """Where vertices near an outline take their colour.

    Parameters
    ----------
    least_inset : int
        Nearer to an outline than this, readings take the colour from farther inside; 1 leaves all as they are [px].
    most_inset : int
        The most that is believed where the colour image shows by how much it is off [px].
    exposure : bool
        Match the brightness and tint of the views over the seams.
    """

    least_inset: int = 2
    most_inset: int = 10
    exposure: bool = True


class _Outline(NamedTuple):
    """``inside`` (H, W) int16: steps to the outline, 1 at it, 0 off the body; ``height`` (H, W) float32, smooth."""

    inside: np.ndarray
    height: np.ndarray


def colors_from_inside(
    color: np.ndarray,
    depth: np.ndarray,
    labels: np.ndarray,
    jumps: np.ndarray,
    settings: ColorSettings = ColorSettings(),
) -> np.ndarray:
    """The colour image with the body's outermost pixels coloured as the surface is farther inside.

    How deep the background's colour reaches is measured at the outline, for each direction: across it the colour goes
    from the background's to the body's, and where it is the body's the inset ends. A pixel nearer to the outline gets
    the colour of the pixel that is reached by climbing away from the outline on the same surface. In parts thinner
    than twice the inset that is their middle, or what they widen to nearby.

    Parameters
    ----------
    color : np.ndarray [shape=(H, W, 3), dtype=uint8]
        Aligned to depth.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m].
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each of the body's pixels, -1 elsewhere.
    jumps : np.ndarray [shape=(N+1,)]
        Of each view: neighbours whose depths differ by more lie on different surfaces [relative to z].

    Returns
    -------
    np.ndarray [shape=(H, W, 3), dtype=uint8]
        The colours themselves where nothing had to be changed. O(H W).
    """
    if settings.least_inset <= 1:
        return color
    margin = _AROUND + 1
    rows, columns = np.flatnonzero((labels >= 0).any(axis=1)), np.flatnonzero((labels >= 0).any(axis=0))
    if not len(rows):
        return color
    top, left = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    box = (slice(top, rows[-1] + margin + 1), slice(left, columns[-1] + margin + 1))
    z, label, shade = depth[box], labels[box], color[box]
    # a margin all round, so that neighbours need no check; the image's own edge is no outline
    z, label = np.pad(z, 1, mode="edge"), np.pad(label, 1, mode="edge")
    shade = np.pad(shade, ((1, 1), (1, 1), (0, 0)), mode="edge")
    jump = np.append(jumps, 0.0).astype(np.float32)
    edge = _find_edge(z, label, jump)
    outline = _find_outline(edge, label >= 0, _SHALLOW)
    misfit = _measure_misfit(shade, label, outline, len(jumps))
    inset = float(settings.least_inset)
    if misfit is not None:
        shade = _moved(shade, label, misfit.shift)
        inset = float(np.clip(np.ceil(misfit.reach) + 1.0, inset, settings.most_inset))
    if inset > _SHALLOW - 1:
        outline = _find_outline(edge, label >= 0, int(inset) + 1)
    pixel, source = _sources(z, label, jump, outline, inset)
    flat = np.ascontiguousarray(shade).reshape(-1, 3)
    known = flat[source].any(axis=1)
    flat[pixel[known]] = flat[source[known]]
    shade = flat.reshape(shade.shape)
    body = label[1:-1, 1:-1] >= 0
    out = color.copy()
    out[box][body] = shade[1:-1, 1:-1][body]
    return out


def _moved(shade: np.ndarray, label: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The colours, each view's taken from where its ``shift`` (N+1, 2) has put them; black means that none is known."""
    out = shade.copy()
    for view in np.flatnonzero(shift.any(axis=1)):
        v, u = np.nonzero(label == view)
        there = shade[
            np.clip(v + shift[view, 1], 0, shade.shape[0] - 1), np.clip(u + shift[view, 0], 0, shade.shape[1] - 1)
        ]
        known = there.any(axis=1)
        out[v[known], u[known]] = there[known]
    return out


def _find_edge(z: np.ndarray, label: np.ndarray, jump: np.ndarray) -> np.ndarray:
    """The body's pixels (H, W) where it ends or its depth jumps."""
    body = label >= 0
    edge = np.zeros_like(body)
    for axis in (0, 1):
        a, b = (_along(axis, slice(None, -1)), _along(axis, slice(1, None)))
        cut = label[a] != label[b]
        near = np.minimum(z[a], z[b])
        cut |= (label[a] == label[b]) & body[a] & (np.abs(z[a] - z[b]) > jump[label[a]] * near)
        edge[a] |= cut
        edge[b] |= cut
    return edge & body


def _find_outline(edge: np.ndarray, body: np.ndarray, deepest: int) -> _Outline:
    """How far every pixel lies from the ``edge`` of the body, within ``deepest`` steps."""
    inside = np.where(edge, 1, 0).astype(np.int16)
    reached = edge
    for step in range(2, deepest + 2):
        grown = _grown(reached, 1, corners=step % 2 == 0) & body
        inside[grown & ~reached] = step
        reached = grown
    inside[body & ~reached] = deepest + 2
    beyond = np.zeros_like(inside)
    reached = body
    for step in range(1, 4):
        grown = _grown(reached, 1, corners=step % 2 == 0)
        beyond[grown & ~reached] = step
        reached = grown
    beyond[~reached] = 4
    inside[~body] = 0
    height = (inside - beyond).astype(np.float32)
    for _ in range(2):
        height = _blurred(height)
    return _Outline(inside, height)


def _along(axis: int, part: slice) -> tuple[slice, slice]:
    return (part, slice(None)) if axis == 0 else (slice(None), part)


def _grown(mask: np.ndarray, steps: int, corners: bool = True) -> np.ndarray:
    """The mask (H, W) with its neighbours, in rows and columns and also over corners."""
    for _ in range(steps):
        out = mask.copy()
        out[1:] |= mask[:-1]
        out[:-1] |= mask[1:]
        across = out.copy() if corners else mask
        out[:, 1:] |= across[:, :-1]
        out[:, :-1] |= across[:, 1:]
        mask = out
    return mask


def _blurred(values: np.ndarray) -> np.ndarray:
    """Means over 3 x 3 pixels; the outermost stay."""
    out = values.copy()
    out[1:-1] = (values[:-2] + values[1:-1] + values[2:]) / 3
    rows = out.copy()
    out[:, 1:-1] = (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 3
    return out


class _Misfit(NamedTuple):
    """``shift`` (N+1, 2) int: the colour of each view lies so far to the right and down of its depth [px].

    ``reach``: how deep the background's colour is mixed into the body's all the same [px].
    """

    shift: np.ndarray
    reach: float


class _Profiles(NamedTuple):
    """Lines across the outline (K,): where their colour turns to the body's, seen from the outline [px].

    ``outward`` (K, 2) is their direction, right and down; ``view`` (K,) int; ``share`` (K, 2 _AROUND) how much of the
    background's colour is in each reading.
    """

    turn: np.ndarray
    outward: np.ndarray
    view: np.ndarray
    share: np.ndarray


def _slope_of(height: np.ndarray, row: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit direction (K,) down and right in which pixels lead away from the outline, and how steeply."""
    down = 0.5 * (height[row + 1, column] - height[row - 1, column])
    right = 0.5 * (height[row, column + 1] - height[row, column - 1])
    steep = np.hypot(down, right)
    scale = 1.0 / np.maximum(steep, 1e-6)
    return down * scale, right * scale, steep


def _profiles(shade: np.ndarray, label: np.ndarray, outline: _Outline) -> _Profiles:
    """Lines across the outline along which one plain colour turns into another."""
    edge = outline.inside == 1
    edge[:_AROUND], edge[-_AROUND:], edge[:, :_AROUND], edge[:, -_AROUND:] = False, False, False, False
    v, u = np.nonzero(edge)
    down, right, steep = _slope_of(outline.height, v, u)
    clear = steep > 2 * _SLANT
    v, u, down, right = v[clear], u[clear], down[clear], right[clear]
    steps = np.arange(-_AROUND, _AROUND)  # 0 is the outline's own pixel
    y = np.rint(v[:, None] + down[:, None] * steps).astype(np.int64)
    x = np.rint(u[:, None] + right[:, None] * steps).astype(np.int64)
    met, view = label[y, x], label[v, u].astype(np.int64)
    whole = (met[:, :_AROUND] < 0).all(axis=1) & (met[:, _AROUND:] == view[:, None]).all(axis=1)
    profile = shade[y[whole], x[whole]].astype(np.float32)
    behind, body = profile[:, :_PLAIN].mean(axis=1), profile[:, -_PLAIN:].mean(axis=1)
    contrast = behind - body
    square = (contrast**2).sum(axis=1)
    uneven = np.maximum(
        np.abs(profile[:, :_PLAIN] - behind[:, None]).max(axis=(1, 2)),
        np.abs(profile[:, -_PLAIN:] - body[:, None]).max(axis=(1, 2)),
    )
    known = profile.any(axis=2).all(axis=1)  # black: the colour camera did not see it
    told = known & (square > _CONTRAST**2) & (uneven < _UNEVEN * np.sqrt(square))
    share = ((profile - body[:, None]) * contrast[:, None]).sum(axis=2)[told] / square[told, None]
    # the steepest place, not the middle level: towards its outline a body is shaded, too
    fall = share[:, :-3] - share[:, 3:]
    at = np.argmax(fall, axis=1)
    sharp = fall[np.arange(len(at)), at] > _STEP
    turn = at + 2.0 - _AROUND  # pixels from there on are the body's
    outward = -np.column_stack((right[whole], down[whole]))[told]
    return _Profiles(turn[sharp], outward[sharp], view[whole][told][sharp], share[sharp])


def _measure_misfit(shade: np.ndarray, label: np.ndarray, outline: _Outline, views: int) -> _Misfit | None:
    """How the colour image lies on the depth, by the outline's two sides; None: nothing is known.

    A colour image that lies aside makes the background's colour reach into the body on one side and the body's out of
    it on the other; what all sides have in common is the edges' own. Both are fitted to where the colours turn,
    reweighted so that what patterns on the clothes feign counts little. Each view has its own shift, as it has its
    own distance; where little is seen of it, that of all views together.
    """
    found = _profiles(shade, label, outline)
    if len(found.turn) < _FEW:
        return None
    even, shift, soiled = _fit_shift(found.turn, found.outward, np.zeros(2), 1.0)
    shifts = np.zeros((views, 2))
    for view in range(views):
        mine = found.view == view
        shifts[view] = _fit_shift(found.turn[mine], found.outward[mine], shift, _OWN_SHIFT)[1] if mine.any() else shift
    shifts[np.hypot(*shifts.T) > _FARTHEST] = 0.0
    shifts[np.abs(shifts) < _NEAREST] = 0.0
    # lens and JPEG carry an edge to either side; outside no shading of a round body feigns it
    last, row, blur = (found.turn + _AROUND).astype(np.int64) - 1, np.arange(len(found.turn)), 0
    while blur < _AROUND // 2:
        at = np.maximum(last - blur, 1)
        if np.median(found.share[row, at - 1] - found.share[row, at]) <= _MIXED:
            break
        blur += 1
    return _Misfit(np.rint(shifts).astype(np.int64), even + min(soiled, _MOST_SPREAD) + blur)


def _fit_shift(
    turn: np.ndarray, outward: np.ndarray, expected: np.ndarray, trust: float
) -> tuple[float, np.ndarray, float]:
    """``turn`` (K,) = even - shift · outward: both, and how much deeper the worst turn [px].

    ``trust``: of the ``expected`` shift (2,), in profiles. It stands where one of two opposite sides is hardly seen:
    what makes the outline wrong there, as hair that gives no reading, looks like a shift.
    """
    A = np.column_stack((np.ones(len(turn)), -outward))
    sides = np.array([(outward > _ACROSS).sum(axis=0), (outward < -_ACROSS).sum(axis=0)])
    seen = sides.min(axis=0) >= np.maximum(_BALANCE * sides.max(axis=0), _SIDE)
    prior = np.diag(np.append(1e-6, np.where(seen, trust, 1e9)))
    target = prior @ np.append(0.0, expected)
    weight = np.ones(len(turn))
    fitted, rest = np.append(0.0, expected), turn
    for _ in range(_ROUNDS):
        fitted = np.linalg.solve((A.T * weight) @ A + prior, (A.T * weight) @ turn + target)
        rest = turn - A @ fitted
        spread = 1.4826 * float(np.median(np.abs(rest))) + 0.2
        weight = 1.0 / (1.0 + (rest / spread) ** 2)
    return float(fitted[0]), fitted[1:], float(np.quantile(rest, _WORST))


def _sources(
    z: np.ndarray, label: np.ndarray, jump: np.ndarray, outline: _Outline, inset: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (K,) nearer to the outline than the ``inset``, and whence each takes its colour (K,); flat indices."""
    width = z.shape[1]
    near = (outline.inside > 0) & (outline.inside < inset)
    near[0], near[-1], near[:, 0], near[:, -1] = False, False, False, False
    pixel = np.flatnonzero(near)
    inside, height = outline.inside.ravel(), outline.height.ravel()
    z, label = z.ravel(), label.ravel()
    best, uphill = height[pixel].copy(), pixel.copy()
    own, mine, step = z[pixel], label[pixel], jump[label[pixel]]
    for offset in (-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1):
        there = pixel + offset
        far = z[there]
        on = (label[there] == mine) & (np.abs(far - own) <= step * np.minimum(far, own)) & (height[there] > best)
        best = np.where(on, height[there], best)
        uphill = np.where(on, there, uphill)
    follow = np.arange(len(z), dtype=np.int64)
    follow[pixel] = uphill
    source = pixel
    for _ in range(2 * int(np.ceil(inset))):
        source = np.where(inside[source] < inset, follow[source], source)
    return pixel, source
