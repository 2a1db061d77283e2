"""Mirrors that contradict the other views: what one view shows is where another sees empty space."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage
from ..errors import Notice
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.curved_glass import behind_front, without_delay
from ..mirrors.mirror import expected_error
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..subject.subject_views import Views
from ..views.view_correspondences import Correspondences, find_correspondences, noise_of, surfaces
from ..views.view_maps import ViewMaps
from .seam_disagreement import planes_by_seams

_RADIUS = 1.0  # how far from the vertical through the subject it may reach [m]
_THROUGH = 0.2  # of what is seen directly may be where a mirror sees empty space: silhouettes are ragged
_BACK_THROUGH = 0.35  # the same of what a mirror shows, whose silhouettes are coarser, where the camera does
_HIDDEN = 0.03  # surfaces farther behind others are hidden by them [m]
_OTHER_PART = 0.12  # surfaces of the subject that are at a larger distance are other parts of it [m]
_DOUBLED, _MOSTLY_THROUGH = 0.03, 0.5  # m, and share in free space, from which on the surface would be doubled
_FEWEST = 40  # pieces of surface: a median of fewer is chance
_LIFTED = 0.026  # m: a lean of 1° displaces 36 mm at the subject, a bow of 2.5 mm up to 17 mm
_GLASS = 0.005  # m: mirrors are so thick, or thin; either excuses them
_BESIDE_SUBJECT = 4  # px
_FLOOR_SEARCHED = 0.15  # above and below the floor [m]
_OFF_FEET, _ABOUT_FEET = (
    0.2,
    0.55,
)  # from the middle of the subject: farther off a given plane's glass may have ended [m]
_FEWEST_FLOOR, _FLAT = 200, 0.6  # readings of it, and their share that must lie in one plane
_LEAST = 0.012  # m: two surfaces so close make no visible step
_BOTH_THROUGH = 0.62  # the share that of two mirrors the one must show where the other sees empty space
_ROUGH = 2.0  # times what neighbouring pairs differ by
_BOTH_THICK = 0.024  # m: so far from each other two mirrors of glass of unknown thickness may show a surface
_CERTAIN = 0.6  # difference of the blame on two mirrors, where 1 is to contradict the direct view


@dataclass(frozen=True)
class Disagreement:
    """Two views place the subject at a distance from each other.

    Parameters
    ----------
    mirror : int
        Index of the mirror most likely at fault.
    other : int
        The view it contradicts, 0 = direct.
    distance : float
        Median distance of surfaces both see [m]; 0 when that is no more than noise, or they hardly overlap.
    through : float
        Share of what one of them shows that is where the other sees empty space: free-space violations.
    sure : bool
        It is certainly this mirror; else it may as well be the other.
    """

    mirror: int
    other: int
    distance: float
    through: float
    sure: bool

    @property
    def hopeless(self) -> bool:
        """The surface would be doubled, and by which mirror is known."""
        return self.sure and (self.distance > _DOUBLED or self.through > _MOSTLY_THROUGH)


def disagreements(image: RgbdImage, views: Views, mirrors: list[Mirror]) -> list[Disagreement]:
    """Where views of the subject contradict each other, the worst of each mirror.

    Compared is what each mirror shows about the subject's place, whether it was taken for the subject or not: a mirror
    that is far off shows something that no longer looks like it.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    views : Views
        Of :func:`.subject_search.find_subject`.
    mirrors : list of Mirror

    Returns
    -------
    list of Disagreement
        At most one a mirror, by the mirror's index.

    Notes
    -----
    O(pixels of the subject).
    """
    depth, intrinsics = image.depth, image.intrinsics
    subject = dot(views.points.reshape(-1, 3)[np.flatnonzero(views.labels == 0)[::5]], views.up)
    low, high = (subject.min(), subject.max()) if len(subject) else (-np.inf, np.inf)
    low = low + 0.1 if views.floor is None else views.floor + 0.1
    labels = _about_kernel(views.labels, views.seen, views.points, views.up, views.axis, low, high + 0.1)
    seen = _within_glass(views, mirrors)
    noise = noise_of(depth, labels)
    shown = [surfaces(image, labels, view, noise) for view in range(len(mirrors) + 1)]
    both_ways: dict[tuple[int, int], list[Correspondences]] = {}
    for m in find_correspondences(mirrors, shown, intrinsics, _OTHER_PART, depth, seen):
        both_ways.setdefault((min(m.of, m.by), max(m.of, m.by)), []).append(m)
    contradictions = []  # pair, distance, share of free-space violations
    doubt = np.zeros(len(mirrors) + 1)  # how far each mirror contradicts the direct view, be it too little to report
    for pair, found in both_ways.items():
        distance, through = _distance(found), max(_looked_through(m) for m in found)
        if pair[0] == 0:
            doubt[pair[1]] = max(m.through / max(m.judged, 100) for m in found)
        if distance > 0.0 or any(_looked_through(m) > _usual_through(m) for m in found):
            contradictions.append((pair, distance, through))
    direct = {pair[1] for pair, _, _ in contradictions if pair[0] == 0}
    worst: dict[int, Disagreement] = {}
    for pair, distance, through in contradictions:
        guilty, witness, sure = (pair[1], 0, True) if pair[0] == 0 else _blame(pair, mirrors, doubt, direct)
        known = worst.get(guilty, Disagreement(guilty - 1, witness, 0.0, 0.0, False))
        worst[guilty] = replace(
            known,
            distance=max(distance, known.distance),
            through=max(through, known.through),
            sure=sure or known.sure,
        )
    return [worst[k] for k in sorted(worst)]


def _within_glass(views: Views, mirrors: list[Mirror]) -> np.ndarray:
    """The view of each pixel (H, W), -1 where it may pass a glass whose ends are not known.

    Beside it the room behind the mirror is seen, which says nothing of what stands before it.
    """
    seen = views.seen
    for k, mirror in enumerate(mirrors):
        if mirror.rectangle is not None:
            continue
        rows, columns = (np.flatnonzero((views.labels == k + 1).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            continue
        surely = np.zeros(seen.shape, np.bool_)
        surely[
            max(rows[0] - _BESIDE_SUBJECT, 0) : rows[-1] + _BESIDE_SUBJECT + 1,
            max(columns[0] - _BESIDE_SUBJECT, 0) : columns[-1] + _BESIDE_SUBJECT + 1,
        ] = True
        seen = np.where((seen == k + 1) & ~surely, -1, seen).astype(seen.dtype)
    return seen


def _whatever_glass(image: RgbdImage, views: Views, mirrors: list[Mirror], timed: bool | None) -> list[Disagreement]:
    """Contradictions that hold whether glass of unknown thickness is thin or thick.

    Thick glass sets what it shows to a camera that measures time farther away by two to three times its thickness.
    """
    found = disagreements(image, views, mirrors)
    unknown = timed is not False and any(m.glass_thickness == 0.0 for m in mirrors)
    if not found or not unknown:
        return found
    thick = [m if m.glass_thickness else behind_front(m, _GLASS) for m in mirrors]
    found = [d for d in found if d.other == 0 or d.distance > _BOTH_THICK or d.distance == 0.0]
    others = {d.mirror: d for d in disagreements(without_delay(image, thick), views, thick)}
    return [
        replace(d, distance=min(d.distance, other.distance), through=min(d.through, other.through))
        for d in found
        if (other := others.get(d.mirror)) is not None
        and (min(d.distance, other.distance) > 0.0 or min(d.through, other.through) > _THROUGH)
    ]


def _distance(found: list[Correspondences]) -> float:
    """Median distance [m] of surfaces that two views both see; 0 when it is only noise, or they hardly overlap."""
    # what lies far behind what the other view sees there may well be hidden from it
    gaps = np.concatenate(
        [np.abs(m.gaps[m.gaps < _HIDDEN]) for m in found] + [np.full(m.before, _OTHER_PART) for m in found]
    )
    variances = np.concatenate([m.variances for m in found])
    if len(gaps) < _FEWEST or not len(variances):
        return 0.0
    distance = float(np.median(gaps))
    # a camera's noise may be more than its readings beside each other tell: what neighbouring pairs differ by
    steps = np.concatenate([np.diff(m.gaps) for m in found])
    rough = 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(2.0) if len(steps) >= _FEWEST // 2 else 0.0
    return distance if distance >= max(_LEAST, 3.0 * float(np.sqrt(np.median(variances))), _ROUGH * rough) else 0.0


def _blame(pair: tuple[int, int], mirrors: list[Mirror], doubt: np.ndarray, direct: set[int]) -> tuple[int, int, bool]:
    """Which of two mirrors that contradict each other is wrong, the other one, and whether that is certain.

    By the direct view where it decides (``direct``: the mirrors that contradict it, ``doubt`` (N+1,): by how much),
    else by how well their frames give their planes.
    """
    errors = [expected_error(mirrors[k - 1]) + 1e-6 for k in pair]
    one, other = ((k in direct) + 4.0 * doubt[k] + 0.2 * np.log2(e) for k, e in zip(pair, errors, strict=True))
    guilty, witness = pair if one > other else (pair[1], pair[0])
    return guilty, witness, abs(one - other) > _CERTAIN


def _usual_through(m: Correspondences) -> float:
    """Share of the pieces from which on they contradict the other view."""
    if m.of > 0 and m.by > 0:  # the one may show what the frame of the other hides: seams judge them better
        return _BOTH_THROUGH
    return _THROUGH if m.of == 0 else _BACK_THROUGH


def _looked_through(m: Correspondences) -> float:
    """Share of the pieces, where there are enough to go by; of a few most must say so."""
    share = m.through / max(m.judged, 1)
    return share if m.judged >= 100 or (m.judged >= _FEWEST and share > 0.7) else 0.0


@njit(cache=True, nogil=True)
def _about_kernel(labels, seen, points, up, axis, low, high):
    """The directly seen subject's pixels, 0, and what mirrors show about it, their views; else -1."""
    out = np.full(labels.shape, -1, np.int8)
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            if labels[v, u] == 0:
                out[v, u] = 0
            if seen[v, u] <= 0:
                continue
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            height = up[0] * x + up[1] * y + up[2] * z
            if height <= low or height >= high:
                continue
            x, y, z = x - axis[0], y - axis[1], z - axis[2]
            along = up[0] * x + up[1] * y + up[2] * z
            if x * x + y * y + z * z - along * along < _RADIUS * _RADIUS:
                out[v, u] = seen[v, u]
    return out


