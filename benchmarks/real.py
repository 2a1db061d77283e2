"""Real captures that others have published: a person from all sides, rooms with mirrors, what the readers make of them.

``python -m benchmarks --only real --captures DIR [--pictures DIR]``: DIR holds clones of the repositories below, by
their names. What is absent is skipped, and said. Nothing of them is copied.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.capture import MirrorPicks, ReadOptions, open_capture
from mirror_scan.core.capture.camera_poses import POSES_FILE, open_posed_captures
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import read_image, write_png
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.half_edges import open_edges
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import expected_error
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.pipeline import Reconstruction, Settings
from mirror_scan.core.pipeline.mirror_placement import place_mirrors
from mirror_scan.core.pipeline.multi_camera import reconstruct_views
from mirror_scan.core.preview.mesh_views import KIND_COLORS, render_views
from scipy.spatial import cKDTree

from .machine import say
from .results import Finding, Result, Table, number, yes

PERSON = "CV2"
"""Tomaat/CV2, ``a1/data``: a person who turns before a Kinect v1, cut at the waist, with masks and poses."""
ROOMS = "CS231aProject"
"""ybson-git/CS231aProject, ``kinect``: rooms with mirrors, Azure Kinect, depth warped to the colour camera."""

FOUR, TWO = (0, 24, 48, 72), (0, 48)
HELD_OUT = (6, 12, 18, 30, 36, 42, 54, 60, 66, 78, 84, 90)
LENS = Intrinsics(640, 480, 525.0, 525.0, 320.0, 240.0)
ROOM_LENS = Intrinsics(1280, 720, 607.4, 607.2, 638.2, 366.0)
"""Typical of an Azure Kinect's colour camera at this size; the repository does not give its own."""
DOORS, APART = "kinect_mirror4", 8.2
"""A cabinet with two mirror doors, and the angle between them [degrees]: the camera sees itself in both."""
DOOR_PICKS = (
    ((386, 122), (520, 118), (656, 116), (672, 340), (684, 560), (530, 566), (384, 570), (385, 340)),
    ((668, 114), (800, 110), (935, 104), (962, 320), (985, 540), (840, 548), (692, 552), (680, 340)),
)
"""Points on the edge of either door [px]."""
SIDES = ((0, 0, -1), (1, 0, -1), (1, 0, 0.2), (0.6, 0, 1), (-0.6, 0, 1), (-1, 0, 0.2), (-1, 0, -1), (0.3, -1, -0.5))
MEDIAN_MM, P95_MM = 1.5, 6.0
MEDIAN_SPARE_MM, P95_SPARE_MM = 0.3, 3.0
SEAM_LIGHT = 0.10
BESIDE = (0.004, 0.02)
"""What lies beside a seam: measured surface at this distance from any seam or fill [m]."""
JUMP = 0.02
"""Neighbouring raw readings are joined up to this difference in depth [m]."""


@dataclass(frozen=True)
class Shot:
    """A file or folder of a repository, and between which depths its scene lies [m]."""

    repository: str
    path: str
    depth: tuple[float, float]
    what: str
    lens: Intrinsics | None = None


SHOTS = (
    Shot(PERSON, "a1/data/0000000000_depth.png", (0.6, 3.5), "Kinect v1, lone PNG"),
    Shot(ROOMS, "kinect/kinect_mirror/depth_aligned_00.npy", (0.3, 6.0), "Azure Kinect, NPY, with its lens", ROOM_LENS),
    Shot(ROOMS, "kinect/kinect_tv/depth_aligned_00.npy", (0.3, 6.0), "Azure Kinect, NPY, with its lens", ROOM_LENS),
    Shot("Make-ORB-SLAM2-RGBD-dataset", ".", (0.6, 10.0), "RealSense, TUM layout"),
    Shot("projeto-ovni", "dataset/realsense", (0.2, 10.0), "RealSense, Open3D's recorder"),
    Shot("ros_detect_planes_from_depth_img", "data/test_img_depth.png", (0.2, 10.0), "D435, lone PNG"),
    Shot("tsdf-fusion-python", "data/frame-000000.depth.png", (0.3, 8.0), "7-Scenes, lone PNG"),
)


