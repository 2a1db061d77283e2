"""Mirror planes against true ones: from picks and without, against the plain fit of the picks; real captures."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.capture import Capture, MirrorPicks, open_capture
from mirror_scan.core.checks.view_disagreement import disagreements
from mirror_scan.core.depth.burst_fusion import fuse_burst
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.depth.outliers_and_dropouts import remove_flying_pixels
from mirror_scan.core.errors import MirrorError
from mirror_scan.core.io.images import read_image, write_png
from mirror_scan.core.mirror_alignment.seam_alignment import SeamSettings
from mirror_scan.core.mirror_alignment.view_alignment import align_views
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings, place_mirror
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.props import open_door, placed, wall_behind
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate
from mirror_scan.core.subject.subject_search import find_subject

from .machine import milliseconds, say
from .results import Finding, Result, Table, number
from .scenes import SHARED

SENSORS = {"azure_kinect": 2.5, "realsense_d455": 2.4, "kinect_v1": 2.75, "ideal": 2.75}
"""Sensor -> distance of the subject that suits its field of view [m]."""
RIGS = 12
FRAMES = 10
BURSTS = (1, 2, 5, 10, 20, 40)
LIMIT_MM = {"azure_kinect": 3.0, "realsense_d455": 3.0, "kinect_v1": 6.0}
MAX_MS = 150.0
FAR_MM = 100.0
"""A mirror that is found but puts the body this far off is a false one."""
PLAIN = MirrorSettings(grow=False)
REAL = (
    "pcl/five_people.pcd", "pcl/person.pcd", "pcl/milk_cartoon_all_small_clorox.pcd", "pcl/grabber_sequences/pclzf",
    "open3d_other/TUM_depth.png", "open3d_other/SUN_depth.png", "open3d_other/NYU_depth.pgm",
    "azure_mkv/recording.mkv",
)  # fmt: skip


@dataclass
class Errors:
    """What one sensor's rigs gave [mm], a mirror an entry."""

    mirrors: int = 0
    plain: list[float] = field(default_factory=list)
    picked: list[float] = field(default_factory=list)
    found: list[float] = field(default_factory=list)
    expected: list[float] = field(default_factory=list)
    incomplete: int = 0
    false: int = 0
    spent: list[float] = field(default_factory=list)


def rigs(sensor: str) -> list[Rig]:
    """Rigs as people build them: no two alike, cameras tilted and rolled, mirrors leaning."""
    rng = np.random.default_rng(sum(sensor.encode()))
    made = []
    for seed in range(RIGS):
        rig = default_rig(
            sensor, SENSORS[sensor] + rng.uniform(-0.1, 0.25), rng.uniform(112, 132), path_length=rng.uniform(4.5, 5.1),
            frame_width=rng.uniform(0.03, 0.05), lean_deg=rng.uniform(-2, 2, 2), camera_height=rng.uniform(0.8, 1.2),
            tilt_deg=rng.uniform(-1, 7), roll_deg=rng.uniform(-4, 4), frames=FRAMES, seed=seed,
        )  # fmt: skip
        made.append(replace(rig, pan_deg=rng.uniform(-2, 2)))
    return made


def cleaned(capture: Capture, frames: int | None = None) -> np.ndarray:
    return one_depth_map(replace(capture, depth=capture.depth[:frames]))[0]


def displacement(mirror: Mirror, true: MirrorPicks, body: np.ndarray) -> float:
    """Median distance [mm] by which the mirror's error moves the reflected body."""
    apart = reflect(body, mirror) - reflect(body, plane_mirror(true.name, true.point, true.normal))
    return 1000.0 * float(np.median(np.linalg.norm(apart, axis=1)))


def clicks(simulation: Simulation, rng: np.random.Generator) -> list[MirrorPicks]:
    """The capture's picks (missed by up to 0.7 px), missed by up to 0.3 px more."""
    return [
        replace(m, frame_pixels=m.frame_pixels + rng.uniform(-0.3, 0.3, m.frame_pixels.shape))
        for m in simulation.capture.mirrors
        if m.frame_pixels is not None
    ]