def check_agreement(
    image: RgbdImage, views: Views, mirrors: list[Mirror], timed: bool | None = False
) -> tuple[Views, list[str]]:
    """Mirrors that contradict the other views are reported, and left out where they would double the body.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    views : Views
        Of :func:`.subject_search.find_subject`.
    mirrors : list of Mirror
    timed : bool or None
        The camera measures time, so that thick glass delays what it reads; None = not known.

    Returns
    -------
    views : Views
        Without the pixels of mirrors that are left out.
    warned : list of str
        Each says which mirror, by how much, and what to do.
    """
    warned: list[str] = []
    known: set[int] = set()
    labels = views.labels
    for found in _whatever_glass(image, views, mirrors, timed):
        name = quoted(mirrors[found.mirror])
        other = "the camera" if found.other == 0 else quoted(mirrors[found.other - 1])
        if found.distance:
            how = Notice(
                "{distance:.0f} cm away from where {other} shows it", distance=100.0 * found.distance, other=other
            )
        else:
            how = Notice("where {other} sees empty space, {share:.0%} of it", other=other, share=found.through)
        who = "its plane is wrong: pick points on all sides of its frame again"
        if not found.sure:
            who = "the plane of one of the two is wrong: pick points on all sides of both frames again"
        if found.hopeless:
            labels = np.where(labels == found.mirror + 1, -1, labels).astype(labels.dtype)
            what = Notice(
                "{name} is left out, because it would double the body: it places the subject {how}", name=name, how=how
            )
        else:
            what = Notice("{name} places the subject {how}, which makes the surface uneven there", name=name, how=how)
        known.add(found.mirror)
        warned.append(
            Notice(
                "{what}; {who} (on nothing else), check that the mirror is flat and has not moved, or record a longer "
                "burst",
                what=what,
                who=who,
                mirrors=[mirrors[k - 1].name for k in (found.mirror + 1, found.other) if k > 0],
            )
        )
    for k, lift in floor_lifts(views, len(mirrors)).items():
        if k in known or abs(lift) < _LIFTED:
            continue
        warned.append(
            Notice(
                "{name} shows the floor about the subject {distance:.0f} cm {side} where the camera sees it: its plane "
                "leans otherwise than the mirror does; pick points on all sides of its frame again, or check that the "
                "mirror has not moved",
                name=quoted(mirrors[k]), distance=100.0 * abs(lift), mirrors=[mirrors[k].name],
                side=Notice("above") if lift > 0.0 else Notice("below"),
            )
        )  # fmt: skip
    return replace(views, labels=labels), warned