def run(captures: Path | None = None, pictures: Path | None = None) -> Result:
    """Tables of what is there in ``captures``; sheets of the avatars and mirrors go to ``pictures``."""
    if captures is None:
        say("real: skipped; --captures DIR names a folder with clones of public repositories")
        return Result()
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    result = Result()
    for part in (_person, _rooms, _files):
        made = part(captures, pictures)
        result.tables += made.tables
        result.findings += made.findings
    return result


def _absent(folder: Path, what: str) -> bool:
    if folder.exists():
        return False
    say(f"real: {what} skipped: {folder} is absent")
    return True


# --- the person ------------------------------------------------------------------------------------------------------


def _person(captures: Path, pictures: Path | None) -> Result:
    data = captures / PERSON / "a1" / "data"
    if _absent(data, "the person"):
        return Result()
    table = Table(
        "Real person: frames that were not used, against the avatar [mm]",
        ("views", "built", "closed", "median", "p95", "raw: median", "raw: p95", "turned to fit: median", "p95"),
    )
    table.notes = [
        f"Kinect v1, {PERSON}/a1/data, views {', '.join(map(str, FOUR))}; {len(HELD_OUT)} others between them.",
        "Raw: the same frames against the raw readings of the views used, joined to surfaces, the nearest counts: what "
        "the poses and the person's movement allow. The poses do not close: views 72 and 0 are 6 mm apart.",
        "Turned to fit: each frame first moved rigidly onto the avatar, so that only the shape is judged.",
    ]
    light = Table(
        "Real person: luminance of seams and fills beside what surrounds them",
        ("views", "surface", "luminance", "beside it", "ratio", "within 10 %", "brighter than 1.5 ×"),
        left=2,
    )
    light.notes = [
        f"Means by area; beside: the median of measured surface {1e3 * BESIDE[0]:.0f} to {1e3 * BESIDE[1]:.0f} mm off."
    ]
    findings = []
    for name, views in (("four", FOUR), ("two opposed", TWO)):
        say(f"real: the person from {name} views")
        try:
            made = person_avatar(data, views)
        except MirrorScanError as error:
            say(f"      failed: {error}")
            table.rows.append((name, "no", *["–"] * 7))
            findings.append(Finding(f"real person, {name} views: built", f"refused: {error}"[:80], False))
            continue
        closed = not len(open_edges(made.mesh.triangles, len(made.mesh.vertices)))
        frames = [_in_first_frame(data, number) for number in HELD_OUT]
        found, raw, turned = _held_out(made.mesh, frames, [_raw_surface(data, view) for view in views])
        table.rows.append((name, "yes", yes(closed), *(number(v) for pair in (found, raw, turned) for v in pair)))
        findings.append(Finding(f"real person, {name} views: built and closed", yes(closed), closed))
        for kind, title in ((SEAM, "seams"), (FILL, "fills")):
            cells = luminance(made.mesh, kind)
            light.rows.append((name, title, *(number(v, d) for v, d in zip(cells, (1, 1, 2, 2, 2), strict=True))))
            if views == FOUR:
                text = f"{cells[0]:.1f} beside {cells[1]:.1f}"
                holds = abs(cells[0] / cells[1] - 1.0) <= SEAM_LIGHT
                findings.append(Finding(f"real person: luminance of {title} within 10 % of surroundings", text, holds))
        if views == FOUR:
            text = f"{found[0]:.2f} and {found[1]:.2f} mm; raw {raw[0]:.2f} and {raw[1]:.2f}"
            allowed = found[0] <= max(MEDIAN_MM, raw[0] + MEDIAN_SPARE_MM)
            allowed &= found[1] <= max(P95_MM, raw[1] + P95_SPARE_MM)
            limit = f"<= {MEDIAN_MM} and {P95_MM:g} mm, or raw + {MEDIAN_SPARE_MM} and {P95_SPARE_MM:g}"
            findings.append(Finding(f"real person, held-out frames: median and p95 {limit}", text, allowed))
        if pictures is not None:
            write_png(pictures / f"real_person_{len(views)}_views.png", _sheet(made.mesh))
    return Result([table, light], findings)