def measure(sensor: str) -> Errors:
    errors = Errors()
    subject = mannequin(resolution=0.012)
    rng = np.random.default_rng(1)
    for rig in rigs(sensor):
        simulation = simulate(subject, rig)
        capture, body = simulation.capture, simulation.truth.body.vertices[::5]
        true = {m.name: m for m in simulation.truth.mirrors}
        depth = cleaned(capture)
        for picks in clicks(simulation, rng):
            errors.plain.append(
                displacement(place_mirror(RgbdImage(depth, capture.intrinsics), picks, PLAIN), true[picks.name], body)
            )
            mirror = place_mirror(RgbdImage(depth, capture.intrinsics), picks)
            errors.picked.append(displacement(mirror, true[picks.name], body))
            errors.expected.append(1000.0 * mirror.displacement(body))
        find_mirrors(RgbdImage(depth, capture.intrinsics, capture.color))  # warm
        spent, found = milliseconds(lambda c=capture: find_mirrors(RgbdImage(cleaned(c), c.intrinsics, c.color)))
        errors.spent.append(spent)
        apart = np.array([[displacement(m, t, body) for t in true.values()] for m in found]).reshape(-1, len(true))
        hit = [float(column.min()) for column in apart.T if len(column) and column.min() < FAR_MM]
        errors.found += hit
        errors.mirrors += len(true)
        errors.incomplete += len(hit) < len(true)
        errors.false += int((apart.min(axis=1) >= FAR_MM).sum()) + (len(found) > len(true))
    return errors


def run() -> Result:
    table = Table(
        f"Mirrors: displacement of the reflected body [mm], bursts of {FRAMES}",
        (
            "sensor", "rigs", "mirrors", "plain fit of 8 picks", "p95", "from 8 picks", "p95", "expected", "no picks",
            "p95", "rigs incomplete", "false mirrors", "ms",
        ),
    )  # fmt: skip
    table.notes = [
        "Median over the mirrors of the median over the body. Picks are missed by up to 1 px each way.",
        "Plain fit: the paper's plane through the picks alone (eq. 1), on the same fused depth.",
        "Expected: the median of what the planes' covariances predict, root mean square over the body.",
        "ms: depth frames in memory to planes without a pick: fusing, finding, refining; median over the rigs.",
    ]
    findings = []
    whole, complete, false = 0, 0, 0
    for sensor in SENSORS:
        say(f"mirrors: {sensor}")
        e = measure(sensor)
        spread = [(np.median(x), np.quantile(x, 0.95)) if x else (None, None) for x in (e.plain, e.picked, e.found)]
        table.rows.append((
            sensor, str(RIGS), str(e.mirrors), *(number(v) for v in spread[0]), *(number(v) for v in spread[1]),
            number(float(np.median(e.expected))), *(number(v) for v in spread[2]), str(e.incomplete), str(e.false),
            number(float(np.median(e.spent)), 0),
        ))  # fmt: skip
        whole, complete, false = whole + RIGS, complete + RIGS - e.incomplete, false + e.false
        if sensor in LIMIT_MM:
            picked, found = spread[1][0], spread[2][0]
            limit = LIMIT_MM[sensor]
            findings.append(Finding(f"8 picks: <= {limit:g} mm, {sensor}", f"{picked:.2f} mm", picked <= limit))
            text = "none found" if found is None else f"{found:.2f} mm"
            findings.append(
                Finding(f"no picks: <= {1.5 * limit:g} mm, {sensor}", text, found is not None and found <= 1.5 * limit)
            )
        if sensor == "kinect_v1":
            spent = float(np.median(e.spent))
            findings.append(
                Finding(f"640x480, {FRAMES} frames: planes < {MAX_MS:g} ms", f"{spent:.0f} ms", spent < MAX_MS)
            )
    findings.append(
        Finding("all mirrors found in >= 95 % of the rigs", f"{complete} of {whole}", complete >= 0.95 * whole)
    )
    findings.append(Finding("no false mirror in the rigs", f"{false}", false == 0))
    frameless, told = _frameless()
    crossing, crossed = _crossing()
    proud, shown = _proud()
    real, more = _real()
    return Result([table, _bursts(), frameless, crossing, proud, *real], findings + told + crossed + shown + more)


