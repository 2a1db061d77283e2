"""Our entries in Blender's menus, and the preferences: there when registered, gone afterwards, used as defaults."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy")


@pytest.fixture
def preferences(bpy):
    """The add-on's preferences, as an installed extension has them."""
    entry = bpy.context.preferences.addons.new()
    entry.module = "mirror_scan"
    yield entry.preferences
    bpy.context.preferences.addons.remove(entry)


def drawn_by_us(bpy, menu: str) -> int:
    functions = getattr(bpy.types, menu)._dyn_ui_initialize()
    return sum("mirror_scan" in function.__module__ for function in functions)


def test_menus_are_gone_after_unregistering(bpy, addon):
    from mirror_scan.mirror_scan_addon.interface import menus

    names = [name for name, _ in menus.MENUS]
    assert {"TOPBAR_MT_file_import", "TOPBAR_MT_file_export", "VIEW3D_MT_add"} <= set(names)
    for _ in range(3):
        assert [drawn_by_us(bpy, name) for name in names] == [1] * len(names)
        addon.unregister()
        assert [drawn_by_us(bpy, name) for name in names] == [0] * len(names)
        addon.register()


class Layout:
    """Notes what a menu puts into its layout; an operator that is not registered is an error, as in Blender."""

    def __init__(self, bpy):
        self.bpy, self.buttons = bpy, []

    def separator(self):
        pass

    def operator(self, name, **options):
        folder, _, inner = name.partition(".")
        getattr(getattr(self.bpy.ops, folder), inner).get_rna_type()
        self.buttons.append((name, options["text"]))


def test_entries_open_what_they_name(bpy):
    from types import SimpleNamespace

    from mirror_scan.mirror_scan_addon.interface import menus

    found = {}
    for name, draw in menus.MENUS:
        layout = Layout(bpy)
        draw(SimpleNamespace(layout=layout), bpy.context)
        found[name] = layout.buttons
    assert found["TOPBAR_MT_file_import"] == [
        ("mirror_scan.load_capture", "Mirror Scan Capture"),
        ("mirror_scan.import_sequence", "Mirror Scan Sequence"),
    ]
    assert found["TOPBAR_MT_file_export"] == [("mirror_scan.export_avatar", "Mirror Scan Avatar")]
    assert ("mirror_scan.add_rig", "Mirror Scan Rig") in found["VIEW3D_MT_add"]


def test_new_rigs_begin_with_the_preferred_sensor(bpy, preferences):
    from mirror_scan.mirror_scan_addon.scene.preferred import preferred

    preferences.sensor = "realsense_d455"
    assert preferred("sensor") == "realsense_d455"
    bpy.ops.mirror_scan.add_rig()
    ours = bpy.context.scene.camera.data.angle_x
    bpy.ops.mirror_scan.add_rig(sensor="azure_kinect")
    given = bpy.context.scene.camera.data.angle_x
    bpy.ops.mirror_scan.add_rig(sensor="realsense_d455")
    assert ours == bpy.context.scene.camera.data.angle_x != given


def test_a_scene_begins_with_the_preferred_texture_and_keeps_its_own(bpy, preferences):
    from mirror_scan.mirror_scan_addon.scene.preferred import begin_with_preferences

    settings = bpy.context.scene.mirror_scan
    preferences.texture_size = "4096"
    begin_with_preferences(settings)
    assert settings.look.texture_size == "4096"
    settings.look.texture_size = "1024"
    begin_with_preferences(settings)
    assert settings.look.texture_size == "1024"


def test_without_preferences_there_are_defaults(bpy):
    from mirror_scan.mirror_scan_addon.interface.preferences import MIRRORSCAN_AP_preferences
    from mirror_scan.mirror_scan_addon.scene.preferred import DEFAULTS, preferred

    assert {name: preferred(name) for name in DEFAULTS} == DEFAULTS
    assert set(DEFAULTS) == set(MIRRORSCAN_AP_preferences.__annotations__)


