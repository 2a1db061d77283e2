"""Rays through a room with mirrors: what each pixel sees, how far along the folded path, and what lights it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..mesh import Mesh
from ..mesh.bvh import STACK, Bvh, build_bvh, raycast_one
from ..numeric.kernels import njit
from ..numeric.threads import each_range
from .props import together
from .scene import BACKING, GLASS_INDEX, Rig, room_waves

NOTHING, BODY, FLOOR, WALL, FRAME, PROP = 0, 1, 2, 3, 4, 5
MAX_BOUNCES = 6
SILVER = 0.88
"""Share of the light a mirror gives back."""
_NUDGE = 5e-4  # metres off a surface before looking back at a light


@dataclass(frozen=True)
class Sight:
    """What each pixel sees; every array is (H, W) or (H, W, 3).

    ``depth`` float64 [m]: z of the point along the unfolded ray, behind the mirrors; 0 = nothing. ``object`` uint8:
    ``NOTHING``, ``BODY``, ``FLOOR``, ``WALL``, ``FRAME``, ``PROP``. ``index`` int32: triangle of the body (of what else
    stands there, those of the body counted first), number of the wall
    or, from 0, of the mirror whose frame it is; else -1. ``view`` int8: 0 = direct, n = by way of mirror n first.
    ``bounces`` uint8: reflections on the way; 2 or more are images in images. ``incidence`` float32 [rad]: ray to
    surface normal. ``color`` uint8 sRGB. ``point``, ``normal`` float64: where the light comes from, avatar frame.
    ``delay`` float64 [m]: by how much the glass on the way is longer for light than geometry says, one way.
    """

    depth: np.ndarray
    object: np.ndarray
    index: np.ndarray
    view: np.ndarray
    bounces: np.ndarray
    incidence: np.ndarray
    color: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    delay: np.ndarray


def look(subject: Mesh, rig: Rig, props: Sequence[Mesh] = ()) -> tuple[Sight, Bvh]:
    """Trace one ray a pixel through the scene.

    O(H · W · log T); about 120 bytes a pixel. Subject and props are in the avatar frame.
    """
    everything = together(subject, *props)
    vertices = np.ascontiguousarray(everything.vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(everything.triangles, dtype=np.int32)
    bvh = build_bvh(vertices, triangles)
    assert everything.colors is not None  # together gives every mesh its colours
    colors = everything.colors.astype(np.float64)
    intrinsics, pose = rig.intrinsics, rig.camera_to_avatar
    shape = (intrinsics.height, intrinsics.width)
    depth, color = np.zeros(shape), np.zeros((*shape, 3), dtype=np.uint8)
    kind, index = np.zeros(shape, dtype=np.uint8), np.full(shape, -1, dtype=np.int32)
    view, bounces = np.zeros(shape, dtype=np.int8), np.zeros(shape, dtype=np.uint8)
    incidence, point, normal = np.zeros(shape, dtype=np.float32), np.zeros((*shape, 3)), np.zeros((*shape, 3))
    delay = np.zeros(shape)
    each_range(
        _look, intrinsics.height,
        bvh, triangles, len(subject.triangles), _vertex_normals(vertices, triangles), colors, _mirror_rows(rig),
        _room_box(rig), room_waves(rig),
        pose[:3, 3].copy(), pose[:3, :3].copy(), intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy,
        depth, kind, index, view, bounces, incidence, color, point, normal, delay,
    )  # fmt: skip
    return Sight(depth, kind, index, view, bounces, incidence, color, point, normal, delay), bvh


def lit(sight: Sight, bvh: Bvh, rig: Rig, baseline: float) -> np.ndarray:
    """How strongly a projector to the right of the camera lights what each pixel sees, by each way.

    Parameters
    ----------
    sight, bvh
        From :func:`look`.
    rig : Rig
    baseline : float
        Projector's place on the camera's x axis [m]; it looks where the camera looks.

    Returns
    -------
    np.ndarray [shape=(H, W, 1 + M), dtype=float32]
        cos / r² by the direct way and by each of the M mirrors once, r along the folded path; 0 = not reached. Ways by
        two mirrors are left out: they are long and weak.
    """
    intrinsics, pose = rig.intrinsics, rig.camera_to_avatar
    light = np.zeros((*sight.depth.shape, 1 + len(rig.mirrors)), dtype=np.float32)
    projector = pose[:3, 3] + baseline * pose[:3, 0]
    # The pattern reaches a little further than the picture.
    right, down = intrinsics.width - 1 - intrinsics.cx, intrinsics.height - 1 - intrinsics.cy
    reach = 1.06 * np.array(
        [-intrinsics.cx / intrinsics.fx, right / intrinsics.fx, -intrinsics.cy / intrinsics.fy, down / intrinsics.fy]
    )
    turn = pose[:3, :3].copy()
    each_range(
        _light, len(light), bvh, _mirror_rows(rig), projector, turn, reach, sight.object, sight.point, sight.normal,
        light,
    )  # fmt: skip
    return light


def lit_by(sight: Sight, bvh: Bvh, rig: Rig, other: Rig, baseline: float) -> np.ndarray:
    """How strongly the projector of another camera lights what each pixel of ``rig``'s sees: cos / r² (H, W), float32.

    Straight, and by each of the rig's mirrors once; ``baseline`` as of :func:`lit`.
    """
    stranger = replace(rig, intrinsics=other.intrinsics, camera=other.camera, pan_deg=other.pan_deg,
                       tilt_deg=other.tilt_deg, roll_deg=other.roll_deg)  # fmt: skip
    return lit(sight, bvh, stranger, baseline).sum(axis=-1)


def _vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(triangles[:, k], face[:, axis], len(vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1.0)


def _mirror_rows(rig: Rig) -> np.ndarray:
    """(M, 19): centre, right, up, normal, half width, half height, frame width, frame depth, two sags, thickness."""
    rows = np.empty((len(rig.mirrors), 19))
    for row, m in zip(rows, rig.mirrors, strict=True):
        sizes = (m.width / 2, m.height / 2, m.frame_width, m.frame_depth, *m.sag, m.glass_thickness)
        row[:] = (*m.centre, *m.axes.ravel(), *sizes)
    return rows


def _room_box(rig: Rig) -> np.ndarray:
    """x0, y0, z0, x1, y1, z1 of floor, walls and ceiling; infinite where there is none."""
    x0, x1, y0, y1, z1 = (-np.inf, np.inf, -np.inf, np.inf, np.inf) if rig.room is None else rig.room
    return np.array([x0, y0, 0.0 if rig.floor else -np.inf, x1, y1, z1])


@njit(cache=True, nogil=True, error_model="numpy")
def _box(low, high, o, d, t_max):
    """Entry into an axis-aligned box: (t, axis entered through), (inf, -1) for a miss or a start inside."""
    near, far, axis = -np.inf, np.inf, -1
    for a in range(3):
        if d[a] == 0.0:
            if o[a] < low[a] or o[a] > high[a]:
                return np.inf, -1
            continue
        t0, t1 = (low[a] - o[a]) / d[a], (high[a] - o[a]) / d[a]
        if t0 > t1:
            t0, t1 = t1, t0
        if t0 > near:
            near, axis = t0, a
        far = min(far, t1)
    if near > far or near <= 1e-9 or near >= t_max:
        return np.inf, -1
    return near, axis


@njit(cache=True, nogil=True, error_model="numpy")
def _bow(row, x, y):
    """How far a bowed glass stands in front of its mean plane at x, y; see :func:`.scene.bow`."""
    x, y = x / row[12], y / row[13]
    return row[16] * (1.0 / 3.0 - x * x) + row[17] * (1.0 / 3.0 - y * y)


@njit(cache=True, nogil=True, error_model="numpy")
def _mirror(row, origin, direction, t_max, local_o, local_d, low, high, normal):
    """First hit of one framed mirror: (t, 1 glass | 2 frame, inf 0 none); the frame's normal to ``normal``."""
    for a in range(3):
        local_o[a], local_d[a] = 0.0, 0.0
        for k in range(3):
            axis = row[3 + 3 * a + k]
            local_o[a] += axis * (origin[k] - row[k])
            local_d[a] += axis * direction[k]
    hw, hh, frame, proud = row[12], row[13], row[14], row[15]
    best, what, face = t_max, 0, -1
    bowed = row[16] != 0.0 or row[17] != 0.0
    if local_o[2] > 0.0 and local_d[2] < 0.0:
        t = -local_o[2] / local_d[2]
        if bowed:
            for _ in range(4):  # each step brings it nearer by the slope, some thousandths
                t = (_bow(row, local_o[0] + t * local_d[0], local_o[1] + t * local_d[1]) - local_o[2]) / local_d[2]
        if 1e-9 < t < best and abs(local_o[0] + t * local_d[0]) <= hw and abs(local_o[1] + t * local_d[1]) <= hh:
            best, what = t, 1
    if bowed and frame > 0.0:
        # The frame bends with the glass: boxes are met where the frame stands at the place the ray makes for.
        t = (proud - local_o[2]) / local_d[2] if local_d[2] != 0.0 else 0.0
        t = max(t, 0.0)
        x = min(max(local_o[0] + t * local_d[0], -hw - frame), hw + frame)
        y = min(max(local_o[1] + t * local_d[1], -hh - frame), hh + frame)
        local_o[2] -= _bow(row, x, y)
    for part in range(5):
        if part > 0 and frame <= 0.0:
            break
        low[2], high[2] = -BACKING, proud
        low[0], high[0], low[1], high[1] = -hw - frame, hw + frame, -hh - frame, hh + frame
        if part == 0:
            high[2] = -0.5 * BACKING
        elif part == 1:
            high[0] = -hw
        elif part == 2:
            low[0] = hw
        elif part == 3:
            high[1], low[0], high[0] = -hh, -hw, hw
        else:
            low[1], low[0], high[0] = hh, -hw, hw
        t, axis = _box(low, high, local_o, local_d, best)
        if axis >= 0:
            best, what, face = t, 2, axis
    if what == 2:
        for k in range(3):
            normal[k] = row[3 + 3 * face + k] * (-1.0 if local_d[face] > 0 else 1.0)
    return best, what


