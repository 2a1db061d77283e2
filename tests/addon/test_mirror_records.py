"""Mirrors as a scene keeps them: every field comes back as it was."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("bpy")


def test_every_field_of_a_mirror_comes_back(addon):
    from mirror_scan.core.mirrors import Mirror
    from mirror_scan.mirror_scan_addon.tasks.mirror_records import mirror_of, record_of

    random = np.random.default_rng(5)
    given = {
        "name": "left", "point": random.random(3), "normal": np.array((0.0, 0.0, -1.0)), "basis": np.eye(3),
        "rectangle": random.random((2, 2)), "outline": random.random((4, 2)), "residual": 0.001, "points_used": 70,
        "refined": True, "source": "found", "covariance": np.eye(3), "polygon": random.random((5, 2)),
        "moved_by": ("floor", "person"), "moved": 0.01, "sag": 0.002, "sag_error": 0.001, "glass_thickness": 0.004,
        "frame_bow": (0.1, 0.2, 0.3, 0.4), "bow_by_frame": (random.random(4), random.random((4, 4))),
        "frame_ahead": 0.02, "turn_by_frame": 1e-6,
    }  # fmt: skip
    assert given.keys() == {field.name for field in dataclasses.fields(Mirror)}
    record = record_of(Mirror(**given))
    back = mirror_of(json.loads(json.dumps(record)))
    for name, value in given.items():
        found = getattr(back, name)
        assert type(found) is type(value), name
        for one, other in zip(value, found, strict=True) if isinstance(value, tuple) else [(value, found)]:
            np.testing.assert_array_equal(one, other, err_msg=name)
    assert mirror_of(record_of(Mirror("plain", *(given[name] for name in ("point", "normal", "basis"))))).moved_by == ()
