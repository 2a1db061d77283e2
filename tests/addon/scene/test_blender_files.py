"""Names of files that are made of names in Blender."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("Zoë 2", "Zoë 2"), ("王", "王"), ("capture.001", "capture_001"),
        ('a/b\\c:d*e?f"g<h>i|j', "a_b_c_d_e_f_g_h_i_j"),
        ("con", "con_"), ("LPT1", "LPT1_"), (" \t", "_"), ("", "_"), ("tab\tnew\nline", "tab_new_line"),
    ],
)  # fmt: skip
def test_letters_stay_and_what_no_system_takes_goes(addon, name, file):
    from mirror_scan.mirror_scan_addon.scene.blender_files import file_name

    assert file_name(name) == file


def test_a_long_name_leaves_room_for_endings(addon):
    from mirror_scan.mirror_scan_addon.scene.blender_files import file_name, image_name

    for letter in "xü王😀":
        assert 175 < len(file_name(letter * 255).encode()) <= 180
    assert image_name("Zoë 2") == "Zoë_2"


def test_two_people_whose_names_differ_by_an_accent_get_two_files(bpy, capsule, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar

    for name in ("Zoé", "Zoë"):
        made = create_avatar(capsule, name=name, collection=bpy.context.collection)
        bpy.context.view_layer.objects.active = made
        made.select_set(True)
        for kind in ("STL", "OBJ"):
            assert bpy.ops.mirror_scan.export_avatar(filepath=f"{tmp_path}/", format=kind) == {"FINISHED"}
    written = {path.name for path in tmp_path.iterdir()}
    assert {"Zoé.stl", "Zoë.stl", "Zoé.obj", "Zoë.obj"} <= written
    assert len([name for name in written if name.endswith(".png")]) == 2