def check_seams(
    mirrors: list[Mirror], maps: ViewMaps, mesh: Mesh, timed: bool | None, told: Iterable[str] = ()
) -> list[str]:
    """Mirrors whose planes the seams between the views contradict.

    Parameters
    ----------
    mirrors : list of Mirror
        In the order of the views that ``maps`` says are reflected.
    maps : ViewMaps
    mesh : Mesh
        As :func:`.zipper.zip_patches` leaves it.
    timed : bool or None
        As in :func:`check_agreement`.
    told : iterable of str
        What is warned of already: mirrors that :func:`check_agreement` found wrong are not reported again.

    Returns
    -------
    list of str
        Each says which mirror, by how much, and what to do.
    """
    known = {name for text in told if _calls_plane_wrong(text) for name in Notice.of(text).mirrors}
    warned: list[str] = []
    for doubt in planes_by_seams(mirrors, maps, mesh, timed):
        about = [mirrors[k] for k in (doubt.mirror, *doubt.others)]
        if known.issuperset(m.name for m in about):
            continue
        if doubt.others:
            text = Notice(
                "the seams between {names} and the other views do not meet: the plane of one of these mirrors "
                "misplaces the subject by about {distance:.0f} cm; pick points on all sides of their frames again (on "
                "nothing else), or check that the mirrors are flat and have not moved",
                names=_listed([quoted(m) for m in about]), distance=100.0 * doubt.distance,
                mirrors=[m.name for m in about],
            )  # fmt: skip
        else:
            text = Notice(
                "the seams between {name} and the other views do not meet: its plane misplaces the subject by about "
                "{distance:.0f} cm; pick points on all sides of its frame again (on nothing else), or check that the "
                "mirror is flat and has not moved",
                name=quoted(about[0]), distance=100.0 * doubt.distance, mirrors=[about[0].name],
            )  # fmt: skip
        warned.append(text)
    return warned


