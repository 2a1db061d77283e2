"""The report kept with an avatar: its warnings keep what they were made of, so that any language can tell them."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("bpy")

from mirror_scan.core.errors import Notice

NOTICE = Notice("{mirror}: {share:.0%}", mirror=Notice("the mirror “{name}”", name="left", mirrors=["left"]), share=0.5)


@pytest.fixture
def avatar(bpy, addon):
    return bpy.data.objects.new("avatar", None)


def test_warnings_keep_their_parts(avatar):
    from mirror_scan.mirror_scan_addon.scene import report_text

    for warnings in ([], ["plain"], [NOTICE, "plain", NOTICE]):
        report_text.set_report(avatar, {"warnings": warnings, "mesh": {"vertices": 3}})
        in_file = json.loads(avatar[report_text.REPORT])
        assert in_file["warnings"] == [str(text) for text in warnings]
        for _ in range(2):  # as when a check adds to the report
            kept = report_text.avatar_report(avatar)
            assert kept == {"warnings": warnings, "mesh": {"vertices": 3}}
            for text, wanted in zip(kept["warnings"], warnings, strict=True):
                assert Notice.of(text).parts() == Notice.of(wanted).parts()
            report_text.set_report(avatar, kept)


@pytest.mark.parametrize("notices", [1, [1], ["x"], [{}], [{"template": "{a.b}", "values": {}, "mirrors": []}],
                                     [{"template": "{", "values": {}, "mirrors": []}],
                                     [{"template": "b", "values": {}, "mirrors": 3}]])  # fmt: skip
def test_parts_edited_into_nonsense_leave_the_text(avatar, notices):
    from mirror_scan.mirror_scan_addon.scene import report_text

    avatar[report_text.REPORT] = json.dumps({"warnings": ["a", "b", 3], "notices": notices})
    assert report_text.avatar_report(avatar) == {"warnings": ["a", "b", 3]}