def _frameless() -> tuple[Table, list[Finding]]:
    """Mirrors without a frame, hung on a wall and clear of any; none where somebody stands behind an open door."""
    table = Table(
        "Mirrors without a frame, no picks [mm]",
        (
            "sensor", "rigs", "found on a wall", "displacement", "max", "found clear of it", "displacement", "max",
            "expected", "found in doors",
        ),
    )  # fmt: skip
    table.notes = [
        "The wall is 1 mm behind the glass: 2 mm of the displacement. Clear of a wall only the person in it shows that",
        "it is a mirror; a Kinect v1 does not see that surface. Doors: open ones, somebody of the same build behind.",
    ]
    subject = mannequin(resolution=0.012)
    hung, clear, wrong, unsure = 0, 0, 0, []
    for sensor in SENSORS:
        say(f"mirrors: without a frame, {sensor}")
        apart, free, expected, doors = [], [], [], 0
        for k, rig in enumerate(rigs(sensor)[:3]):
            bare = replace(rig, frames=4, mirrors=tuple(replace(m, frame_width=0.0) for m in rig.mirrors))
            for others, told in (([wall_behind(m) for m in bare.mirrors], apart), ([], free)):
                simulation = simulate(subject, bare, others)
                body = simulation.truth.body.vertices[::5]
                for m in find_mirrors(RgbdImage(cleaned(simulation.capture), simulation.capture.intrinsics)):
                    told.append(min(displacement(m, t, body) for t in simulation.truth.mirrors))
                    if told is free:
                        expected.append(1000.0 * m.displacement(body))
            room = replace(bare, mirrors=(), room=(-4.5, 4.5, -5.0, 6.5, 2.8))
            behind = [placed(open_door(), 1.0, 0.8, -25.0), placed(subject, 1.35, 1.9, 70.0 + 60.0 * k)]
            capture = simulate(subject, room, behind).capture
            doors += len(find_mirrors(RgbdImage(cleaned(capture), capture.intrinsics)))
        hung += sum(a < FAR_MM for a in apart)
        wrong += sum(a >= FAR_MM for a in apart + free) + doors
        if sensor != "kinect_v1":
            clear += sum(a < FAR_MM for a in free)
            unsure += free
        row = [sensor, "3"]
        for told in (apart, free):
            row += [f"{len(told)} of 6", *(number(float(f(told))) if told else "–" for f in (np.median, max))]
        row += [number(float(np.median(expected))) if expected else "–", str(doors)]
        table.rows.append(tuple(row))
    share = 6 * (len(SENSORS) - 1)
    middle = f"{np.median(unsure):.1f} mm" if unsure else "none found"
    return table, [
        Finding("mirrors without a frame, hung: found", f"{hung} of {6 * len(SENSORS)}", hung >= 5.7 * len(SENSORS)),
        Finding("mirrors without a frame, clear of a wall: found (not Kinect v1)", f"{clear} of {share}",
                clear >= 0.75 * share),
        Finding("mirrors without a frame, clear of a wall: <= 15 mm", middle,
                bool(unsure) and float(np.median(unsure)) <= 15.0),
        Finding("mirrors without a frame: none false", str(wrong), wrong == 0),
    ]  # fmt: skip


def _crossing() -> tuple[Table, list[Finding]]:
    """Three mirrors, two of them crossing: planes from picks, then moved until the views agree."""
    table = Table(
        "Three mirrors that cross, D455 [mm]",
        ("frames", "mirrors", "from 8 picks", "max", "after agreement", "max", "expected", "false alarms"),
    )  # fmt: skip
    table.notes = ["False alarms: mirrors said to contradict other views, none of which does."]
    subject, worst = mannequin(resolution=0.012), 0.0
    for frames in (1, 3, 10):
        say(f"mirrors: crossing, {frames} frames")
        before, after, expected, alarms = [], [], [], 0
        for seed in range(3):
            rig = default_rig(
                "realsense_d455", mirrors=(115.0 + 3 * seed, -118.0 - seed, -150.0 - 2 * seed), frames=frames, seed=seed
            )  # fmt: skip
            simulation = simulate(subject, rig)
            body, intrinsics, depth = simulation.truth.body.vertices[::5], simulation.capture.intrinsics, cleaned(
                simulation.capture)  # fmt: skip
            placed = [place_mirror(RgbdImage(depth, intrinsics), picks) for picks in simulation.capture.mirrors]
            agreed = align_views(RgbdImage(depth, intrinsics), placed)[0]
            alarms += len(
                disagreements(RgbdImage(depth, intrinsics), find_subject(RgbdImage(depth, intrinsics), agreed), agreed)
            )
            for old, new, true in zip(placed, agreed, simulation.truth.mirrors, strict=True):
                before.append(displacement(old, true, body))
                after.append(displacement(new, true, body))
                expected.append(1000.0 * new.displacement(body))
        worst = max(worst, max(after))
        table.rows.append((
            str(frames), str(len(after)), number(float(np.median(before))), number(max(before)),
            number(float(np.median(after))), number(max(after)), number(float(np.median(expected))), str(alarms),
        ))  # fmt: skip
    return table, [Finding("three mirrors that cross, D455: worst <= 12 mm", f"{worst:.1f} mm", worst <= 12.0)]


