"""What 3D viewports show, as far as it can be told without a window that draws."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")


def test_an_avatar_without_a_texture_is_shown_in_its_colours_again(bpy, capsule):
    from mirror_scan.mirror_scan_addon.interface.viewport import show_colors_again
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar
    from mirror_scan.mirror_scan_addon.scene.scan_records import TEXTURED

    shadings = [
        area.spaces.active.shading
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "VIEW_3D"
    ]
    assert shadings

    def shown() -> set[str]:
        for shading in shadings:
            shading.type, shading.color_type = "SOLID", "TEXTURE"
        show_colors_again()
        return {shading.color_type for shading in shadings}

    assert shown() == {"TEXTURE"}  # no avatar: what the user chose
    avatar = create_avatar(capsule, collection=bpy.context.collection, report={})
    assert shown() == {"VERTEX"}
    avatar.data[TEXTURED] = avatar.active_material
    assert shown() == {"TEXTURE"}
    assert show_colors_again in bpy.app.handlers.undo_post


def test_of_several_viewports_the_largest_is_turned(bpy):
    from types import SimpleNamespace

    from mirror_scan.mirror_scan_addon.interface.viewport import viewport

    small, large = (SimpleNamespace(type="VIEW_3D", width=size, height=size) for size in (100, 400))
    screen = SimpleNamespace(areas=[small, SimpleNamespace(type="OUTLINER", width=900, height=900), large])
    assert viewport(SimpleNamespace(area=None, screen=screen)) is large
    assert viewport(SimpleNamespace(area=small, screen=screen)) is small
    assert viewport(SimpleNamespace(area=None, screen=None)) is None
