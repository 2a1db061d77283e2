"""Draws every picture of README.md and docs/how_it_works.md into docs/images: python docs/pictures.py

All of them come from the virtual scan of the built-in mannequin that ``make demo`` runs too: the same person, rig,
camera model, burst and noise. Run it again when a stage changes what it makes, and look at the result.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.coordinate_frame import avatar_frame
from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
from mirror_scan.core.avatar.pose import bone_matrices, skinned
from mirror_scan.core.avatar.skin_weights import skinned_mesh
from mirror_scan.core.camera import RgbdImage, unproject
from mirror_scan.core.capture import Capture
from mirror_scan.core.capture.capture_summary import picture
from mirror_scan.core.closing.mesh_closing import close_mesh
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.io.images import openimageio, read_image, write_png
from mirror_scan.core.light.two_way_light import undo_two_way_light
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import reflection_matrix
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.motion import MotionOptions, choose_clip, sole_points
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.scan import clean_views, make_patches
from mirror_scan.core.preview.mesh_views import (
    BACKGROUND,
    INK,
    KIND_COLORS,
    SIDES,
    draw_text,
    render_preview,
    render_views,
)
from mirror_scan.core.rig_planning.placement_search import find_placement
from mirror_scan.core.rig_planning.plan_drawing import write_plan_drawing
from mirror_scan.core.rig_planning.plan_files import plan_picture
from mirror_scan.core.rig_planning.rooms import ROOMS
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import Rig, default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.subject_search import find_subject
from mirror_scan.core.views.view_maps import view_maps
from mirror_scan.core.zippering.zipper import zip_patches
from PIL import Image

IMAGES = Path(__file__).parent / "images"
VIEW_COLORS = np.array(((236, 164, 72), (64, 158, 164), (150, 112, 190)), np.uint8)  # direct, right, left mirror
WOOD = np.array((122, 92, 66), np.uint8)
MOULDING = 100  # the “view” of a mirror's frame in these pictures
OBLIQUE = (0.25, -1.0, 0.6)
REAR = (0.5, 1.0, 0.25)
RIGHT, TOO_FAR, TOO_NEAR = np.array((205.0,) * 3), np.array((206.0, 60, 48)), np.array((52.0, 106, 200))
WORST = 0.03  # error that has the full colour [m]
BAND = 44  # height of a line of captions [px]


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    rig = default_rig()
    (IMAGES / "plan.svg").write_text(plan(rig), encoding="utf-8")
    capture = simulate(mannequin(), rig).capture
    settings = Settings()
    camera = capture.intrinsics

    save("capture", [picture(capture)], ["depth", "colour"], scale=0.8)

    depth, _ = one_depth_map(capture, settings.depth)
    mirrors = [place_mirror(RgbdImage(depth, camera), picks, settings.mirror) for picks in capture.mirrors]
    views = find_subject(RgbdImage(depth, camera), mirrors, settings.views)
    labels = views.labels
    save("views", [_views_picture(capture, views.seen), _views_picture(capture, labels)],
         ["which way it is seen", "what is the person"])  # fmt: skip

    first = capture.depth[0]
    depth, views, noise = clean_views(RgbdImage(depth, camera), views, len(mirrors), settings.depth)
    box = _box(views.labels == 0)
    save("depth", [_relief(first, labels, camera)[box], _relief(depth, views.labels, camera)[box]],
         ["one frame", "burst fused and smoothed"], scale=2)  # fmt: skip

    patches = make_patches(depth, views, mirrors, noise, capture, settings)
    maps = view_maps(RgbdImage(depth, camera), views.labels, views.seen, mirrors, noise)
    parted = part_overlaps(patches, maps, settings.overlap)
    zipped, _, twin = zip_patches(parted, maps, views.up, views.axis, views.floor, settings.zipper)
    closed, _ = close_mesh(zipped, maps, views.up, views.floor, settings.closing, twin)
    to_avatar = avatar_frame(closed.vertices, views.up, views.axis, views.floor)

    frames = [_moulding(mirror) for mirror in mirrors]
    behind = [_over(patch, mirror) for patch, mirror in zip(patches, [None, *mirrors], strict=True)]
    save("mirrors", [_shot([*behind, *frames], to_avatar, [OBLIQUE], 560, 460),
                     _shot([*patches, *frames], to_avatar, [OBLIQUE], 560, 460)],
         ["as the camera measures", "flipped back over the mirrors"])  # fmt: skip
    together = [SIDES["front"], SIDES["left side"], REAR]
    save("patches", [_shot(patches, to_avatar, together, 300, 480)], ["front", "left side", "back"])
    save("parting", [_closer(patches, to_avatar), _closer(parted, to_avatar)], ["views overlap", "parted"])
    save("zippering", [_closer(parted, to_avatar), _closer([zipped], to_avatar, kinds=True)], ["parted", "zippered"])
    save("closing", [_shot([closed], to_avatar, together, 300, 480, kinds=True)], ["front", "left side", "back"])

    avatar = closed.transformed(to_avatar)
    sides = render_views(avatar, avatar.colors, list(SIDES.values()), 300, 480)
    save("avatar", [sides], list(SIDES))
    _result(capture, avatar)
    save("two_way_light", _two_way_light(rig), ["as read", "corrected"], scale=1.6)
    with tempfile.TemporaryDirectory() as folder:
        skeleton = find_skeleton(avatar)
        fine, weights = skinned_mesh(avatar, skeleton)
        render_preview(fine, Path(folder) / "preview.png", skeleton, weights)
        write("preview", resized(read_image(Path(folder) / "preview.png"), 0.7))
    _room_plan()


# --- pictures of arrays ----------------------------------------------------------------------------------------------


def save(name: str, parts: Sequence[np.ndarray], captions: Sequence[str], scale: float = 1.0) -> None:
    """Pictures side by side under a line of captions, each over its share of the width."""
    parts = [resized(part, scale) for part in parts]
    height = max(part.shape[0] for part in parts)
    image = np.concatenate([_padded(part, height) for part in parts], axis=1)
    image = np.concatenate((blank(BAND, image.shape[1]), image))
    for k, caption in enumerate(captions):
        draw_text(image, caption, (k + 0.5) * image.shape[1] / len(captions), 0.68 * BAND, 20, INK, centred=True)
    write(name, image)


def write(name: str, image: np.ndarray) -> None:
    """To docs/images; colours in steps of four, unseen by the eye, make noisy pictures half as large."""
    path = IMAGES / f"{name}.png"
    write_png(path, (np.clip(image, 0, 251).astype(np.int16) + 2 & ~3).astype(np.uint8))
    print(f"{path.name}: {image.shape[1]}×{image.shape[0]}, {path.stat().st_size / 1000:.0f} kB")


def resized(image: np.ndarray, scale: float) -> np.ndarray:
    if scale == 1.0:
        return image
    oiio = openimageio()
    height, width = (round(scale * n) for n in image.shape[:2])
    source = oiio.ImageBuf(np.ascontiguousarray(image))
    target = oiio.ImageBufAlgo.resize(source, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, 3))
    return target.get_pixels(oiio.UINT8)


def blank(height: int, width: int) -> np.ndarray:
    return np.full((height, width, 3), BACKGROUND, np.uint8)


def _padded(image: np.ndarray, height: int) -> np.ndarray:
    return np.concatenate((image, blank(height - image.shape[0], image.shape[1])))


def _box(mask: np.ndarray, margin: int = 10) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(max(rows[0] - margin, 0), rows[-1] + margin), slice(max(columns[0] - margin, 0), columns[-1] + margin)


def _views_picture(capture: Capture, labels: np.ndarray) -> np.ndarray:
    """The colour image with each pixel tinted by its view, dark where it has none."""
    gray = capture.color.mean(axis=2, keepdims=True)
    tint = VIEW_COLORS[np.maximum(labels, 0)] * (0.35 + 0.65 * gray / 255)
    return np.where(labels[..., None] >= 0, tint, 0.3 * gray).astype(np.uint8)


def _two_way_light(rig: Rig) -> list[np.ndarray]:
    """Readings of the direct view, coloured by their error, before and after light that comes two ways is undone."""
    simulation = simulate(mannequin(), with_real_optics(rig, effects=("multipath",)))
    image = RgbdImage(one_depth_map(simulation.capture)[0], rig.intrinsics)
    mirrors = [place_mirror(image, picks) for picks in simulation.capture.mirrors]
    views = find_subject(image, mirrors)
    undone = undo_two_way_light(image, views, mirrors, views.floor_noise, phase=True)
    assert undone is not None  # its camera is said to measure phase
    mine, true = (views.labels == 0) & (image.depth > 0), simulation.truth.sight.depth
    pictures = []
    for depth, shown in ((image.depth, mine), (undone.depth, mine & ~undone.spoiled)):
        share = np.clip((depth - true) / WORST, -1.0, 1.0)[..., None]
        tint = np.where(share > 0.0, RIGHT + share * (TOO_FAR - RIGHT), RIGHT - share * (TOO_NEAR - RIGHT))
        drawn = blank(*depth.shape)
        drawn[mine], drawn[shown] = (40, 40, 40), tint[shown].astype(np.uint8)
        pictures.append(drawn[_box(mine)])
    return pictures


def _relief(depth: np.ndarray, labels: np.ndarray, camera) -> np.ndarray:
    """The direct view's surface lit from the upper left: shows noise that a depth map's colours hide."""
    points = unproject(depth, camera)
    down, right = np.gradient(points, axis=(0, 1))
    normal = np.cross(down, right)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    light = np.array((-0.45, -0.6, -0.66))
    shade = 60 + 180 * np.clip(normal @ light / np.linalg.norm(light), 0, 1)
    image = blank(*depth.shape)
    mine = (labels == 0) & (depth > 0)
    image[mine] = np.repeat(shade[mine][:, None], 3, axis=1).astype(np.uint8)
    return image


# --- pictures of meshes ----------------------------------------------------------------------------------------------


def _shot(meshes, to_avatar, directions, width, height, kinds=False) -> np.ndarray:
    """Meshes of the camera frame, coloured by view, with seams and fills in their colours when ``kinds``."""
    mesh = merge([replace(m, colors=None) for m in meshes]).transformed(to_avatar)
    view = mesh.view[mesh.triangles].max(axis=1)
    colors = np.where((view == MOULDING)[:, None], WOOD, VIEW_COLORS[np.clip(view, 0, 2)])
    if kinds:
        for kind, color in KIND_COLORS.items():
            if kind:
                colors[mesh.kind == kind] = color
    return render_views(mesh, colors, directions, width, height)


def _moulding(mirror: Mirror) -> Mesh:
    """A mirror's frame as four flat boards without its glass, camera frame; one can look through."""
    (left, right), (top, bottom) = mirror.rectangle
    wide = 0.05
    boards = (
        (left, right, top, top + wide), (left, right, bottom - wide, bottom),
        (left, left + wide, top, bottom), (right - wide, right, top, bottom),
    )  # fmt: skip
    corners = np.array([((a, c), (a, d), (b, d), (b, c)) for a, b, c, d in boards]).reshape(-1, 2)
    vertices = mirror.point + corners @ mirror.basis[:, :2].T
    triangles = np.array([(4 * k + i, 4 * k + j, 4 * k + m) for k in range(4) for i, j, m in ((0, 2, 1), (0, 3, 2))])
    return Mesh(vertices, triangles.astype(np.int32), None, np.full(16, MOULDING, np.int8), np.zeros(8, np.int8))