def _pose(data: Path, frame: int) -> np.ndarray:
    """Camera → world (4, 4) of one frame, as its XML says."""
    text = (data / f"{frame:010d}_camera.xml").read_text(encoding="utf-8")
    _, turn, place = (np.array(block.split(), float) for block in re.findall(r"<data>(.*?)</data>", text, re.DOTALL))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.reshape(3, 3), place
    return pose


def person_avatar(data: Path, views: Iterable[int]) -> Reconstruction:
    """The avatar from these frames, in the frame of the first one's camera."""
    with tempfile.TemporaryDirectory() as place:
        folder, cameras = Path(place), []
        for frame in views:
            view = folder / f"view_{frame:02d}"
            for kind, name in (("depth", f"{frame:010d}_depth.png"), ("color", f"{frame:010d}.jpg")):
                (view / kind).mkdir(parents=True)
                source = data / name
                (view / kind / f"000000{source.suffix}").write_bytes(source.read_bytes())
            lens = [LENS.fx, 0, 0, 0, LENS.fy, 0, LENS.cx, LENS.cy, 1]
            (view / "intrinsic.json").write_text(
                json.dumps({"width": 640, "height": 480, "intrinsic_matrix": lens, "depth_scale": 1000})
            )
            cameras.append({"capture": view.name, "camera_to_world": _pose(data, frame).tolist()})
        (folder / POSES_FILE).write_text(json.dumps({"cameras": cameras}))
        read, poses = open_posed_captures([folder])
    return reconstruct_views(read, poses, frame="camera")


def _readings(data: Path, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Every pixel (H, W, 3) in the first camera's frame [m], and which are the person's (H, W)."""
    z = read_image(data / f"{frame:010d}_depth.png").astype(np.float64) / 1000.0
    body = (read_image(data / f"{frame:010d}_mask.jpg") > 128) & (z > 0)
    v, u = np.mgrid[: z.shape[0], : z.shape[1]]
    points = np.stack(((u - LENS.cx) * z / LENS.fx, (v - LENS.cy) * z / LENS.fy, z), axis=-1)
    to_first = np.linalg.inv(_pose(data, FOUR[0])) @ _pose(data, frame)
    return transform(points.reshape(-1, 3), to_first).reshape(points.shape), body


def _in_first_frame(data: Path, frame: int) -> np.ndarray:
    """Every third reading of the person (N, 3)."""
    points, body = _readings(data, frame)
    return np.ascontiguousarray(points[body][::3])


def _raw_surface(data: Path, frame: int) -> Mesh:
    """One frame's raw readings, joined to their neighbours in the image."""
    points, body = _readings(data, frame)
    z = read_image(data / f"{frame:010d}_depth.png").astype(np.float64).ravel() / 1000.0
    at = np.arange(body.size).reshape(body.shape)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    triangles = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))
    near = np.ptp(z[triangles], axis=1) < JUMP
    triangles = triangles[near & body.ravel()[triangles].all(axis=1)]
    return Mesh(points.reshape(-1, 3), triangles.astype(np.int32))


def _distances(surface: Mesh, points: np.ndarray) -> np.ndarray:
    tree = build_bvh(np.ascontiguousarray(surface.vertices), np.ascontiguousarray(surface.triangles))
    return closest_point(tree, points)[0]


def _held_out(mesh: Mesh, frames: list[np.ndarray], raw: list[Mesh]) -> list[tuple[float, float]]:
    """Median and p95 [mm] of the frames' readings: to the avatar, to the nearest raw surface, to the avatar turned."""
    everything = np.concatenate(frames)
    found = _distances(mesh, everything)
    nearest = np.minimum.reduce([_distances(surface, everything) for surface in raw])
    turned = [_distances(mesh, np.ascontiguousarray(transform(frame, _fit(frame, mesh)))) for frame in frames]
    return [
        (1e3 * float(np.median(values)), 1e3 * float(np.percentile(values, 95)))
        for values in (found, nearest, np.concatenate(turned))
    ]


