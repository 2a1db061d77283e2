"""The whole way in Blender's window, with simulated mouse and keyboard; run by ``run.py`` inside Blender.

Blender calls :func:`tick` from its timers; each ``yield`` in :func:`story` gives it that many seconds to draw and to
work. Buttons are found as a person finds them, by looking under the mouse: Blender's own “copy Python command” tells
which operator the button there belongs to. From the fresh Blender to the avatar nothing is called, all is clicked and
typed; each click is kept in ``result.json``, with what was seen, beside the screenshots.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

OUT, CAPTURE, ZIP, ADDON = (
    Path(os.environ["MIRROR_SCAN_OUT"]),
    os.environ["MIRROR_SCAN_CAPTURE"],
    os.environ["MIRROR_SCAN_ZIP"],
    os.environ["MIRROR_SCAN_ID"],
)
SECOND = os.environ["MIRROR_SCAN_SECOND"]  # a capture of somebody else
ABOVE = int(os.environ["MIRROR_SCAN_ABOVE"])  # how much of the screen is above the window [px]
SMALL, LARGE = (1280, 800), (1600, 1000)  # of the window [px]
ALL_LOOKS = bool(os.environ.get("MIRROR_SCAN_LOOKS"))  # pictures in both sizes, light and dark
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # what tests share
WRONG = Path(os.environ["MIRROR_SCAN_WRONG"])  # folder of files that are no capture
LIMIT_S = 900.0  # for one step of the way, compiling included
STUCK_S = 200.0  # without a turn of Blender's timers, after which it is taken for stuck

result: dict = {
    "blender": f"Blender {bpy.app.version_string}", "steps": [], "figures": {}, "screenshots": [], "events": [],
    "actions": [],
}  # fmt: skip
Story = Iterator[float]


# --- what is done --------------------------------------------------------------------------------------------------


def story() -> Story:
    blocks = Blocks()
    with step("install the zip"):
        yield from install()
    with step("open the sidebar"):
        yield from open_sidebar()
    yield from looks("1_panel")
    note("redraw_empty_ms", redraw_ms())

    with step("from a dropped capture to the avatar, in a new file as it comes"):
        yield from first_avatar()

    with step("load by the file browser"):
        yield from press("load_capture")
        yield from choose(CAPTURE, picture="2_browser")
        yield from settled()
        expect(cloud() is not None, "points of the capture")
    yield from shot("2_in_the_way")
    with step("hide what is in the way"):
        expect(bpy.data.objects["Cube"].visible_get(), "the cube of a new file")
        yield from press("make_room")
        expect(not bpy.data.objects["Cube"].visible_get(), "no cube in the way")
    yield from looks("2_capture")

    with step("load by drag and drop, only to look"):
        _, shown = yield from drop()
        note("points_shown_first_s", shown)  # while kernels are compiled in the background
        yield 1.0
        expect(settings().cloud_colors == "CAPTURE" and not settings().subject.searched_with, "no search unasked")

    with step("find mirrors"):
        yield from press("clear_mirrors", 0.97)
        expect(len(settings().mirrors) == 0, "no mirrors")
        yield from press("find_mirrors")
        yield from settled()
        expect(len(settings().mirrors) == 2, f"two mirrors, not {len(settings().mirrors)}")
        note("mirror_residuals_mm", [mirror.residual_mm for mirror in settings().mirrors])
    yield from looks("3_mirrors")

    with step("pick mirror points"):
        yield from pick()
    with step("find the subject"):
        yield from press("find_subject")
        yield from settled()
        expect(bool(settings().subject.message), "the points of the person, counted")
    yield from looks("5_subject")

    with step("click the person"):
        yield from click_person()
    with step("calibrate the rig, and use its file"):
        for name in ("calibrate_rig", "use_rig"):
            with viewport():
                getattr(bpy.ops.mirror_scan, name)("INVOKE_DEFAULT", filepath=str(OUT / "rig.json"))
            yield from settled()
            sources = [mirror.source for mirror in settings().mirrors]
            expect(sources == ["rig file"] * 2, f"two mirrors of a rig file, not {sources}")
        yield from press("find_mirrors")
        yield from settled()
    with step("move the subject's settings, live"):
        yield from live()
    watch = Watch()
    with step("build, with the window alive"):
        yield from press("build_avatar")
        blocks.start()
        yield 0.1
        with standing_still():
            yield 0.4  # the bar is drawn again
            expect(busy(), "a build under way")
            yield from looks("6_building", settle=0.0)
            expect(busy(), "a build under way in its pictures")
        yield from settled()
        yield 0.5
        blocks.stop()
        note("first_build_blocks_ms", blocks.worst)
        expect(avatar() is not None, "an avatar")
        note("avatar_vertices", len(avatar().data.vertices))
        note("watertight", watertight(avatar()))
        result["clicks_from_zip_to_avatar"] = len(result["events"])
    yield from looks("7_avatar")

    with step("undo and redo by the keyboard"):
        count = len(bpy.data.meshes)
        yield from keys("Z", ctrl=True)
        yield 0.7
        expect(avatar() is None, "no avatar after undo")
        yield from keys("Z", ctrl=True, shift=True)
        yield 0.7
        expect(avatar() is not None and len(bpy.data.meshes) == count, "the avatar again after redo")

    with step("build again, kernels and process ready"):
        watch.forget()
        yield from press("build_avatar")
        blocks.start()
        started = time.perf_counter()
        yield from settled()
        note("second_build_s", time.perf_counter() - started)
        yield 0.5
        blocks.stop()
        note("build_working_blocks_ms", blocks.worst_until(watch.last_modal))
        note("second_build_blocks_ms", blocks.worst)
        note("build_own_ms", watch.worst())
        result["own_calls_ms"] = watch.longest()
        note("redraw_ms", redraw_ms())
    watch.stop()
    with step("undo the second avatar"):
        yield from keys("Z", ctrl=True)
        yield 0.7
        expect(sum("mirror_scan_report" in item for item in bpy.data.objects) == 1, "one avatar again")

    with step("cancel by Esc"):
        count = len(bpy.data.objects)
        yield from press("build_avatar")
        yield from keys("ESC")
        yield 0.5
        expect(not busy() and len(bpy.data.objects) == count, "nothing new after Esc")

    with step("cancel by the button beside the bar"):
        yield from press("build_avatar")
        yield from press("cancel_job", 0.97)
        yield 0.5
        expect(not busy() and len(bpy.data.objects) == count, "nothing new after the button")

    with step("build while the avatar is edited"):
        yield from press("build_avatar")
        with viewport():
            bpy.ops.object.mode_set(mode="EDIT")
        mesh = avatar().data.session_uid
        yield from settled()
        expect(bpy.context.mode == "OBJECT" and avatar().data.session_uid != mesh, "the new mesh, in Object Mode")

    with step("skeleton, walk, and a tracker that is followed"):
        yield from motion()

    with step("texture, measurements, a garment, a studio"):
        yield from look()

    with step("check, and jump to a problem"):
        expect(bpy.context.object == avatar(), "the avatar selected")
        yield from press("check")
        yield from settled()
        yield from looks("8_check")
        tear(bpy.context.object)
        yield from press("check")
        yield from settled()
        yield from press("color_by", 0.8, mode="KIND")
        yield from press("jump_to_problem", 0.97, direction="NEXT")
        expect(settings().problem_index == 1, "the first problem")
        yield 0.5
    yield from looks("8_problem")

    yield from pictures()

    with step("drop what is none, and press what cures it"):
        yield from wrong_files()

    with step("every wrong file and state"):
        yield from wrong_inputs()

    with step("load by drag and drop again, kernels ready"):
        made, shown = yield from drop()
        note("points_made_s", made)
        note("points_shown_s", shown)
        note("points_shown", len(cloud().data.vertices))
        note("redraw_points_ms", redraw_ms())

    with step("from a dropped capture to the avatar in one press"):
        avatars = sum("mirror_scan_report" in item for item in bpy.data.objects)
        yield from drop_capture()
        started = time.perf_counter()
        yield from type_key("M", *middle())  # of the menu that asks: Make Avatar
        yield from settled()
        note("one_press_s", time.perf_counter() - started)
        made = sum("mirror_scan_report" in item for item in bpy.data.objects)
        expect(made == avatars and watertight(bpy.context.object), "the torn avatar replaced by one that is closed")
        expect(not settings().show_cloud and not settings().show_mirrors, "nothing of the scan before it")
    yield from shot("9_one_press")
    with step("undo it"):
        yield from keys("Z", ctrl=True)
        yield 0.7
        expect(avatar() is not None and not watertight(avatar()), "the torn avatar again")

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

    with step("every format, with Colour By on each"):
        yield from every_format()
    with step("two people in one file, each built again twice"):
        yield from two_people()

    with step("a recording played to the live view, until its avatar is there"):
        yield from live_view()

    with step("plan a rig"):
        yield from keys("A")
        yield from keys("DEL")
        expect(not any(item.visible_get() for item in bpy.context.scene.objects), "nothing to be seen")
        yield from press("add_rig")
        yield from press("simulate")
        yield from settled()
        expect(cloud() is not None and "%" in settings().rig_message, "a virtual capture, and what it covers")
        yield from until(lambda: settings().rig_person is not None, "the rig's mannequin", LIMIT_S)
        yield from until(lambda: '"seen"' in settings().rig_checked, "what the rig sees", LIMIT_S)
        yield from scroll(40)
    yield from looks("9_rig")

    with step("disable and enable"):
        note("redraw_with_ms", redraw_ms())
        # in the midst of picking: that ends, and the mirrors are as before
        mirrors = [(mirror.name, len(mirror.picks)) for mirror in settings().mirrors]
        with viewport():
            bpy.ops.mirror_scan.pick_mirror_points("INVOKE_DEFAULT", add=True)
        expect(busy() and len(settings().mirrors) == len(mirrors) + 1, "picking a new mirror")
        with viewport():
            bpy.ops.preferences.addon_disable(module=ADDON)
        yield 0.5
        expect(dir(bpy.ops.mirror_scan) == [], "no operators when disabled")
        expect(not hasattr(bpy.types.Scene, "mirror_scan"), "no properties when disabled")
        note("redraw_without_ms", redraw_ms())
        with viewport():
            bpy.ops.preferences.addon_enable(module=ADDON)
        yield 0.5
        expect(cloud() is not None, "the file's data again when enabled")
        expect(mirrors == [(mirror.name, len(mirror.picks)) for mirror in settings().mirrors], "the mirrors as before")
        with viewport():
            expect(bpy.ops.mirror_scan.find_mirrors.poll(), "nothing under way any more")

    measure()


def install() -> Story:
    """Edit › Preferences › Get Extensions › the arrow at the right › Install from Disk."""
    main = window()
    action("Edit")
    yield from click(*EDIT_MENU(main), on=main)
    yield 0.5
    yield from shot("0_menu", settle=0.0)
    middle = main.width // 2, main.height // 2  # where the window is going to be
    action("Preferences")
    yield from type_key("UP_ARROW", *middle, main)  # the last entry
    yield from type_key("RET", *middle, main)
    yield from until(lambda: find_area("PREFERENCES") is not None, "the Preferences window")
    where, area = find_area("PREFERENCES")
    action("Get Extensions")
    tabs = next(r for r in area.regions if r.type in ("UI", "NAVIGATION_BAR"))
    preferences = bpy.context.preferences
    for y in range(tabs.y + tabs.height - 12, tabs.y, -12):
        yield from click(tabs.x + tabs.width // 2, y, on=where)
        if preferences.active_section == "EXTENSIONS":
            break
    expect(preferences.active_section == "EXTENSIONS", "the tab Get Extensions")
    yield from shot("0_extensions")
    action("the arrow")
    top = next(r for r in area.regions if r.type == "WINDOW")
    yield from click(top.x + top.width - 23, top.y + top.height - 22, on=where)
    yield 0.5
    yield from shot("0_install_menu", settle=0.0)
    action("Install from Disk")
    yield from type_key("UP_ARROW", on=where)  # the last entry again
    yield from type_key("RET", on=where)
    action("the zip")
    yield from choose(ZIP, picture="0_zip")
    yield from until(lambda: hasattr(bpy.types.Scene, "mirror_scan"), "the add-on, installed and enabled")
    yield from shot("0_installed")
    action("close the Preferences")
    with bpy.context.temp_override(window=find_area("PREFERENCES")[0]):
        bpy.ops.wm.window_close()  # its cross belongs to the desktop, which there is none of here
    yield 0.5


def first_avatar() -> Story:
    """What a person does who has just installed the add-on: drop a capture, choose *Make Avatar*; then undo it."""
    action("drop the capture")
    started = time.perf_counter()
    yield from drop_capture()
    action("Make Avatar")
    yield from type_key("M", *middle())
    yield from until(lambda: cloud() is not None, "points of the capture", LIMIT_S)
    note("first_load_s", time.perf_counter() - started)
    note("points", len(cloud().data.vertices))
    yield from settled()
    note("first_build_s", time.perf_counter() - started)
    expect(avatar() is not None and watertight(avatar()), "a closed avatar")
    expect(
        not bpy.data.objects["Cube"].visible_get() and avatar().visible_get(),
        "the avatar to be seen, and no cube in the way",
    )
    note("actions", result["actions"])
    expect(len(result["actions"]) <= 9, f"at most nine actions, not {result['actions']}")
    for name, options in (("scan_to_avatar", {}), ("build_avatar", {}), ("export_avatar", {"format": "3MF"})):
        place = yield from find_button(name, 0.4, options, 10)
        expect(place is not None and scrolled() > -1, f"{name} to be seen without scrolling")
    yield from looks("1_first_avatar")
    yield from keys("Z", ctrl=True)
    yield 0.7
    expect(avatar() is None and bpy.data.objects["Cube"].visible_get(), "the file as it was, after undo")


def action(what: str) -> None:
    """Note one thing that a person does on the shortest way."""
    result["actions"].append(what)


def EDIT_MENU(main) -> tuple[int, int]:
    """Where “Edit” is in the top bar, which Python is not told of."""
    return 78, main.height - 13


def pick() -> Story:
    """Eight clicks on the frame of the first mirror, where the capture's own mirrors.json has them."""
    content = json.loads((Path(CAPTURE) / "mirrors.json").read_text())
    pixels = content["mirrors"][0]["frame_pixels"]
    yield from press("clear_mirrors", 0.97)
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
            yield from looks("4_picking", settle=0.0)
    expect(settings().mirrors[0].name == "mirror 1", f"mirror 1, not {settings().mirrors[0].name}")
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


