"""The camera in the mirrors: where it sees itself, the line of sight is the mirror's normal.

Two mirrors that hang side by side and face the camera both show it, and what stands at its side. How far apart they
show it is how much their normals differ, to a fraction of a degree and whatever the wall behind them is like. The
picture that shows it is the colour image; what the camera looks like need not be known, as both mirrors show the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from ..errors import Notice
from ..mirrors import Mirror
from ..mirrors.mirror import expected_error, moved, with_reason


@dataclass(frozen=True)
class OwnReflectionSettings:
    """When the camera's own reflections may turn two mirrors.

    Parameters
    ----------
    use : bool
    uncertainty : float
        One of them is expected to misplace a person by more than this [m].
    piece : float
        Size of the pieces of what stands about the camera that are looked for [m].
    across, upright : float
        By how much the normals may differ from what the frames say, in the picture's direction across and upright
        [rad].
    alike : float
        Correlation from which two pieces of the picture show the same.
    pieces : int
        So many must agree.
    distinct : float
        So many times as alike as those of any other displacement they must be.
    """

    use: bool = True
    uncertainty: float = 0.012
    piece: float = 0.12
    across: float = 0.12
    upright: float = 0.04
    alike: float = 0.7
    pieces: int = 6
    distinct: float = 1.5


_ABOUT = 0.05  # so far about the glass as it is known it may go on [m]
_SHARE = 0.4  # of the piece that both must show
_ALIKE = 0.006  # so near to each other displacements are the same [rad]
_FEWEST_PIXELS = 8  # to each side of a piece's middle
_LEAST_CONTRAST = 4.0  # standard deviation of a piece's brightness, of 255
_EXACT = 0.0015  # what the difference of the normals is known to, one standard deviation [rad]
_NEAREST, _FARTHEST = 0.3, 3.0  # of the mirrors from the camera [m]


def align_own_reflections(
    image: RgbdImage, mirrors: Sequence[Mirror], settings: OwnReflectionSettings | None = None
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors turned until both of a pair show the camera where their normals say.

    Parameters
    ----------
    image : RgbdImage
        With the colour image, of the same camera; without one nothing is done.

    Returns
    -------
    mirrors : list of Mirror
    notes : tuple of str
        Which were turned, for the user.

    Notes
    -----
    Nothing is looked for while every mirror is certain enough.
    """
    settings = settings or OwnReflectionSettings()
    out, notes = list(mirrors), []
    color = image.color
    if not settings.use or color is None or color.shape[:2] != image.depth.shape:
        return out, ()
    near = [
        k for k, m in enumerate(out)
        if m.covariance is not None and m.source in ("picked", "found") and m.rectangle is not None
        and _NEAREST < -(m.normal @ m.point) < _FARTHEST
    ]  # fmt: skip
    if len(near) < 2 or not any(expected_error(out[k]) > settings.uncertainty for k in near):
        return out, ()
    gray = color.astype(np.float64) @ (0.299, 0.587, 0.114)
    for n, i in enumerate(near):
        for j in near[n + 1 :]:
            if max(expected_error(out[i]), expected_error(out[j])) < settings.uncertainty:
                continue
            apart = _apart(gray, image.intrinsics, out[i], out[j], settings)
            if apart is None:
                continue
            turned = _turned(out[i], out[j], apart, image.intrinsics)
            for k, new in zip((i, j), turned, strict=True):
                out[k] = with_reason(new, out[k], "own reflection")
            angle = float(np.degrees(np.arccos(np.clip(turned[0].normal @ turned[1].normal, -1.0, 1.0))))
            notes.append(
                Notice(
                    "{one} and {other}: the camera's own reflection in both shows that they stand at {angle:.1f}° to "
                    "each other; both were turned accordingly",
                    one=out[i].name,
                    other=out[j].name,
                    angle=angle,
                    mirrors=[out[i].name, out[j].name],
                )  # fmt: skip
            )
    return out, tuple(notes)