def _over(patch: Mesh, mirror: Mirror | None) -> Mesh:
    """A patch where the camera lays it: behind its mirror."""
    if mirror is None:
        return patch
    turned = np.ascontiguousarray(patch.triangles[:, ::-1])
    return replace(patch.transformed(reflection_matrix(mirror)), triangles=turned)


def _closer(meshes, to_avatar, kinds=False) -> np.ndarray:
    """Trunk and arm from the side, from nearer by."""
    image = _shot(meshes, to_avatar, [(0.95, -0.25, 0.15)], 900, 1400, kinds)
    return image[110:700, 220:720]


def _result(capture: Capture, avatar: Mesh) -> None:
    """The README's picture: what the camera gave on the left; on the right what came out, and it walks."""
    rows, columns = slice(70, 550), slice(50, 590)
    color = resized(capture.color[rows, columns], 0.8)
    depth = picture(replace(capture, mirrors=(), color=None))
    depth = resized(depth[rows, columns], 0.8)
    gap = blank(12, color.shape[1])
    left = np.concatenate((color, gap, depth))
    middle, images = left.shape[1], []
    for step in _walking(avatar):
        right = render_views(step, step.colors, [(0.6, -1.0, 0.1), (0.6, 1.0, 0.1)], 300, left.shape[0])
        image = np.concatenate((left, right), axis=1)
        image = np.concatenate((blank(BAND, image.shape[1]), image))
        draw_text(image, "one snapshot", middle / 2, 0.68 * BAND, 20, INK, centred=True)
        draw_text(image, "one rigged avatar", middle + right.shape[1] / 2, 0.68 * BAND, 20, INK, centred=True)
        images.append(Image.fromarray(image).quantize(128, dither=Image.Dither.NONE))
    path = IMAGES / "result.gif"
    images[0].save(path, save_all=True, append_images=images[1:], duration=80, loop=0, optimize=True)
    print(f"{path.name}: {len(images)} pictures, {path.stat().st_size / 1000:.0f} kB")


