"""An avatar that cannot be right: refused, with what most likely caused it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..camera import Intrinsics
from ..capture.depth_units import UNIT_MISTAKES
from ..errors import Notice, ReconstructionError
from ..mesh import Mesh
from ..mesh.normals import triangle_normals
from ..mirrors import Mirror
from ..numeric.point_products import lengths, transform

HEIGHTS = (0.5, 2.4)
"""A person is between so tall [m]; taller ones hold up their arms."""

VOLUMES = (0.006, 0.04)
"""A person's volume over the cube of its height: 0.007 in somebody slim with raised arms, 0.025 in a baby."""

USUAL_HEIGHTS, USUAL_DISTANCES = (0.8, 2.2), (1.0, 8.0)
"""Of persons, and from the camera to them, among which a mistaken unit is looked for [m]."""

THINNEST = 0.012
"""A person's mean thickness, the volume over half its surface, over its height is more: .039 in the slimmest."""

_REACH = 0.01  # m: a figure that reaches to within this of where it was cut off is cut off
_DEEPER = 1.25  # a body that crouches has so much more volume for its height, at most
_NEAR_TOP, _USUAL_NEAR_TOP = (
    0.95,
    0.92,
)  # of the volume, and of the height of a slim body, below which that much of it is
_USUAL_HEIGHT = 1.6  # m: of several mistakes the one that makes the subject about so tall
_TOO_NEAR = 0.8  # m: nearer than that no camera sees a whole person
_ARMS_UP = 0.88  # of the height: below which that much of the volume is when a slim body holds its arms up
_OFF_CENTRE = 0.25  # of the image: a principal point is no farther from the middle
_FOCAL = (0.3, 6.0)  # of the image's larger side: a lens of 120° to one of 9°
_DISPLACED, _ROUGH = 0.012, 0.008  # m: a mirror that displaces the subject so much, or whose frame fits so badly


@dataclass(frozen=True)
class ScanFacts:
    """What is known of a scan beside the avatar.

    Parameters
    ----------
    stands : bool
        The floor that it stands on was seen.
    cut : tuple of str
        Sides of the image, "top", "bottom", "left" or "right", that cut the subject off.
    distance : float
        From the camera to the subject, the nearest of several [m].
    highest : float
        Height above the floor at which a person is cut off [m].
    lenses : sequence of Intrinsics
        Of the cameras.
    mirrors : sequence of Mirror
        Camera frame.
    blind : sequence of str
        Names of mirrors in which nothing of the subject was read.
    warnings : sequence of str
        The worst first.
    to_avatar : np.ndarray [shape=(4, 4)]
        Rigid; camera frame → avatar frame.
    """

    stands: bool = True
    cut: tuple[str, ...] = ()
    distance: float = np.nan
    highest: float = np.inf
    lenses: Sequence[Intrinsics] = ()
    mirrors: Sequence[Mirror] = ()
    blind: Sequence[str] = ()
    warnings: Sequence[str] = ()
    to_avatar: np.ndarray = field(default_factory=lambda: np.eye(4))