def _proud() -> tuple[Table, list[Finding]]:
    """Frames that project in front of their glass: corrected by what is seen twice, or else by the seams."""
    table = Table(
        "Frames that project in front of their glass, no picks [mm]",
        ("sensor", "projects by", "mirrors", "as found", "max", "without the seams", "max", "with them", "max",
         "moved"),
        left=1,
    )  # fmt: skip
    table.notes = [
        "As found: from the frames alone. Without the seams: moved by what is seen both directly and in the glass, if",
        "anything. With them: moved also by the offsets that seams show. A Kinect v1 reads no surface twice.",
    ]
    flush, worse, halved, made = 0, 0, 0, 0
    for sensor in LIMIT_MM:
        say(f"mirrors: projecting frames, {sensor}")
        for depth in (0.0, 0.006, 0.012, 0.018):
            apart, moved = [[], [], []], 0
            for k, rig in enumerate(rigs(sensor)[3:7]):
                subject = mannequin(1.6 + 0.08 * k, seed=20 + k, resolution=0.012)
                simulation = simulate(subject, replace(rig, mirrors=tuple(
                    replace(m, frame_depth=depth) for m in rig.mirrors
                )))  # fmt: skip
                capture, body = simulation.capture, simulation.truth.body.vertices[::5]
                found = find_mirrors(RgbdImage(cleaned(capture), capture.intrinsics, capture.color))
                alone = reconstruct(capture, (), Settings(seams=SeamSettings(use=False))).mirrors
                whole = reconstruct(capture, ()).mirrors
                for told, mirrors in zip(apart, (found, alone, whole), strict=True):
                    told += [min(displacement(m, t, body) for t in simulation.truth.mirrors) for m in mirrors]
                moved += sum("seams" in m.moved_by for m in whole)
            table.rows.append((
                sensor, number(1000.0 * depth, 0), str(len(apart[0])),
                *(number(float(f(told))) for told in apart for f in (np.median, max)), str(moved),
            ))  # fmt: skip
            flush += moved * (depth == 0.0)
            worse += sum(after > before + 0.5 for before, after in zip(*apart[1:], strict=True))
            if depth == 0.018:
                halved += sum(after < 0.5 * before for before, after in zip(apart[0], apart[2], strict=True))
                made += len(apart[0])
    return table, [
        Finding("flush frames: none moved by the seams", str(flush), flush == 0),
        Finding("no mirror made worse by the seams", str(worse), worse == 0),
        Finding("frames projecting by 18 mm: errors halved for most", f"{halved} of {made}", halved > 0.75 * made),
    ]


def _bursts() -> Table:
    """The displacement against the number of frames."""
    table = Table(
        "Mirrors: a longer burst [mm]", ("sensor", "", *(f"{n} frame{'s' * (n > 1)}" for n in BURSTS)), left=2
    )
    table.notes = ["Median over 8 mirrors. Random errors fall with the root of the frames, those of edges do not."]
    subject = mannequin(resolution=0.012)
    for sensor in LIMIT_MM:
        say(f"mirrors: bursts, {sensor}")
        made, promised = [[] for _ in BURSTS], [[] for _ in BURSTS]
        for rig in rigs(sensor)[:4]:
            simulation = simulate(subject, replace(rig, frames=max(BURSTS)))
            body = simulation.truth.body.vertices[::5]
            true = {m.name: m for m in simulation.truth.mirrors}
            for k, frames in enumerate(BURSTS):
                depth = cleaned(simulation.capture, frames)
                for picks in simulation.capture.mirrors:
                    mirror = place_mirror(RgbdImage(depth, simulation.capture.intrinsics), picks)
                    if mirror.covariance is not None:
                        made[k].append(displacement(mirror, true[picks.name], body))
                        promised[k].append(1000.0 * mirror.displacement(body))
        table.rows.append((sensor, "made", *(number(float(np.median(x))) for x in made)))
        table.rows.append(("", "expected", *(number(float(np.median(x))) for x in promised)))
    return table


