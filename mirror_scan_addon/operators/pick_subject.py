"""Choose the person by a click, where the search chooses another."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import FloatVectorProperty

from ..background import job_operators
from ..interface import overlay
from ..interface.aiming import NAVIGATION, Aim, region_under
from ..language.texts import CONTEXT, say
from ..scene import scan_records


class MIRRORSCAN_OT_pick_subject(bpy.types.Operator):
    """Click the person or object to make the avatar of, where the camera sees it directly. Only needed if Find Subject chooses another person or object"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.pick_subject"
    bl_label = "Click the Person"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    pixel: FloatVectorProperty(
        name="Pixel", description="Position of the person in the depth image, in pixels from the left and from the top",
        size=2, default=(-1.0, -1.0), precision=1, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    _picking = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(
            cls, scan_records.editable(context) or scan_records.no_cloud(context) or scan_records.no_mirror(context)
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..scene import point_cloud

        try:
            intrinsics = point_cloud.read_cloud(point_cloud.cloud_of(context.scene), color=False).intrinsics
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        u, v = self.pixel
        if not (0 <= u < intrinsics.width and 0 <= v < intrinsics.height):
            text = say("pixel: give a column from 0 to {width} and a row from 0 to {height}")
            self.report({"ERROR"}, text.format(width=intrinsics.width - 1, height=intrinsics.height - 1))
            return {"CANCELLED"}
        subject = context.scene.mirror_scan.subject
        subject.click, subject.clicked = (u, v), True
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..scene import point_cloud

        if bpy.app.background or self.properties.is_property_set("pixel"):
            return self.execute(context)
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, say("The person is clicked in a 3D viewport; scripts set pixel"))
            return {"CANCELLED"}
        try:
            arrays = point_cloud.read_cloud(point_cloud.cloud_of(context.scene), color=False)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        self._aim, self._points = Aim(arrays.points), arrays.points
        self._pixels, self._width = arrays.pixel, arrays.intrinsics.width
        self._scene_uid, self._area = context.scene.session_uid, context.area.as_pointer()
        settings = context.scene.mirror_scan
        settings.show_cloud, settings.fold = True, False  # points are clicked where they are drawn
        context.window_manager.modal_handler_add(self)
        job_operators.show_status(context, say("[Click] The person    [Esc] Cancel"))
        self._picking = True
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..scene import point_cloud

        target = point_cloud.cloud_of(context.scene)
        ended = ""
        if context.scene.session_uid != self._scene_uid:
            ended = say("Another scene is shown; picking has ended")
        elif target is None or len(target.data.vertices) != len(self._points):
            ended = say("The points of the capture are gone; picking has ended")
        elif context.mode != "OBJECT":  # other workspaces bring other modes
            ended = say("Object Mode was left; picking has ended")
        if ended:
            self.cancel(context)
            self.report({"WARNING"}, ended)
            return {"CANCELLED"}
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        region = region_under(context, event, self._area)
        context.window.cursor_modal_set("DEFAULT" if region is None else "CROSSHAIR")
        if region is None or event.type.startswith(NAVIGATION):
            if event.type == "MOUSEMOVE":
                index = None if region is None else self._aim.nearest(context, event, region)
                overlay.set_hover(None if index is None else self._points[index])
                job_operators.redraw(context)
            return {"PASS_THROUGH"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS" or event.alt:
            return {"PASS_THROUGH"}
        index = self._aim.nearest(context, event, region)
        if index is None:
            self.report({"WARNING"}, say("The capture has no point here; click on the person"))
            return {"RUNNING_MODAL"}
        row, column = divmod(int(self._pixels[index]), self._width)
        self.pixel = column, row
        self.cancel(context)
        return self.execute(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore the cursor and the status bar; Blender calls this too, when it loads another file."""
        if not self._picking:
            return
        self._picking = False
        overlay.set_hover(None)
        if context.window is not None:
            context.window.cursor_modal_restore()
        job_operators.show_status(context, None)
        job_operators.redraw(context)


CLASSES = (MIRRORSCAN_OT_pick_subject,)
