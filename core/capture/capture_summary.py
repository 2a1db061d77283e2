"""What a capture holds, for a person: in words and as a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .capture import Capture


def words(capture: Capture) -> Iterator[str]:
    """Lines for a person: sensor, sizes, range, coverage, noise, mirrors, notes, and a histogram of the range."""
    depth, camera = capture.depth, capture.intrinsics
    frames = len(depth)
    valid = depth > 0
    z = depth[valid]
    near, far = (float(v) for v in np.percentile(z, (0.5, 99.5)))
    fov = [2 * math.degrees(math.atan2(n, 2 * f)) for n, f in ((camera.width, camera.fx), (camera.height, camera.fy))]
    yield f"{capture.name}: {capture.format}"
    count = f"{frames} frames" if frames > 1 else "1 frame"
    if capture.sensor != "unknown":
        yield f"  sensor   {capture.sensor}"
    yield f"  depth    {camera.width}×{camera.height}, {count}, {near:.2f} to {far:.2f} m"
    yield (
        f"  camera   fx {camera.fx:.1f}, fy {camera.fy:.1f}, cx {camera.cx:.1f}, cy {camera.cy:.1f} px; "
        f"view {fov[0]:.0f}° × {fov[1]:.0f}°"
    )
    coverage = f"  readings at {valid.mean():.0%} of the pixels"
    if frames > 1:
        coverage += f"; {valid.all(axis=0).mean():.0%} in every frame, {valid.any(axis=0).mean():.0%} in any"
    yield coverage
    if frames > 1:
        steady = valid[0] & valid[1]
        if steady.any():
            noise = np.median(np.abs(depth[1][steady] - depth[0][steady])) / (math.sqrt(2) * 0.6745)
            yield f"  noise    {noise * 1e3:.1f} mm from frame to frame (median over the pixels)"
    yield "  colour   " + _color(capture)
    if not capture.mirrors:
        yield "  mirrors  none in the file; pick points on their frames and save them in mirrors.json"
    for mirror in capture.mirrors:
        known = f"{len(mirror.frame_pixels)} points on its frame" if mirror.frame_pixels is not None else "known plane"
        yield f"  mirror   {mirror.name}: {known}"
    for note in capture.notes:
        yield f"  note     {note}"
    yield "  range    share of the readings"
    edges = np.linspace(near, far, 11) if far > near else np.array((near - 0.05, near + 0.05))
    shares = np.histogram(np.clip(z, edges[0], edges[-1]), edges)[0] / z.size
    for low, high, share in zip(edges, edges[1:], shares, strict=False):
        bar = "#" * round(40 * share / shares.max())
        yield f"    {low:5.2f} to {high:5.2f} m {share:6.1%} {bar}"


def _color(capture: Capture) -> str:
    """Size of the colour image, and of the colour camera's own where that is another."""
    color, own = capture.color, capture.native_color
    if color is None:
        return "none"
    size = f"{color.shape[1]}×{color.shape[0]}"
    if own is None or own.shape == color.shape:
        return size
    return f"{size}, aligned to depth; the colour camera's own {own.shape[1]}×{own.shape[0]}"


def picture(capture: Capture) -> np.ndarray:
    """First frame's depth in colours (near yellow, far violet, no reading black) beside the colour image.

    Picks on the mirrors' frames are marked by red crosses.

    Returns
    -------
    np.ndarray [shape=(H, W or 2 W, 3), dtype=uint8]
    """
    depth = capture.depth[0] if capture.depth[0].any() else capture.depth.max(axis=0)
    valid = depth > 0
    near, far = np.percentile(depth[valid], (1, 99))
    shade = np.clip((far - depth) / max(far - near, 1e-6), 0, 1)
    stops = np.linspace(0, 1, 6)
    anchors = ((68, 1, 84), (65, 68, 135), (42, 120, 142), (34, 168, 132), (122, 209, 81), (253, 231, 37))
    colored = np.stack([np.interp(shade, stops, channel) for channel in np.transpose(anchors)], axis=-1)
    colored[~valid] = 0
    image = np.rint(colored).astype(np.uint8)
    if capture.color is not None:
        image = np.hstack((image, capture.color))
    height, width = depth.shape
    for mirror in capture.mirrors:
        for u, v in np.rint(mirror.frame_pixels if mirror.frame_pixels is not None else []).astype(int):
            for shift in range(-4, 5):
                for x, y in ((u + shift, v), (u, v + shift)):
                    if 0 <= x < width and 0 <= y < height:
                        image[y, x::width] = (255, 40, 40)
    return image