def test_compiled_code_is_measured_and_cleared(bpy, tmp_path, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import compiled_code, numba_setup

    folder = tmp_path / "numba_cache"
    monkeypatch.setattr(numba_setup, "cache_folder", lambda: str(folder))
    with pytest.raises(RuntimeError, match="Nothing is kept yet"):
        bpy.ops.mirror_scan.clear_compiled_code()
    (folder / "core_abc").mkdir(parents=True)
    (folder / "core_abc" / "kernel.nbi").write_bytes(b"x" * 3_000_000)
    (folder / "compiled_0123").touch()
    monkeypatch.setattr(compiled_code, "FRESH_S", 0.0)
    assert compiled_code.size() == (3_000_000, 2)
    assert bpy.ops.mirror_scan.clear_compiled_code() == {"FINISHED"}
    assert list(folder.iterdir()) == [] and compiled_code.size() == (0, 0)


def test_somebody_else_s_compiled_code_is_not_touched(bpy, tmp_path, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import numba_setup

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert numba_setup.cache_folder() == ""
    (tmp_path / "kernel.nbi").write_text("x")
    with pytest.raises(RuntimeError, match="NUMBA_CACHE_DIR"):
        bpy.ops.mirror_scan.clear_compiled_code()
    assert (tmp_path / "kernel.nbi").exists()


def test_help_opens_a_page_that_is_there(bpy, monkeypatch):
    """The browser is Blender's to start; here only what it would be given is looked at."""
    import webbrowser
    from pathlib import Path
    from urllib.parse import unquote, urlparse

    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    from mirror_scan.mirror_scan_addon.operators.help import PAGES

    for name, *_ in PAGES:
        assert bpy.ops.mirror_scan.help(page=name) == {"FINISHED"}
    assert bpy.ops.mirror_scan.help() == {"FINISHED"}
    assert len(opened) == len(PAGES) + 1 and "blender" in opened[-1]
    for url in opened:
        assert urlparse(url).scheme == "file" and Path(unquote(urlparse(url).path)).is_file()


def test_a_copy_without_help_says_so(bpy, monkeypatch, tmp_path):
    from mirror_scan.mirror_scan_addon.operators import help

    monkeypatch.setattr(help, "ADDON_FOLDER", tmp_path)
    monkeypatch.setattr(help, "ROOT_FOLDER", tmp_path)
    with pytest.raises(RuntimeError, match="no help pages; install"):
        bpy.ops.mirror_scan.help()


def test_exports_and_textures_begin_where_preferred(bpy, preferences, capsule, tmp_path, monkeypatch):
    from mirror_scan.mirror_scan_addon.operators import export_avatar
    from mirror_scan.mirror_scan_addon.scene.preferred import drop_makes, preferred

    preferences.export_folder = str(tmp_path)
    assert export_avatar.preferred("export_folder") == str(tmp_path)
    assert [drop_makes(what) for what in ("AVATAR", "LOOK")] == [True, True]
    preferences.on_drop = "LOOK"
    assert [drop_makes(what) for what in ("AVATAR", "LOOK")] == [False, True]
    assert preferred("on_drop") == "LOOK"


def test_what_is_dropped_is_asked_for_in_words(bpy, tmp_path):
    """Blender's menu shows the names of the operators that dropped files are handed to."""
    kinds = bpy.types.FileHandler.__subclasses__()
    handlers = [kind for kind in kinds if kind.bl_import_operator.startswith("mirror_scan.drop_")]
    names = set()
    for handler in handlers:
        operator = getattr(bpy.ops.mirror_scan, handler.bl_import_operator.partition(".")[2])
        names.add(operator.get_rna_type().name)
        assert handler.bl_label.startswith(operator.get_rna_type().name)
        with pytest.raises(RuntimeError, match="no such file"):
            operator(filepath=str(tmp_path / "nowhere.mkv"))
    assert names == {"Make Avatar", "Only Look"} and len(handlers) == 4
