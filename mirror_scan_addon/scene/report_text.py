"""The report kept with an avatar (``report.json`` as text), and its problems and figures in words."""

from __future__ import annotations

import json

import bpy

from ...core.errors import Notice
from ..language.texts import say
from . import units
from .scan_records import REPORT

MANY_CROSSINGS = 1e-3  # share of the faces above which self-intersections are warned of


def avatar_report(avatar: bpy.types.Object | None) -> dict | None:
    """The report kept with an avatar, or None for any other object (also when its text was edited into nonsense)."""
    text = avatar.get(REPORT) if avatar is not None else None
    if not isinstance(text, str):
        return None
    try:
        report = json.loads(text)
    except ValueError:
        return None
    return _with_notices(_sound(report)) if isinstance(report, dict) else None


SHOWN = {
    "mesh": ("height_m", "volume_l", "vertices", "components", "self_intersections", "triangles", "fill_triangles",
             "seam_triangles", "filled_share"),
    "mirrors": ("residual_mm",),
    "optics": ("lit_twice_share", "corrected_share"),
    "seams": ("mean_gap_mm", "max_gap_mm"),
}  # fmt: skip
"""Numbers of a report that are shown; ``mirrors`` and ``seams`` are lists of what holds them."""


def _sound(report: dict) -> dict:
    """A report without what somebody edited into nonsense."""
    kinds = {
        "mesh": dict,
        "optics": dict,
        "texture": dict,
        "measurements": dict,
        "timings_ms": dict,
        "mirrors": list,
        "seams": list,
        "warnings": list,
        "problems": list,
        "notices": list,
    }
    sound = {name: value for name, value in report.items() if isinstance(value, kinds.get(name, object))}

    def numbers(values: dict, names: tuple[str, ...]) -> dict:
        return {name: value for name, value in values.items() if name not in names or _is_number(value)}

    for name, names in SHOWN.items():
        if isinstance(sound.get(name), dict):
            sound[name] = numbers(sound[name], names)
        elif name in sound:
            sound[name] = [numbers(value, names) for value in sound[name] if isinstance(value, dict)]
    if "timings_ms" in sound:
        sound["timings_ms"] = numbers(sound["timings_ms"], tuple(sound["timings_ms"]))
    for seam in sound.get("seams", ()):
        if not isinstance(seam.get("between", []), list):
            del seam["between"]
    return sound


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def set_report(avatar: bpy.types.Object, report: dict) -> None:
    """Keep a report with an avatar.

    Of a notice among the ``warnings`` JSON keeps only its text, so the parts are kept beside them, as ``notices``.
    """
    warnings = report.get("warnings")
    notices = (
        [text.parts() for text in warnings if isinstance(text, Notice)] if isinstance(warnings, list | tuple) else []
    )
    avatar[REPORT] = json.dumps(report | ({"notices": notices} if notices else {}), ensure_ascii=False)


def _with_notices(report: dict) -> dict:
    """A report whose warnings are notices again, where their parts were kept and still make that text."""
    kept = {}
    for parts in report.pop("notices", ()):
        try:
            notice = Notice.of_parts(parts)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError):  # edited into nonsense
            continue
        kept[str(notice)] = notice
    if kept:
        report["warnings"] = [kept.get(str(text), text) for text in report.get("warnings", ())]
    return report


def problems_of(report: dict) -> list[dict]:
    """The places to look at, worst first; what was edited into nonsense is left out, and surface that no view saw,
    which older versions took for a problem."""
    return [
        place
        for place in report.get("problems", ())
        if isinstance(place, dict) and _is_problem(place) and place["kind"] != "guess"
    ]


def _is_problem(place: dict) -> bool:
    vectors = all(
        isinstance(place.get(name), list) and len(place[name]) == 3 and all(map(_is_number, place[name]))
        for name in ("point", "normal")
    )
    return (
        vectors
        and isinstance(place.get("kind"), str)
        and all(_is_number(place.get(name)) for name in ("size", "area", "count"))
    )


def problem_text(place: dict, scene: bpy.types.Scene) -> str:
    """One problem in plain words, its size in the scene's units."""
    text = {
        "hole": say("Hole, {size} across"),
        "edge": say("{count} faces share one edge"),
        "crossing": say("Surface intersects itself, {size}"),
        "piece": say("Loose piece, {size}"),
    }.get(place["kind"], "{kind}")
    return text.format(size=units.length_text(place["size"], scene), count=place["count"], kind=place["kind"])


def summary(report: dict, scene: bpy.types.Scene) -> list[tuple[str, str, str]]:
    """What a report says of its mesh, as label, value and "OK", "WARN" or ""; leaves out what it does not have."""
    mesh = report.get("mesh", {})
    lines = []
    if mesh.get("height_m") is not None:
        lines.append((say("Height"), units.length_text(mesh["height_m"], scene), ""))
    if mesh.get("volume_l") is not None:
        lines.append((say("Volume"), units.volume_text(mesh["volume_l"], scene), ""))
    if "vertices" in mesh:
        lines.append((say("Vertices"), f"{mesh['vertices']:,}", ""))
    if "watertight" in mesh:
        closed = mesh["watertight"]
        lines.append((say("Surface"), say("closed") if closed else say("has holes"), "OK" if closed else "WARN"))
    if "manifold" in mesh:
        clean = mesh["manifold"]
        lines.append((say("Edges"), say("manifold") if clean else say("non-manifold"), "OK" if clean else "WARN"))
    if mesh.get("components", 1) > 1:
        lines.append((say("Pieces"), str(mesh["components"]), "WARN"))
    if mesh.get("self_intersections") is not None:
        count = mesh["self_intersections"]
        text = say("none") if not count else say("{count:,} faces").format(count=count)
        # a few in tens of thousands do no harm: the build leaves them rather than cut for them
        much = count > MANY_CROSSINGS * mesh.get("triangles", 0)
        lines.append((say("Intersections"), text, "OK" if not count else "WARN" if much else ""))
    return lines


