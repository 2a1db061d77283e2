"""The whole way in Blender's window, with simulated mouse and keyboard; run by ``run.py`` inside Blender.

Blender calls :func:`tick` from its timers; each ``yield`` in :func:`story` gives it that many seconds to draw and to
work. Buttons are found as a person finds them, by looking under the mouse: Blender's own “copy Python command” tells
which operator the button there belongs to. What was seen goes to ``result.json`` beside the screenshots.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

OUT, CAPTURE, ADDON = (
    Path(os.environ["MIRROR_SCAN_OUT"]),
    os.environ["MIRROR_SCAN_CAPTURE"],
    os.environ["MIRROR_SCAN_ID"],
)
WIDTH = 1280  # of the window [px]
LIMIT_S = 900.0  # for one step of the way, compiling included

result: dict = {"blender": f"Blender {bpy.app.version_string}", "steps": [], "figures": {}, "screenshots": []}
Story = Iterator[float]


# --- what is done --------------------------------------------------------------------------------------------------


def story() -> Story:
    blocks = Blocks()
    with viewport():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
    yield from open_sidebar()
    yield from shot("1_panel")

    with step("load by the operator, as a click does"):
        yield from press("load_capture", choose=CAPTURE)
        yield from settled()
        expect(cloud() is not None, "points of the capture")
        note("points", len(cloud().data.vertices))
    yield from shot("2_capture")

    with step("load by drag and drop"):
        before = cloud().session_uid
        files = [{"name": "intrinsic.json"}]
        start = time.perf_counter()
        with viewport():
            bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=CAPTURE, files=files)
        while busy() or cloud() is None or cloud().session_uid == before:
            expect(time.perf_counter() - start < 60, "other points than before")
            yield 0.01
        with viewport():
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        note("points_shown_s", time.perf_counter() - start)
        note("points_shown", len(cloud().data.vertices))
        yield 0.5

    with step("find mirrors"):
        yield from press("clear_mirrors")
        expect(len(settings().mirrors) == 0, "no mirrors")
        yield from press("find_mirrors")
        yield from settled()
        expect(len(settings().mirrors) == 2, f"two mirrors, not {len(settings().mirrors)}")
        note("mirror_residuals_mm", [mirror.residual_mm for mirror in settings().mirrors])
    yield from shot("3_mirrors")

    with step("pick mirror points"):
        yield from pick()
    with step("find the subject"):
        with viewport():  # its panel is folded
            bpy.ops.mirror_scan.find_subject("INVOKE_DEFAULT")
        yield from settled()
    yield from shot("5_subject")

    with step("build, with the window alive"):
        own = timed_modal("MIRROR_SCAN_OT_build_avatar", "TIMER")
        yield from press("build_avatar")
        blocks.start()
        yield 1.2
        yield from shot("6_building", settle=0.0)
        yield from settled()
        yield 0.5
        blocks.stop()
        note("first_build_blocks_ms", blocks.worst)
        expect(avatar() is not None, "an avatar")
        note("avatar_vertices", len(avatar().data.vertices))
        note("watertight", watertight(avatar()))
    yield from shot("7_avatar")

    with step("undo and redo by the keyboard"):
        count = len(bpy.data.meshes)
        yield from keys("Z", ctrl=True)
        yield 0.7
        expect(avatar() is None, "no avatar after undo")
        yield from keys("Z", ctrl=True, shift=True)
        yield 0.7
        expect(avatar() is not None and len(bpy.data.meshes) == count, "the avatar again after redo")

    with step("build again, kernels and process ready"):
        yield from press("build_avatar")
        blocks.start()
        started = time.perf_counter()
        yield from settled()
        note("second_build_s", time.perf_counter() - started)
        yield 0.5
        blocks.stop()
        note("second_build_blocks_ms", blocks.worst)
        note("build_own_ms", max(own))
        with viewport():
            start = time.perf_counter()
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=5)
            note("redraw_ms", 1000 * (time.perf_counter() - start) / 5)

    with step("cancel by Esc"):
        count = len(bpy.data.objects)
        yield from press("build_avatar")
        yield from keys("ESC")
        yield 0.5
        expect(not busy() and len(bpy.data.objects) == count, "nothing new after Esc")

    yield from pictures()

    with step("save and reload"):
        path, points = str(OUT / "saved.blend"), len(cloud().data.vertices)
        with viewport():
            bpy.ops.wm.save_as_mainfile(filepath=path)
            bpy.ops.wm.open_mainfile(filepath=path)
        yield 1.0
        expect(cloud() is not None and len(cloud().data.vertices) == points, "the points after reloading")
        expect(len(settings().mirrors) == 2 and avatar() is not None, "mirrors and avatar after reloading")
        yield from open_sidebar()
    yield from shot("9_reloaded")

    with step("disable and enable"):
        with viewport():
            bpy.ops.preferences.addon_disable(module=ADDON)
        yield 0.5
        expect(dir(bpy.ops.mirror_scan) == [], "no operators when disabled")
        expect(not hasattr(bpy.types.Scene, "mirror_scan"), "no properties when disabled")
        with viewport():
            bpy.ops.preferences.addon_enable(module=ADDON)
        yield 0.5
        expect(cloud() is not None and len(settings().mirrors) == 2, "the file's data again when enabled")

    measure()


def pick() -> Story:
    """Eight clicks on the frame of the first mirror, where the capture's own mirrors.json has them."""
    content = json.loads((Path(CAPTURE) / "mirrors.json").read_text())
    pixels = content["mirrors"][0]["frame_pixels"]
    yield from press("clear_mirrors")
    yield from look_from_camera()
    times = timed_modal("MIRROR_SCAN_OT_pick_mirror_points", "LEFTMOUSE")
    yield from press("pick_mirror_points")
    expect(busy(), "picking runs")
    for number, pixel in enumerate(pixels):
        place = screen_place(pixel)
        if place is None:
            continue
        yield from click(*place)
        if number == 4:
            yield 0.6
            yield from shot("4_picking", settle=0.0)
    picked = len(settings().mirrors[0].picks)
    expect(picked >= 6, f"picks: {picked} of {len(pixels)}")
    yield from keys("BACK_SPACE")
    expect(len(settings().mirrors[0].picks) == picked - 1, "Backspace drops the last")
    yield 1.0
    yield from keys("RET")
    yield from settled()
    mirror = settings().mirrors[0]
    expect(bool(mirror.plane) and 0 < mirror.residual_mm < 20, f"a plane: {mirror.residual_mm} mm, {mirror.message}")
    note("picking_ms", max(times))
    # The rest of the way goes on with both mirrors.
    yield from press("find_mirrors")
    yield from settled()
    expect(len(settings().mirrors) == 2, "two mirrors again")


