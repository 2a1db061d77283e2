"""Move an avatar live, by the joints a tracking program sends over UDP."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import time

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ...core.errors import CaptureError, MirrorScanError
from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import scan_records
from ..scene.scan_records import armature_of, no_skeleton

TICK_S = 1 / 60
SAY_S = 0.5  # how often the status bar is written
LOOPBACK = "127.0.0.1"  # core.motion.live_stream.LOOPBACK, which numpy would have to be imported for
_LOCAL = (LOOPBACK, "localhost", "::1")


class MIRRORSCAN_OT_follow_stream(bpy.types.Operator):
    """Move the selected avatar by what a motion tracker sends. Press again to stop and keep the pose"""

    bl_idname = "mirror_scan.follow_stream"
    bl_label = "Follow Stream"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    port: IntProperty(
        name="Port", description="UDP port the tracker sends to", default=39541, min=1, max=65535,
        translation_context=CONTEXT,
    )  # fmt: skip
    address: StringProperty(
        name="Address",
        description="Address of this computer to listen at. The default hears only programs on this computer",
        default=LOOPBACK, translation_context=CONTEXT,
    )  # fmt: skip
    record: BoolProperty(
        name="Record", description="Keep what was followed as a motion of the avatar", default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    seconds: FloatProperty(
        name="Seconds", description="How long to follow. 0 = until stopped; in scripts, 10 s", default=0.0, min=0.0,
        subtype="TIME_ABSOLUTE", options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    _following = None  # the one that follows, of this class

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if MIRRORSCAN_OT_follow_stream._following is not None:
            return True
        return scan_records.allows(cls, scan_records.editable(context) or no_skeleton(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        running = MIRRORSCAN_OT_follow_stream._following
        if running is not None:
            running._stop = True
            return {"FINISHED"}
        if bpy.app.background:
            return self.execute(context)
        try:
            self._begin(context)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        MIRRORSCAN_OT_follow_stream._following = self
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self._begin(context)
            ends = time.monotonic() + (self.seconds or 10.0)
            while time.monotonic() < ends:
                if not self._advance(context):
                    time.sleep(0.002)
            self._keep(context)
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        finally:
            self._close()
        return {"FINISHED"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self._restore()
            self.cancel(context)
            self.report({"INFO"}, say("{label}: cancelled, nothing was changed").format(label=say(self.bl_label)))
            return {"CANCELLED"}
        if event.type != "TIMER" and not self._stop:
            return {"PASS_THROUGH"}
        try:
            over = self._stop or (self.seconds and time.monotonic() - self._began > self.seconds)
            if not over:
                self._advance(context)
                self._tell(context)
                return {"PASS_THROUGH"}
            self._keep(context)
        except job_operators.REPORTED as error:
            self.cancel(context)
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        self.cancel(context)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Close the port and clear the traces from the window; Blender calls this too, when it loads another file."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        self._close()
        MIRRORSCAN_OT_follow_stream._following = None
        job_operators.show_status(context, None)
        job_operators.redraw(context)

    _timer: bpy.types.Timer | None = None
    _stream = None
    _stop = False

    def _begin(self, context: bpy.types.Context) -> None:
        from ...core.motion import LiveStream, StreamFollower
        from ..scene import armature, rig_controls

        if self.address not in _LOCAL and not bpy.app.online_access:
            text = say("Blender is not allowed online; allow it in the preferences (System, Network), or use {address}")
            raise CaptureError(text.format(address=LOOPBACK), code="stream")
        bones = armature_of(context.object)
        self._uid = bones.session_uid
        self._unit = armature.unit_of(bones, context.scene)
        self._follower = StreamFollower(armature.read_skeleton(bones, self._unit))
        self._stream = LiveStream(self.port, self.address)
        action = armature.action_of(bones)
        self._before = (
            {
                bone.name: (bone.location.copy(), bone.rotation_quaternion.copy(), bone.rotation_mode)
                for bone in bones.pose.bones
            },
            action.name if action is not None else "",
            rig_controls.switch_controls(bones, False),
        )
        if action is not None:
            bones.animation_data.action = None
        armature.use_quaternions(bones)
        self._poses: list = []
        self._began = self._told = time.monotonic()

    def _bones(self) -> bpy.types.Object:
        from ..scene import avatar_objects

        bones = avatar_objects.object_of(self._uid)
        if bones is None:
            raise CaptureError(say("The skeleton no longer exists"), code="no_skeleton")
        return bones

    def _advance(self, context: bpy.types.Context) -> bool:
        """Show the newest frame; whether there was one."""
        from ..scene import armature

        frame = self._stream.read()
        if frame is None:
            return False
        try:
            pose = self._follower.follow(frame)
        except MirrorScanError as error:  # a stranger's joints do not end what the tracker's began
            self._stream.reject(error.notice)
            return False
        armature.show_pose(self._bones(), pose, self._unit)
        if self.record:
            self._poses.append((time.monotonic() - self._began, pose))
        return True

    def _tell(self, context: bpy.types.Context) -> None:
        if time.monotonic() - self._told < SAY_S:
            return
        self._told = time.monotonic()
        if not self._stream.frames:
            text = say("Waiting for joints at port {port}    [Esc] Cancel").format(port=self.port)
            if self._stream.problem is not None:
                text = tell(self._stream.problem)
        else:
            text = say("Following: {frames} frames    [Esc] Cancel").format(frames=self._stream.frames)
        job_operators.show_status(context, text)

    def _keep(self, context: bpy.types.Context) -> None:
        """The end: what was recorded becomes a motion."""
        if not self._stream.frames:
            if self._stream.problem is not None:
                raise CaptureError(tell(self._stream.problem), code="stream")
            text = say("nothing came at port {port}; start the tracker, and have it send to {address}")
            raise CaptureError(text.format(port=self.port, address=self.address), code="stream")
        if self.record and len(self._poses) > 1:
            from ..scene import armature

            rate = context.scene.render.fps / context.scene.render.fps_base
            clip = _clip_of(self._poses, rate)
            armature.add_clip(self._bones(), clip, self._unit, start=context.scene.frame_current)
        if self._stream.malformed:
            text = say("{count} messages of the tracker could not be read; the last: {problem}")
            self.report({"WARNING"}, text.format(count=self._stream.malformed, problem=tell(self._stream.problem)))
        self.report({"INFO"}, say("Followed {frames} frames").format(frames=self._stream.frames))

    def _restore(self) -> None:
        try:
            bones = self._bones()
        except MirrorScanError:  # deleted meanwhile: there is nothing to put back
            return
        from ..scene import rig_controls

        places, action, led = self._before
        for name, before in places.items():
            if name in bones.pose.bones:
                bone = bones.pose.bones[name]
                bone.location, bone.rotation_quaternion, bone.rotation_mode = before
        if action and action in bpy.data.actions:
            bones.animation_data.action = bpy.data.actions[action]
        if led:
            rig_controls.switch_controls(bones, True)

    def _close(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None


def _clip_of(poses: list, rate: float):
    """Poses with their times [s] as a clip of ``rate`` frames a second."""
    import numpy as np

    from ...core.avatar.clip import Clip

    times = np.array([moment for moment, _ in poses])
    wanted = np.arange(times[0], times[-1] + 1e-9, 1 / rate)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    nearest = after - (wanted - times[after - 1] <= times[after] - wanted)
    rotations = np.array([poses[k][1].rotations for k in nearest])
    return Clip("Stream", rate, rotations, np.array([poses[k][1].translation for k in nearest]))


CLASSES = (MIRRORSCAN_OT_follow_stream,)
