"""What a planned rig sees, measured again beside the window while its objects are moved.

One check runs at a time, in the second process; the next begins, with the places of then, when it is done. The result
belongs to the scene like a colour: it makes no undo step of its own. The picture of what the camera sees is of the
session only. Without a rig nothing is done: the handler looks at one pointer of the scene and returns.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ..background import job_operators

if TYPE_CHECKING:
    import numpy as np

    from ..tasks import RigChecked

DELAY_S, WAIT_S = 0.05, 0.5  # from a change to the check; while a job of ours runs, or the user edits

_TOLD = {"seen", "shares", "parts", "views", "error_mm", "light_mm", "lit_twice"}  # of a check

_wanted: set[int] = set()  # scenes, by session_uid; no state: a file knows nothing of them
_without_person: set[int] = set()  # scenes whose rig waits for its mannequin
_check: tuple[int, object, job_operators.Task] | None = None
_pictures: dict[int, tuple[int, np.ndarray]] = {}  # scene → number of the picture and the picture (H, W, 3) uint8
_mannequin: list = []  # the mannequin, once it was made in this session


def task_for(context_scene: bpy.types.Scene, person: bpy.types.Object | None) -> job_operators.Task:
    """The check of a scene's rig; raises MirrorScanError when there is no rig that could be checked."""
    from . import virtual_rig  # numpy, which Blender's start must not wait for

    rig, mirrors = virtual_rig.rig_fields(context_scene)
    surface = None if person is None else virtual_rig.world_surface(bpy.context, person)
    return job_operators.Task("check_rig_steps", (surface, rig, mirrors))