def pictures() -> Story:
    """Panels in the light theme and in a narrow sidebar."""
    theme = next(Path(bpy.utils.system_resource("SCRIPTS")).glob("presets/interface_theme/*ight.xml"))
    with step("light theme"), viewport():
        bpy.ops.script.execute_preset(filepath=str(theme), menu_idname="USERPREF_MT_interface_theme_presets")
    yield from shot("8_light")
    with step("dark theme"), viewport():
        bpy.ops.preferences.reset_default_theme()
    with step("narrow sidebar"):
        yield from resize_sidebar(180)
        yield from shot("8_narrow")
        yield from resize_sidebar(300)


def measure() -> None:
    """Figures that need no clicks."""
    with step("mesh of 60 000 vertices"):
        scene = sys.modules[f"{ADDON}.mirror_scan_addon.scene"]
        mesh = sys.modules[f"{ADDON}.mirror_scan_addon.tasks"].Surface(*grid(245))
        spent = []
        for _ in range(5):
            start = time.perf_counter()
            made = scene.create_avatar(mesh, collection=bpy.context.scene.collection)
            spent.append(1000 * (time.perf_counter() - start))
            bpy.data.meshes.remove(made.data)
        note("mesh_vertices", len(mesh.vertices))
        note("mesh_ms", float(np.median(spent)))


# --- looking ---------------------------------------------------------------------------------------------------------


def settings():
    return bpy.context.scene.mirror_scan


def cloud():
    return settings().cloud


def avatar():
    return next((item for item in bpy.context.scene.objects if "mirror_scan_report" in item), None)


def busy() -> bool:
    names = (operator.bl_idname for operator in window().modal_operators)
    return any(name.startswith("MIRROR_SCAN_OT_") for name in names)


def watertight(item) -> bool:
    edges = np.empty(len(item.data.loops), np.int32)
    item.data.loops.foreach_get("edge_index", edges)
    return bool((np.bincount(edges, minlength=len(item.data.edges)) == 2).all())