def check_avatar(mesh: Mesh, volume: float | None, facts: ScanFacts, any_object: bool = False) -> None:
    """Refuse an avatar that nobody can have.

    Parameters
    ----------
    mesh : Mesh
        Avatar frame, soles on z = 0 [m].
    volume : float or None
        It encloses [m³]; None where it is not closed.
    facts : ScanFacts
    any_object : bool
        It may be anything: it must only have an inside.

    Raises
    ------
    ReconstructionError
        It is inside out, too small or too tall for a person, or too flat, too thin or too fat for its height.
    """
    height = float(np.ptp(mesh.vertices[:, 2])) if len(mesh.vertices) else 0.0
    if height <= 0.0 or (volume is not None and volume <= 0.0):
        raise ReconstructionError(
            "the result has no inside: {volume:.1f} l at a height of {height:.2f} m; {cause}",
            volume=1e3 * (volume or 0.0), height=height, cause=_likely_cause(mesh, replace(facts, cut=())), code="size",
        )  # fmt: skip
    if any_object:
        return
    if height < HEIGHTS[0]:
        raise ReconstructionError(
            "the subject would be {height:.2f} m tall, too small for a person: {cause}; if it is an object, say so "
            "(--object; in Blender “Any Object”)",
            height=height, cause=_likely_cause(mesh, facts), code="size",
        )  # fmt: skip
    if height > min(HEIGHTS[1], facts.highest - _REACH):
        raise ReconstructionError(
            "the subject would be {height:.2f} m tall or more, too tall for a person: {cause}; if it is an object, say "
            "so (--object; in Blender “Any Object”)",
            height=height, cause=_likely_cause(mesh, facts), code="size",
        )  # fmt: skip
    if volume is None:
        return
    least, most = _usual_volumes(mesh, height, facts)
    if volume < least:
        raise ReconstructionError(
            "the avatar would have only {volume:.0f} l at a height of {height:.2f} m, and a person has more than "
            "{least:.0f} l: {cause}",
            volume=1e3 * volume, height=height, least=1e3 * least, cause=_likely_cause(mesh, facts, False), code="size",
        )  # fmt: skip
    if volume > most:
        raise ReconstructionError(
            "the avatar would have {volume:.0f} l at a height of {height:.2f} m, and a person has less than {most:.0f} "
            "l: {cause}; if it is an object, say so (--object; in Blender “Any Object”)",
            volume=1e3 * volume, height=height, most=1e3 * most, cause=_likely_cause(mesh, facts, False), code="size",
        )  # fmt: skip
    thickness = _mean_thickness(mesh, volume)
    if thickness < THINNEST * height:
        raise ReconstructionError(
            "the avatar would be {thickness:.0f} mm thick at a height of {height:.2f} m, as flat as a board: {cause}; "
            "if it is an object, say so (--object; in Blender “Any Object”)",
            thickness=1e3 * thickness, height=height, cause=_likely_cause(mesh, facts, False), code="size",
        )  # fmt: skip


def _mean_thickness(mesh: Mesh, volume: float) -> float:
    """The volume [m³] over half the surface [m], as of a board."""
    return 4.0 * volume / float(lengths(triangle_normals(mesh.vertices, mesh.triangles)).sum())


def _usual_volumes(mesh: Mesh, height: float, facts: ScanFacts) -> tuple[float, float]:
    """Least and largest volume of a person of this height [m³]."""
    # arms held up make somebody taller, and hardly larger
    below = _most_below(mesh)
    least = VOLUMES[0] * (height * (below / _USUAL_NEAR_TOP if below < _ARMS_UP else 1.0)) ** 3
    if not facts.stands or "bottom" in facts.cut:
        return least, np.inf  # a trunk has much volume for its height
    # as bent knees make somebody deeper
    depth = float(np.ptp(mesh.vertices[:, 1]))
    deeper = min((1.0 + (depth / height) ** 2) ** 1.5, _DEEPER)
    return least, VOLUMES[1] * deeper * height**3


def _most_below(mesh: Mesh) -> float:
    """Below which part of its height most of its volume is.

    By Gauss's theorem: a level slab's volume is ∫ x n_x dA over the surface between its faces, where n_x is 0.
    """
    corners = mesh.vertices[mesh.triangles]
    b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing = 0.5 * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
    low, high = mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()
    level = np.clip((corners[..., 2].mean(axis=1) - low) / (high - low), 0.0, 1.0)
    order = np.argsort(level)
    below = np.cumsum((facing * corners[..., 0].mean(axis=1))[order])
    return float(level[order][np.searchsorted(np.maximum.accumulate(below), _NEAR_TOP * below[-1])])