def planned_camera(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The camera of the rig that is planned, while it is in the scene; None without a rig."""
    camera = scene.mirror_scan.rig_camera
    return camera if camera is not None and scene.objects.get(camera.name) == camera else None


def person_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """What a scene's rig looks at, whatever is active."""
    kept = scene.mirror_scan.rig_person
    return kept if kept is not None and scene.objects.get(kept.name) == kept else None


def deliver(scene: bpy.types.Scene, found: RigChecked) -> None:
    """Have the scene tell what was found."""
    number = _pictures.get(scene.session_uid, (0, None))[0] + 1
    _pictures[scene.session_uid] = number, found.image
    scene.mirror_scan.rig_checked = json.dumps({name: getattr(found, name) for name in sorted(_TOLD)})


def checked(scene: bpy.types.Scene) -> dict | None:
    """What was found last; None before that, or when somebody's edits spoiled it."""
    text = scene.mirror_scan.rig_checked
    if not text:
        return None
    try:
        found = json.loads(text)
    except ValueError:
        return None
    if not isinstance(found, dict) or not isinstance(found.get("views"), list):
        return None
    return found if "problem" in found or found.keys() >= _TOLD else None


def picture(scene: bpy.types.Scene) -> tuple[int, np.ndarray] | None:
    """What the rig's camera sees (H, W, 3) uint8, and its number, which changes with it."""
    return _pictures.get(scene.session_uid)


def keep_mannequin(mesh) -> None:
    """Remember the mannequin for the next rig of this session."""
    _mannequin[:] = [mesh]


def bring_person(scene: bpy.types.Scene) -> None:
    """Have the mannequin stand in a rig: at once where it is known or there is no window, else when it is made."""
    if not _mannequin and bpy.app.background:
        keep_mannequin(job_operators.Task("mannequin_steps", ()).now())
    if _mannequin:
        from . import virtual_rig

        virtual_rig.add_person(scene, _mannequin[0])
    else:
        _without_person.add(scene.session_uid)
    schedule(scene)


def schedule(scene: bpy.types.Scene) -> None:
    """Have a scene's rig checked soon, or its mannequin brought; nothing happens without a window or a rig."""
    if bpy.app.background or scene.library is not None or planned_camera(scene) is None:
        return
    if not scene.mirror_scan.rig_live and scene.session_uid not in _without_person:
        return
    _wanted.add(scene.session_uid)
    if not bpy.app.timers.is_registered(_turn):
        bpy.app.timers.register(_turn, first_interval=DELAY_S, persistent=True)


def stage(scene: bpy.types.Scene) -> str:
    """What is being done for a scene's rig now, such as compiling before the first check; "" when nothing is."""
    return _check[1].progress[1] if _check is not None and _check[0] == scene.session_uid else ""


def _turn() -> float | None:
    """Blender calls this again after the seconds it returns."""
    global _check
    context = bpy.context
    if _check is not None:
        (uid, worker, task), scene = _check, _scene(_check[0])
        if worker.is_alive():
            return DELAY_S
        if task.name == "mannequin_steps" and _dragging(context):  # a new object has an undo step of its own
            return WAIT_S
        _check = None
        if isinstance(worker.error, job_operators.UNAVAILABLE):
            if scene is not None:
                _begin(scene, task, thread=True)
            return DELAY_S
        if worker.error is not None and not isinstance(worker.error, job_operators.REPORTED):
            raise worker.error
        if scene is not None and worker.error is None:
            _put(scene, task, worker.result)
        elif scene is not None:
            _without_person.discard(uid)
            _tell(scene, worker.error)
        job_operators.redraw(context)
    if not _wanted:
        return None
    if job_operators.running(context) or context.mode != "OBJECT":
        return WAIT_S
    uid = _wanted.pop()
    scene = _scene(uid)
    if scene is None or scene != context.scene or planned_camera(scene) is None:
        return DELAY_S
    from . import virtual_rig

    virtual_rig.remove_orphans(scene)
    try:
        if uid in _without_person:
            task = job_operators.Task("mannequin_steps", ())
        else:
            task = task_for(scene, person_of(scene))
    except job_operators.REPORTED as error:  # a mirror that is not flat, say
        _tell(scene, error)
        return DELAY_S
    _begin(scene, task)
    return DELAY_S


def _dragging(context: bpy.types.Context) -> bool:
    """Whether objects are being moved, turned or scaled with the mouse."""
    operators = (operator for window in context.window_manager.windows for operator in window.modal_operators)
    return any(operator is not None and operator.bl_idname.startswith("TRANSFORM_OT_") for operator in operators)


def _begin(scene: bpy.types.Scene, task: job_operators.Task, thread: bool = False) -> None:
    global _check
    try:
        _check = scene.session_uid, job_operators.begin(task, thread=thread), task
    except job_operators.REPORTED as error:  # no numba, or a full disk
        _without_person.discard(scene.session_uid)
        _tell(scene, error)


def _tell(scene: bpy.types.Scene, error: Exception) -> None:
    """Have the panel say why nothing could be measured."""
    scene.mirror_scan.rig_checked = json.dumps({"views": [], "problem": job_operators.in_words(error)})
    job_operators.redraw(bpy.context)


def _put(scene: bpy.types.Scene, task: job_operators.Task, result) -> None:
    if task.name != "mannequin_steps":
        deliver(scene, result)
        return
    from . import virtual_rig

    keep_mannequin(result)
    if scene.session_uid in _without_person:
        _without_person.discard(scene.session_uid)
        if planned_camera(scene) is not None and person_of(scene) is None:
            virtual_rig.add_person(scene, result)
            if bpy.ops.ed.undo_push.poll():  # the step of Add Rig was made before the mannequin was ready
                bpy.ops.ed.undo_push(message="Mannequin")
    schedule(scene)


def _scene(uid: int) -> bpy.types.Scene | None:
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


@persistent
def _after_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    settings = scene.mirror_scan
    if settings.rig_camera is None or not settings.rig_live:
        return
    for update in depsgraph.updates:
        if _concerns(update, settings):
            schedule(scene)
            return


def _concerns(update: bpy.types.DepsgraphUpdate, settings: bpy.types.PropertyGroup) -> bool:
    """Whether what the rig sees may have changed: its camera, a mirror or the person was moved, or objects came, went
    or were hidden."""
    if isinstance(update.id, bpy.types.Collection):
        return update.is_updated_geometry
    if not isinstance(update.id, bpy.types.Object) or not (update.is_updated_transform or update.is_updated_geometry):
        return False
    item = update.id.original
    return item.mirror_scan.is_mirror or item in (settings.rig_camera, settings.rig_person)


@persistent
def _after_undo(*_: object) -> None:
    known = {scene.session_uid for scene in bpy.data.scenes}
    for uid in _pictures.keys() - known:  # of the file before
        del _pictures[uid]
    for scene in bpy.data.scenes:
        if scene.mirror_scan.rig_camera is not None:
            schedule(scene)


_HANDLERS = ("undo_post", "redo_post", "load_post")


def register() -> None:
    if bpy.app.background:
        return
    bpy.app.handlers.depsgraph_update_post.append(_after_change)
    for name in _HANDLERS:
        getattr(bpy.app.handlers, name).append(_after_undo)


def unregister() -> None:
    global _check
    if _after_change in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.remove(_after_change)
    for name in _HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        if _after_undo in handlers:
            handlers.remove(_after_undo)
    if bpy.app.timers.is_registered(_turn):
        bpy.app.timers.unregister(_turn)
    if _check is not None:
        _check[1].ask_to_stop()
    _check = None
    for kept in (_wanted, _without_person, _pictures, _mannequin):
        kept.clear()
