"""What is kept with an avatar about how it came out: ``report.json`` as text, and its problems in words."""

from __future__ import annotations

import json

import bpy

from .texts import say

REPORT = "mirror_scan_report"  # custom property of an avatar: report.json as text


def avatar_report(avatar: bpy.types.Object | None) -> dict | None:
    """The report kept with an avatar, or None for any other object (also when its text was edited into nonsense)."""
    text = avatar.get(REPORT) if avatar is not None else None
    if not isinstance(text, str):
        return None
    try:
        report = json.loads(text)
    except ValueError:
        return None
    return report if isinstance(report, dict) else None


def set_report(avatar: bpy.types.Object, report: dict) -> None:
    avatar[REPORT] = json.dumps(report, ensure_ascii=False)


def problems_of(report: dict) -> list[dict]:
    """The places to look at, worst first; what was edited into nonsense is left out."""
    problems = report.get("problems", ())
    needed = {"kind", "point", "normal", "size", "area", "count"}
    return [place for place in problems if isinstance(place, dict) and needed <= place.keys()]


def problem_text(place: dict) -> str:
    """One problem in plain words."""
    centimetres = 100 * place["size"]
    text = {
        "hole": say("Hole, {size:.1f} cm across"),
        "edge": say("{count} faces branch off one edge"),
        "crossing": say("Surface runs through itself, {size:.1f} cm"),
        "piece": say("Loose piece, {size:.1f} cm"),
        "guess": say("Nobody saw this: {area:.0f} cm² made up"),
    }.get(place["kind"], place["kind"])
    return text.format(size=centimetres, count=place["count"], area=1e4 * place["area"])


def summary(report: dict) -> list[tuple[str, str, str]]:
    """What a report says of its mesh, as label, value and "OK", "WARN" or ""; leaves out what it does not have."""
    mesh = report.get("mesh", {})
    lines = []
    if mesh.get("height_m") is not None:
        lines.append((say("Height"), f"{mesh['height_m']:.2f} m", ""))
    if mesh.get("volume_l") is not None:
        lines.append((say("Volume"), f"{mesh['volume_l']:.1f} l", ""))
    if "vertices" in mesh:
        lines.append((say("Vertices"), f"{mesh['vertices']:,}", ""))
    if "watertight" in mesh:
        closed = mesh["watertight"]
        lines.append((say("Surface"), say("closed") if closed else say("has holes"), "OK" if closed else "WARN"))
    if "manifold" in mesh:
        clean = mesh["manifold"]
        lines.append((say("Edges"), say("two faces each") if clean else say("some branch"), "OK" if clean else "WARN"))
    if mesh.get("components", 1) > 1:
        lines.append((say("Pieces"), str(mesh["components"]), "WARN"))
    if "self_intersections" in mesh:
        count = mesh["self_intersections"]
        text = say("none") if not count else say("{count:,} faces").format(count=count)
        lines.append((say("Crossings"), text, "WARN" if count else "OK"))
    return lines


def distances(report: dict) -> list[tuple[str, str, str]]:
    """How well the views fitted, as :func:`summary`: mirrors, gaps bridged by seams, share of made-up surface."""
    lines = []
    for mirror in report.get("mirrors", ()):
        if mirror.get("residual_mm") is not None:
            label = say("Mirror {name}").format(name=mirror.get("name", ""))
            good = mirror["residual_mm"] <= 12.0
            text = say("fits to {residual:.1f} mm").format(residual=mirror["residual_mm"])
            lines.append((label, text, "OK" if good else "WARN"))
    for seam in report.get("seams", ()):
        if seam.get("mean_gap_mm") is not None and len(seam.get("between", ())) == 2:
            label = say("Gap {one}–{other}").format(one=seam["between"][0], other=seam["between"][1])
            text = say("{mean:.0f} mm, widest {widest:.0f} mm").format(
                mean=seam["mean_gap_mm"], widest=seam.get("max_gap_mm", 0.0)
            )
            lines.append((label, text, "WARN" if seam["mean_gap_mm"] > 40 else ""))
    mesh = report.get("mesh", {})
    faces = mesh.get("triangles")
    if faces and "fill_triangles" in mesh:
        lines.append((say("Made up"), f"{(mesh['fill_triangles'] + mesh.get('seam_triangles', 0)) / faces:.0%}", ""))
    timings = report.get("timings_ms", {})
    if timings:
        seconds = timings.get("total", sum(timings.values())) / 1000
        lines.append((say("Time"), f"{seconds:.1f} s", ""))
    return lines
