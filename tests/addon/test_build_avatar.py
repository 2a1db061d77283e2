"""The operator and its panel, as scripts and as Blender's interface call them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("bpy")


@pytest.fixture
def steps(addon, monkeypatch, reconstruction):
    """A stand-in for the work, so that these tests are about Blender: what it was asked and what it shall answer."""
    from mirror_scan.mirror_scan_addon.operators import build_avatar

    calls = []

    def build_steps(*arguments):
        calls.append(arguments)
        yield 0.0, "Reading"
        yield 0.5, "Zippering"
        if isinstance(calls[0], Exception):
            raise calls.pop(0)
        return reconstruction

    monkeypatch.setattr(build_avatar, "build_steps", build_steps)
    return calls


def test_it_builds_selects_and_remembers(bpy, steps, reconstruction, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = str(tmp_path)
    bpy.context.scene.mirror_scan.frames = 7
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    assert steps == [(str(tmp_path), "", 7)]
    avatar = bpy.context.object
    assert avatar.name == "Avatar" and bpy.context.selected_objects == [avatar]
    assert len(avatar.data.vertices) == len(reconstruction.mesh.vertices)
    assert bpy.ops.mirror_scan.build_avatar("INVOKE_DEFAULT") == {"FINISHED"}  # background: runs to its end
    assert bpy.context.selected_objects == [bpy.data.objects["Avatar.001"]]
    assert len(bpy.data.materials) == 1


def test_arguments_win_over_the_scene(bpy, steps, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = "/elsewhere"
    bpy.context.scene.mirror_scan.frames = 7
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path), mirrors_filepath="/m.json", frames=0)
    assert steps == [(str(tmp_path), "/m.json", 0)]


def test_undo_takes_it_back(bpy, steps, tmp_path):
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.ed.undo_push(message="built")
    bpy.ops.ed.undo()
    assert len(bpy.data.objects) == len(bpy.data.meshes) == len(bpy.data.materials) == 0
    bpy.ops.ed.redo()
    assert [item.name for item in bpy.data.objects] == ["Avatar"]


def test_an_error_is_one_line_and_changes_nothing(bpy, steps, tmp_path):
    from mirror_scan.core.errors import ReconstructionError

    steps.append(ReconstructionError("nobody stands between camera and mirrors"))
    with pytest.raises(RuntimeError, match=r"^Error: nobody stands between camera and mirrors\s*$"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    assert len(bpy.data.objects) == len(bpy.data.meshes) == 0


def test_real_reading_errors_are_reports_too(bpy, tmp_path):
    with pytest.raises(RuntimeError, match=r"^Error: .*there is no such file"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path / "missing"))
    with pytest.raises(RuntimeError, match=r"^Error: .*is not a capture"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))


def test_without_a_capture_it_says_where_to_choose_one(bpy):
    with pytest.raises(RuntimeError, match="Error: No capture chosen"):
        bpy.ops.mirror_scan.build_avatar()


def test_wrong_states_are_refused_with_a_reason(bpy, steps, tmp_path):
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(bpy.data.objects) == 1


def test_a_linked_scene_is_refused(bpy, steps, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.context.scene.name = "Linked"
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (there, here):
        here.scenes = there.scenes
    bpy.context.window.scene = bpy.data.scenes["Linked"]
    with pytest.raises(RuntimeError, match="linked from another file"):
        bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))


def test_an_excluded_collection_does_not_hide_the_avatar(bpy, steps, tmp_path):
    inner = bpy.data.collections.new("Inner")
    bpy.context.scene.collection.children.link(inner)
    layer = bpy.context.view_layer.layer_collection.children["Inner"]
    bpy.context.view_layer.active_layer_collection = layer
    layer.exclude = True
    bpy.ops.mirror_scan.build_avatar(filepath=str(tmp_path))
    assert bpy.context.object.name == "Avatar" and bpy.context.object.visible_get()


def test_state_survives_saving(bpy, steps, tmp_path):
    bpy.context.scene.mirror_scan.capture_path = "//capture"
    with pytest.raises(RuntimeError, match="save it first"):
        bpy.ops.mirror_scan.build_avatar()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.mirror_scan.build_avatar()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    assert bpy.context.scene.mirror_scan.capture_path == "//capture"
    assert texts(bpy)[-4:-2] == [("label", "Mirror left"), ("label", "fits to 0.8 mm")]
    steps.clear()
    bpy.ops.mirror_scan.build_avatar()
    assert steps[0][0] == str(tmp_path / "capture")  # "//" is the .blend's folder


# --- panels: drawn into a layout that holds every call against Blender's own description of it ------------------------


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
            if name == "operator":
                submodule, _, operator = given["operator"].partition(".")
                assert operator in dir(getattr(self._bpy.ops, submodule))
                self._said.append(("button", operator, self.__dict__.get("enabled", True)))
            if name in ("label", "progress"):
                self._said.append((name, given["text"]))
            return Layout(self._bpy, self._said) if name in ("row", "column", "split", "box") else SimpleNamespace()

        return call


def texts(bpy) -> list[tuple]:
    """What the panels of the tab show in the present context."""
    from mirror_scan.mirror_scan_addon import panels

    said = []
    for panel in (panels.MIRRORSCAN_PT_capture, panels.MIRRORSCAN_PT_build, panels.MIRRORSCAN_PT_check):
        assert panel.bl_category == "Mirror Scan"
        if not hasattr(panel, "poll") or panel.poll(bpy.context):
            panel.draw(SimpleNamespace(layout=Layout(bpy, said)), bpy.context)
    return said


def test_panels_say_what_is_missing_and_what_came_out(bpy, steps, tmp_path):
    assert texts(bpy) == [("button", "build_avatar", False), ("label", "Choose a capture folder first")]
    bpy.context.scene.mirror_scan.capture_path = str(tmp_path)
    assert texts(bpy) == [("button", "build_avatar", True)]
    bpy.ops.mirror_scan.build_avatar()
    shown = texts(bpy)
    assert ("label", "1.70 m") in shown and ("label", "closed") in shown and ("label", "200.0 l") in shown
    bpy.context.object["mirror_scan_report"] = "edited {"
    assert texts(bpy) == [("button", "build_avatar", True)]


# --- the modal driver ------------------------------------------------------------------------------------------------


class Window:
    """What the modal driver uses of a context, recorded."""

    def __init__(self, bpy):
        self.status, self.timers, self.handlers = [], 0, 0
        self.scene = bpy.context.scene
        self.window = None
        self.workspace = SimpleNamespace(status_text_set=self.status.append)
        self.window_manager = SimpleNamespace(
            windows=[], mirror_scan=SimpleNamespace(fraction=0.0, message=""),
            event_timer_add=self.add, event_timer_remove=self.remove, modal_handler_add=self.handle,
        )  # fmt: skip

    def add(self, step, window):
        self.timers += 1
        return object()

    def remove(self, timer):
        self.timers -= 1

    def handle(self, operator):
        self.handlers += 1


@pytest.fixture
def job(bpy, monkeypatch):
    """A running modal job that takes longer than one turn, its context, and what became of it."""
    from mirror_scan.core.errors import ReconstructionError
    from mirror_scan.mirror_scan_addon import jobs

    class Operator(jobs.JobOperator):
        bl_label = "Build"

        def __init__(self):
            self.reports, self.results, self.closed, self.steps = [], [], False, 0

        def report(self, kind, text):
            self.reports.append((kind.copy().pop(), text))

        def start(self, context):
            try:
                for self.steps in range(1, 4):
                    clock.now += jobs.TICK_S * 1.5
                    yield self.steps / 4, f"Stage {self.steps}"
                if self.fails:
                    raise self.fails
                return "done"
            finally:
                self.closed = True

        def finish(self, context, scene, result):
            self.results.append((scene.name, result))

    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(jobs.time, "perf_counter", lambda: clock.now)
    monkeypatch.setattr(jobs, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data))
    operator, window = Operator(), Window(bpy)
    operator.fails = None
    operator.Error = ReconstructionError
    assert operator.invoke(window, None) == {"RUNNING_MODAL"} and window.timers == window.handlers == 1
    return operator, window


TIMER, ESC, MOUSE = (SimpleNamespace(type=kind, value="PRESS") for kind in ("TIMER", "ESC", "MOUSEMOVE"))


def test_one_piece_a_turn_then_the_result(job):
    operator, window = job
    assert operator.modal(window, MOUSE) == {"PASS_THROUGH"} and operator.steps == 0
    for turn in range(1, 4):
        assert operator.modal(window, TIMER) == {"PASS_THROUGH"} and operator.steps == turn
        assert window.window_manager.mirror_scan.message == f"Stage {turn}"
        assert "Esc" in window.status[-1] and f"Stage {turn}" in window.status[-1]
    assert operator.modal(window, TIMER) == {"FINISHED"}
    assert operator.results == [("Scene", "done")]
    assert window.timers == 0 and window.status[-1] is None


def test_escape_stops_it(job):
    operator, window = job
    operator.modal(window, TIMER)
    assert operator.modal(window, ESC) == {"CANCELLED"}
    assert operator.closed and operator.results == [] and window.timers == 0 and window.status[-1] is None
    assert operator.reports[-1][0] == "INFO"


def test_a_job_that_fails_leaves_the_window_clean(job):
    operator, window = job
    operator.fails = operator.Error("nobody there")
    for _ in range(3):
        operator.modal(window, TIMER)
    assert operator.modal(window, TIMER) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "nobody there")] and window.timers == 0 and window.status[-1] is None


def test_a_fault_of_ours_is_shown_as_one(job):
    operator, window = job
    operator.fails = ZeroDivisionError("ours")
    with pytest.raises(ZeroDivisionError):
        for _ in range(4):
            operator.modal(window, TIMER)
    assert window.timers == 0 and window.status[-1] is None


def test_a_scene_that_went_away_is_told(job, bpy):
    operator, window = job
    window.scene.name = "Renamed"
    for _ in range(3):
        operator.modal(window, TIMER)
    assert operator.modal(window, TIMER) == {"CANCELLED"}
    assert "removed or renamed" in operator.reports[-1][1] and operator.results == []
