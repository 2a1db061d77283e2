"""What the panels ask for where nothing was changed is what core does by itself."""

from __future__ import annotations

import pytest
from mirror_scan.core.pipeline import Settings
from mirror_scan.mirror_scan_addon.state import build_settings


def test_the_panels_begin_with_the_settings_of_core(bpy):
    asked = build_settings(bpy.context.scene.mirror_scan)
    assert asked
    for stage, fields in asked.items():
        own = getattr(Settings(), stage)
        for name, value in fields.items():
            assert value == pytest.approx(getattr(own, name), rel=1e-6), f"{stage}.{name}"