def grid(n: int) -> tuple:
    """Arrays of a sheet of n × n vertices with everything an avatar has."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    vertices = np.stack((x, y, 0.1 * np.sin(9 * x)), -1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([
        np.stack((corner, corner + 1, corner + n), 1), np.stack((corner + 1, corner + n + 1, corner + n), 1)
    ]).astype(np.int32)  # fmt: skip
    colors = (255 * np.stack((x, y, 1 - x), -1)).astype(np.uint8).reshape(-1, 3)
    return vertices, triangles, colors, np.zeros(n * n, np.int8), np.zeros(len(triangles), np.int8)


def window():
    return bpy.context.window_manager.windows[0]


def area():
    return max((a for a in window().screen.areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)


def region(kind: str):
    return next(r for r in area().regions if r.type == kind)


@contextlib.contextmanager
def viewport(kind: str = "WINDOW"):
    with bpy.context.temp_override(window=window(), area=area(), region=region(kind)):
        yield


def screen_place(pixel) -> tuple[int, int] | None:
    """Where the point of the capture nearest to a pixel of its depth map is on the screen."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    item = cloud()
    reader = sys.modules[f"{ADDON}.mirror_scan_addon.cloud"]
    arrays = reader.read_cloud(item)
    width = arrays.intrinsics.width
    here = np.stack((arrays.pixel % width, arrays.pixel // width), -1) - np.array(pixel)
    nearest = int(np.argmin((here**2).sum(1)))
    at = item.matrix_world @ Vector(arrays.points[nearest].tolist())
    main = region("WINDOW")
    place = location_3d_to_region_2d(main, main.data, at)
    sidebar = region("UI")
    if place is None or not (20 < place.y < main.height - 80 and 60 < place.x < main.width - sidebar.width - 20):
        return None
    return main.x + round(place.x), main.y + round(place.y)


# --- doing -----------------------------------------------------------------------------------------------------------


def move(x: int, y: int) -> Story:
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield 0.02


def click(x: int, y: int, kind: str = "LEFTMOUSE") -> Story:
    yield from move(x - 1, y)
    yield from move(x, y)
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=kind, value=value, x=x, y=y)
        yield 0.04
    yield 0.1


def keys(kind: str, **modifiers: bool) -> Story:
    """A key over the middle of the viewport."""
    main = region("WINDOW")
    x, y = main.x + main.width // 3, main.y + main.height // 2
    yield from move(x, y)
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=kind, value=value, x=x, y=y, **modifiers)
        yield 0.05
    yield 0.2


def open_sidebar() -> Story:
    area().spaces.active.show_region_ui = True
    yield 0.5
    region("UI").active_panel_category = "Mirror Scan"
    yield 0.5
    if region("UI").width < 290:
        yield from resize_sidebar(300)