def click_person() -> Story:
    """A click on the middle of the person: the search goes by it, and finds the same."""
    points, module = cloud(), sys.modules[f"{ADDON}.mirror_scan_addon.scene.live_subject"]
    reader = sys.modules[f"{ADDON}.mirror_scan_addon.scene.point_cloud"]
    arrays, view = reader.read_cloud(points), reader.values(points.data, reader.VIEW, np.int8)
    rows, columns = np.divmod(arrays.pixel[view == 0], arrays.intrinsics.width)
    pixel = np.median(columns), np.median(rows)
    yield from press("pick_subject")
    expect(busy(), "clicking runs")
    yield from click(*screen_place(pixel))
    subject = settings().subject
    expect(subject.clicked and np.hypot(*(np.array(subject.click) - pixel)) < 12, f"the click: {tuple(subject.click)}")
    yield from until(lambda: not subject.stale and not module.searching(bpy.context.scene), "the person, searched for")
    expect((reader.values(cloud().data, reader.VIEW, np.int8) == view).mean() > 0.999, "the same person as before")
    subject.clicked = False
    yield from until(lambda: not subject.stale and not module.searching(bpy.context.scene), "the person again")


def drop() -> Story:
    """A capture dropped into the viewport three times; seconds until its points are there, and until they are drawn."""
    made, shown = [], []
    for _ in range(3):
        before = cloud().session_uid
        yield from drop_capture()
        start = time.perf_counter()
        yield from type_key("O", *middle())  # of the menu that asks: Only Look, not Make Avatar
        while busy() or cloud() is None or cloud().session_uid == before:
            expect(time.perf_counter() - start < 60, "other points than before")
            yield 0.01
        made.append(time.perf_counter() - start)
        with viewport():
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        shown.append(time.perf_counter() - start)
        yield 0.5
    return made, shown


