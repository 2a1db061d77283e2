"""The content of ``report.json``."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from ..avatar.skeleton import BONES, Skeleton
from ..mesh import FILL, SEAM, Mesh
from ..zippering.seam_strips import Seam
from .avatar_stages import AvatarParts
from .scan import Clock, Scan

if TYPE_CHECKING:
    from ..texture import TextureSummary


def scan_report(scan: Scan, patches: list[Mesh], seams: list[Seam], to_avatar: np.ndarray) -> dict:
    """What the report says of cameras, mirrors, views and seams; plain Python values, ready for JSON."""
    names = scan.names
    person = np.concatenate([patch.vertices for patch in patches])[::97]
    return {
        "camera_to_avatar": to_avatar.tolist(),
        "sensor": scan.sensor,
        "cameras": [{"sensor": one.sensor, "measures": one.measures, "by": one.by} for one in scan.principles],
        "mirrors": [
            {
                "name": m.name,
                "point": m.point.tolist(),
                "normal": m.normal.tolist(),
                "residual_mm": 1000.0 * m.residual,
                "points_used": m.points_used,
                "source": m.source,
                "refined": m.refined,
                "moved_by": list(m.moved_by),
                "moved_mm": 1000.0 * m.moved,
                "sag_mm": 1000.0 * m.sag,
                "sag_error_mm": 1000.0 * m.sag_error,
                "glass_thickness_mm": 1000.0 * m.glass_thickness,
                "covariance": None if m.covariance is None else m.covariance.tolist(),
                "displacement_mm": None if (error := m.displacement(person)) is None else 1000.0 * error,
            }
            for m in scan.mirrors
        ],
        "views": [
            {
                "name": name,
                "pixels": int((scan.maps.labels == k).sum()),
                "depth_m": None if np.isnan(scan.limits[k]).any() else scan.limits[k].tolist(),
                "frames": scan.noise[k].frames,
                "frame_noise_mm": _millimetres(scan.noise[k].frame),
                "expected_noise_mm": _millimetres(scan.noise[k].expected),
                "noise_mm": _millimetres(scan.noise[k].fused),
                "vertices": len(patch.vertices),
                "triangles": len(patch.triangles),
            }
            for k, (name, patch) in enumerate(zip(names, patches, strict=True))
        ],
        "seams": _seam_summary(seams, names),
    }


def make_report(
    of_scan: dict, scan: Scan, avatar: AvatarParts, soundness: dict, warnings: tuple[str, ...], clock: Clock
) -> dict:
    """The whole report: what :func:`scan_report` says, and the avatar, whose mesh has that ``soundness``."""
    mesh, checked = avatar.mesh, soundness
    assert mesh.kind is not None  # a closed mesh says it
    report = of_scan | {
        "mesh": {
            "vertices": len(mesh.vertices),
            "triangles": len(mesh.triangles),
            "watertight": checked["watertight"],
            "manifold": checked["manifold"],
            "components": checked["components"],
            "euler_characteristic": checked["euler_characteristic"],
            "self_intersections": checked["self_intersections"],
            "seam_triangles": int((mesh.kind == SEAM).sum()),
            "fill_triangles": int((mesh.kind == FILL).sum()),
            "filled_share": checked.get("filled_share"),
            "volume_l": None if checked["volume_m3"] is None else 1000.0 * checked["volume_m3"],
            "height_m": float(np.ptp(mesh.vertices[:, 2])),
        },
        "optics": None
        if scan.lit_twice is None
        else {"lit_twice_share": scan.lit_twice[0], "corrected_share": scan.lit_twice[1]},
        "timings_ms": {name: round(value, 2) for name, value in clock.laps.items()},
        "warnings": [str(warning) for warning in warnings],  # without the parts of notices
    }
    if avatar.skeleton is not None:
        report["skeleton"] = skeleton_summary(avatar.skeleton)
    if avatar.measurements is not None:
        from ..measurements import measurement_summary  # only those who measure wait for it

        report["measurements"] = measurement_summary(avatar.measurements)
    if avatar.summary is not None:
        report["texture"] = texture_summary(avatar.summary)
    return report


def skeleton_summary(skeleton: Skeleton) -> dict:
    """Joints [m] and how certain they are, by name."""
    return {
        "joints": dict(zip(BONES, skeleton.joints.tolist(), strict=True)),
        "confidence": dict(zip(BONES, skeleton.confidence.tolist(), strict=True)),
    }


def texture_summary(summary: TextureSummary) -> dict:
    """What a texture is like; ``used`` and the shares are parts of 1."""
    found = asdict(summary)
    return {"size": found.pop("size"), "islands": found.pop("islands"), "used": found.pop("used_share"), **found}


def _millimetres(value: float | None) -> float | None:
    return None if value is None else round(1000.0 * value, 3)


def _seam_summary(seams: list[Seam], names: list[str]) -> list[dict]:
    """One row a pair of views, seams weighed by their length."""
    rows = []
    for pair in sorted({seam.views for seam in seams}):
        mine = [seam for seam in seams if seam.views == pair]
        length = sum(seam.length for seam in mine)
        rows.append(
            {
                "between": [names[pair[0]] if pair[0] >= 0 else "made", names[pair[1]] if pair[1] >= 0 else "made"],
                "method": sorted({seam.method for seam in mine}),
                "length_m": length,
                "mean_gap_mm": 1000.0 * sum(s.mean_gap * s.length for s in mine) / length if length else 0.0,
                "max_gap_mm": 1000.0 * max(seam.max_gap for seam in mine),
            }
        )
    return rows