def distances(report: dict) -> list[tuple[str, str, str]]:
    """How well the views fit, as :func:`summary`: mirrors, gaps bridged by seams, share of surface not measured."""
    lines = []
    for mirror in report.get("mirrors", ()):
        if mirror.get("residual_mm") is not None:
            text = say("flat to {residual:.1f} mm").format(residual=mirror["residual_mm"])
            lines.append((mirror_label(str(mirror.get("name", ""))), text, ""))
    for seam in report.get("seams", ()):
        if seam.get("mean_gap_mm") is not None and len(seam.get("between", ())) == 2:
            label = _gap_label(*map(str, seam["between"]))
            text = say("{mean:.0f} mm, at most {widest:.0f} mm").format(
                mean=seam["mean_gap_mm"], widest=seam.get("max_gap_mm", 0.0)
            )
            lines.append((label, text, ""))
    mesh = report.get("mesh", {})
    share = mesh.get("filled_share")
    if share is None and mesh.get("triangles") and "fill_triangles" in mesh:  # of an older version
        share = mesh["fill_triangles"] / mesh["triangles"]
    if share is not None:
        lines.append((say("Filled"), say("{share} of the surface, seen by no view").format(share=_percent(share)), ""))
    light = report.get("optics", {})
    if "lit_twice_share" in light:
        text = say("{lit:.0%}, corrected: {corrected:.0%}").format(
            lit=light["lit_twice_share"], corrected=light.get("corrected_share", 0.0)
        )
        lines.append((say("Two-way light"), text, ""))
    timings = report.get("timings_ms", {})
    if timings:
        seconds = timings.get("total", sum(timings.values())) / 1000
        lines.append((say("Time"), f"{seconds:.1f} s", ""))
    return lines


def texture_lines(texture: dict) -> list[tuple[str, str, str]]:
    """What a report says of an avatar's texture, as :func:`summary`."""
    lines = []
    if _is_number(texture.get("size")):
        lines.append((say("Texture"), say("{size} × {size} px").format(size=texture["size"]), ""))
    if _is_number(texture.get("texel_mm")):
        lines.append((say("Texture pixel"), say("{size:.1f} mm").format(size=texture["texel_mm"]), ""))
    if _is_number(texture.get("seen_share")):
        lines.append((say("Seen"), f"{texture['seen_share']:.0%}", ""))
    return lines


def measurements_of(report: dict) -> dict[str, dict]:
    """The measures that a report holds, by name: ``mm``, ``error_mm`` and ``iso_name``; without what was edited into
    nonsense."""
    found = report.get("measurements")
    sound = found.items() if isinstance(found, dict) else ()
    return {
        name: {"mm": one["mm"], "error_mm": one["error_mm"], "iso_name": str(one.get("iso_name", ""))}
        for name, one in sound
        if isinstance(one, dict) and _is_number(one.get("mm")) and _is_number(one.get("error_mm"))
    }


MEASURES = {
    "height": "Height", "height_standing": "Height Upright", "chest": "Chest", "waist": "Waist", "hip": "Hip",
    "thigh": "Thigh", "calf": "Calf", "upper_arm": "Upper Arm", "neck": "Neck", "inseam": "Inseam",
    "arm_length": "Arm Length", "shoulder_width": "Shoulder Width",
}  # fmt: skip
"""How the panel names each measure."""


def measures(report: dict, scene: bpy.types.Scene) -> list[tuple[str, str, str]]:
    """What was measured on the body, as :func:`summary`."""
    lines = []
    for name, one in measurements_of(report).items():
        value = units.length_text(one["mm"] / 1000.0, scene)
        text = say("{value} ± {error:.0f} mm").format(value=value, error=one["error_mm"])
        lines.append((say(MEASURES.get(name, name)), text, ""))
    return lines


def _percent(share: float) -> str:
    """A share in percent; what is less than half of one is not said to be nothing."""
    return f"{share:.0%}" if share == 0.0 or share >= 0.005 else "< 1%"


def mirror_label(name: str) -> str:
    """What a mirror is called where nothing else says that it is one: “Mirror left”, but “Mirror 1”, not twice so."""
    return (
        f"{name[0].upper()}{name[1:]}" if name.lower().startswith("mirror") else say("Mirror {name}").format(name=name)
    )


def _gap_label(one: str, other: str) -> str:
    """The gap between two views, which may be twice the same; ``direct`` and ``made`` are names of the report."""
    known = {"direct": say("the direct view"), "made": say("filled surface")}
    if one == other:
        return say("Gaps within {view}").format(view=known.get(one, mirror_label(one)))
    return say("Gap between {one} and {other}").format(
        one=known.get(one, mirror_label(one)), other=known.get(other, mirror_label(other))
    )
