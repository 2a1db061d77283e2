"""What the panels ask for where nothing was changed is what core does by itself."""

from __future__ import annotations

import pytest
from mirror_scan.core.capture import ReadOptions
from mirror_scan.core.pipeline import Settings
from mirror_scan.mirror_scan_addon.scene.scan_records import build_settings, reading_of


def test_the_panels_begin_with_the_settings_of_core(bpy):
    asked = build_settings(bpy.context.scene.mirror_scan)
    assert asked
    for stage, fields in asked.items():
        own = getattr(Settings(), stage)
        for name, value in fields.items():
            default = getattr(own, name)
            if isinstance(default, float):
                default = pytest.approx(default, rel=1e-6)
            assert value == default, f"{stage}.{name}"


def test_the_panels_read_captures_as_core_does(bpy):
    assert ReadOptions(**reading_of(bpy.context.scene.mirror_scan) | {"intrinsics": None}) == ReadOptions()