def _real() -> tuple[list[Table], list[Finding]]:
    """Real captures: none must be found where none is; where one is, its plane from points beside its mask."""
    folder = SHARED / "data" / "real"
    if not folder.is_dir():
        return [], [Finding("no false mirror in real captures", "there are none beside the checkout", None)]
    drawn = Path(tempfile.gettempdir()) / "mirror_scan_outlines"
    drawn.mkdir(exist_ok=True)
    table = Table(
        "Mirrors: real captures", ("capture", "mirrors in it", "found", "points used", "residual [mm]"), left=1
    )
    table.notes = [f"Outlines are drawn into {drawn.name}/ in the folder for temporary files."]
    false = []
    for name in REAL:
        capture = open_capture(folder / name)
        found = find_mirrors(RgbdImage(cleaned(capture), capture.intrinsics, capture.color))
        table.rows.append((name, "0", str(len(found)), "–", "–"))
        false += [name] * bool(found)
    for name in ("45", "686"):
        depth, color, masks = _nyu(folder / "nyu_mirrors", name)
        intrinsics = Intrinsics(
            depth.shape[1], depth.shape[0], 519.0, 519.0, depth.shape[1] / 2 - 0.5, depth.shape[0] / 2 - 0.5
        )
        clean = remove_flying_pixels(fuse_burst(depth[None])[0], 1.0 / intrinsics.fx)
        found = find_mirrors(RgbdImage(clean, intrinsics, color))
        for k, mask in enumerate(masks, start=1):
            label = f"nyu_mirrors {name}, mirror {k} of {len(masks)}"
            try:
                mirror = place_mirror(RgbdImage(clean, intrinsics), MirrorPicks(label, _beside(mask)))
            except MirrorError as error:
                table.rows.append((label, "1", str(len(found)), "–", "–"))
                table.notes.append(str(error))
                continue
            table.rows.append((label, "1", str(len(found)), str(mirror.points_used), number(1000 * mirror.residual, 1)))
            color = _outlined(color, mirror.outline, _beside(mask))
        write_png(drawn / f"nyu_{name}.png", color)
    table.notes += [
        "nyu_mirrors: no person is in front of them, so nothing proves them and none is found without a pick;",
        "their planes are fitted from 12 points just outside of the published masks. The holes of the published",
        "depth are filled: most of the glass reads as the wall does, no depth edge is left, and the residuals are",
        "as much the filling's as the plane's.",
    ]
    return [table], [Finding("no false mirror in real captures", ", ".join(false) or f"none in {len(REAL)}", not false)]


def _nyu(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    depth = read_image(folder / "raw_sensorD" / f"{name}.png").astype(np.float32) / 1000.0
    color = read_image(folder / "mirror_color_images" / f"{name}.jpg")[..., :3]
    instances = read_image(folder / "mirror_instance_mask_precise" / f"{name}.png")
    values = [v for v in np.unique(instances) if v and (instances == v).sum() > 500]
    return depth, np.ascontiguousarray(color), [instances == v for v in values]


def _beside(mask: np.ndarray, outward: float = 6.0, count: int = 12) -> np.ndarray:
    """Points (K, 2) around a mask, ``outward`` px outside of its edge, as far as they are in the image."""
    v, u = np.nonzero(mask)
    center = np.array((u.mean(), v.mean()))
    points = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.1:
        way = np.array((np.cos(angle), np.sin(angle)))
        along = (np.column_stack((u, v)) - center) @ way
        across = np.abs((np.column_stack((u, v)) - center) @ (-way[1], way[0]))
        point = center + (along[across < 1.5].max() + outward) * way
        if (point >= 1).all() and (point < np.array(mask.shape[::-1]) - 2).all():
            points.append(point)
    return np.array(points)


def _outlined(color: np.ndarray, outline: np.ndarray, picks: np.ndarray) -> np.ndarray:
    """The picture with an outline in red and points in green."""
    color = color.copy()
    height, width = color.shape[:2]
    corners = np.vstack((outline, outline[:1]))
    steps = np.linspace(0, 1, 2000)[:, None]
    line = np.concatenate([a + steps * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    for points, tint, size in ((line, (255, 0, 0), 1), (picks, (0, 255, 0), 3)):
        for u, v in np.rint(points[np.isfinite(points).all(axis=1)]).astype(int):
            if 0 <= u < width and 0 <= v < height:
                color[max(v - size, 0) : v + size, max(u - size, 0) : u + size] = tint
    return color
