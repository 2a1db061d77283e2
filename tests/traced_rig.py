"""A virtual rig whose mirrors may be bowed and thick, traced exactly and apart from ``core.simulation.rays``.

One reflection; what a second would show is not read. For tests of what undoes bow and thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mirror_scan.core.camera import RgbdImage, project, unproject
from mirror_scan.core.capture import Capture, MirrorPicks
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, raycast
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.curved_glass import REFRACTION, flattened
from mirror_scan.core.mirrors.mirror import reflect
from mirror_scan.core.simulation.scene import FramedMirror, Rig
from mirror_scan.core.simulation.sensors import find_sensor, measure

NOTHING, BODY, FRAME, ROOM = range(4)


@dataclass(frozen=True)
class Traced:
    """Ideal ``depth`` (H, W), ``kind`` and ``view`` of each pixel, and where it ``real``ly is, camera frame."""

    capture: Capture
    depth: np.ndarray
    kind: np.ndarray
    view: np.ndarray
    real: np.ndarray

    def displacement(self, mirrors: list[Mirror]) -> list[float]:
        """By how much each mirror misplaces the body it shows, root mean square [m]."""
        out = []
        for k, mirror in enumerate(mirrors, start=1):
            body = (self.view == k) & (self.kind == BODY)
            read = unproject(self.depth, self.capture.intrinsics)[body]
            placed = reflect(flattened(read, mirror, time_of_flight=True), mirror)
            out.append(float(np.sqrt(((placed - self.real[body]) ** 2).sum(axis=1).mean())))
        return out


def trace(subject: Mesh, rig: Rig, sags, thickness: float = 0.0, warp=None, seed: int = 0) -> Traced:
    """``sags``: of each mirror [m], over its height with the frame. ``warp`` (H, W): relative error of all depth."""
    k, pose = rig.intrinsics, rig.camera_to_avatar
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    ray = np.stack(((u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)), axis=-1).reshape(-1, 3)
    along = 1.0 / np.linalg.norm(ray, axis=1)  # z over range
    d, eye = (ray * along[:, None]) @ pose[:3, :3].T, pose[:3, 3]
    bvh = build_bvh(subject.vertices, subject.triangles)
    corners = subject.vertices[subject.triangles]
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets /= np.maximum(np.linalg.norm(facets, axis=1), 1e-12)[:, None]

    def hit(origin, direction):
        """Way to the body or the room, kind, and cosine of incidence."""
        x0, x1, y0, y1, z1 = rig.room
        near, triangle = raycast(bvh, origin, direction)[:2]
        with np.errstate(all="ignore"):
            walls = np.where(direction > 0, (np.array((x1, y1, z1)) - origin) / direction,
                             (np.array((x0, y0, 0.0)) - origin) / direction)  # fmt: skip
        walls = np.where(np.isfinite(walls) & (walls > 1e-9), walls, np.inf)
        axis, far = walls.argmin(axis=1), walls.min(axis=1)
        body = near < far
        normal = np.where(body[:, None], facets[np.where(body, triangle, 0)], np.eye(3)[axis])
        cosine = np.abs(np.einsum("ni,ni->n", normal, direction))
        return np.where(body, near, far), np.where(body, BODY, ROOM), cosine

    way, kind, cosine = hit(np.broadcast_to(eye, d.shape).copy(), d)
    view, first, real = np.zeros(len(d), int), way.copy(), eye + d * way[:, None]
    for index, (m, sag) in enumerate(zip(rig.mirrors, sags, strict=True), start=1):
        for part in (FRAME, NOTHING):
            proud = m.frame_depth if part == FRAME else 0.0
            t, place, normal = _surface(m, sag, proud, eye, d)
            half = np.array((m.width, m.height)) / 2
            glass = (np.abs(place) <= half).all(axis=1)
            on = (np.abs(place) <= half + m.frame_width).all(axis=1) & ~glass if part == FRAME else glass
            i = np.flatnonzero(on & np.isfinite(t) & (t < first))
            first[i], view[i] = t[i], 0 if part == FRAME else index
            if part == FRAME:
                way[i], kind[i], cosine[i], real[i] = t[i], FRAME, np.abs(d[i] @ m.axes[2]), eye + d[i] * t[i, None]
                continue
            c = -np.einsum("ni,ni->n", d[i], normal[i])
            inside = np.sqrt(REFRACTION**2 - 1.0 + c**2)  # n cos θ'
            side = d[i] + c[:, None] * normal[i]
            leaves = eye + d[i] * t[i, None] + 2.0 * thickness / inside[:, None] * side  # 2 T tan θ' along the glass
            turned = d[i] + 2.0 * c[:, None] * normal[i]
            left, what, cosine[i] = hit(leaves + 1e-6 * turned, turned)
            kind[i], way[i] = what, t[i] + left + 2.0 * thickness * REFRACTION**2 / inside
            real[i] = leaves + turned * left[:, None]
            for j, other in enumerate(rig.mirrors, start=1):  # seen by two reflections: not read
                if j != index:
                    s, at, _ = _surface(other, 0.0, 0.0, leaves, turned)
                    edge = np.array((other.width, other.height)) / 2 + other.frame_width
                    twice = (np.abs(at) <= edge).all(axis=1) & (s > 1e-6) & (s < left)
                    kind[i[twice]], way[i[twice]] = NOTHING, 0.0
    shape = k.height, k.width
    depth = (way * along).reshape(shape)
    sensor, rng = find_sensor(rig.sensor), np.random.default_rng(seed)
    read = depth if warp is None else depth * (1.0 + warp)
    incidence = np.arccos(np.clip(cosine, 0.0, 1.0)).reshape(shape)
    burst = measure(sensor, read, incidence, k.fx, rig.frames, rng)
    back = np.linalg.inv(pose)
    kind, view = kind.reshape(shape), view.reshape(shape)
    picks = tuple(_picks(m, sag, back, k, kind, rng) for m, sag in zip(rig.mirrors, sags, strict=True))
    capture = Capture(burst, None, k, picks, "traced", "simulation")
    return Traced(capture, depth, kind, view, (real @ back[:3, :3].T + back[:3, 3]).reshape(*shape, 3))


def _surface(m: FramedMirror, sag: float, proud: float, origin, d):
    """Ways to the bowed surface, places on it (N, 2), and its normals: z = proud + sag (1 - 4 y² / L²)."""
    right, up, n = m.axes
    offset = np.asarray(origin) - np.array(m.centre)
    k = 4.0 * sag / (m.height + 2.0 * m.frame_width) ** 2
    x0, y0, z0 = offset @ right, offset @ up, offset @ n
    dy, dz = d @ up, d @ n
    a, b, c = k * dy**2, dz + 2.0 * k * y0 * dy, z0 - proud - sag + k * y0**2
    with np.errstate(all="ignore"):
        t = np.where(b < 0.0, 2.0 * c / (-b + np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))), np.inf)
    t = np.where(t > 0.0, t, np.inf)
    reach = np.where(np.isfinite(t), t, 0.0)
    y = y0 + reach * dy
    normal = n + (2.0 * k * y)[:, None] * up
    place = np.column_stack((x0 + reach * (d @ right), y))
    return t, place, normal / np.linalg.norm(normal, axis=1)[:, None]


def _picks(m: FramedMirror, sag: float, back, intrinsics, kind, rng) -> MirrorPicks:
    w, h = (m.width + m.frame_width) / 2, (m.height + m.frame_width) / 2
    at = np.linspace(0.0, 4.0, 401)[:-1]
    corners = np.array([(-w, -h), (w, -h), (w, h), (-w, h), (-w, -h)])
    side = at.astype(int)
    flat = corners[side] + (at - side)[:, None] * (corners[side + 1] - corners[side])
    level = m.frame_depth + sag * (1.0 - 4.0 * flat[:, 1] ** 2 / (m.height + 2.0 * m.frame_width) ** 2)
    points = np.array(m.centre) + flat @ m.axes[:2] + level[:, None] * m.axes[2]
    pixels = project(points @ back[:3, :3].T + back[:3, 3], intrinsics) + rng.uniform(-0.7, 0.7, (400, 2))
    u, v = np.rint(pixels).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < intrinsics.width) & (v < intrinsics.height)
    pixels = pixels[inside][kind[v[inside], u[inside]] == FRAME]
    return MirrorPicks(m.name, np.array([part[rng.integers(len(part))] for part in np.array_split(pixels, 8)]))


def fused(traced: Traced) -> RgbdImage:
    """Its burst as one depth image."""
    from mirror_scan.core.depth.depth_map import one_depth_map

    return RgbdImage(one_depth_map(traced.capture)[0], traced.capture.intrinsics)