@njit(cache=True, nogil=True, error_model="numpy")
def _tilt(row, origin, direction, t, normal):
    """Unit normal of a bowed glass where a ray meets it, to ``normal``."""
    x, y = 0.0, 0.0
    for a in range(3):
        at = origin[a] + t * direction[a] - row[a]
        x += at * row[3 + a]
        y += at * row[6 + a]
    x, y = 2.0 * row[16] * x / row[12] ** 2, 2.0 * row[17] * y / row[13] ** 2
    long = np.sqrt(1.0 + x * x + y * y)
    for a in range(3):
        normal[a] = (row[9 + a] + x * row[3 + a] + y * row[6 + a]) / long


@njit(cache=True, nogil=True, error_model="numpy")
def _reflect(row, o, d, t, length, normal):
    """Reflect a ray that meets a glass at ``t``: (further way before it turns back, delay in the glass)."""
    for a in range(3):
        normal[a] = row[9 + a]
    if row[16] != 0.0 or row[17] != 0.0:
        _tilt(row, o, d, t, normal)
    along, more, late = 0.0, 0.0, 0.0
    for a in range(3):
        along += d[a] * normal[a]
    if row[18] > 0.0:
        # Silver behind glass acts as a mirror that lies shallower: see :func:`.scene.apparent_depth` and `glass_delay`.
        sine = 1.0 - (along / length) ** 2
        more = row[18] / np.sqrt(GLASS_INDEX**2 - sine) / length
        late = 2.0 * row[18] * (GLASS_INDEX - 1.0 / GLASS_INDEX) / np.sqrt(1.0 - sine / GLASS_INDEX**2)
    for a in range(3):
        o[a] += (t + more) * d[a]
        d[a] -= 2.0 * along * normal[a]
        o[a] += 1e-9 * normal[a]
    return more, late