def drop_capture(folder: str = CAPTURE, file: str = "intrinsic.json") -> Story:
    """A file dropped into the viewport; a menu asks what to do with it."""
    yield from move(*middle())
    with viewport():
        bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=folder, files=[{"name": file}])
    yield 0.3


def live() -> Story:
    """Drag *Reach*, and tick *Any Object*: the person is searched for again automatically; undo reverts that too."""
    module = sys.modules[f"{ADDON}.mirror_scan_addon.scene.live_subject"]
    inner, spent = module._turn, []

    def turn():
        start = time.perf_counter()
        try:
            return inner()
        finally:
            spent.append(1000 * (time.perf_counter() - start))

    module._turn = turn

    def found():
        return not subject().stale and not module.searching(bpy.context.scene)

    def subject():
        return settings().subject

    stamp = cloud().data["mirror_scan_stamp"]
    yield from unfold("subject")
    x, y = yield from find_field("mirror_scan.subject.reach", 0.75)
    before = subject().reach
    yield from move(x, y)
    send("LEFTMOUSE", "PRESS", x, y)
    yield 0.1
    for k in range(1, 9):
        yield from move(x - 4 * k, y)
        yield 0.1
    expect(cloud().data["mirror_scan_stamp"] != stamp, "points that were sorted anew while the mouse still drags")
    send("LEFTMOUSE", "RELEASE", x - 32, y)
    yield 0.2
    expect(subject().reach < before, f"a smaller reach than {before}, not {subject().reach}")
    yield from until(found, "the person, searched for with the new reach")
    yield from keys("Z", ctrl=True)
    yield from until(lambda: abs(subject().reach - before) < 1e-6 and found(), "the reach and the person of before")
    place = yield from find_field("mirror_scan.subject.object", 0.75)
    yield from click(*place)
    yield from until(lambda: subject().object and found(), "the object, searched for")
    yield from shot("5_live")
    yield from click(*place)
    yield from until(lambda: not subject().object and found(), "the person again")
    module._turn = inner
    note("live_search_own_ms", max(spent))