def _walking(avatar: Mesh) -> list[Mesh]:
    """The avatar in each picture of a walk on the spot, all with the same bounds, so that they are drawn alike."""
    skeleton = find_skeleton(avatar)
    fine, weights = skinned_mesh(avatar, skeleton)
    soles = sole_points(fine.vertices, weights, skeleton)
    clip = choose_clip("walk", skeleton, soles, options=MotionOptions(in_place=True), rate=12.5)
    shapes = [skinned(fine.vertices, weights, bone_matrices(skeleton, clip.pose(k))) for k in range(len(clip))]
    low, high = np.min(shapes, axis=(0, 1)), np.max(shapes, axis=(0, 1))
    corners = np.array([low, high]).repeat(3, axis=0) + 1e-6 * np.tile(np.eye(3), (2, 1))  # too small to be seen
    triangles = np.concatenate((fine.triangles, len(fine.vertices) + np.arange(6, dtype=np.int32).reshape(2, 3)))
    colors = np.concatenate((fine.colors, np.zeros((6, 3), np.uint8)))
    return [Mesh(np.concatenate((shape, corners)), triangles, colors) for shape in shapes]


# --- the plan of the rig ---------------------------------------------------------------------------------------------


def _room_plan() -> None:
    """The plan of the smallest room of docs/plan.md, and its preview."""
    placement = find_placement(ROOMS["small"], "azure_kinect")
    write_plan_drawing(IMAGES / "room_plan.svg", placement)
    write("room_preview", plan_picture(placement.rig, mannequin()))


