"""What each step of cleaning a depth map improves, on captures whose truth is known; and its speed against Open3D."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.capture import Capture, ReadOptions, open_capture
from mirror_scan.core.depth.burst_fusion import fuse_burst
from mirror_scan.core.depth.clean_views import clean
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.depth.outliers_and_dropouts import close_dropouts, remove_flying_pixels
from mirror_scan.core.depth.sensor_recognition import recognise
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, raycast
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.rays import BODY, NOTHING
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate, write_simulation
from mirror_scan.core.subject.subject_search import find_subject
from scipy.ndimage import binary_dilation

from .machine import installed, medians, say
from .results import Finding, Result, Table, number
from .scenes import SHARED

DISTANCE = 4.8  # m: the folded path to the back of a person
WILD = 0.15  # m: a reading farther off is not noise of this surface
RUNS = 9
MIN_GAIN = {("kinect_v1", 10): 3.0, ("azure_kinect", 1): 2.0}
MAX_SHIFT, MAX_MS = 1.0, 120.0
STEPS = ("one frame", "fused", "flying dropped", "gaps closed", "steps undone", "smoothed")


@dataclass(frozen=True)
class View:
    """One view of a subject: true depth (H, W) [m], 0 beside it, and where else its readings may lie."""

    name: str
    capture: Capture
    truth: np.ndarray
    near: np.ndarray


def run() -> Result:
    table = Table(
        f"Cleaning: RMS depth error of readings on the subject [mm], at {DISTANCE} m",
        ("capture", "frames", "z [m]", *STEPS, "gain", "beyond", "left", "outline", "cleaned"),
    )
    table.notes = [
        f"Errors up to {1e3 * WILD:.0f} mm; beyond, left: readings of the subject farther off, before and after [%].",
        "Gain: one frame over smoothed. Each column adds its step to those before it.",
        "Outline, cleaned: how far the silhouette lies outside the true one, area over length [px], before and after.",
        "Steps are undone only where noise does not average them out.",
    ]
    gains: dict[tuple[str, int], float] = {}
    shifts: dict[str, float] = {}
    body = mannequin()
    for sensor, frames in (("kinect_v1", 1), ("kinect_v1", 10), ("azure_kinect", 1), ("azure_kinect", 10),
                           ("realsense_d455", 1), ("realsense_d455", 10)):  # fmt: skip
        say(f"cleaning: {sensor}, {frames} frames")
        row = _measure(_direct(sensor, frames, body))
        gains[sensor, frames] = row.gain
        shifts[f"{sensor} × {frames}"] = row.shift
        table.rows.append(row.cells)
    for folder in sorted((SHARED / "data" / "simulated").glob("*/truth/body.ply")):
        say(f"cleaning: {folder.parents[1].name}")
        for view in _folder_views(folder.parents[1]):
            table.rows.append(_measure(view).cells)
    speed, findings = _speed(body)
    found = []
    for (sensor, frames), least in MIN_GAIN.items():
        gain = gains[sensor, frames]
        found.append(
            Finding(f"{sensor} × {frames} at {DISTANCE} m: RMS cut >= {least:g} x", f"{gain:.1f} x", gain >= least)
        )
    worst = max(shifts, key=lambda k: abs(shifts[k]))
    limit = f"cleaning moves silhouettes <= {MAX_SHIFT:g} px"
    found.append(Finding(limit, f"worst {shifts[worst]:+.2f}, {worst}", abs(shifts[worst]) <= MAX_SHIFT))
    return Result([table, speed], found + findings)


# --- captures with truth ---------------------------------------------------------------------------------------------


def _direct(sensor: str, frames: int, body: Mesh) -> View:
    made = simulate(body, default_rig(sensor, subject_distance=DISTANCE, mirrors=0, frames=frames))
    mine = made.truth.labels == 0
    # beside the body only where there is nothing at a depth too similar to separate
    sight = made.truth.sight
    floor = (sight.object != BODY) & (sight.object != NOTHING) & _like(sight.depth, mine)
    near = (binary_dilation(mine, iterations=4) & ~binary_dilation(floor, iterations=2)) | mine
    return View(f"{sensor} × {frames}", made.capture, np.where(mine, sight.depth, 0), near)


def _like(depth: np.ndarray, mine: np.ndarray) -> np.ndarray:
    return (depth > depth[mine].min() - 0.3) & (depth < depth[mine].max() + 0.3)


def _folder_views(folder: Path) -> list[View]:
    """The views of a capture with mirrors; the truth is traced by way of the true mirrors."""
    capture = open_capture(folder)
    camera = capture.intrinsics
    depth = one_depth_map(capture)[0]
    labels = find_subject(
        RgbdImage(depth, camera), [place_mirror(RgbdImage(depth, camera), pick) for pick in capture.mirrors]
    ).labels
    planes = json.loads((folder / "truth" / "rig.json").read_text(encoding="utf-8"))["mirrors"]
    body = read_mesh(folder / "truth" / "body.ply")
    tree = build_bvh(np.ascontiguousarray(body.vertices, np.float64), np.ascontiguousarray(body.triangles, np.int32))
    views = []
    for k, name in enumerate(["direct", *(mirror.name for mirror in capture.mirrors)]):
        mine = labels == k
        truth = np.zeros(depth.shape)
        truth[mine] = _trace(tree, camera, mine, planes[k - 1] if k else None)
        views.append(View(f"{folder.name}, {name}", capture, truth, mine & (truth > 0)))
    return views


def _trace(tree, intrinsics: Intrinsics, pixels: np.ndarray, plane: dict | None) -> np.ndarray:
    """True z [m] at ``pixels``, by way of a mirror or directly; 0 beside the body."""
    v, u = np.nonzero(pixels)
    rays = np.column_stack(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(len(u))))
    origins = np.zeros_like(rays)
    if plane is not None:
        normal = np.array(plane["normal"]) / np.linalg.norm(plane["normal"])
        origins += 2 * (np.array(plane["point"]) @ normal) * normal
        rays -= 2 * (rays @ normal)[:, None] * normal
    z = raycast(tree, origins, rays)[0]
    return np.where(np.isfinite(z), z, 0)


# --- steps -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    cells: tuple[str, ...]
    gain: float
    shift: float


def _measure(view: View) -> Row:
    capture, truth = view.capture, view.truth
    there = truth > 0
    focal = capture.intrinsics.fx
    settings = DepthSettings()
    _, model = recognise(capture, settings)
    fused, spread = fuse_burst(capture.depth, settings)
    kept = remove_flying_pixels(fused, 1.0 / focal, settings)
    low, high = truth[there].min() - 0.3, truth[there].max() + 0.3
    labels = np.where(view.near & (kept > low) & (kept < high), 0, -1).astype(np.int8)
    closed = close_dropouts(kept, labels, settings.close_gaps)[0]
    burst = spread if len(capture.depth) > 1 else None
    undone = clean(kept, labels, 1, focal, replace(settings, smoothing=0.0), model, burst)[0]
    smooth, clean_labels, _ = clean(kept, labels, 1, focal, settings, model, burst)
    errors = [_errors(frame, truth) for frame in capture.depth]
    one = float(np.sqrt(np.mean([rms**2 for rms, _ in errors])))
    wild = float(np.mean([share for _, share in errors]))
    rest = [_errors(z, truth) for z in (fused, kept, closed, undone, smooth)]
    gain = one / rest[-1][0]
    raw = view.near & (capture.depth[0] > low) & (capture.depth[0] < high)
    outlines = (_outwards(raw, there), _outwards(clean_labels == 0, there))
    known = bool((view.near & ~there).any())  # whether what lies beside the subject was looked at
    cells = (view.name, str(len(capture.depth)), number(float(np.median(truth[there]))), number(one),
             *(number(rms) for rms, _ in rest), f"{gain:.1f} x", f"{100 * wild:.2f}", f"{100 * rest[-1][1]:.2f}",
             *(f"{o:+.2f}" if known else "–" for o in outlines))  # fmt: skip
    return Row(cells, gain, outlines[1] - outlines[0])


def _errors(depth: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """RMS [m → mm] of the readings of the surface, and the share that is farther off than any noise."""
    read = (truth > 0) & (depth > 0)
    error = np.abs(depth[read] - truth[read])
    surface = error <= WILD
    return 1e3 * float(np.sqrt(np.mean(error[surface] ** 2))), float(1 - surface.mean())


def _outwards(mine: np.ndarray, truth: np.ndarray) -> float:
    """How far the silhouette lies outside the true one on average [px]."""
    rim = truth & binary_dilation(~truth)
    return (int(mine.sum()) - int(truth.sum())) / int(rim.sum())


# --- time ------------------------------------------------------------------------------------------------------------


def _speed(body: Mesh) -> tuple[Table, list[Finding]]:
    """Ten frames of 640 × 480 from a folder to one clean map, compared with what Open3D offers for the same."""
    say("cleaning: speed")
    made = simulate(body, default_rig("kinect_v1", frames=10))
    subject = made.truth.labels
    title = "Cleaning: folder of 10 frames of 640x480 to clean depth [ms]"
    table = Table(title, ("program", "what it does", "time"), left=2)
    limit = f"decode + clean 10 frames of 640x480 < {MAX_MS:g} ms"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "capture"
        write_simulation(made, folder)

        def ours():
            capture = open_capture(folder, options=ReadOptions(color=False))
            settings = DepthSettings()
            focal = capture.intrinsics.fx
            _, model = recognise(capture, settings)
            kept, spread = one_depth_map(capture, settings)
            labels = np.where(kept > 0, subject, -1).astype(np.int8)
            return clean(kept, labels, 3, focal, settings, model, spread)[0]

        calls = {"Mirror Scan": ours}
        table.notes = ["Warm; the depth PNGs are read from the disk's cache. Open3D filters each frame separately."]
        if installed("open3d"):
            calls |= _open3d_calls(sorted((folder / "depth").glob("*.png")))
        times, _ = medians(calls, RUNS)
    words = {
        "Mirror Scan": "decode, fuse, flying pixels, missing readings, steps, smoothing of the subject",
        "Open3D bilateral": "decode, bilateral filter of each frame",
        "Open3D outliers": "decode, points, statistical outlier removal of each frame",
    }
    for name, spent in times.items():
        table.rows.append((name, words[name], number(spent, 0)))
    mine = times.pop("Mirror Scan")
    findings = [Finding(limit, f"{mine:.0f} ms", mine < MAX_MS)]
    limit = "… faster than Open3D reads and filters it"
    if not times:
        return table, [*findings, Finding(limit, "Open3D is not installed", None)]
    best = min(times, key=times.get)
    return table, [*findings, Finding(limit, f"{best} {times[best]:.0f} ms", mine < times[best])]


def _open3d_calls(files: list[Path]) -> dict:
    import open3d

    def bilateral():
        last = None
        for file in files:
            depth = open3d.t.io.read_image(str(file)).to(open3d.core.float32, scale=0.001)
            last = depth.filter_bilateral(kernel_size=5, value_sigma=0.03, dist_sigma=2.0)
        return last

    def clouds():
        camera = open3d.camera.PinholeCameraIntrinsic(640, 480, 585.0, 585.0, 319.5, 239.5)
        last = None
        for file in files:
            cloud = open3d.geometry.PointCloud.create_from_depth_image(open3d.io.read_image(str(file)), camera)
            last = cloud.remove_statistical_outlier(8, 2.0)
        return last

    return {"Open3D bilateral": bilateral, "Open3D outliers": clouds}
