"""Pick points on a mirror's frame in the viewport."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty

from ..background import job_operators
from ..interface import overlay
from ..interface.aiming import NAVIGATION, Aim, region_under
from ..interface.viewport import look_at_whole_capture
from ..language.texts import CONTEXT, say, tell
from ..scene import kept_errors, scan_records

GRAB_PX = 12.0  # how far from the mouse a pick can be grabbed [px at 100 % scale]
FRAME_M = 0.12  # how far outside of the glass, and of its plane, a frame may reach [m]
ENOUGH = 3  # picks that define a plane; with fewer the mirror is searched for around them


class MIRRORSCAN_OT_pick_mirror_points(bpy.types.Operator):
    """Click the frame of each mirror, once, not the glass. If it is not found from one click, click more: 8 points on all four sides are best, 3 on two sides are the least"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.pick_mirror_points"
    bl_label = "Click the Frames"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    add: BoolProperty(
        name="New Mirror", description="Add a mirror to the list, and pick points on it", options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip

    _running = False

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if properties.add:
            return say("Add a mirror to the list, and click points on its frame")
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or scan_records.no_cloud(context)
        if not problem and (context.area is None or context.area.type != "VIEW_3D"):
            problem = say("Frames are clicked in a 3D viewport; scripts use Set Mirror")
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.report({"ERROR"}, say("Frames are clicked with the mouse; scripts use Set Mirror"))
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..scene import point_cloud

        if bpy.app.background:
            return self.execute(context)
        target = point_cloud.cloud_of(context.scene)
        try:
            arrays = point_cloud.read_cloud(target)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        settings = context.scene.mirror_scan
        self._points, self._pixel = arrays.points, arrays.pixel
        self._aim = Aim(arrays.points)
        self._count = len(target.data.vertices)
        self._depth, self._intrinsics = arrays.depth, arrays.intrinsics
        self._sensor = str(arrays.info.get("sensor", ""))
        self._before = scan_records.records_of(settings)
        self._seen_before = point_cloud.values(target.data, point_cloud.SEEN, "int8")
        self._views_before = (settings.mirror_index, settings.show_cloud)
        self._scene_uid, self._area = context.scene.session_uid, context.area.as_pointer()
        self._errand = self._task = self._asked = self._dragged = None
        self._accepting = False
        settings.show_cloud = True
        if self.add or not settings.mirrors:
            self._add_mirror(settings)
        settings.mirror_index = min(settings.mirror_index, len(settings.mirrors) - 1)
        look_at_whole_capture(context, target)
        context.window_manager.mirror_scan.picked = False
        self._timer = context.window_manager.event_timer_add(job_operators.TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.window_manager.mirror_scan.picking = True
        context.window.cursor_modal_set("CROSSHAIR")
        self._running = True
        self._show_status(context)
        return {"RUNNING_MODAL"}

    # --- events -------------------------------------------------------------------------------------------------------

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..scene import point_cloud

        target = point_cloud.cloud_of(context.scene)
        # a panel's button, undo or a script may have changed anything meanwhile
        if context.scene.session_uid != self._scene_uid:
            self._end(context)
            self.report({"WARNING"}, say("Another scene is shown; picking has ended, what was picked is kept"))
            return {"FINISHED"}
        if target is None or len(target.data.vertices) != self._count:
            self._end(context)
            self.report({"WARNING"}, say("The points of the capture are gone; picking has ended"))
            return {"CANCELLED"}
        if context.mode != "OBJECT":  # other workspaces bring other modes
            self._keep(context)
            self.report({"WARNING"}, say("Object Mode was left; picking has ended, what was picked is kept"))
            return {"FINISHED"}
        if not context.scene.mirror_scan.mirrors:
            self._add_mirror(context.scene.mirror_scan)
        if event.type == "TIMER":
            if context.window_manager.mirror_scan.picked:
                context.window_manager.mirror_scan.picked = False
                self._accepting = True
            try:
                return self._on_tick(context)
            except job_operators.REPORTED as error:  # no room for a second process and its input
                self._undo_all(context)
                self.report({"ERROR"}, job_operators.in_words(error))
                return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            self._undo_all(context)
            return {"CANCELLED"}
        if self._dragged is not None:
            return self._drag(context, event)
        region = region_under(context, event, self._area)
        if region is None:  # panels, headers, other editors, the navigation gizmo
            if overlay.hovered() is not None:
                overlay.set_hover(None)
                job_operators.redraw(context)
            context.window.cursor_modal_set("DEFAULT")
            return {"PASS_THROUGH"}
        context.window.cursor_modal_set("CROSSHAIR")
        return self._in_viewport(context, event, region)

    def _in_viewport(self, context, event, region) -> set[str]:
        settings = context.scene.mirror_scan
        pressed = event.value == "PRESS"
        plain = not (event.alt or event.ctrl or event.shift or event.oskey)
        if event.type == "MOUSEMOVE":
            self._hover_over(context, event, region)
            return {"PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and pressed and plain:
            self._press(context, event, region)
        elif event.type == "LEFTMOUSE" and not plain:
            return {"PASS_THROUGH"}  # with Alt it rotates the view, for mice without a middle button
        elif event.type == "RIGHTMOUSE" and pressed:
            number = self._pick_under(context, event, region)
            if number is not None:
                self._active(settings).picks.remove(number)
                self._changed(context)
        elif event.type in ("RET", "NUMPAD_ENTER") and pressed:
            return self._accept(context)
        elif event.type == "TAB" and pressed:
            self._next_mirror(context, backwards=event.shift)
        elif pressed and (event.type == "BACK_SPACE" or (event.type == "Z" and (event.ctrl or event.oskey))):
            picks = self._active(settings).picks
            if len(picks):
                picks.remove(len(picks) - 1)
                self._changed(context)
        elif event.type.startswith(NAVIGATION) or event.type in ("N", "T"):
            return {"PASS_THROUGH"}
        return {"RUNNING_MODAL"}

    def _press(self, context, event, region) -> None:
        """Grab the pick under the mouse, or add one there."""
        picks = self._active(context.scene.mirror_scan).picks
        number = self._pick_under(context, event, region)
        if number is None:
            pixel = self._snap(context, event, region)
            if pixel is None:
                self.report({"WARNING"}, say("The capture has no point here; click on the mirror's frame"))
                return
            self._choose_mirror(context.scene.mirror_scan, pixel)
            picks = self._active(context.scene.mirror_scan).picks
            picks.add().pixel = pixel
            number = len(picks) - 1
            self._changed(context)
        self._dragged = number
        overlay.set_hover(None)

    def _drag(self, context, event) -> set[str]:
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._dragged = None
            self._changed(context)
        elif event.type == "MOUSEMOVE":
            region = region_under(context, event, self._area)
            pixel = None if region is None else self._snap(context, event, region)
            picks = self._active(context.scene.mirror_scan).picks
            if pixel is not None and self._dragged < len(picks):
                picks[self._dragged].pixel = pixel
                job_operators.redraw(context)
        return {"RUNNING_MODAL"}

    def _hover_over(self, context, event, region) -> None:
        index = self._aim.nearest(context, event, region)
        overlay.set_hover(None if index is None else self._points[index])
        job_operators.redraw(context)

    def _choose_mirror(self, settings, pixel: tuple[float, float]) -> None:
        """Make the mirror active that a new pick belongs to: the one on whose frame it lies; and when the active one is
        placed and it lies elsewhere, the next."""
        import numpy as np

        active = self._active(settings)
        if not active.plane:
            if len(active.picks):
                return  # its frame was not found yet, or is being looked for: more picks are its own
        elif active.message:
            return
        at = int(np.searchsorted(self._pixel, round(pixel[1]) * self._intrinsics.width + round(pixel[0])))
        owners = [k for k, item in enumerate(settings.mirrors) if on_frame(item, self._points[at])]
        if owners:
            settings.mirror_index = owners[0]
        elif active.plane:
            self._go_on(settings)

    def _go_on(self, settings) -> None:
        """Make a mirror active that nothing is picked on yet."""
        fresh = [k for k, item in enumerate(settings.mirrors) if not item.plane and not len(item.picks)]
        if fresh:
            settings.mirror_index = fresh[0]
        else:
            self._add_mirror(settings)

    def _next_mirror(self, context, backwards: bool) -> None:
        """Make the next mirror active; after the last, if something is picked on it, add a new one."""
        settings = context.scene.mirror_scan
        last = len(settings.mirrors) - 1
        active = self._active(settings)
        if not backwards and settings.mirror_index == last and (len(active.picks) or active.plane):
            self._add_mirror(settings)
        else:
            settings.mirror_index = (settings.mirror_index + (-1 if backwards else 1)) % (last + 1)
        self._show_status(context)

    # --- where the mouse is -------------------------------------------------------------------------------------------

    def _snap(self, context, event, region) -> tuple[float, float] | None:
        index = self._aim.nearest(context, event, region)
        if index is None:
            return None
        row, column = divmod(int(self._pixel[index]), self._intrinsics.width)
        return float(column), float(row)

    def _pick_under(self, context, event, region) -> int | None:
        """Number of the active mirror's pick under the mouse; None if there is none."""
        import numpy as np

        from ...core.preview.point_picking import project_to_picture
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        target = point_cloud.cloud_of(context.scene)
        numbers, points = [], []
        for number, pick in enumerate(self._active(settings).picks):
            pixel = round(pick.pixel[1]) * self._intrinsics.width + round(pick.pixel[0])
            at = int(np.searchsorted(self._pixel, pixel))
            if at < len(self._pixel) and self._pixel[at] == pixel:
                numbers.append(number)
                points.append(self._points[at])
        if not numbers:
            return None
        matrix = np.array(region.data.perspective_matrix @ target.matrix_world)
        xy = project_to_picture(np.array(points), matrix, (region.width, region.height))
        distance = np.linalg.norm(xy - (event.mouse_x - region.x, event.mouse_y - region.y), axis=1)
        distance = np.where(np.isfinite(distance), distance, np.inf)
        nearest = int(np.argmin(distance))
        return numbers[nearest] if distance[nearest] <= GRAB_PX * context.preferences.system.ui_scale else None

    # --- fitting, in the background -----------------------------------------------------------------------------------

    def _changed(self, context) -> None:
        """The active mirror has other picks: its plane is fitted again at the next tick."""
        item = self._active(context.scene.mirror_scan)
        item.source, item.message = "picked", ""
        if not len(item.picks):
            item.plane, item.residual_mm = "", 0.0
        self._asked = None
        self._show_status(context)

    def _on_tick(self, context) -> set[str]:
        """One tick of the timer: fetch a finished fit, start one that is due, end when there is nothing left to do."""
        settings = context.scene.mirror_scan
        if self._errand is not None and not self._errand.is_alive():
            errand, self._errand = self._errand, None
            if isinstance(errand.error, job_operators.UNAVAILABLE):
                self._errand = job_operators.begin(self._task, thread=True)
            elif isinstance(errand.error, job_operators.REPORTED):
                self._active(settings).message = str(errand.error)
            elif errand.error is not None:
                self._undo_all(context)
                raise errand.error
            elif self._asked is not None:
                self._apply(context, errand.result)
        if self._errand is None and self._dragged is None and self._asked is None:
            records = scan_records.records_of(settings)
            self._asked = [number for number, record in enumerate(records) if record["picks"] or record["plane"]]
            if self._asked:
                chosen = [records[number] for number in self._asked]
                offset = scan_records.behind_frame(settings)
                self._task = job_operators.Task(
                    "fit_steps", (self._depth, self._intrinsics, chosen, offset, self._asked, self._sensor)
                )
                self._errand = job_operators.begin(self._task)
            else:
                self._set_seen(context, None)
        if self._accepting and self._errand is None and self._asked is not None:
            return self._finish(context)
        return {"PASS_THROUGH"}

    def _apply(self, context, fitted) -> None:
        settings = context.scene.mirror_scan
        for number, record in zip(self._asked, fitted.mirrors, strict=True):
            if number >= len(settings.mirrors):  # undo removed it
                break
            item = settings.mirrors[number]
            for name in ("plane", "residual_mm", "message", "source"):
                setattr(item, name, record[name])
            scan_records.set_judgement(item, record)
            if 0 < len(record["picks"]) < ENOUGH:
                item.message = ""  # not an error yet: more picks will follow
        self._set_seen(context, fitted.seen)
        active = self._active(settings)
        if active.plane and not active.message and 0 < len(active.picks) < ENOUGH and self._dragged is None:
            text = say("{name}: found. Click the frame of the next mirror, or press Enter")
            self.report({"INFO"}, text.format(name=active.name))
            self._go_on(settings)
        self._show_status(context)

    def _set_seen(self, context, seen) -> None:
        from ..scene import point_cloud

        mesh = point_cloud.cloud_of(context.scene).data
        if seen is None:
            point_cloud.forget_values(mesh, point_cloud.SEEN)
        else:
            point_cloud.set_values(mesh, seen=seen)

    # --- end ----------------------------------------------------------------------------------------------------------

    def _accept(self, context) -> set[str]:
        self._accepting = True
        return {"RUNNING_MODAL"}

    def _finish(self, context) -> set[str]:
        settings = context.scene.mirror_scan
        kept = _picked(scan_records.records_of(settings))
        short = [record for record in kept if 0 < len(record["picks"]) < ENOUGH and not record["plane"]]
        if short:
            self._accepting = False
            text = say("{name}: points picked: {count}, needed: 3; pick more, or remove them with Backspace")
            self.report({"WARNING"}, text.format(name=short[0]["name"], count=len(short[0]["picks"])))
            return {"PASS_THROUGH"}
        self._keep(context)
        if not any(record["message"] for record in kept):
            kept_errors.forget(context, self)
        for record in kept:
            if record["message"]:
                self.report({"WARNING"}, tell(record["message"]))
        names = ", ".join(record["name"] for record in kept)
        self.report({"INFO"}, say("Mirrors: {names}").format(names=names))
        return {"FINISHED"}

    def _keep(self, context) -> None:
        """End, with the mirrors that something is picked on; what was found of the person with others is forgotten."""
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        records = scan_records.records_of(settings)
        kept = _picked(records)
        mesh = point_cloud.cloud_of(context.scene).data
        if len(kept) < len(records):  # a mirror that Tab added and that has no picks
            numbers = [number for number, record in enumerate(records) if record in kept]
            scan_records.set_records(settings, kept)
            if numbers != list(range(len(kept))):
                point_cloud.forget_values(mesh, point_cloud.SEEN)
        point_cloud.forget_values(mesh, point_cloud.VIEW, point_cloud.HEIGHT)
        scan_records.forget_subject(settings)
        self._end(context)

    def _undo_all(self, context) -> None:
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        scan_records.set_records(settings, self._before)
        settings.mirror_index, settings.show_cloud = self._views_before
        mesh = point_cloud.cloud_of(context.scene).data
        if self._seen_before is None:
            point_cloud.forget_values(mesh, point_cloud.SEEN)
        else:
            attribute = mesh.attributes.get(point_cloud.SEEN) or mesh.attributes.new(point_cloud.SEEN, "INT8", "POINT")
            attribute.data.foreach_set("value", self._seen_before)
            point_cloud.touch(mesh)
        self._end(context)
        self.report({"INFO"}, say("Picking was cancelled; the mirrors are as before"))

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this when it loads another file, or when the window is closed."""
        from ..scene import point_cloud

        scene = context.scene
        if self._running and scene is not None and scene.session_uid == self._scene_uid:
            if point_cloud.cloud_of(scene) is not None:
                self._keep(context)
        self._end(context)

    def leave(self, context: bpy.types.Context) -> None:
        """The add-on is disabled while points are picked: the same as Esc."""
        from ..scene import point_cloud

        if context.scene.session_uid == self._scene_uid and point_cloud.cloud_of(context.scene) is not None:
            self._undo_all(context)
        else:
            self._end(context)

    def _end(self, context) -> None:
        if not self._running:
            return
        self._running = False
        if self._errand is not None:
            self._errand.ask_to_stop()
            self._errand = None
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.mirror_scan.picking = False
        overlay.set_hover(None)
        if context.window is not None:
            context.window.cursor_modal_restore()
        job_operators.show_status(context, None)
        job_operators.redraw(context)

    # --- helpers ------------------------------------------------------------------------------------------------------

    def _active(self, settings) -> bpy.types.PropertyGroup:
        return settings.mirrors[min(settings.mirror_index, len(settings.mirrors) - 1)]

    def _add_mirror(self, settings) -> None:
        record = scan_records.new_record(settings)
        scan_records.set_record(settings.mirrors.add(), record)
        settings.mirror_index = len(settings.mirrors) - 1

    def _show_status(self, context) -> None:
        item = self._active(context.scene.mirror_scan)
        count = len(item.picks)
        if item.message:
            how = tell(item.message)
        elif item.plane and count:
            how = scan_records.quality_word(item)
        elif not count:
            how = say("click its frame once")
        elif count < ENOUGH and self._errand is None and self._asked is not None:
            how = say("not found from here; click {more} more points on it").format(more=ENOUGH - count)
        else:
            how = say("looking for its frame")
        text = say(
            "{name}: {count} picked, {how}    [Click] Pick or drag   [Right Click] Remove   [Backspace] Remove last   "
            "[Tab] Next mirror   [Enter] Accept   [Esc] Cancel"
        )
        job_operators.show_status(context, text.format(name=item.name, count=count, how=how))
        job_operators.redraw(context)


def _picked(records: list[dict]) -> list[dict]:
    """Those of mirrors that are placed, or that something is picked on."""
    return [record for record in records if record["picks"] or record["plane"]]


def on_frame(item: bpy.types.PropertyGroup, point) -> bool:
    """Whether a point of the camera's frame [m] lies on the frame of a mirror that is placed."""
    plane = scan_records.plane_of(item)
    if plane is None or item.message:
        return False
    off = [float(point[k]) - plane["point"][k] for k in range(3)]
    if abs(sum(off[k] * plane["normal"][k] for k in range(3))) > FRAME_M:
        return False
    if plane.get("rectangle") is None:
        return True
    # along the two directions in the glass: the columns of the basis, as the overlay draws it
    along = [sum(off[k] * plane["basis"][k][axis] for k in range(3)) for axis in (0, 1)]
    return all(low - FRAME_M < value < high + FRAME_M for value, (low, high) in zip(along, _sides(plane), strict=True))


def _sides(plane: dict) -> list[tuple[float, float]]:
    return [(min(pair), max(pair)) for pair in plane["rectangle"]]


class MIRRORSCAN_OT_finish_picking(bpy.types.Operator):
    """Accept the mirrors whose frames were clicked, as Enter does"""

    bl_idname = "mirror_scan.finish_picking"
    bl_label = "Done"
    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = "" if context.window_manager.mirror_scan.picking else say("No frames are being clicked")
        return scan_records.allows(cls, problem)

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.mirror_scan.picked = True  # the modal operator sees it at its next tick
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_pick_mirror_points, MIRRORSCAN_OT_finish_picking)