def plan(rig: Rig) -> str:
    """SVG: where camera, person and mirrors stand, from above and from the side, drawn from the rig's own numbers."""
    s = 140  # px a metre

    def at(x, y):
        return 350 + s * x, 185 - s * y

    camera = rig.camera
    parts = ['<rect width="1160" height="590" fill="#fff"/>']

    def line(a, b, style):
        parts.append(f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" {style}/>')

    def text(x, y, words, anchor="start", weight="normal", fill="#333"):
        parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-weight="{weight}" fill="{fill}">{words}</text>'
        )

    sight = 'stroke="#e08a1e" stroke-width="1.6" stroke-dasharray="6 4"'
    measure = 'stroke="#777" stroke-width="1" marker-start="url(#tick)" marker-end="url(#tick)"'
    parts.append(
        '<defs><marker id="tick" viewBox="0 0 2 10" refX="1" refY="5" markerWidth="2" markerHeight="10" orient="auto">'
        '<line x1="1" y1="0" x2="1" y2="10" stroke="#777" stroke-width="1.5"/></marker></defs>'
    )
    text(24, 34, "Seen from above", weight="bold")
    c = at(camera[0], camera[1])
    half = math.atan(rig.intrinsics.width / 2 / rig.intrinsics.fx)
    for side in (-1, 1):
        far = at(side * 2.1 * math.tan(half), camera[1] + 2.1)
        line(c, far, 'stroke="#bbb" stroke-width="1"')
    edge = at(1.02, -1.05)
    text(*edge, "edge of the", fill="#888")
    text(edge[0], edge[1] + 17, "camera’s view", fill="#888")
    person = at(0, 0)
    for mirror in rig.mirrors:
        right = mirror.axes[0]
        ends = [at(*(np.array(mirror.centre) + k * mirror.width / 2 * right)[:2]) for k in (-1, 1)]
        middle = at(*mirror.centre[:2])
        line(c, middle, sight)
        line(middle, person, sight)
        line(*ends, 'stroke="#3f7fb5" stroke-width="7" stroke-linecap="round"')
    line(c, person, sight)
    parts.append(f'<ellipse cx="{person[0]}" cy="{person[1]}" rx="36" ry="19" fill="#d9d4cc" stroke="#555"/>')
    parts.append(f'<circle cx="{person[0]}" cy="{person[1]}" r="14" fill="#8a7a6a"/>')
    parts.append(f'<path d="M {person[0] - 5} {person[1] + 13} l 5 7 l 5 -7 z" fill="#8a7a6a"/>')
    parts.append(f'<rect x="{c[0] - 20}" y="{c[1] - 4}" width="40" height="18" rx="4" fill="#444"/>')
    text(c[0] + 30, c[1] + 12, "camera")
    text(person[0] + 44, person[1] + 18, "person")
    right_mirror = rig.mirrors[0]
    m = at(*right_mirror.centre[:2])
    turn = math.degrees(math.atan2(abs(right_mirror.normal[0]), -right_mirror.normal[1]))
    text(m[0] + 18, m[1] + 60, f"mirror, turned {turn:.0f}°", fill="#3f7fb5")
    text(m[0] + 18, m[1] + 77, "towards the person", fill="#3f7fb5")
    x = at(-1.95, 0)[0]
    line((x, person[1]), (x, c[1]), measure)
    text(x - 8, (person[1] + c[1]) / 2, f"{-camera[1]:.1f} m", "end")
    line((x, person[1]), (x, m[1]), measure)
    text(x - 8, (person[1] + m[1]) / 2 + 5, f"{right_mirror.centre[1]:.2f} m", "end")
    y = at(0, 1.02)[1]
    left = at(*rig.mirrors[1].centre[:2])
    line((left[0], y), (person[0], y), measure)
    line((person[0], y), (m[0], y), measure)
    for a in (left, m):
        text((a[0] + person[0]) / 2, y - 8, f"{right_mirror.centre[0]:.1f} m", "middle")

    text(680, 34, "Seen from the side", weight="bold")
    s, ground = 95, 320

    def side(y, z):
        return 710 + s * (y - camera[1]), ground - s * z

    line((670, ground), (1055, ground), 'stroke="#555" stroke-width="2"')
    c = side(camera[1], camera[2])
    half = math.atan(rig.intrinsics.height / 2 / rig.intrinsics.fy)
    for k in (-1, 1):
        # the lower edge is drawn as far as the floor
        slope = math.tan(k * half - math.radians(rig.tilt_deg))
        reach = min(3.3, -camera[2] / slope) if slope < 0 else 2.75
        line(c, side(camera[1] + reach, camera[2] + slope * reach), 'stroke="#bbb" stroke-width="1"')
    parts.append(f'<rect x="{c[0] - 14}" y="{c[1] - 7}" width="20" height="14" rx="3" fill="#444"/>')
    line((c[0] - 4, c[1] + 7), (c[0] - 4, ground), 'stroke="#444" stroke-width="2"')
    text(c[0] + 6, ground - 20, f"lens {camera[2]:.1f} m")
    text(c[0] + 6, ground - 4, "above the floor")
    head, foot = side(0, 1.7), side(0, 0)
    parts.append(
        f'<rect x="{foot[0] - 13}" y="{head[1] + 24:.1f}" width="26" height="{foot[1] - head[1] - 24:.1f}" rx="12" '
        f'fill="#d9d4cc" stroke="#555"/><circle cx="{head[0]}" cy="{head[1] + 12:.1f}" r="12" fill="#8a7a6a"/>'
    )
    bottom = right_mirror.centre[2] - right_mirror.height / 2
    low, high = side(right_mirror.centre[1], bottom), side(right_mirror.centre[1], bottom + right_mirror.height)
    line(low, high, 'stroke="#3f7fb5" stroke-width="7" stroke-linecap="round"')
    text(low[0] + 12, (low[1] + high[1]) / 2, f"{right_mirror.width:.1f} m wide", fill="#3f7fb5")
    text(low[0] + 12, (low[1] + high[1]) / 2 + 17, f"{right_mirror.height:.2f} m high", fill="#3f7fb5")
    text(low[0] + 12, ground - 8, f"{100 * bottom:.0f} cm up", fill="#3f7fb5")

    text(680, 400, "In words", weight="bold")
    notes = (
        f"Camera {-camera[1]:.1f} m before the person, lens at hip height,",
        f"nearly level ({rig.tilt_deg:.0f}° down).",
        "Person faces the camera, arms and legs a little apart.",
        "Mirrors upright, behind the person on either side,",
        "each turned until the camera sees the person’s",
        "back in the middle of it.",
        "From the lens you see three people: one from the",
        "front, two from behind, heads and feet in all three.",
    )
    for k, words in enumerate(notes):
        text(680, 422 + 20 * k, words)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1160 590" font-family="sans-serif" font-size="14">\n'
        + "\n".join(parts)
        + "\n</svg>\n"
    )


if __name__ == "__main__":
    main()
