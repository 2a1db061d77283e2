"""The Subject step's settings, live: while they move, the person is searched for again, beside the window.

The limits colour the points anew at once (:func:`.overlay.cloud_arrays`); what is connected with what, and so what
*Reach* and *Any Thing* change, only a new search tells. One runs at a time; the next begins, with the values of then,
when it is done. What it finds belongs to the settings like a colour: it makes no undo step of its own, and after undo
and redo it is made again when it does not fit.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ...core.errors import MirrorScanError
from ..background import job_operators
from ..language.texts import say
from . import scan_records

DELAY_S = 0.1  # from a change to the search, and from one look at it to the next
WAIT_S = 0.5  # while a job of ours runs in the window, or the user edits

_wanted: set[int] = set()  # scenes, by session_uid, whose settings changed; no state: a file knows nothing of them
_search: Search | None = None


class Search:
    """One that is under way, and what it was begun with."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        from . import point_cloud

        settings = scene.mirror_scan
        points = point_cloud.cloud_of(scene)
        arrays = point_cloud.read_cloud(points, color=False)
        self.scene_uid = scene.session_uid
        self.stamp = point_cloud.stamp_of(points)
        self.views = scan_records.view_settings(settings)
        self._task = job_operators.Task(
            "find_subject_steps", (arrays.depth, arrays.intrinsics, scan_records.placed_mirrors(settings), self.views)
        )
        self.worker = job_operators.begin(self._task)

    def is_alive(self) -> bool:
        if self.worker.is_alive():
            return True
        if isinstance(self.worker.error, job_operators.UNAVAILABLE):
            self.worker = job_operators.begin(self._task, thread=True)
            return True
        return False

    def deliver(self, scene: bpy.types.Scene) -> None:
        from . import point_cloud

        pass

        points = point_cloud.cloud_of(scene)
        if points is None or point_cloud.stamp_of(points) != self.stamp or _obstacle(scene):
            return  # undone, loaded anew or sorted by other mirrors meanwhile
        subject, error = scene.mirror_scan.subject, self.worker.error
        if not subject.searched_with:  # the first search: show what it found
            scene.mirror_scan.cloud_colors = "PART"
        if error is None:
            put_subject(scene, points, self.worker.result, self.views)
        elif isinstance(error, job_operators.REPORTED):
            point_cloud.set_nobody(points.data)
            subject.message, subject.searched_with = "", scan_records.key_of(self.views)
            subject.problem = str(error) if isinstance(error, MirrorScanError) else job_operators.in_words(error)
        else:
            raise error


def schedule(scene: bpy.types.Scene) -> None:
    """Have a scene's person searched for again soon; nothing happens without a window, or without mirrors."""
    if bpy.app.background or scene.library is not None:
        return
    _wanted.add(scene.session_uid)
    if not bpy.app.timers.is_registered(_turn):
        bpy.app.timers.register(_turn, first_interval=DELAY_S, persistent=True)


def forget(scene: bpy.types.Scene) -> None:
    """Begin no search that was asked for; what was to be sorted is there no more."""
    _wanted.discard(scene.session_uid)


def searching(scene: bpy.types.Scene) -> bool:
    """Whether a search is under way for a scene, or about to begin."""
    return scene.session_uid in _wanted or (_search is not None and _search.scene_uid == scene.session_uid)


def _turn() -> float | None:
    """Blender calls this again after the seconds it returns."""
    global _search
    context = bpy.context
    if _search is not None:
        if _search.is_alive():
            return DELAY_S
        done, _search = _search, None
        scene = _scene(done.scene_uid)
        if scene is not None:
            done.deliver(scene)
            if scene.mirror_scan.subject.stale:
                _wanted.add(scene.session_uid)
        job_operators.redraw(context)
    for uid in list(_wanted):
        scene = _scene(uid)
        if scene is None or not _possible(scene):
            _wanted.discard(uid)
    if not _wanted:
        return None
    if job_operators.running(context):
        return WAIT_S
    uid = _wanted.pop()
    try:
        _search = Search(_scene(uid))
    except (
        job_operators.REPORTED
    ):  # somebody's edits left no depth map, or the disk is full: pressing Find Subject says so
        return DELAY_S
    job_operators.redraw(context, panels_only=True)
    return DELAY_S


def _scene(uid: int) -> bpy.types.Scene | None:
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def _possible(scene: bpy.types.Scene) -> bool:
    mirrors = scene.mirror_scan.mirrors
    return bool(mirrors) and all(item.plane for item in mirrors) and not _obstacle(scene) and _changed(scene)


def _changed(scene: bpy.types.Scene) -> bool:
    subject = scene.mirror_scan.subject
    return subject.stale or not subject.searched_with


def _obstacle(scene: bpy.types.Scene) -> bool:
    """Whether the points cannot be written to."""
    from . import point_cloud

    points = point_cloud.cloud_of(scene)
    return points is None or points.library is not None or points.data.library is not None or points.mode != "OBJECT"


@persistent
def _after_undo(*_: object) -> None:
    """A step holds the settings, and the colours that were made of those before them when they were not ready yet."""
    for scene in bpy.data.scenes:
        if scene.mirror_scan.subject.stale:
            schedule(scene)


def register() -> None:
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(_after_undo)


def unregister() -> None:
    global _search
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        if _after_undo in handlers:
            handlers.remove(_after_undo)
    if bpy.app.timers.is_registered(_turn):
        bpy.app.timers.unregister(_turn)
    if _search is not None:
        _search.worker.ask_to_stop()
    _search = None
    _wanted.clear()


def put_subject(target: bpy.types.Scene, points: bpy.types.Object, result, views: dict) -> None:
    """Have a scene's points tell what a search with the settings ``views`` found."""
    from . import point_cloud

    settings, subject = target.mirror_scan, target.mirror_scan.subject
    point_cloud.set_values(points.data, seen=result.seen, view=result.view, height=result.height)
    names = [say("direct"), *(item.name for item in settings.mirrors)]
    counts = ", ".join(f"{name} {pixels:,}" for name, pixels in zip(names, result.pixels, strict=False))
    subject.message = say("Points of the person: {counts}").format(counts=counts)
    subject.problem, subject.searched_with = "", scan_records.key_of(views)
