"""What the panels ask for where nothing was changed is what core does by itself."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from mirror_scan.core.capture import ReadOptions
from mirror_scan.core.pipeline import Settings
from mirror_scan.mirror_scan_addon.scene import scan_records
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
    reading = reading_of(bpy.context.scene.mirror_scan)
    assert not reading.pop("lens") and not reading.pop("intrinsics")
    assert ReadOptions(**reading) == ReadOptions()


def test_glass_and_light_of_the_panels_reach_core(bpy):
    settings = bpy.context.scene.mirror_scan
    quality = settings.quality
    quality.glass_offset, quality.glass_thickness, quality.bowed = 0.012, 0.005, False
    quality.two_ways, quality.frequencies = "ON", (100.0, 80.0, 0.0)
    base, asked = Settings(), build_settings(settings)
    chosen = replace(base, **{stage: replace(getattr(base, stage), **fields) for stage, fields in asked.items()})
    assert chosen.mirror.behind_frame == pytest.approx(scan_records.behind_frame(settings))
    assert chosen.mirror.glass_thickness == pytest.approx(0.005) and not chosen.bow.use
    assert chosen.light.two_ways == "on" and chosen.light.frequencies == pytest.approx((100.0, 80.0))


@pytest.mark.parametrize("measures", ["phase", "time", "unknown", "angles", "pulses", None])
def test_frequencies_are_left_out_where_they_do_not_apply(bpy, measures):
    settings = bpy.context.scene.mirror_scan
    settings.quality.frequencies = (100.0, 80.0, 16.0)
    settings.cloud = bpy.data.objects.new("Cloud", bpy.data.meshes.new("Cloud"))
    settings.cloud[scan_records.CLOUD] = json.dumps({} if measures is None else {"measures": measures})
    applies = measures not in ("angles", "pulses")
    assert bool(build_settings(settings)["light"]["frequencies"]) == applies
    assert ("Does not apply" in scan_records.no_two_ways(settings)) != applies
    settings.quality.two_ways = "ON"  # whatever the file says
    assert build_settings(settings)["light"]["frequencies"] and not scan_records.no_two_ways(settings)
    settings.quality.two_ways = "OFF"
    assert not build_settings(settings)["light"]["frequencies"] and "off" in scan_records.no_two_ways(settings)
