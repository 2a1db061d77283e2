"""Panels drawn into a layout that holds every call against Blender's own description of it."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import pytest

pytest.importorskip("bpy")

NESTING = ("row", "column", "split", "box", "grid_flow", "column_flow")
MODULES = ("panels_main", "panels_capture", "panels_avatar", "panels_check")


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
            if name == "operator_menu_enum":
                operator = given["operator"].partition(".")[2]
                properties = getattr(self._bpy.ops.mirror_scan, operator).get_rna_type().properties
                assert properties[given["property"]].type == "ENUM"
                self._said.append(("button", operator, True))
                self._said.append(("menu", operator))
                return Properties(properties)
            if name == "prop":
                assert given["property"] in given["data"].bl_rna.properties
                self._said.append(("prop", given["property"]))
            if name == "operator":
                submodule, _, operator = given["operator"].partition(".")
                assert operator in dir(getattr(self._bpy.ops, submodule))
                self._said.append(("button", operator, self.__dict__.get("enabled", True)))
                self._said.append(("text", given.get("text", "")))
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
    kind = panel(bpy, name)
    said = []
    this = SimpleNamespace(layout=Layout(bpy, said), state=getattr(kind, "state", None))
    for part in ("draw_header", "draw_header_preset", "draw"):
        if hasattr(kind, part) and name != "quality":
            getattr(kind, part)(this, bpy.context)
    return said


def folded(bpy, name: str) -> tuple[str, str]:
    """What a folded panel says on its line, and the icon in front."""
    return panel(bpy, name).state(bpy.context)


def panel(bpy, name: str):
    """The class of a panel."""
    assert getattr(bpy.types, f"MIRRORSCAN_PT_{name}").bl_category == "Mirror Scan"
    for module in MODULES:
        found = getattr(importlib.import_module(f"mirror_scan.mirror_scan_addon.interface.{module}"),
                        f"MIRRORSCAN_PT_{name}", None)  # fmt: skip
        if found is not None:
            return found
    raise AssertionError(name)


PANELS = ("main", "capture", "mirrors", "optics", "subject", "build", "avatar", "check", "export", "rig")


def words(said) -> str:
    return " ".join(entry[1] for entry in said if entry[0] == "label")


def test_an_empty_scene_says_what_to_do_first(bpy):
    shown = {name: draw(bpy, name) for name in PANELS}
    buttons = [entry[1] for entry in shown["main"] if entry[0] == "button"]
    assert buttons[:5] == ["help", "report_problem", "scan_to_avatar", "sample_capture", "build_avatar"]
    assert buttons.count("export_avatar") == 11
    assert "Choose a capture, or drop one" in words(shown["main"])
    assert ("button", "load_capture", True) in shown["capture"] and "Load a capture" in words(shown["capture"])
    assert "Find them, or click points" in words(shown["mirrors"])
    assert "Select an avatar" in words(shown["check"])
    said = {name: folded(bpy, name)[0] for name in PANELS if hasattr(panel(bpy, name), "state")}
    assert said == {
        "capture": "none yet", "mirrors": "none yet", "subject": "automatic", "build": "nothing yet",
        "avatar": "nothing yet", "check": "not checked", "export": "asks each time",
    }  # fmt: skip
    for name in said:  # and that is all that is seen of it at first
        assert panel(bpy, name).bl_options == {"DEFAULT_CLOSED"} and said[name] in words(draw(bpy, name))


def test_the_build_button_says_why_it_is_disabled(bpy, monkeypatch):
    from mirror_scan.mirror_scan_addon.operators.build_avatar import MIRRORSCAN_OT_build_avatar as build

    said = []
    monkeypatch.setattr(build, "poll_message_set", said.append, raising=False)
    scene = SimpleNamespace(is_editable=True, mirror_scan=SimpleNamespace(capture_path="", cloud=None))
    manager = SimpleNamespace(windows=())
    context = SimpleNamespace(scene=scene, region=SimpleNamespace(type="UI"), mode="OBJECT", window_manager=manager)
    assert not build.poll.__func__(build, context) and said == ["Load a capture first"]
    context.region = None  # a script names the capture
    assert build.poll.__func__(build, context)
    context.region, scene.mirror_scan.capture_path = SimpleNamespace(type="UI"), "/scan"
    assert build.poll.__func__(build, context)


def test_a_capture_shows_what_it_is(bpy, loaded):
    settings = bpy.context.scene.mirror_scan
    shown = {name: draw(bpy, name) for name in PANELS}
    count = f"{len(settings.cloud.data.vertices):,}"
    assert "RGB-D folder" in words(shown["capture"]) and count in words(shown["capture"])
    assert folded(bpy, "capture") == (f"capture, {count} points", "CHECKMARK")
    assert folded(bpy, "mirrors") == ("2 good", "CHECKMARK")
    assert ("button", "build_avatar", True) in shown["main"]
    assert "Good" in words(shown["mirrors"])
    assert ("prop", "glass_thickness") in shown["optics"] and "does not" not in words(shown["optics"])
    settings.mirrors[0].message, settings.mirrors[0].plane = "right: the 3 frame points lie on one line", ""
    assert "lie on one line" in words(draw(bpy, "mirrors"))
    assert folded(bpy, "mirrors") == ("1 good, 1 wrong", "ERROR")
    assert "Check these mirrors first: right" in words(draw(bpy, "main"))
    settings.mirrors[0].message, settings.mirrors[0].residual_mm = "", 40.0
    settings.mirrors[0].plane = settings.mirrors[1].plane
    settings.mirrors[0].quality = ""  # as in a file of an older version
    assert "Wrong" in words(draw(bpy, "mirrors"))
    settings.mirrors[0].quality, settings.mirrors[0].reason = "usable", "right: its frame is noisy"
    assert "its frame is noisy" in words(draw(bpy, "mirrors"))


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
    for part in ("1.70 m", "200.0 l", "21%, corrected: 17%", "has holes", "Mirror left flat to 0.8 mm",
                 "at most 31 mm", "3 faces", "nobody is seen in", "Problems: 1",
                 "Gap between the direct view and Mirror left ", "Gaps within the direct view ",
                 "Gaps within Mirror left ", "Gap between Mirror left and filled surface ",
                 "Gaps within filled surface "):  # fmt: skip
        assert part in shown, part
    assert folded(bpy, "build") == ("has holes", "ERROR") and folded(bpy, "check") == ("problems: 1", "ERROR")
    buttons = [entry[1] for entry in draw(bpy, "main") if entry[0] == "button"]
    assert {"texture", "add_skeleton", "apply_motion", "dress", "measure", "reduce"} <= set(buttons)
    bpy.context.scene.mirror_scan.problem_index = 1
    assert "Hole, 5.0 cm across" in words(draw(bpy, "check"))
    avatar[report_text.REPORT] = "edited {"
    assert "Select an avatar" in words(draw(bpy, "check"))
    avatar[report_text.REPORT] = '{"problems": [1, {"kind": "hole"}], "mesh": {}}'
    assert "No problems found" in words(draw(bpy, "check"))


def test_motion_and_dress_are_menus_only_where_they_can_be_opened(bpy, capsule, monkeypatch):
    """Blender shows a menu as enabled, and a disabled layout without a reason; a disabled button says its reason."""
    from mirror_scan.mirror_scan_addon.scene import scan_records
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    select_only(bpy.context, create_avatar(capsule, collection=bpy.context.collection, report={}))
    said = draw(bpy, "main")
    assert not any(entry[0] == "menu" for entry in said)
    assert {("button", "apply_motion", True), ("button", "dress", True)} <= set(said)
    with pytest.raises(RuntimeError, match="Add a skeleton first"):
        bpy.ops.mirror_scan.apply_motion()
    monkeypatch.setattr(scan_records, "no_skeleton", lambda context: "")
    assert {("menu", "apply_motion"), ("menu", "dress")} <= set(draw(bpy, "main"))


def test_only_avatars_are_checked(bpy, capsule):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    bpy.ops.mesh.primitive_cube_add()
    assert not bpy.ops.mirror_scan.check.poll()
    select_only(bpy.context, create_avatar(capsule, collection=bpy.context.collection, report={}))
    assert bpy.ops.mirror_scan.check.poll()


def test_every_list_row_can_be_drawn(bpy, loaded):
    from mirror_scan.mirror_scan_addon.interface.panels_capture import MIRRORSCAN_UL_mirrors

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
    from mirror_scan.mirror_scan_addon.interface import panel_parts as parts

    monkeypatch.setattr(parts, "width", lambda: width)
    said, text = [], "No mirrors yet: those of the capture are used, or they are found automatically"
    parts.sentence(Layout(bpy, said), text, "INFO")
    lines = [line for _, line in said]
    assert " ".join(lines) == text and len(lines) >= 2
    assert all(blf.dimensions(0, line)[0] <= width - parts.MARGIN - parts.ICON for line in lines)
    said.clear()
    parts.on_one_line(Layout(bpy, said), "a name of a capture that is longer than any line of the sidebar has room for")
    assert [line[-1] for _, line in said] == (["…"] if width > parts.NARROW else [])


def test_the_bar_of_a_job_stands_in_the_panel_that_is_always_open(bpy, loaded, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import job_operators

    monkeypatch.setattr(job_operators, "running", lambda context, name="": True)
    progress = bpy.context.window_manager.mirror_scan
    progress.fraction, progress.message, progress.left = 0.25, "Zippering", "about 12 s left"
    progress.operator = "mirror_scan.build_avatar"
    assert {name for name in PANELS if ("progress", "25%") in draw(bpy, name)} == {"main"}
    shown = words(draw(bpy, "main"))
    assert "Zippering" in shown and "about 12 s left" in shown and "press Esc" in shown
    progress.operator = ""  # it is over, and a file browser is open: that is no bar
    assert ("progress", "25%") not in draw(bpy, "main")


def test_while_frames_are_clicked_the_panel_says_how(bpy, loaded):
    shown = bpy.context.window_manager.mirror_scan
    shown.picking = True
    try:
        said = draw(bpy, "main")
        assert "Click the frame of each mirror, once" in words(said)
        assert [entry[1] for entry in said if entry[0] == "button"] == ["help", "report_problem", "finish_picking"]
        assert bpy.ops.mirror_scan.finish_picking() == {"FINISHED"} and shown.picked
    finally:
        shown.picking = shown.picked = False
    assert not bpy.ops.mirror_scan.finish_picking.poll()


def test_a_large_scene_is_not_looked_through_at_every_redraw(bpy, monkeypatch):
    from mirror_scan.mirror_scan_addon.interface import panel_states
    from mirror_scan.mirror_scan_addon.scene import scan_records

    looks: list[bool] = []
    inner = scan_records.person_of
    monkeypatch.setattr(scan_records, "person_of", lambda context: looks.append(True) or inner(context))
    monkeypatch.setattr(panel_states, "_answers", {})
    draw(bpy, "main")
    few = len(looks)
    assert few > 1
    for _ in range(panel_states.FEW + 1):
        bpy.context.collection.objects.link(bpy.data.objects.new("Empty", None))
    looks.clear()
    monkeypatch.setattr(panel_states, "LOOK_S", 60.0)
    for _ in range(5):
        draw(bpy, "main")
    assert len(looks) == 1
    bpy.context.collection.objects.link(bpy.data.objects.new("Empty", None))  # another scene now
    draw(bpy, "main")
    assert len(looks) == 2