def motion() -> Story:
    """A skeleton, a clip that plays, and joints sent over UDP that the avatar follows until the button is pressed."""
    yield from press("add_skeleton", 0.6)
    started = time.perf_counter()
    yield from settled()
    note("skeleton_s", time.perf_counter() - started)
    bones = avatar().parent
    expect(bones is not None and len(bones.data.bones) == 22, "a skeleton")
    yield from press("apply_motion", 0.5, clip="walk")
    yield from settled()
    expect(bones.animation_data.action is not None, "a motion")
    scene = bpy.context.scene
    frames = range(scene.frame_start, scene.frame_end + 1)
    started = time.perf_counter()
    for frame in frames:
        scene.frame_set(frame)
    note("walk_frame_ms", 1e3 * (time.perf_counter() - started) / len(frames))
    scene.frame_set(scene.frame_start + len(frames) // 4)
    yield from looks("7_walk")

    hand = bones.pose.bones["mixamorig:LeftHand"]
    yield from press("follow_stream")
    expect(busy(), "a stream that is followed")
    rest = {name: list(bones.data.bones[f"mixamorig:{name}"].head_local) for name in JOINTS}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for k in range(20):  # the left arm is raised, the rest stands as it rests
            turned = math.radians(3.0 * k)
            sent = {name: raised(place, rest["LeftArm"], turned, name) for name, place in rest.items()}
            out.sendto(json.dumps({"joints": list(sent.values())}).encode(), ("127.0.0.1", 39541))
            yield 0.05
    aim = raised(rest["LeftHand"], rest["LeftArm"], math.radians(57.0), "LeftHand")

    def there() -> bool:
        return max(abs(a - b) for a, b in zip(hand.head, aim, strict=True)) < 0.03

    try:
        yield from until(there, "the hand where it was sent", 10.0)
    except Missed:
        raise Missed(f"the hand at {aim}, where it was sent, not at {list(hand.head)}") from None
    yield from shot("7_follow")
    yield from press("follow_stream")
    yield 0.3
    expect(not busy() and abs(hand.head[2] - aim[2]) < 0.02, "the pose stays when the button is pressed again")
    yield from press("apply_motion", 0.2, clip="idle")
    yield from settled()


def look() -> Story:
    """What the panels below *Avatar* make: a texture, tapes about the body, a skirt, and lights to render it in."""
    for name, options in (
        ("texture", {"size": "1024"}), ("measure", {}), ("dress", {"kind": "skirt", "tight": True}), ("add_studio", {}),
    ):  # fmt: skip
        started = time.perf_counter()
        with viewport():
            getattr(bpy.ops.mirror_scan, name)("INVOKE_DEFAULT", **options)
        yield from settled()
        note(f"{name}_s", time.perf_counter() - started)
    expect("mirror_scan_texture" in avatar().data, "a texture")
    tapes = [item for item in bpy.data.objects if item.type == "CURVE"]
    expect(len(tapes) == 12, f"twelve measures, not {len(tapes)}")
    expect(sum("Skirt" in item.name for item in bpy.data.objects) == 1, "a skirt")
    expect(bpy.context.scene.camera.name == "Studio Camera", "a studio")
    yield 0.5
    yield from looks("7_look")
    with viewport():
        bpy.ops.mirror_scan.remove_studio("INVOKE_DEFAULT")
    yield 0.5
    expect("Studio Camera" not in bpy.data.objects, "no studio any more")


JOINTS = (
    "Hips", "Spine", "Spine1", "Spine2", "Neck", "Head", "LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand",
    "RightShoulder", "RightArm", "RightForeArm", "RightHand", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase",
    "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase",
)  # fmt: skip


def raised(place, shoulder, angle: float, name: str) -> list[float]:
    """A joint of the left arm turned upwards about the shoulder; others as they are."""
    if name not in ("LeftForeArm", "LeftHand"):
        return place
    x, z = place[0] - shoulder[0], place[2] - shoulder[2]
    return [shoulder[0] + math.cos(angle) * x - math.sin(angle) * z, place[1],
            shoulder[2] + math.sin(angle) * x + math.cos(angle) * z]  # fmt: skip


def pictures() -> Story:
    """Panels in the light theme and in a narrow sidebar, from top to bottom."""
    with step("light theme"):
        use_theme("light")
        for number, turns in enumerate((-40, 24), start=1):
            yield from scroll(turns)
            yield from shot(f"8_light_{number}")
    with step("dark theme"):
        use_theme("dark")
    with step("narrow sidebar"):
        yield from resize_sidebar(180)
        for number, turns in enumerate((-40, 12, 12), start=1):
            yield from scroll(turns)
            yield from shot(f"8_narrow_{number}")
        yield from resize_sidebar(300)


def wrong_files() -> Story:
    """Files that are no capture, or a spoiled one, dropped: the panel says what is wrong, and its button cures it."""
    keeper = sys.modules[f"{ADDON}.mirror_scan_addon.scene.kept_errors"]
    pressed = 0
    for wrong in json.loads((WRONG / "wrong.json").read_text()):
        folder, file = os.path.split(WRONG / wrong["file"])
        yield from drop_capture(folder, file)
        yield from type_key("O", *middle())
        yield from settled()
        yield from keys("ESC")  # Blender's own message, at the mouse
        kept = keeper.kept(bpy.context)
        expect(kept is not None and re.search(wrong["words"], str(kept.notice)), f"{wrong['name']}: {kept}")
        if pressed == 0:
            yield from press_cure("load_capture", "filepath=", absent=True)
            yield from until(lambda: find_area("FILE_BROWSER") is not None, "a file browser for another capture")
            with seen(*find_area("FILE_BROWSER"), "WINDOW"):
                bpy.ops.file.cancel()
            yield 0.3
            pressed += 1
        repaired = False
        if wrong["name"] == "a depth image cut off":
            name = min(os.listdir(Path(CAPTURE) / "depth"))
            shutil.copy(Path(CAPTURE) / "depth" / name, Path(folder) / "depth" / name)
            repaired = True
        elif kept.kind.name == "lens_wrong":
            yield from looks("8_error")
            settings().reading.lens = "azure_kinect"
            repaired = True
        elif kept.kind.name == "mirror_file":
            yield from click(*(yield from find_field("reading.own_mirrors", 0.5)))
            expect(not settings().reading.own_mirrors, "the mirrors of the file left out")
            repaired = True
        if repaired:
            yield from press_cure("load_capture", "filepath=")
            yield from settled()
            expect(keeper.kept(bpy.context) is None and settings().capture_path == folder, f"{wrong['name']}, cured")
            pressed += 1
        else:
            yield from press_cure("dismiss_error", "", 0.97)
            expect(keeper.kept(bpy.context) is None, "no error any more")
    settings().reading.property_unset("lens")
    settings().reading.property_unset("own_mirrors")
    expect(pressed == 4, f"four cures pressed, not {pressed}")


def wrong_inputs() -> Story:
    """All of ``tests/wrong_inputs.py``, each in a scene of its own: said in the panel, with cures; the cure works."""
    from wrong_inputs import CURES, FILES, INSIDE, STATES, Bench

    keeper = sys.modules[f"{ADDON}.mirror_scan_addon.scene.kept_errors"]
    drawn, first = drawn_cures(), window().scene
    tried, shown, cured = 0, 0, 0
    overlay = area().spaces.active.overlay
    overlay.show_overlays = False  # the panel is looked at; without a graphics card the viewport takes long to draw
    for wrong in FILES + STATES:
        if wrong.words == "save it first" and bpy.data.is_saved:
            continue  # an earlier case was cured by saving
        folder = Path(tempfile.mkdtemp())
        with viewport():
            bpy.ops.scene.new(type="NEW")
        yield 0.1
        bench = Bench(bpy, folder, WRONG / "half", capsule(), ADDON)
        with viewport():
            wrong.make(bench)
            bpy.context.window_manager.mirror_scan.error = ""
            said = refused(wrong.press, bench)
        kept = keeper.kept(bpy.context)
        known = said if kept is None else str(kept.notice)  # where a person is told it in other words
        offered = CURES.search(said) or (kept is not None and kept.kind.cures)  # in words, or as buttons
        expect(bool(re.search(wrong.words, known) and offered) and not INSIDE.search(said), f"{wrong.name}: {said}")
        tried += 1
        drawn.clear()
        region("UI").tag_redraw()
        yield 0.15
        if kept is not None:  # no button was disabled instead, with the reason
            times = max(len(drawn) // max(len(kept.kind.cures), 1), 1)  # Blender may draw a panel more than once
            expect(drawn == times * list(kept.kind.cures), f"{wrong.name}: {drawn} drawn of {kept.kind.cures}")
            shown += 1
        if shown in (1, 20, 40) and kept is not None:
            yield from shot(f"8_wrong_{shown}", settle=0.0)
        if wrong.cure is not None:
            with viewport():
                wrong.cure(bench)
                expect((wrong.again or wrong.press)(bench) == {"FINISHED"}, f"{wrong.name}, cured")
            cured += 1
            yield 0.05
            left = keeper.kept(bpy.context)
            expect(left is None or left.kind.topic == "output", f"{wrong.name}: cured, and still shown: {left}")
        with viewport():
            if bpy.context.mode != "OBJECT":
                bpy.ops.object.mode_set(mode="OBJECT")
        bpy.data.scenes.remove(window().scene)
        window().scene = first
        shutil.rmtree(folder)
    overlay.show_overlays = True
    note("wrong_inputs", {"tried": tried, "in the panel": shown, "cured": cured})
    expect(tried >= 70 and shown >= 40, f"{tried} wrong files and states, {shown} of them told by the panel")


def every_format() -> Story:
    """An avatar of many colours written in every format, with *Colour By* on each mode, and brought back: each file
    shows the capture's colours, bit for bit."""
    from exported_colors import IMPORTERS, MODES, check_colors

    first, folder = window().scene, Path(tempfile.mkdtemp())
    mesh = sys.modules[f"{ADDON}.core.mesh"].Mesh(*many_colors())
    objects = sys.modules[f"{ADDON}.mirror_scan_addon.scene.avatar_objects"]
    absent = {
        name for name, built in (("usdc", "usd"), ("abc", "alembic")) if not getattr(bpy.app.build_options, built)
    }
    tried = []
    for mode in MODES:
        for ending in (*(name for name in IMPORTERS if name not in absent), "blend", "3mf"):
            with viewport():
                bpy.ops.scene.new(type="NEW")
            yield 0.05
            with viewport():
                made = objects.create_avatar(mesh, collection=bpy.context.scene.collection)
                objects.select_only(bpy.context, made)
                expect(bpy.ops.mirror_scan.color_by(mode=mode) == {"FINISHED"}, f"colours by {mode}")
                path = folder / f"{mode.lower()}.{ending}"
                expect(bpy.ops.mirror_scan.export_avatar(filepath=str(path)) == {"FINISHED"}, f"{path.name} written")
                bpy.data.meshes.remove(made.data)
                check_colors(bpy, path, mesh)
            tried.append(path.name)
            for item in list(bpy.context.scene.objects):
                bpy.data.objects.remove(item)
            bpy.data.scenes.remove(window().scene)
            window().scene = first
    shutil.rmtree(folder)
    note("formats_with_colors", tried)
    note("formats_this_blender_lacks", sorted(absent))


def many_colors() -> tuple:
    """A small capsule whose colours are drawn at random."""
    from capsules import capsule as arrays

    vertices, triangles, colors, view, kind = arrays(16, 12)
    return vertices, triangles, np.random.default_rng(8).integers(0, 256, colors.shape).astype(np.uint8), view, kind


def two_people() -> Story:
    """Two captures dropped into a new file in turn, three times: two avatars with names of their own, apart, each
    replaced; undone, and there again after reloading."""
    yield from new_file()
    names = [os.path.basename(path) for path in (CAPTURE, SECOND)]
    built = []
    for number in range(6):
        yield from drop_capture((CAPTURE, SECOND)[number % 2])
        yield from type_key("M", *middle())
        yield from settled()
        made, name = bpy.context.object, names[number % 2]
        expect(made is not None and made.name == name and watertight(made), f"a closed {name}")
        built.append(made.data.session_uid)
        expect_people(names[: number + 1])
    expect(len(set(built)) == 6, "each of six meshes new")
    yield from looks("9_two_people")
    yield from keys("Z", ctrl=True)
    yield 0.7
    expect_people(names)
    yield from keys("Z", ctrl=True, shift=True)
    yield 0.7
    places = [tuple(bpy.data.objects[name].location) for name in names]
    path = str(OUT / "two_people.blend")
    with viewport():
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    expect_people(names)
    expect(places == [tuple(bpy.data.objects[name].location) for name in names], "where they stood")
    note("people_apart_m", round(gap_between(*(bpy.data.objects[name] for name in names)), 3))
    yield from open_sidebar()


def live_view() -> Story:
    """A recording in which all is well: the burst is taken by itself, and an avatar made of it."""
    folder = Path(tempfile.mkdtemp())
    shutil.copy(Path(CAPTURE) / "intrinsic.json", folder)
    for kind in ("color", "depth"):
        frames = sorted((Path(CAPTURE) / kind).iterdir())
        (folder / kind).mkdir()
        for number in range(60):  # the frames of a short burst, again and again
            frame = frames[number % len(frames)]
            shutil.copy(frame, folder / kind / f"{number:06d}{frame.suffix}")
    yield from new_file()
    with viewport():
        bpy.ops.mirror_scan.live_view(
            "INVOKE_DEFAULT", source="playback", filepath=str(folder), rate=10.0, fast=True, frames=6, countdown=1.0,
            ignore={"ARMS"},
        )  # fmt: skip
    expect(busy(), "a recording that plays")
    yield from settled()
    shutil.rmtree(folder)
    expect(avatar() is not None and watertight(avatar()), "the avatar of the burst")
    expect(settings().capture_path.startswith(bpy.app.tempdir), f"a burst, not {settings().capture_path}")


def new_file() -> Story:
    """File › New; all panels are folded in it."""
    global unfolded
    with viewport():
        bpy.ops.wm.read_homefile()
    yield 1.0
    unfolded = ""
    places.clear()
    yield from open_sidebar()


def expect_people(names: list[str]) -> None:
    """These avatars and no others, each in a collection of its capture, closed, and apart from each other."""
    people = [item for item in bpy.context.scene.objects if "mirror_scan_report" in item]
    expect(sorted(item.name for item in people) == sorted(set(names)), f"avatars: {[item.name for item in people]}")
    for item in people:
        expect(item.data.name == item.active_material.name == item.name, f"mesh and material named {item.name}")
        within = item.users_collection[0]
        parent = next(other for other in bpy.data.collections if within.name in other.children)
        expect(parent.name == item.name and item.name in bpy.data.collections["Mirror Scan"].children, within.name)
        expect(watertight(item) and item.visible_get(), f"{item.name}, closed, to be seen")
    if len(people) == 2:
        expect(gap_between(*people) > 0.2, f"{gap_between(*people):.2f} m between two people")


def gap_between(first, second) -> float:
    """Metres between two objects along X; negative where they overlap."""
    ends = [[(item.matrix_world @ Vector(corner)).x for corner in item.bound_box] for item in (first, second)]
    return max(min(ends[0]) - max(ends[1]), min(ends[1]) - max(ends[0]))


def drawn_cures() -> list[str]:
    """The names of the cures that the panel draws, from now on."""
    cures = sys.modules[f"{ADDON}.mirror_scan_addon.interface.panel_errors"].CURES
    names: list[str] = []

    def noting(name, draw):
        return lambda layout, context, found: (names.append(name), draw(layout, context, found))[1]

    for name, draw in list(cures.items()):
        cures[name] = noting(name, draw)
    return names


def refused(press, bench) -> str:
    """What Blender says when an operator refuses to work."""
    from wrong_inputs import refusal

    try:
        press(bench)
    except RuntimeError as error:
        said, lines = refusal(error, bench.folder)
        expect(lines == 1, f"one line: {error}")
        return said
    raise Missed("a refusal")


def press_cure(operator: str, words: str, column: float = 0.33, absent: bool = False) -> Story:
    """Click the button of an operator in the box of the error, on top of the sidebar; with these words in what it
    calls, or without them."""
    yield from scroll(-40)
    sidebar = region("UI")
    x = sidebar.x + 10 + round(column * (sidebar.width - 48))
    for y in range(sidebar.y + sidebar.height - 10, sidebar.y + sidebar.height // 3, -14):
        if (yield from is_button(operator, {}, x, y)) and (words in bpy.context.window_manager.clipboard) != absent:
            yield from click(x, y)
            return
    raise Missed(f"a button for {operator} in the error's box")


def looks(name: str, settle: float = 0.6) -> Story:
    """A picture; where all are wanted, also in the light theme and in a larger window."""
    yield from shot(name, settle)
    if not ALL_LOOKS:
        return
    use_theme("light")
    yield from shot(f"{name}_1280_light")
    yield from resize_window(LARGE)
    yield from shot(f"{name}_1600_light")
    use_theme("dark")
    yield from shot(f"{name}_1600_dark")
    yield from resize_window(SMALL)


@contextlib.contextmanager
def standing_still():
    """The processes that Blender has started stop meanwhile, where they can be stopped: a build of a second would be
    over before its pictures are made."""
    stopped = []
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):  # one that has just ended
            if re.search(rf"^PPid:\t{os.getpid()}$", status.read_text(), re.MULTILINE):
                os.kill(int(status.parent.name), signal.SIGSTOP)
                stopped.append(int(status.parent.name))
    try:
        yield
    finally:
        for number in stopped:
            with contextlib.suppress(OSError):
                os.kill(number, signal.SIGCONT)


def use_theme(name: str) -> None:
    with viewport():
        if name == "light":
            theme = next(Path(bpy.utils.system_resource("SCRIPTS")).glob("presets/interface_theme/*ight.xml"))
            bpy.ops.script.execute_preset(filepath=str(theme), menu_idname="USERPREF_MT_interface_theme_presets")
        else:
            bpy.ops.preferences.reset_default_theme()


def resize_window(size: tuple[int, int]) -> Story:
    """Have the X server change the size of Blender's window, as a window manager would; its lower edge stays."""
    import ctypes

    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XDefaultRootWindow.restype = ctypes.c_ulong
    x11.XDefaultRootWindow.argtypes = (ctypes.c_void_p,)
    display = ctypes.c_void_p(x11.XOpenDisplay(None))
    root, parent, children = ctypes.c_ulong(), ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)()
    count = ctypes.c_uint()
    x11.XQueryTree(display, ctypes.c_ulong(x11.XDefaultRootWindow(display)), ctypes.byref(root), ctypes.byref(parent),
                   ctypes.byref(children), ctypes.byref(count))  # fmt: skip
    for number in range(count.value):
        window_id = ctypes.c_ulong(children[number])
        place = [ctypes.c_int() for _ in range(2)]
        measures = [ctypes.c_uint() for _ in range(4)]
        x11.XGetGeometry(display, window_id, ctypes.byref(root), *map(ctypes.byref, (*place, *measures)))
        if (measures[0].value, measures[1].value) in (SMALL, LARGE):  # Blender's main window
            x11.XMoveResizeWindow(display, window_id, 0, ABOVE + SMALL[1] - size[1], *size)
    x11.XFlush(display)
    x11.XCloseDisplay(display)
    yield from until(lambda: (window().width, window().height) == size, f"a window of {size}", 20.0)
    yield 0.5


def tear(item) -> None:
    """Make a hole in a mesh, for there to be something to find."""
    import bmesh

    work = bmesh.new()
    work.from_mesh(item.data)
    middle = Vector((0, -1, 1.2))
    faces = sorted(work.faces, key=lambda face: (face.calc_center_median() - middle).length)[:60]
    bmesh.ops.delete(work, geom=faces, context="FACES")
    work.to_mesh(item.data)
    work.free()


def measure() -> None:
    """Figures that need no clicks."""
    with step("mesh of 60 000 vertices"):
        scene = sys.modules[f"{ADDON}.mirror_scan_addon.scene.avatar_objects"]
        mesh = sys.modules[f"{ADDON}.core.mesh"].Mesh(*grid(245))
        spent = []
        for _ in range(5):
            start = time.perf_counter()
            made = scene.create_avatar(mesh, collection=bpy.context.scene.collection)
            spent.append(1000 * (time.perf_counter() - start))
            bpy.data.meshes.remove(made.data)
        note("mesh_vertices", len(mesh.vertices))
        note("mesh_ms", float(np.median(spent)))


def capsule():
    """A closed mesh of a person's size that has everything an avatar has."""
    from capsules import capsule as arrays

    return sys.modules[f"{ADDON}.core.mesh"].Mesh(*arrays(48, 32))


# --- looking ---------------------------------------------------------------------------------------------------------


def settings():
    return bpy.context.scene.mirror_scan


def cloud():
    return settings().cloud


def avatar():
    return next((item for item in bpy.context.scene.objects if "mirror_scan_report" in item), None)


def busy() -> bool:
    # None is what is left of an operator whose add-on was disabled
    names = (operator.bl_idname for operator in window().modal_operators if operator is not None)
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
    reader = sys.modules[f"{ADDON}.mirror_scan_addon.scene.point_cloud"]
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


def send(kind: str, value: str, x: int, y: int, on=None, **more) -> None:
    """One event, kept in the record when it is more than a move."""
    if kind != "MOUSEMOVE" and value == "PRESS":
        known = {name: held for name, held in more.items() if held}
        result["events"].append({"step": current, "type": kind, "x": x, "y": y} | known)
    (on or window()).event_simulate(type=kind, value=value, x=x, y=y, **more)


def move(x: int, y: int, on=None) -> Story:
    send("MOUSEMOVE", "NOTHING", x, y, on)
    yield 0.02


def click(x: int, y: int, kind: str = "LEFTMOUSE", on=None) -> Story:
    yield from move(x - 1, y, on)
    yield from move(x, y, on)
    for value in ("PRESS", "RELEASE"):
        send(kind, value, x, y, on)
        yield 0.04
    yield 0.1


def keys(kind: str, **modifiers: bool) -> Story:
    """A key over the middle of the viewport."""
    main = region("WINDOW")
    x, y = main.x + main.width // 3, main.y + main.height // 2
    yield from move(x, y)
    yield from type_key(kind, x, y, **modifiers)


def type_key(kind: str, x: int = 0, y: int = 0, on=None, **more: bool) -> Story:
    """A key where the mouse is, or is said to be."""
    for value in ("PRESS", "RELEASE"):
        send(kind, value, x, y, on, **more)
        yield 0.05
    yield 0.2


def write(text: str, x: int, y: int, on) -> Story:
    """Letters into the field that is edited."""
    for letter in text:
        kind = letter.upper() if letter.isascii() and letter.isalpha() else "SLASH"
        on.event_simulate(type=kind, value="PRESS", x=x, y=y, unicode=letter)
        on.event_simulate(type=kind, value="RELEASE", x=x, y=y)
        yield 0.01
    result["events"].append({"step": current, "type": "TEXT", "text": text})
    yield 0.3


def open_sidebar() -> Story:
    """N over the viewport, then one tab after the other until ours is in front."""
    if region("UI").width <= 1:
        yield from keys("N")
        yield from until(lambda: region("UI").width > 1, "the sidebar")
        yield 0.5
    sidebar = region("UI")
    for y in range(sidebar.y + sidebar.height - 20, sidebar.y, -35):
        if region("UI").active_panel_category == "Mirror Scan":
            break
        yield from click(sidebar.x + sidebar.width - 12, y)
        yield 0.2
    expect(region("UI").active_panel_category == "Mirror Scan", "the tab Mirror Scan")
    if region("UI").width < 290:
        yield from resize_sidebar(300)


def resize_sidebar(width: int) -> Story:
    """Drag the sidebar's left edge."""
    sidebar = region("UI")
    x, y = sidebar.x, sidebar.y + sidebar.height // 3
    yield from move(x, y)
    send("LEFTMOUSE", "PRESS", x, y)
    yield 0.1
    target = sidebar.x + sidebar.width - width
    for k in range(1, 6):
        yield from move(x + (target - x) * k // 5, y)
    send("LEFTMOUSE", "RELEASE", target, y)
    yield 0.5
    expect(abs(region("UI").width - width) < 20, f"a sidebar of {width} px, not {region('UI').width}")


def scroll(turns: int) -> Story:
    """The wheel over the sidebar, down, or up when negative."""
    sidebar = region("UI")
    x, y = sidebar.x + 20, sidebar.y + sidebar.height // 2
    if turns < 0 and scrolled() > -1:  # is at its top
        return
    yield from move(x, y)
    for _ in range(abs(turns)):
        send("WHEELDOWNMOUSE" if turns > 0 else "WHEELUPMOUSE", "PRESS", x, y)
        yield 0.03
    yield 0.3


def scrolled() -> float:
    """Where the top of the sidebar is in its panels; 0 when it is not scrolled down, else negative."""
    return region("UI").view2d.region_to_view(0, region("UI").height)[1]


PANELS = ("capture", "mirrors", "subject", "build", "avatar", "check", "export", "rig")
"""The folded panels, from top to bottom."""

PANEL_OF = {
    "load_capture": "capture", "find_mirrors": "mirrors", "clear_mirrors": "mirrors", "pick_mirror_points": "mirrors",
    "find_subject": "subject", "pick_subject": "subject", "apply_motion": "avatar", "follow_stream": "avatar",
    "check": "check", "color_by": "check", "jump_to_problem": "check", "add_rig": "rig", "simulate": "rig",
    "find_rig": "rig", "check_rig": "rig", "save_plan": "rig",
}  # fmt: skip
"""In which of them an operator's button is; others are in the panel that is always open."""

HEADER, FIRST = 28, 36  # from one header to the next, and from the last button of *Export* to the first header [px]
unfolded = ""  # the panel that is open; a click on the header of another opens it instead


def unfold(name: str) -> Story:
    """Open one of the folded panels, and close the one that was open."""
    global unfolded
    if unfolded == name:
        return
    for panel in filter(None, (unfolded, name)):  # what is above an open one is folded, so its header is where it was
        yield from scroll(-60)
        places.pop(("export_avatar", ("format", "3MF")), None)
        _, y = yield from find_button("export_avatar", 0.4, {"format": "3MF"}, 10)
        yield from click(region("UI").x + 70, y - FIRST - HEADER * PANELS.index(panel))
        yield 0.6
    unfolded = name
    places.clear()


def press(operator: str, column: float = 0.33, **properties: str) -> Story:
    """Click the button of an operator in the sidebar, at ``column`` of its width; among several the one with these
    properties."""
    if operator in PANEL_OF:
        yield from unfold(PANEL_OF[operator])
    place = yield from find_button(operator, column, properties)
    expect(place is not None, f"a button for {operator}")
    yield from click(*place)


def find_button(operator: str, column: float = 0.33, properties: dict[str, str] | None = None, by: int = 14):
    """Move down the sidebar until Blender says that the button under the mouse is the one; scroll when it is not."""
    properties = properties or {}
    key = (operator, *properties.items())
    for share in (column, 0.97, 0.1, 0.6):
        for turns in (0, -60, *[8] * 6):
            before = scrolled()
            if turns:
                yield from scroll(turns)
                if scrolled() == before:  # nothing new to see
                    continue
            sidebar = region("UI")
            if key in places and (yield from is_button(operator, properties, *places[key])):
                return places[key]
            x = sidebar.x + 10 + round(share * (sidebar.width - 48))
            for y in range(sidebar.y + sidebar.height - 10, sidebar.y, -by):
                if (yield from is_button(operator, properties, x, y)):
                    places[key] = x, y
                    return x, y
    return None


def find_field(name: str, column: float):
    """Where a setting's field is in the sidebar: its data path, as Blender copies it, ends with ``name``."""
    manager, sidebar = bpy.context.window_manager, region("UI")
    x = sidebar.x + 10 + round(column * (sidebar.width - 48))
    for turns in (0, -40, 8, 8, 8):
        if turns:
            yield from scroll(turns)
        for y in range(sidebar.y + sidebar.height - 10, sidebar.y, -12):
            yield from move(x - 1, y)
            yield from move(x, y)
            manager.clipboard = ""
            with viewport("UI"), contextlib.suppress(RuntimeError):
                if bpy.ops.ui.copy_data_path_button.poll():
                    bpy.ops.ui.copy_data_path_button(full_path=True)
            if manager.clipboard.endswith(name):
                return x, y
    raise Missed(f"the field of {name}")


def is_button(operator: str, properties: dict[str, str], x: int, y: int, on=None, area=None, kind: str = "UI"):
    """Whether the mouse is on a button of this operator there."""
    manager = bpy.context.window_manager
    yield from move(x - 1, y, on)
    yield from move(x, y, on)
    manager.clipboard = ""
    context = viewport(kind) if area is None else seen(on, area, kind)
    with context, contextlib.suppress(RuntimeError):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
    said = manager.clipboard
    name = operator if "." in operator else f"mirror_scan.{operator}"
    return f"{name}(" in said and all(f"{name}='{value}'" in said for name, value in properties.items())


places: dict[tuple, tuple[int, int]] = {}  # where buttons were


def choose(path: str, picture: str = "") -> Story:
    """Type a path into the file browser that opens, and take it by the button at its lower right."""
    yield from until(lambda: find_area("FILE_BROWSER") is not None, "a file browser")
    yield 1.0
    where, area = find_area("FILE_BROWSER")
    main = next(r for r in area.regions if r.type == "WINDOW")
    x, y = main.x + main.width // 2, main.y + main.height // 2
    folder = path if os.path.isdir(path) else os.path.dirname(path)
    yield from move(x, y, where)
    yield from type_key("L", x, y, where, ctrl=True)
    yield from type_key("A", x, y, where, ctrl=True)
    yield from write(folder, x, y, where)
    yield from type_key("RET", x, y, where)

    def shown():
        return area.spaces.active.params

    yield from until(lambda: os.path.samefile(os.fsdecode(shown().directory), folder), f"the folder {folder}")
    yield 1.0
    yield from click(x, main.y + 30, on=where)  # on nothing: the field goes on being edited otherwise
    for _ in range(5 if folder != path else 0):
        yield from move(x, y, where)
        yield from type_key("DOWN_ARROW", x, y, where)
        if shown().filename == os.path.basename(path):
            break
    expect(folder == path or shown().filename == os.path.basename(path), f"{path}, not {shown().filename}")
    if picture:
        yield from shot(picture)
    bar = next(r for r in area.regions if r.type == "EXECUTE")
    for x in range(bar.x + bar.width - 30, bar.x, -40):
        for y in range(bar.y + 10, bar.y + bar.height, 12):
            if (yield from is_button("file.execute", {}, x, y, where, area, "EXECUTE")):
                yield from click(x, y, on=where)
                yield 0.5
                return
    raise Missed("the button that takes the file")


def middle() -> tuple[int, int]:
    """The middle of the viewport."""
    main = region("WINDOW")
    return main.x + main.width // 3, main.y + main.height // 2


def find_area(kind: str):
    """The window and the area of an editor, if it is shown."""
    windows = bpy.context.window_manager.windows
    return next(((w, a) for w in windows for a in w.screen.areas if a.type == kind), None)


@contextlib.contextmanager
def seen(where, area, kind: str):
    there = next(r for r in area.regions if r.type == kind)
    with bpy.context.temp_override(window=where, area=area, region=there):
        yield


def until(holds, what: str, limit: float = 120.0) -> Story:
    deadline = time.monotonic() + limit
    while not holds():
        expect(time.monotonic() < deadline, what)
        yield 0.1


class Watch:
    """How long Blender waits for each call into the add-on: modal operators, panels and what is drawn."""

    def __init__(self) -> None:
        self.spent: list[tuple[float, str]] = []
        self.last_modal = 0.0  # when the last call of an operator's modal() began
        self._put_back: list[tuple[object, str, object]] = []
        prefix = f"{ADDON}.mirror_scan_addon."
        for kind in (bpy.types.Operator, bpy.types.Panel):
            for cls in kind.__subclasses__():
                for name in ("modal", "draw", "draw_header"):
                    if cls.__module__.startswith(prefix) and hasattr(cls, name):
                        self._wrap(cls, name, f"{cls.__name__}.{name}")
        overlay = sys.modules[f"{prefix}interface.overlay"]
        overlay.unregister()
        for name in ("_draw_view", "_draw_text"):
            self._wrap(overlay, name, f"overlay.{name}")
        overlay.register()
        self._overlay = overlay

    def _wrap(self, owner, name: str, label: str) -> None:
        inner = getattr(owner, name)

        def call(*arguments):
            start = time.perf_counter()
            if name == "modal":
                self.last_modal = start
            try:
                return inner(*arguments)
            finally:
                self.spent.append((1000 * (time.perf_counter() - start), label))

        # Blender counts the arguments of what it calls
        count = inner.__code__.co_argcount
        timed = {0: lambda: call(), 2: lambda this, context: call(this, context),
                 3: lambda this, context, event: call(this, context, event)}[count]  # fmt: skip
        self._put_back.append((owner, name, vars(owner).get(name)))
        setattr(owner, name, timed)

    def stop(self) -> None:
        self._overlay.unregister()
        for owner, name, inner in self._put_back:
            if inner is None:
                delattr(owner, name)
            else:
                setattr(owner, name, inner)
        self._overlay.register()

    def forget(self) -> None:
        self.spent.clear()

    def worst(self) -> float:
        return max(self.spent)[0]

    def longest(self) -> dict[str, float]:
        return {label: round(ms, 1) for ms, label in sorted(self.spent)}  # the last of each name is its longest


def redraw_ms() -> float:
    """What drawing the whole window takes [ms]."""
    with viewport():
        start = time.perf_counter()
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=3)
    return 1000 * (time.perf_counter() - start) / 3


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
        self.all: list[tuple[float, float]] = []  # each one's end, and its length [ms]
        self._last, self._on = 0.0, False

    @property
    def worst(self) -> float:
        return self.worst_until(math.inf)

    def worst_until(self, end: float) -> float:
        """Of those that were over by then."""
        return max((length for ended, length in self.all if ended <= end), default=0.0)

    def start(self) -> None:
        self.all, self._last, self._on = [], time.perf_counter(), True
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
        self.all.append((now, 1000 * (now - self._last)))
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
    if settle and find_area("FILE_BROWSER") is None and find_area("PREFERENCES") is None:
        yield from move(region("WINDOW").x + 90, region("WINDOW").y + 40)  # no tooltip over the picture
    yield settle
    for a in window().screen.areas:
        a.tag_redraw()
    yield 0.3
    path = OUT / f"{name}.png"
    if shutil.which("import"):
        width, height = window().width, window().height
        place = f"{width}x{height}+0+{ABOVE + SMALL[1] - height}"
        cut = ["-crop", "+0+0" if name.startswith(("0_", "failed")) else place, "+repage"]
        subprocess.run(["import", "-window", "root", *cut, str(path)], check=True, timeout=60)
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


current = ""  # the step of the way that is gone


@contextlib.contextmanager
def step(name: str):
    global current
    current, start = name, time.perf_counter()
    print(f"         {name} …", flush=True)
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
    # When the next turn does not come, the log tells where every thread is, and Blender ends.
    faulthandler.dump_traceback_later(STUCK_S, exit=True)
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
preferences.view.show_splash = False
preferences.use_preferences_save = False
preferences.view.show_statusbar_stats = True
bpy.app.timers.register(tick, first_interval=1.0, persistent=True)