def _fit(points: np.ndarray, mesh: Mesh, rounds: int = 10) -> np.ndarray:
    """Trimmed point-to-plane alignment (Chen and Medioni 1992) of points onto the mesh."""
    tree = build_bvh(np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.triangles))
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    motion = np.eye(4)
    for _ in range(rounds):
        moved = transform(points, motion)
        distance, triangle, foot = closest_point(tree, np.ascontiguousarray(moved))
        normal, center = normals[triangle], moved.mean(axis=0)
        rest = ((moved - foot) * normal).sum(axis=1)
        used = (np.abs(rest) < 3 * 1.4826 * np.median(np.abs(rest))) & (distance < 0.02)
        A = np.concatenate((np.cross(moved - center, normal), normal), axis=1)[used]
        step = np.linalg.lstsq(A, -rest[used], rcond=None)[0]
        angle = float(np.linalg.norm(step[:3]))
        x, y, z = step[:3] / max(angle, 1e-12)
        cross = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
        turn = np.eye(4)
        turn[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        turn[:3, 3] = center - turn[:3, :3] @ center + step[3:]
        motion = turn @ motion
    return motion


def luminance(mesh: Mesh, kind: int) -> tuple[float, float, float, float, float]:
    """Mean luminance (Rec. 709, sRGB levels) of the ``kind`` of surface and of what lies beside it, by area.

    Then the median ratio of both, and the shares of the area where it is within 10 % and above 1.5.
    """
    assert mesh.colors is not None and mesh.kind is not None
    level = mesh.colors @ np.array((0.2126, 0.7152, 0.0722))
    made, measured = np.zeros((2, len(mesh.vertices)), np.bool_)
    made[mesh.triangles[mesh.kind != SURFACE]] = True
    measured[mesh.triangles[mesh.kind == SURFACE]] = True
    off = cKDTree(mesh.vertices[made]).query(mesh.vertices, distance_upper_bound=BESIDE[1])[0]
    ring = np.flatnonzero(measured & (off > BESIDE[0]) & np.isfinite(off))
    corners = mesh.triangles[mesh.kind == kind]
    sides = mesh.vertices[corners]
    area = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    away, near = cKDTree(mesh.vertices[ring]).query(sides.mean(axis=1), k=32, distance_upper_bound=1.5 * BESIDE[1])
    found = np.isfinite(away)
    kept = found.sum(axis=1) >= 8
    around = np.where(found, np.append(level[ring], np.nan)[near], np.nan)[kept]
    beside, own, area = np.nanmedian(around, axis=1), level[corners].mean(axis=1)[kept], area[kept]
    ratio = own / np.maximum(beside, 1.0)
    order = np.argsort(ratio)
    middle = ratio[order][np.searchsorted(np.cumsum(area[order]), area.sum() / 2)]
    share = [float(np.average(part, weights=area)) for part in (np.abs(ratio - 1) <= SEAM_LIGHT, ratio > 1.5)]
    means = [float(np.average(part, weights=area)) for part in (own, beside)]
    return means[0], means[1], float(middle), share[0], share[1]


def _sheet(mesh: Mesh) -> np.ndarray:
    """The mesh from all sides: in its colours, plain, and by kind of surface."""
    kinds = np.array([KIND_COLORS[kind] for kind in (SURFACE, SEAM, FILL)], np.uint8)[mesh.kind]
    rows = [render_views(mesh, colors, SIDES, 300, 360, up=(0.0, -1.0, 0.01)) for colors in (mesh.colors, None, kinds)]
    return np.concatenate(rows)


# --- the rooms -------------------------------------------------------------------------------------------------------


def _rooms(captures: Path, pictures: Path | None) -> Result:
    folder = captures / ROOMS / "kinect"
    if _absent(folder, "the rooms"):
        return Result()
    table = Table(
        "Real rooms, Azure Kinect: mirrors",
        ("room", "mirrors", "angle of the first two [°]", "residual [mm]", "stated error [mm]"),
    )
    table.notes = [
        f"{ROOMS}/kinect. {DOORS}: from 8 picks on the edge of either door; the camera's reflection in both says "
        f"that they are {APART}° apart. Others without a pick; none has a frame that stands out, whole in the picture.",
    ]
    findings = []
    for room in sorted(path.parent for path in folder.glob("*/depth_aligned_*.npy")):
        capture = open_capture(next(room.glob("depth_aligned_*.npy")), None, ReadOptions(intrinsics=ROOM_LENS))
        color = read_image(next(room.glob("color_*.png")))[..., :3]
        depth, doors = one_depth_map(capture)[0], room.name == DOORS
        if doors:
            picks = [MirrorPicks(name, np.array(at, float)) for name, at in zip("ab", DOOR_PICKS, strict=True)]
            try:
                mirrors, notes = place_mirrors(tuple(picks), depth, replace(capture, color=color), Settings())
            except MirrorScanError as error:
                mirrors, notes = [], (str(error),)
            for note in notes:
                say(f"real: {room.name}: {note}")
        else:
            mirrors = find_mirrors(RgbdImage(depth, capture.intrinsics, color))
        angle = None
        if len(mirrors) > 1:
            cosine = abs(float(mirrors[0].normal @ mirrors[1].normal))
            angle = float(np.degrees(np.arccos(min(cosine, 1.0))))
        residual = max((1e3 * mirror.residual for mirror in mirrors), default=None)
        stated = max((1e3 * expected_error(mirror) for mirror in mirrors), default=None)
        table.rows.append((room.name, str(len(mirrors)), number(angle, 1), number(residual, 1), number(stated, 1)))
        if doors:
            text = "not placed" if angle is None else f"{angle:.1f}°"
            passed = angle is not None and abs(angle - APART) <= 1.0
            findings.append(Finding(f"real room: two cabinet doors {APART} ± 1° apart", text, passed))
        if pictures is not None:
            write_png(pictures / f"real_{room.name}.png", _outlined(color, mirrors))
    return Result([table], findings)


def _outlined(color: np.ndarray, mirrors: list[Mirror]) -> np.ndarray:
    """The colour picture with the outline of every mirror."""
    picture = np.ascontiguousarray(color[::2, ::2])
    for mirror in mirrors:
        if mirror.outline is None:
            continue
        corners = mirror.outline / 2
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            count = int(np.abs(b - a).max()) + 2
            u, v = (np.linspace(a[k], b[k], count).round().astype(int) for k in (0, 1))
            inside = (u >= 1) & (v >= 1) & (u < picture.shape[1] - 1) & (v < picture.shape[0] - 1)
            for step in (-1, 0, 1):
                picture[v[inside] + step, u[inside]] = (255, 40, 40)
    return picture


# --- every file ------------------------------------------------------------------------------------------------------


def _files(captures: Path, pictures: Path | None) -> Result:
    table = Table(
        "Real files: what the readers make of them",
        ("file", "camera", "frames", "size", "depth, 5 to 95 % [m]", "wanted [m]", "fx [px]", "right"),
        left=2,
    )
    table.notes = ["Opened as they are; only where nothing says so, the lens is given. At most 10 frames."]
    wrong, opened = [], 0
    for entry in SHOTS:
        path = captures / entry.repository / entry.path
        if _absent(path, f"{entry.repository} ({entry.what})"):
            continue
        opened += 1
        name = f"{entry.repository}/{entry.path}" if entry.path != "." else entry.repository
        wanted = "{:g} to {:g}".format(*entry.depth)
        try:
            capture = open_capture(path, 10, ReadOptions(intrinsics=entry.lens))
        except MirrorScanError as error:
            say(f"real: {name}: {error}")
            wrong.append(name)
            table.rows.append((name, entry.what, "–", "–", "refused", wanted, "–", "no"))
            continue
        read = capture.depth[capture.depth > 0]
        low, high = (float(v) for v in np.percentile(read, (5, 95))) if len(read) else (np.nan, np.nan)
        right = entry.depth[0] <= low <= high <= entry.depth[1]
        if not right:
            wrong.append(name)
        size = "{1} × {0}".format(*capture.depth.shape[1:])
        table.rows.append((
            name, entry.what, str(len(capture.depth)), size, f"{low:.2f} to {high:.2f}", wanted,
            number(capture.intrinsics.fx, 1), yes(right),
        ))  # fmt: skip
    if not opened:
        return Result()
    text = f"{opened - len(wrong)} of {opened}" + (f"; wrong: {', '.join(wrong)}" if wrong else "")
    return Result([table], [Finding("real files: read with the right scale", text, not wrong)])