def _likely_cause(mesh: Mesh, facts: ScanFacts, by_height: bool = True) -> Notice:
    """What most likely caused it, by evidence, and what to do; ``by_height``: it is the height that is wrong."""
    for lens in facts.lenses:
        wrong = implausible_lens(lens)
        if wrong:
            return wrong
    height = float(np.ptp(mesh.vertices[:, 2])) if len(mesh.vertices) else 0.0
    mistakes = [m for m in UNIT_MISTAKES if _is_usual(height * m[1], facts.distance * m[1])]
    if by_height and mistakes:
        mistake = min(mistakes, key=lambda m: abs(np.log(height * m[1] / _USUAL_HEIGHT)))
        return Notice(
            "it looks like {mistake}, so multiply the depth unit (--depth-unit) by {factor:g}",
            mistake=mistake[0], factor=mistake[1],
        )  # fmt: skip
    if facts.distance < _TOO_NEAR:
        return Notice(
            "it is only {distance:.2f} m from the camera, nearer than a person can be seen as a whole; check the depth "
            "unit (--depth-unit) and the intrinsics",
            distance=facts.distance,
        )
    if {"top", "bottom"} & set(facts.cut):
        return Notice("the picture cuts it off, so step back until the camera sees all of the subject")
    if len(facts.blind):
        return Notice(
            "nothing of it was read in {names}, and so its other side is not known ({why})",
            names=" and ".join(f"“{name}”" for name in facts.blind),
            why=next(
                (text for text in facts.warnings if any(_is_about(text, n) for n in facts.blind)), "check the mirrors"
            ),
        )
    person = transform(mesh.vertices[::97], np.linalg.inv(facts.to_avatar))
    off = [mirror.displacement(person) or 0.0 for mirror in facts.mirrors]
    rough = [mirror.residual for mirror in facts.mirrors]
    if off and (max(off) > _DISPLACED or max(rough) > _ROUGH):
        worst = int(np.argmax(np.maximum(np.array(off) / _DISPLACED, np.array(rough) / _ROUGH)))
        return Notice(
            "the plane of the mirror “{name}” is very uncertain; pick points on all sides of its frame, on nothing "
            "else",
            name=facts.mirrors[worst].name,
        )
    if facts.warnings:
        return Notice("{warning}", warning=facts.warnings[0])
    return Notice("check the depth unit (--depth-unit), the intrinsics and the mirrors' planes")


def _is_about(text: str, view: str) -> bool:
    """Whether a warning is about a mirror's view, which several cameras name “camera: mirror”."""
    mirror = view.rpartition(": ")[2]
    return text.startswith(f"{view}: ") or (f"“{mirror}”" in text and text.startswith(view.removesuffix(mirror)))


def _is_usual(height: float, distance: float) -> bool:
    """Whether a person may be so tall and so far away [m]; a distance that is not known is NaN."""
    near, far = USUAL_DISTANCES
    return USUAL_HEIGHTS[0] <= height <= USUAL_HEIGHTS[1] and not (distance < near or distance > far)


def implausible_lens(lens: Intrinsics) -> Notice | None:
    """What is wrong with a camera's intrinsics, and what to do; None for what a camera may have."""
    off = max(abs(lens.cx / lens.width - 0.5), abs(lens.cy / lens.height - 0.5))
    larger = max(lens.width, lens.height)
    if off > _OFF_CENTRE:
        return Notice(
            "the intrinsics do not fit the picture: their centre ({cx:.0f}, {cy:.0f}) is near the edge of its "
            "{width}×{height} pixels; give those of this resolution (--intrinsics)",
            cx=lens.cx, cy=lens.cy, width=lens.width, height=lens.height,
        )  # fmt: skip
    if not _FOCAL[0] <= min(lens.fx, lens.fy) / larger <= max(lens.fx, lens.fy) / larger <= _FOCAL[1]:
        return Notice(
            "the intrinsics do not fit the picture: a focal length of {focal:.0f} px is no depth camera's at {width}×"
            "{height} pixels; give those of this resolution (--intrinsics)",
            focal=lens.fx, width=lens.width, height=lens.height,
        )  # fmt: skip
    return None