def _listed(names: list[Notice]) -> Notice:
    """Two or more names as a sentence has them."""
    out = names[0]
    for name in names[1:]:
        out = Notice("{first} and {second}", first=out, second=name)
    return out


def _calls_plane_wrong(text: str) -> bool:
    return "what" in Notice.of(text).values and "who" in Notice.of(text).values


def floor_lifts(views: Views, count: int) -> dict[int, float]:
    """How far above the floor each of ``count`` mirrors shows the floor about the subject [m], by the mirror's index.

    A lean displaces the reflection upright, along most of a body's surface, so that skin hardly shows it. Mirrors that
    show too little floor are left out.
    """
    if views.floor is None:
        return {}
    out = {}
    for k in range(count):
        points = views.points[(views.seen == k + 1) & (views.labels < 0)]
        height = dot(points, views.up) - views.floor
        aside = points - views.axis
        aside = aside - dot(aside, views.up)[:, None] * views.up
        distance = np.linalg.norm(aside, axis=1)
        near = (np.abs(height) < _FLOOR_SEARCHED) & (distance > _OFF_FEET) & (distance < _ABOUT_FEET)
        if near.sum() < _FEWEST_FLOOR:
            continue
        lift = float(np.median(height[near]))
        about = np.abs(height[near] - lift) < _LIFTED
        if about.mean() > _FLAT:
            out[k] = float(np.median(height[near][about]))
    return out


def quoted(mirror: Mirror) -> Notice:
    """How a sentence names a mirror; a notice that has it among its values is about this mirror."""
    return Notice("the mirror “{name}”", name=mirror.name, mirrors=[mirror.name])