@njit(cache=True, nogil=True, error_model="numpy")
def _uneven(waves, what, side, room, o, d, t):
    """Where a ray meets a floor or wall that is not flat, having met the flat one at ``t``."""
    a = side % 3
    b, c = (a + 1) % 3, (a + 2) % 3
    inward = 1.0 if side < 3 else -1.0
    height = 3 if what == FLOOR else 4
    for _ in range(3):
        rise = 0.0
        for k in range(waves.shape[0]):
            turn = waves[k, 0] * (o[b] + t * d[b]) + waves[k, 1] * (o[c] + t * d[c]) + waves[k, 2]
            rise += waves[k, height] * np.sin(turn)
        # A ray that grazes is moved no further than a hundred times the rise.
        slant = d[a] if abs(d[a]) > 0.01 else np.copysign(0.01, d[a])
        t += (room[side] + inward * rise - (o[a] + t * d[a])) / slant
    return t


@njit(cache=True, nogil=True)
def _look(
    begin, end, bvh, triangles, of_body, vertex_normals, vertex_colors, mirrors, room, waves, eye, turn, fx, fy, cx, cy,
    depth, kind, index, view, bounces, incidence, color, point, normals, delay,
):  # fmt: skip
    for v in range(begin, end):
        _look_row(
            v, bvh, triangles, of_body, vertex_normals, vertex_colors, mirrors, room, waves, eye, turn, fx,
            fy, cx, cy, depth, kind, index, view, bounces, incidence, color, point, normals, delay,
        )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _look_row(
    v, bvh, triangles, of_body, vertex_normals, vertex_colors, mirrors, room, waves, eye, turn, fx, fy, cx, cy,
    depth, kind, index, view, bounces, incidence, color, point, normals, delay,
):  # fmt: skip
    stack = np.empty(STACK, dtype=np.int32)
    o, d, n, m, shade, tint = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    s0, s1, s2, s3 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for u in range(depth.shape[1]):
        ray_x, ray_y = (u - cx) / fx, (v - cy) / fy
        for a in range(3):
            o[a] = eye[a]
            d[a] = turn[a, 0] * ray_x + turn[a, 1] * ray_y + turn[a, 2]
        # The camera-frame ray has z = 1 and reflection keeps its length, so t along the folded path is depth.
        length = np.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0)
        travelled, late, first, bounce = 0.0, 0.0, 0, 0
        while bounce <= MAX_BOUNCES:
            t, tri, wb, wc = raycast_one(bvh, o[0], o[1], o[2], d[0], d[1], d[2], np.inf, stack)
            what, which = NOTHING, -1
            if tri >= 0:
                what, which = BODY if tri < of_body else PROP, tri
            for a in range(3):
                if d[a] != 0.0:
                    side = a if d[a] < 0.0 else a + 3
                    reach = (room[side] - o[a]) / d[a]
                    if 1e-9 < reach < t:
                        t, which = reach, side
                        what = FLOOR if side == 2 else WALL
                        n[0], n[1], n[2] = 0.0, 0.0, 0.0
                        n[a] = 1.0 if d[a] < 0.0 else -1.0
            glass = -1
            for j in range(mirrors.shape[0]):
                at, hit = _mirror(mirrors[j], o, d, t, s0, s1, s2, s3, m)
                if hit == 1:
                    t, glass = at, j
                elif hit == 2:
                    t, which, what, glass = at, j, FRAME, -1
                    n[0], n[1], n[2] = m[0], m[1], m[2]
            travelled += t
            if glass >= 0:
                if first == 0:
                    first = glass + 1
                more, waited = _reflect(mirrors[glass], o, d, t, length, m)
                travelled += more
                late += waited
                bounce += 1
                continue
            break
        view[v, u], bounces[v, u] = first, bounce
        if bounce > MAX_BOUNCES or what == NOTHING or not np.isfinite(travelled):
            continue
        if what == BODY or what == PROP:
            i, j, k = triangles[which, 0], triangles[which, 1], triangles[which, 2]
            wa = 1.0 - wb - wc
            for a in range(3):
                shade[a] = wa * vertex_normals[i, a] + wb * vertex_normals[j, a] + wc * vertex_normals[k, a]
                tint[a] = wa * vertex_colors[i, a] + wb * vertex_colors[j, a] + wc * vertex_colors[k, a]
                n[a] = shade[a]
        if waves.shape[0] > 0 and (what == FLOOR or what == WALL):
            more = _uneven(waves, what, which, room, o, d, t) - t
            t += more
            travelled += more
        px, py, pz = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
        if what == FLOOR:
            light = 0.92 if (int(np.floor(px / 0.6)) + int(np.floor(py / 0.6))) % 2 == 0 else 1.0
            tint[0], tint[1], tint[2] = 118.0 * light, 106.0 * light, 94.0 * light
        elif what == WALL:
            tint[0], tint[1], tint[2] = 206.0, 206.0, 202.0
        elif what == FRAME:
            tint[0], tint[1], tint[2] = 66.0, 44.0, 28.0
        facing = -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) / length
        turned = 1.0
        if facing < 0.0:
            facing, turned = -facing, -1.0
        # A soft key light from above and ahead, a lamp at the camera, and the room's own glow.
        key = max(turned * (-0.35 * n[0] - 0.45 * n[1] + 0.82 * n[2]), 0.0)
        bright = (0.42 + 0.30 * key + 0.34 * facing) * SILVER**bounce
        norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        depth[v, u], kind[v, u], index[v, u], delay[v, u] = travelled, what, which, late
        incidence[v, u] = np.arccos(min(facing / norm, 1.0))
        point[v, u, 0], point[v, u, 1], point[v, u, 2] = px, py, pz
        for a in range(3):
            color[v, u, a] = np.uint8(min(max(tint[a] * bright + 0.5, 0.0), 255.0))
            normals[v, u, a] = turned * n[a] / norm


