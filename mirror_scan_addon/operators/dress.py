"""Clothes for an avatar: garments of ours, and the artist's own made ready for cloth."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records
from ..scene.scan_records import armature_of, no_skeleton

KINDS = (
    ("tshirt", "T-Shirt", "From the neck to below the hips, sleeves to above the elbows"),
    ("trousers", "Trousers", "From the waist to the ankles"),
    ("skirt", "Skirt", "From the waist to the knees"),
)


class _Bake:
    """Cloth that falls frame by frame in this thread, a frame each time it is asked; looks like a job's worker."""

    error = None

    def __init__(self, scene: bpy.types.Scene, garments: list[int]) -> None:
        from ..scene import cloth

        self.progress = (0.0, "Letting the cloth fall")
        self.result = self
        self._done = False
        self._steps = cloth.pose_cloth(garments, scene)

    def is_alive(self) -> bool:
        if not self._done:
            try:
                self.progress = (next(self._steps), self.progress[1])
            except StopIteration:
                self._done = True
        return not self._done

    def ask_to_stop(self) -> None:
        self._steps.close()


class _ClothOperator(job_operators.JobOperator):
    """Base of operators whose result may be baked: the cloth falls through all frames, with progress and Esc."""

    _worn: list[int]  # garments that were made cloth, by their numbers

    def execute(self, context: bpy.types.Context) -> set[str]:
        done = super().execute(context)
        if done == {"FINISHED"} and self.bake and self._worn:
            manager = context.window_manager
            manager.progress_begin(0, 100)
            bake = _Bake(context.scene, self._worn)
            while bake.is_alive():
                manager.progress_update(round(100 * bake.progress[0]))
            manager.progress_end()
        return done

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if isinstance(self._worker, _Bake) and self.is_cancelled_by(event):
            self.cancel(context)
            self.report({"INFO"}, say("Baking was stopped; the cloth falls when the scene is played"))
            return {"FINISHED"}
        return super().modal(context, event)

    def _deliver(self, context: bpy.types.Context, result: object) -> set[str]:
        if isinstance(result, _Bake):
            return {"FINISHED"}
        done = super()._deliver(context, result)
        if done != {"FINISHED"} or not (self.bake and self._worn) or context.scene.session_uid != self._scene_uid:
            return done
        self._worker, self.over = _Bake(context.scene, self._worn), False
        self._timer = context.window_manager.event_timer_add(job_operators.TICK_S, window=context.window)
        return {"RUNNING_MODAL"}


