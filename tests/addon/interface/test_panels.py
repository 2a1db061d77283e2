"""Panels drawn into a layout that holds every call against Blender's own description of it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("bpy")

NESTING = ("row", "column", "split", "box", "grid_flow", "column_flow")


class Layout:
    def __init__(self, bpy, said):
        self.__dict__.update(_bpy=bpy, _said=said)

    def __setattr__(self, name, value):
        assert name in self._bpy.types.UILayout.bl_rna.properties, f"UILayout has no {name}"
        self.__dict__[name] = value

    def __getattr__(self, name):
        function = self._bpy.types.UILayout.bl_rna.functions[name]
        parameters = {parameter.identifier: parameter for parameter in function.parameters}

        def call(*arguments, **options):
            given = dict(zip([key for key in parameters if not parameters[key].is_output], arguments, strict=False))
            given.update(options)
            assert given.keys() <= parameters.keys(), f"{name}() has no {given.keys() - parameters.keys()}"
            if "icon" in given:
                assert given["icon"] in parameters["icon"].enum_items
            if name == "prop":
                assert given["property"] in given["data"].bl_rna.properties
                self._said.append(("prop", given["property"]))
            if name == "operator":
                submodule, _, operator = given["operator"].partition(".")
                assert operator in dir(getattr(self._bpy.ops, submodule))
                self._said.append(("button", operator, self.__dict__.get("enabled", True)))
                known = getattr(getattr(self._bpy.ops, submodule), operator).get_rna_type().properties
                return Properties(known)
            if name in ("label", "progress"):
                self._said.append((name, given["text"]))
            return Layout(self._bpy, self._said) if name in NESTING else SimpleNamespace()

        return call


class Properties:
    """What ``layout.operator`` returns: only what the operator has can be set."""

    def __init__(self, known):
        self.__dict__["_known"] = known

    def __setattr__(self, name, value):
        assert name in self._known, f"the operator has no {name}"


def draw(bpy, name: str) -> list[tuple]:
    """What one panel shows in the present context."""
    panel = getattr(bpy.types, f"MIRRORSCAN_PT_{name}")
    assert panel.bl_category == "Mirror Scan"
    said = []
    from mirror_scan.mirror_scan_addon.interface import panels

    kind = getattr(panels, f"MIRRORSCAN_PT_{name}")
    this = SimpleNamespace(layout=Layout(bpy, said))
    if hasattr(kind, "draw_header"):
        kind.draw_header(this, bpy.context)
    kind.draw(this, bpy.context)
    return said


PANELS = ("capture", "mirrors", "optics", "subject", "build", "quality", "check", "export", "rig")


def words(said) -> str:
    return " ".join(entry[1] for entry in said if entry[0] == "label")


def test_an_empty_scene_says_what_to_do_first(bpy):
    shown = {name: draw(bpy, name) for name in PANELS}
    assert ("button", "load_capture", True) in shown["capture"] and "Load a capture" in words(shown["capture"])
    assert ("button", "build_avatar", False) in shown["build"] and "Load a capture first" in words(shown["build"])
    assert "Find them, or click points" in words(shown["mirrors"])
    assert "Select an avatar" in words(shown["check"])


def test_a_capture_shows_what_it_is(bpy, loaded):
    settings = bpy.context.scene.mirror_scan
    shown = {name: draw(bpy, name) for name in PANELS}
    assert "RGB-D folder" in words(shown["capture"]) and f"{len(settings.cloud.data.vertices):,}" in words(
        shown["capture"]
    )
    assert ("button", "build_avatar", True) in shown["build"]
    assert "Good: the frame is flat to" in words(shown["mirrors"])
    assert ("prop", "glass_thickness") in shown["optics"] and "does not" not in words(shown["optics"])
    settings.mirrors[0].message, settings.mirrors[0].plane = "right: the 3 frame points lie on one line", ""
    assert "lie on one line" in words(draw(bpy, "mirrors"))
    assert "Check these mirrors first: right" in words(draw(bpy, "build"))
    settings.mirrors[0].message, settings.mirrors[0].residual_mm = "", 40.0
    settings.mirrors[0].plane = settings.mirrors[1].plane
    assert "Poor: the frame is 40.0 mm off a plane" in words(draw(bpy, "mirrors"))


def test_an_avatar_shows_how_it_came_out(bpy, capsule):
    from mirror_scan.mirror_scan_addon.scene import report_text
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    report = {
        "mirrors": [{"name": "left", "residual_mm": 0.8}],
        "seams": [
            {"between": pair, "mean_gap_mm": 12.0, "max_gap_mm": 31.0}
            for pair in (["direct", "left"], ["direct", "direct"], ["left", "left"], ["left", "made"], ["made", "made"])
        ],
        "mesh": {"height_m": 1.7, "volume_l": 200.0, "watertight": False, "self_intersections": 3},
        "problems": [{"kind": "hole", "point": [0, 0, 1], "normal": [0, -1, 0], "size": 0.05, "area": 0, "count": 9}],
        "warnings": ["left: nobody is seen in this mirror"],
        "optics": {"lit_twice_share": 0.21, "corrected_share": 0.17},
    }
    avatar = create_avatar(capsule, collection=bpy.context.collection, report=report)
    select_only(bpy.context, avatar)
    shown = words(draw(bpy, "check"))
    for part in ("1.70 m", "200.0 l", "21%, corrected: 17%", "has holes", "left flat to 0.8 mm", "at most 31 mm",
                 "3 faces", "nobody is seen in", "Problems: 1", "Gap direct view–left ",
                 "Gap within the direct view ", "Gap within left ", "Gap left–filled surface ",
                 "Gap within filled surface "):  # fmt: skip
        assert part in shown, part
    bpy.context.scene.mirror_scan.problem_index = 1
    assert "Hole, 5.0 cm across" in words(draw(bpy, "check"))
    avatar[report_text.REPORT] = "edited {"
    assert "Select an avatar" in words(draw(bpy, "check"))
    avatar[report_text.REPORT] = '{"problems": [1, {"kind": "hole"}], "mesh": {}}'
    assert "No problems found" in words(draw(bpy, "check"))


def test_every_list_row_can_be_drawn(bpy, loaded):
    from mirror_scan.mirror_scan_addon.interface.panels import MIRRORSCAN_UL_mirrors

    settings = bpy.context.scene.mirror_scan
    said = []
    for item in settings.mirrors:
        MIRRORSCAN_UL_mirrors.draw_item(
            None, bpy.context, Layout(bpy, said), settings, item, 0, settings, "mirror_index"
        )
    assert sum(entry[0] == "prop" for entry in said) == len(settings.mirrors) == 2
    assert all(" mm" in entry[1] for entry in said if entry[0] == "label")


@pytest.mark.parametrize("width", (280.0, 180.0))
def test_long_sentences_break_into_lines(bpy, monkeypatch, width):
    import blf
    from mirror_scan.mirror_scan_addon.interface import panels

    monkeypatch.setattr(panels, "_width", lambda: width)
    said, text = [], "No mirrors yet: those of the capture are used, or they are found automatically"
    panels._text(Layout(bpy, said), text, "INFO")
    lines = [line for _, line in said]
    assert " ".join(lines) == text and len(lines) >= 2
    assert all(blf.dimensions(0, line)[0] <= width - panels.MARGIN - panels.ICON for line in lines)


def test_progress_stands_in_the_panel_whose_button_was_pressed(bpy, loaded, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import job_operators

    monkeypatch.setattr(job_operators, "running", lambda context: True)
    progress = bpy.context.window_manager.mirror_scan
    progress.fraction, progress.message = 0.25, "Zippering"
    for operator, panel in (("load_capture", "capture"), ("find_mirrors", "mirrors"), ("build_avatar", "build")):
        progress.operator = f"mirror_scan.{operator}"
        shown = {name for name in PANELS if ("progress", "25%") in draw(bpy, name)}
        assert shown == {panel}
        assert "Zippering" in words(draw(bpy, panel)) and "Press Esc" in words(draw(bpy, panel))