@njit(cache=True, nogil=True, error_model="numpy")
def _blocked(bvh, mirrors, a, b, through, stack, d, s0, s1, s2, s3, m):
    """Does the body or a mirror stand between points a and b? The glass of mirror ``through`` does not count."""
    for k in range(3):
        d[k] = b[k] - a[k]
    for j in range(mirrors.shape[0]):
        hit = _mirror(mirrors[j], a, d, 1.0 - 1e-6, s0, s1, s2, s3, m)[1]
        if hit == 2 or (hit == 1 and j != through):
            return True
    return raycast_one(bvh, a[0], a[1], a[2], d[0], d[1], d[2], 1.0 - 1e-6, stack)[1] >= 0


@njit(cache=True, nogil=True)
def _light(begin, end, bvh, mirrors, projector, turn, reach, kind, point, normals, light):
    for v in range(begin, end):
        _light_row(v, bvh, mirrors, projector, turn, reach, kind, point, normals, light)


@njit(cache=True, nogil=True, error_model="numpy")
def _light_row(v, bvh, mirrors, projector, turn, reach, kind, point, normals, light):
    stack = np.empty(STACK, dtype=np.int32)
    p, q, s, d, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    s0, s1, s2, s3 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for u in range(kind.shape[1]):
        if kind[v, u] == NOTHING:
            continue
        for a in range(3):
            p[a] = point[v, u, a] + _NUDGE * normals[v, u, a]
        for way in range(light.shape[2]):
            s[0], s[1], s[2] = projector[0], projector[1], projector[2]
            if way > 0:
                off = 0.0
                for a in range(3):
                    off += mirrors[way - 1, 9 + a] * (projector[a] - mirrors[way - 1, a])
                if off <= 0.0:
                    continue
                for a in range(3):
                    s[a] -= 2.0 * off * mirrors[way - 1, 9 + a]
            squared, facing = 0.0, 0.0
            for a in range(3):
                squared += (s[a] - p[a]) ** 2
                facing += (s[a] - p[a]) * normals[v, u, a]
            if facing <= 0.0:
                continue
            q[0], q[1], q[2] = p[0], p[1], p[2]
            if way > 0:
                above, below = 0.0, 0.0
                for a in range(3):
                    above += mirrors[way - 1, 9 + a] * (p[a] - mirrors[way - 1, a])
                    below += mirrors[way - 1, 9 + a] * (s[a] - mirrors[way - 1, a])
                if above <= 0.0:
                    continue
                share = above / (above - below)
                right, up = 0.0, 0.0
                for a in range(3):
                    q[a] = p[a] + share * (s[a] - p[a])
                    right += mirrors[way - 1, 3 + a] * (q[a] - mirrors[way - 1, a])
                    up += mirrors[way - 1, 6 + a] * (q[a] - mirrors[way - 1, a])
                if abs(right) > mirrors[way - 1, 12] or abs(up) > mirrors[way - 1, 13]:
                    continue
            x, y, z = 0.0, 0.0, 0.0
            for a in range(3):
                x += turn[a, 0] * (q[a] - projector[a])
                y += turn[a, 1] * (q[a] - projector[a])
                z += turn[a, 2] * (q[a] - projector[a])
            if z <= 0.0 or x < reach[0] * z or x > reach[1] * z or y < reach[2] * z or y > reach[3] * z:
                continue
            if way > 0 and _blocked(bvh, mirrors, p, q, way - 1, stack, d, s0, s1, s2, s3, m):
                continue
            if _blocked(bvh, mirrors, projector, q, way - 1, stack, d, s0, s1, s2, s3, m):
                continue
            light[v, u, way] = facing / squared**1.5