class MIRRORSCAN_OT_dress(_ClothOperator, bpy.types.Operator):
    """Give the selected avatar a garment cut to its body, as cloth that falls or tight to the skin"""

    bl_idname = "mirror_scan.dress"
    bl_label = "Dress"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Garment", description="What the avatar puts on", items=KINDS, default="tshirt",
        translation_context=CONTEXT,
    )  # fmt: skip
    ease: FloatProperty(
        name="Ease (mm)",
        description="Distance from the skin to the garment in millimetres. A garment that falls is wider at its hem",
        default=15.0, min=2.0, max=80.0, soft_max=40.0, precision=0, translation_context=CONTEXT,
    )  # fmt: skip
    tight: BoolProperty(
        name="Tight",
        description="The garment lies close to the body and moves with the skeleton, without a cloth simulation",
        default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    bake: BoolProperty(
        name="Bake", description="Let the cloth fall through all frames of the scene now and keep that",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or no_skeleton(context))

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import armature, cloth

        self._worn = []
        if self.bake and not self.tight:
            cloth.check_motion(context.scene)
        avatar = _avatar_of(context)
        self._uid = avatar.session_uid
        self._unit = armature.unit_of(avatar, context.scene)
        rigged = armature.read_avatar(avatar, self._unit)
        from ...core.clothes import LAYER, NAMES

        below = sum(item[cloth.GARMENT]["name"] != NAMES[self.kind] for item in cloth.garments_of(avatar))
        return job_operators.Task("dress_steps", (rigged, self.kind, self.ease / 1000.0 + LAYER * below, self.tight))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..scene import armature, avatar_objects, cloth

        avatar = _alive(self._uid)
        with armature.object_mode(context, target):
            collection = _collection_of(avatar, target)
            old = [item for item in cloth.garments_of(avatar) if item[cloth.GARMENT]["name"] == result.name]
            cloth.remove(old)
            made = cloth.add_garment(avatar, result, collection, self._unit)
            if not result.tight:
                if cloth.collider_of(avatar) is None:
                    cloth.add_collider(avatar, collection, target)
                cloth.make_cloth(made, avatar, target)
                self._worn = [made.session_uid]
            else:
                cloth.keep_off_skin(made, avatar, 1.0 / cloth.metres_per_unit(target))
        if target == context.scene:
            avatar_objects.select_only(context, avatar)
        text = say("{name}: {count:,} vertices").format(name=made.name, count=len(made.data.vertices))
        self.report({"INFO"}, text)


class MIRRORSCAN_OT_prepare_for_cloth(_ClothOperator, bpy.types.Operator):
    """Prepare a cloth simulation: the other selected meshes become garments that fall on the active avatar"""

    bl_idname = "mirror_scan.prepare_for_cloth"
    bl_label = "Prepare for Cloth"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    pins: StringProperty(
        name="Pins", description="Vertex group of the garment that holds it; by default its highest open edge",
        default="", translation_context=CONTEXT,
    )  # fmt: skip
    tight: BoolProperty(
        name="Tight", description="The garments move with the skeleton, without a cloth simulation", default=False,
        translation_context=CONTEXT,
    )  # fmt: skip
    bake: BoolProperty(
        name="Bake", description="Let the cloth fall through all frames of the scene now and keep that",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or no_skeleton(context))

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        import numpy as np

        from ...core.mesh import Mesh
        from ..scene import armature, avatar_objects, cloth

        self._worn = []
        avatar = _avatar_of(context)
        self._uid = avatar.session_uid
        unit = armature.unit_of(avatar, context.scene)
        rigged = armature.read_avatar(avatar, unit)
        chosen = [item for item in context.selected_objects if _is_garment(item, avatar)]
        if self.bake and chosen and not self.tight:
            cloth.check_motion(context.scene)
        self._garments, meshes = [item.session_uid for item in chosen], []
        for item in chosen:
            if self.pins and self.pins not in item.vertex_groups:
                text = say("{name}: has no vertex group “{group}”").format(name=item.name, group=self.pins)
                raise OutputError(text, code="avatar")
            surface = avatar_objects.read_surface(item, np.ones(3))
            there = np.array(cloth.in_avatar(item, avatar))
            placed = (surface.vertices @ there[:3, :3].T + there[:3, 3]) * unit
            avatar_objects.check_finite(item, placed)
            meshes.append(Mesh(placed, surface.triangles))
        self._meshes = meshes
        return job_operators.Task("garment_weight_steps", (meshes, rigged))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.clothes.weight_transfer import top_edge
        from ..scene import armature, cloth

        avatar = _alive(self._uid)
        with armature.object_mode(context, target):
            if cloth.collider_of(avatar) is None:
                cloth.add_collider(avatar, _collection_of(avatar, target), target)
            for uid, mesh, weights in zip(self._garments, self._meshes, result, strict=True):
                garment = _alive(uid)
                pinned = None if self.pins or self.tight else top_edge(mesh, cloth.HELD, cloth.FREE)
                cloth.wear(garment, avatar, weights, pinned)
                cloth.hang_on(garment, avatar)
                garment[cloth.GARMENT] = {"name": garment.name, "tight": self.tight}
                if self.tight:
                    cloth.keep_off_skin(garment, avatar, 1.0 / cloth.metres_per_unit(target))
                else:
                    cloth.make_cloth(garment, avatar, target, self.pins or cloth.PINNED)
                    self._worn.append(uid)
        text = say("{name}: ready for cloth, {count} garments").format(name=avatar.name, count=len(result))
        self.report({"INFO"}, text)


def _avatar_of(context: bpy.types.Context) -> bpy.types.Object:
    """The avatar that the active object is, or that its armature moves; a garment's avatar when that is active."""
    from ..scene import armature, cloth

    active = context.object
    if cloth.is_worn(active):
        active = armature_of(active)
    return armature.body_of(active)


def _is_garment(item: bpy.types.Object, avatar: bpy.types.Object) -> bool:
    """Whether a selected object is to be worn."""
    from ..scene import cloth

    return item.type == "MESH" and item != avatar and not item.get(cloth.COLLIDER) and bool(item.data.polygons)


def _alive(uid: int) -> bpy.types.Object:
    from ..scene import avatar_objects

    found = avatar_objects.object_of(uid)
    if found is None:
        raise OutputError(say("The avatar or a garment no longer exists"), code="no_data")
    return found


def _collection_of(avatar: bpy.types.Object, target: bpy.types.Scene) -> bpy.types.Collection:
    """The collection of its scan that the avatar is in, else the one that its skeleton is in, in the scene; the scene's
    own when it is in none."""
    from ..scene import scan_collections

    scan = scan_collections.scan_around(avatar, target)
    homes = (armature_of(avatar) if scan is None else avatar).users_collection
    known = {target.collection, *target.collection.children_recursive}
    return next((home for home in homes if home in known), target.collection)


CLASSES = (MIRRORSCAN_OT_dress, MIRRORSCAN_OT_prepare_for_cloth)