def resize_sidebar(width: int) -> Story:
    """Drag the sidebar's left edge."""
    sidebar = region("UI")
    x, y = sidebar.x, sidebar.y + sidebar.height // 3
    yield from move(x, y)
    window().event_simulate(type="LEFTMOUSE", value="PRESS", x=x, y=y)
    yield 0.1
    target = sidebar.x + sidebar.width - width
    for k in range(1, 6):
        yield from move(x + (target - x) * k // 5, y)
    window().event_simulate(type="LEFTMOUSE", value="RELEASE", x=target, y=y)
    yield 0.5
    region("UI").active_panel_category = "Mirror Scan"
    yield 0.3


def press(operator: str, choose: str = "") -> Story:
    """Click the button of an operator in the sidebar; ``choose`` is then taken in the file browser."""
    place = yield from find_button(operator)
    expect(place is not None, f"a button for {operator}")
    yield from click(*place)
    if choose:
        yield 0.7
        yield from choose_file(choose)


def find_button(operator: str):
    """Move down the sidebar until Blender says that the button under the mouse is the one; scroll when it is not."""
    for wheel, turns in (("", 0), ("WHEELUPMOUSE", 40), ("WHEELDOWNMOUSE", 8), ("WHEELDOWNMOUSE", 8)):
        sidebar = region("UI")
        for _ in range(turns):
            x, y = sidebar.x + 20, sidebar.y + sidebar.height // 2
            window().event_simulate(type=wheel, value="PRESS", x=x, y=y)
            yield 0.03
        yield 0.3
        if operator in places and (yield from is_button(operator, *places[operator])):
            return places[operator]
        for x in (sidebar.x + sidebar.width // 3, sidebar.x + sidebar.width - 48):
            for y in range(sidebar.y + sidebar.height - 10, sidebar.y, -10):
                if (yield from is_button(operator, x, y)):
                    places[operator] = x, y
                    return x, y
    return None


def is_button(operator: str, x: int, y: int):
    """Whether the mouse is on a button of this operator there."""
    manager = bpy.context.window_manager
    yield from move(x - 1, y)
    yield from move(x, y)
    manager.clipboard = ""
    with viewport("UI"), contextlib.suppress(RuntimeError):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
    return f"mirror_scan.{operator}(" in manager.clipboard


places: dict[str, tuple[int, int]] = {}  # where buttons were


def choose_file(path: str) -> Story:
    """Take a folder in the file browser that is open."""
    windows = bpy.context.window_manager.windows
    browser = next((w, a) for w in windows for a in w.screen.areas if a.type == "FILE_BROWSER")
    yield 0.5
    space = browser[1].spaces.active
    space.params.directory = os.fsencode(path if path.endswith("/") else path + "/")
    yield 0.5
    if "2_browser" not in result["screenshots"]:
        yield from shot("2_browser")
    with bpy.context.temp_override(window=browser[0], area=browser[1], region=browser[1].regions[-1]):
        bpy.ops.file.execute()
    yield 0.3


def look_from_camera() -> Story:
    """View as the depth camera had it, a little wider; every reading is then in sight."""
    placed = cloud().matrix_world @ Matrix.Diagonal((1, -1, -1, 1))  # x right, y up, looking along -z
    space = area().spaces.active
    space.lens = 22
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = placed.to_quaternion()
    view.view_distance = 2.5
    view.view_location = placed @ Vector((0, 0, -2.5))
    yield 0.5


def timed_modal(idname: str, event_type: str) -> list[float]:
    """Milliseconds of each call of an operator's modal() for one kind of event, from now on."""
    cls = next(c for c in bpy.types.Operator.__subclasses__() if c.bl_rna.identifier == idname)
    inner, spent = cls.modal, []

    def modal(self, context, event):
        kind, start = event.type, time.perf_counter()  # the event may be gone afterwards
        try:
            return inner(self, context, event)
        finally:
            if kind == event_type:
                spent.append(1000 * (time.perf_counter() - start))

    cls.modal = modal
    return spent


class Blocks:
    """How long the window stood still: the longest time between two turns of Blender's timers [ms]."""

    STEP_S = 0.005
    running: Blocks | None = None

    def __init__(self) -> None:
        self.worst, self._last, self._on = 0.0, 0.0, False

    def start(self) -> None:
        self.worst, self._last, self._on = 0.0, time.perf_counter(), True
        Blocks.running = self
        bpy.app.timers.register(self._turn)

    def stop(self) -> None:
        self._on = False

    @classmethod
    def skip(cls) -> None:
        """What was just waited for, such as a screenshot, is not Blender's."""
        if cls.running is not None:
            cls.running._last = time.perf_counter()

    def _turn(self) -> float | None:
        now = time.perf_counter()
        self.worst = max(self.worst, 1000 * (now - self._last))
        self._last = now
        return self.STEP_S if self._on else None


def settled(limit: float = LIMIT_S) -> Story:
    """Until nothing of ours runs."""
    deadline = time.monotonic() + limit
    yield 0.3
    while busy():
        expect(time.monotonic() < deadline, f"an end within {limit:g} s")
        yield 0.1
    yield 0.3


def shot(name: str, settle: float = 0.6) -> Story:
    """The whole screen as a picture; what Blender itself makes is black where there is no graphics card."""
    yield settle
    for a in window().screen.areas:
        a.tag_redraw()
    yield 0.3
    path = OUT / f"{name}.png"
    if shutil.which("import"):
        subprocess.run(["import", "-window", "root", str(path)], check=True, timeout=60)
    else:
        with viewport():
            bpy.ops.screen.screenshot(filepath=str(path))
    result["screenshots"].append(name)
    Blocks.skip()


# --- bookkeeping -----------------------------------------------------------------------------------------------------


class Missed(Exception):
    """What was expected was not there."""


def expect(holds: bool, what: str) -> None:
    if not holds:
        raise Missed(what)


def note(name: str, value) -> None:
    result["figures"][name] = value


@contextlib.contextmanager
def step(name: str):
    start = time.perf_counter()
    try:
        yield
    except Missed as error:
        result["steps"].append({"step": name, "error": str(error)})
        raise
    result["steps"].append({"step": name, "seconds": round(time.perf_counter() - start, 2)})
    print(f"{time.perf_counter() - start:6.2f} s  {name}", flush=True)


def end(code: int) -> None:
    (OUT / "result.json").write_text(json.dumps(result, indent=1))
    sys.stdout.flush()
    os._exit(code)


def tick():
    try:
        return next(told)
    except StopIteration:
        end(0)
    except BaseException:
        result["error"] = traceback.format_exc()
        traceback.print_exc()
        with contextlib.suppress(Exception):
            for pause in shot("failed"):
                time.sleep(pause)
        end(1)


told = story()
preferences = bpy.context.preferences
preferences.view.filebrowser_display_type = "SCREEN"
preferences.view.show_splash = False
preferences.use_preferences_save = False
preferences.view.show_statusbar_stats = True
bpy.app.timers.register(tick, first_interval=1.0, persistent=True)
