"""What is drawn over the 3D viewport while a camera is looked at live: its points, mirrors, advice and its arrows.

The picture is of this session and in no file. In a Blender without a window nothing is drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

if TYPE_CHECKING:
    from ..tasks.live_frames import LivePicture

WARNING, GOOD, NOTE = (0.98, 0.72, 0.16), (0.3, 0.88, 0.4), (0.75, 0.75, 0.78)
"""sRGB of advice that the burst waits for, of all that is well, and of what is only said."""

POINT_SIZE = 5.0  # px
_BEHIND = (0.0, 0.0, 0.0, 0.65)  # what is written is read on white walls too
_BELOW = 130  # px at 100 % scale: advice begins so far below the viewport's top, under what Blender writes there
_HEAD = 0.12, 0.05  # m: length and half width of an arrow's head

_shown: list[LivePicture] = []  # the picture, while there is one
_batch: list[tuple[int, Any]] = []  # number of a picture, and its points on the graphics card


def show(picture: LivePicture | None) -> None:
    """Draw this picture from now on; None ends it."""
    _shown[:] = [] if picture is None else [picture]
    if picture is None:
        _batch.clear()


def shown() -> LivePicture | None:
    """The picture that is drawn."""
    return _shown[0] if _shown else None


def lines_of(picture: LivePicture) -> list[tuple[str, tuple[float, float, float]]]:
    """What is written in the viewport, and in which colour; the most urgent first."""
    from ...core.errors import Notice
    from ..language.texts import as_sentence, say, tell

    colors = {"warning": WARNING, "note": NOTE}
    lines = [(as_sentence(tell(Notice.of_parts(one["text"]))), colors[one["severity"]]) for one in picture.advices]
    if picture.state == "burst":
        text = say("Hold still: {done:.0%} taken, moved by {moved:.0f} mm")
        return [(text.format(done=picture.share, moved=1000.0 * picture.moved_m), GOOD)]
    if picture.retaken:
        lines.append((say("You moved during the burst; it is taken again"), NOTE))
    if picture.state == "counting down":
        lines = lines[-1:] if picture.retaken else []
        return [(say("All is well, hold still: {seconds:.0f}").format(seconds=picture.left_s + 0.49), GOOD), *lines]
    if picture.well:
        lines.insert(0, (say("All is well"), GOOD))
    return lines


def arrow_segments(start, end) -> list[tuple[float, float, float]]:
    """Ends of the lines of an arrow from ``start`` to ``end`` (3,) each, in pairs."""
    import numpy as np

    start, end = np.asarray(start, float), np.asarray(end, float)
    along = end - start
    length = float(np.linalg.norm(along))
    if length < 1e-6:
        return []
    along /= length
    aside = np.cross(along, (0.0, 0.0, 1.0) if abs(along[2]) < 0.9 else (1.0, 0.0, 0.0))
    aside /= np.linalg.norm(aside)
    long, wide = (part * min(1.0, length / 0.2) for part in _HEAD)
    barbs = [end - long * along + sign * wide * aside for sign in (-1.0, 1.0)]
    return [tuple(map(float, place)) for place in (start, end, end, barbs[0], end, barbs[1])]


# --- drawing ---------------------------------------------------------------------------------------------------------


def draw_view(context: bpy.types.Context) -> bool:
    """Draw points, mirrors and arrows in 3D; whether there is a picture."""
    picture = shown()
    if picture is None:
        return False
    import gpu
    from mathutils import Matrix

    gpu.matrix.push()
    try:
        gpu.matrix.multiply_matrix(Matrix(picture.placement.tolist()))
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        gpu.state.active_framebuffer_get().clear(depth=1.0)  # nothing of the scene hides what the camera sees
        _draw_points(context, picture)
        gpu.state.depth_mask_set(False)
        _draw_lines(context, picture)
    finally:
        gpu.matrix.pop()
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")
    return True


def _draw_points(context: bpy.types.Context, picture: LivePicture) -> None:
    import gpu
    import numpy as np

    from .overlay import point_shader

    if not _batch or _batch[0][0] != picture.number:
        batch = None
        if len(picture.points):
            rgba = np.full((len(picture.points), 4), 255, np.uint8)
            rgba[:, :3] = picture.colors
            layout = gpu.types.GPUVertFormat()
            layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
            layout.attr_add(id="color", comp_type="U8", len=4, fetch_mode="INT_TO_FLOAT_UNIT")
            buffer = gpu.types.GPUVertBuf(len=len(picture.points), format=layout)
            buffer.attr_fill(id="pos", data=np.ascontiguousarray(picture.points, np.float32))
            buffer.attr_fill(id="color", data=rgba)
            batch = gpu.types.GPUBatch(type="POINTS", buf=buffer)
        _batch[:] = [(picture.number, batch)]
    if _batch[0][1] is not None:
        _batch[0][1].draw(point_shader("FLAT", POINT_SIZE * context.preferences.system.ui_scale))


def _draw_lines(context: bpy.types.Context, picture: LivePicture) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    scale, region = context.preferences.system.ui_scale, context.region
    line = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("NONE")
    blamed = {one["where"] for one in picture.advices if one["severity"] == "warning"}
    for color, width, segments in (
        *((WARNING if m["name"] in blamed else GOOD, 2.0, _outline(m["corners"])) for m in picture.mirrors),
        *((WARNING, 4.0, arrow_segments(*one["arrow"])) for one in picture.advices if one["arrow"]),
    ):
        if not segments:
            continue
        line.bind()
        line.uniform_float("viewportSize", (region.width, region.height))
        line.uniform_float("lineWidth", width * scale)
        line.uniform_float("color", (*color, 1.0))
        batch_for_shader(line, "LINES", {"pos": segments}).draw(line)


def _outline(corners: list) -> list:
    return [tuple(corners[j % 4]) for k in range(4) for j in (k, k + 1)]


def draw_text(context: bpy.types.Context, left: float, right: float) -> bool:
    """Write advice, countdown and the hold-still bar between two columns of the viewport.

    Returns whether there is a picture.
    """
    picture = shown()
    if picture is None:
        return False
    import blf

    from ..language.texts import wrapped

    scale = context.preferences.system.ui_scale
    y = context.region.height - _BELOW * scale
    room = max(right - left - 24 * scale, 1.0)
    for number, (text, color) in enumerate(lines_of(picture)):
        size = (22 if number == 0 else 15) * scale
        blf.size(0, size)
        for line in wrapped(text, room, lambda part: blf.dimensions(0, part)[0]):
            wide = blf.dimensions(0, line)[0]
            x = left + (right - left - wide) / 2
            _fill((x - 0.4 * size, y - 0.32 * size), (x + wide + 0.4 * size, y + 0.95 * size), _BEHIND)
            blf.position(0, x, y, 0)
            blf.color(0, *color, 1)
            blf.draw(0, line)
            y -= 1.27 * size
        y -= 0.25 * size
    if picture.state == "burst":
        _bar(left + 0.3 * (right - left), y, 0.4 * (right - left), 10 * scale, picture.share)
    return True


def _bar(x: float, y: float, width: float, height: float, share: float) -> None:
    """A bar of which a share is filled."""
    for part, color in ((1.0, _BEHIND), (share, (*GOOD, 1.0))):
        _fill((x, y), (x + part * width, y + height), color)


def _fill(low: tuple[float, float], high: tuple[float, float], color: tuple[float, float, float, float]) -> None:
    """A rectangle over the viewport."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    plain = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    plain.bind()
    plain.uniform_float("color", color)
    corners = [low, (high[0], low[1]), high, low, high, (low[0], high[1])]
    batch_for_shader(plain, "TRIS", {"pos": corners}).draw(plain)
    gpu.state.blend_set("NONE")