def _foot(mirror: Mirror, intrinsics: Intrinsics) -> np.ndarray:
    """The pixel (2,) where the camera would see itself."""
    return project(-mirror.normal[None], intrinsics)[0]


def _in_glasses(one: Mirror, other: Mirror, intrinsics: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """1 for the pixels (H, W) that may lie in the glass of the one, and of the other mirror, else 0.

    Where a mirror without a frame ends on its wall is known badly: the line halfway between both parts them.
    """
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    rays = np.stack(
        ((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(u.shape)), axis=-1
    )
    middles, inside = [], []
    for mirror in (one, other):
        assert mirror.rectangle is not None  # it was asked for
        fall = rays @ mirror.normal
        at = (mirror.normal @ mirror.point) / np.where(fall < -0.05, fall, -np.inf)
        place = (rays * at[..., None] - mirror.point) @ mirror.basis[:, :2]
        within = (place > mirror.rectangle[:, 0] - _ABOUT) & (place < mirror.rectangle[:, 1] + _ABOUT)
        inside.append(within.all(axis=-1) & (fall < -0.05))
        middle = mirror.point + mirror.basis[:, :2] @ mirror.rectangle.mean(axis=1)
        middles.append(project(middle[None], intrinsics)[0])
    across = middles[1] - middles[0]
    nearer = (u * across[0] + v * across[1]) < 0.5 * (middles[0] + middles[1]) @ across
    return (inside[0] & nearer).astype(float), (inside[1] & ~nearer).astype(float)


def _apart(
    gray: np.ndarray, intrinsics: Intrinsics, one: Mirror, other: Mirror, settings: OwnReflectionSettings
) -> np.ndarray | None:
    """By how many pixels (2,) the second shows the camera off where the first does; None where that is not seen.

    Pieces of the picture about where the first should show the camera are looked for in the second. What is near the
    camera is displaced alike, whatever it is; what lies behind it differently, piece by piece.
    """
    height, width = gray.shape
    focal = 0.5 * (intrinsics.fx + intrinsics.fy)
    half = int(round(settings.piece * focal / (4.0 * -float(one.normal @ one.point))))
    feet = np.array((_foot(one, intrinsics), _foot(other, intrinsics)))
    dx, dy = int(settings.across * focal), int(settings.upright * focal)
    if not np.isfinite(feet).all() or half < _FEWEST_PIXELS:
        return None
    mine, theirs = _in_glasses(one, other, intrinsics)
    first, between = np.rint(feet[0]).astype(int), np.rint(feet[1] - feet[0]).astype(int)
    found = []
    for v in range(first[1] - dx // 2, first[1] + dx // 2 + 1, half):
        for u in range(first[0] - dx, first[0] + dx + 1, half):
            low, high = (u - half, v - half), (u + half + 1, v + half + 1)
            if min(low) < 0 or high[0] > width or high[1] > height:
                continue
            here = slice(low[1], high[1]), slice(low[0], high[0])
            if mine[here].mean() < _SHARE:
                continue
            left, top = low[0] + between[0] - dx, low[1] + between[1] - dy
            right, bottom = high[0] + between[0] + dx, high[1] + between[1] + dy
            x, y = max(left, 0), max(top, 0)
            there = slice(y, min(bottom, height)), slice(x, min(right, width))
            if min(gray[there].shape) < 2 * half + 1:
                continue
            score = _correlation(gray[here], mine[here], gray[there], theirs[there])
            row, column = np.unravel_index(np.argmax(score), score.shape)
            if score[row, column] > settings.alike:
                found.append((x + column - low[0], y + row - low[1], score[row, column] - settings.alike))
    return _agreed(np.array(found).reshape(-1, 3), focal, settings)


def _agreed(found: np.ndarray, focal: float, settings: OwnReflectionSettings) -> np.ndarray | None:
    """The displacement (2,) that most pieces agree on, of ``found`` (N, 3): displacements and how alike they are."""
    if len(found) < settings.pieces:
        return None
    gap = np.linalg.norm(found[:, None, :2] - found[None, :, :2], axis=2)
    votes = (gap < _ALIKE * focal) @ found[:, 2]
    best = int(np.argmax(votes))
    near, away = gap[best] < _ALIKE * focal, gap[best] > 2.0 * _ALIKE * focal
    rival = float(votes[away].max()) if away.any() else 0.0
    if near.sum() < settings.pieces or votes[best] < settings.distinct * rival:
        return None
    return np.average(found[near, :2], axis=0, weights=found[near, 2])


def _correlation(piece: np.ndarray, known: np.ndarray, searched: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Normalised correlation of a piece (h, w) with each place (H - h + 1, W - w + 1), over what both masks leave."""

    def slide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Sums of ``a`` times each window of ``b``."""
        size = [n + m - 1 for n, m in zip(a.shape, b.shape, strict=True)]
        full = np.fft.irfft2(np.fft.rfft2(b, size) * np.conj(np.fft.rfft2(a, size)), size)
        return full[: b.shape[0] - a.shape[0] + 1, : b.shape[1] - a.shape[1] + 1]

    middle = float((piece * known).sum() / known.sum())
    a, b = (piece - middle) * known, (searched - middle) * usable
    count = np.maximum(slide(known, usable), 1.0)
    sum_a, sum_b = slide(a, usable), slide(known, b)
    square_a, square_b = slide(a * a, usable), slide(known, b * b)
    spread_a = np.maximum(square_a - sum_a**2 / count, 0.0)
    spread_b = np.maximum(square_b - sum_b**2 / count, 0.0)
    score = (slide(a, b) - sum_a * sum_b / count) / np.sqrt(np.maximum(spread_a * spread_b, 1e-9))
    plain = np.minimum(spread_a, spread_b) < _LEAST_CONTRAST**2 * count
    return np.where(plain | (count < _SHARE * piece.size), -1.0, score)


def _turned(one: Mirror, other: Mirror, apart: np.ndarray, intrinsics: Intrinsics) -> tuple[Mirror, Mirror]:
    """Both turned until their feet are so far ``apart`` [px], each by its share of what they are uncertain."""
    out = []
    error = apart - (_foot(other, intrinsics) - _foot(one, intrinsics))
    error = error / (intrinsics.fx, intrinsics.fy)  # [rad], nearly: the feet lie near the picture's middle
    spreads = []
    for mirror in (one, other):
        assert mirror.covariance is not None  # it was asked for
        spreads.append(mirror.covariance[:2, :2] + np.eye(2) * 1e-8)
    # what the camera sees of itself is certain: where frames contradict it, they are less certain than they seemed
    allowed = sum(float(np.trace(spread)) for spread in spreads)
    doubt = max(1.0, float(error @ error) / allowed)
    spreads = [spread * doubt for spread in spreads]
    for mirror, sign in ((one, -1.0), (other, 1.0)):
        # slopes (α, β) turn the normal by -α a - β b, and the foot with it
        foot = -mirror.normal
        change = (mirror.basis[:2, :2] - foot[:2, None] / foot[2] * mirror.basis[2:, :2]) / foot[2]
        variances = [c @ s @ c.T for c, s in zip((change, change), spreads, strict=True)]
        total = variances[0] + variances[1] + np.eye(2) * _EXACT**2
        k = 0 if sign < 0.0 else 1
        gain = spreads[k] @ change.T @ np.linalg.inv(total)
        step = sign * (gain @ error)
        left = spreads[k] - gain @ change @ spreads[k]
        turned = moved(mirror, np.append(step, 0.0))
        covariance = np.array(mirror.covariance)
        covariance[:2, :2] = 0.5 * (left + left.T)
        out.append(replace(turned, covariance=covariance))
    return out[0], out[1]
