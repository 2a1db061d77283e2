"""Write the selected avatar to a file, in one of Blender's formats."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import kept_errors, scan_records
from ..scene.blender_files import file_name, missing_library
from ..scene.preferred import preferred
from ..scene.scan_records import no_mesh

FORMATS = (
    ("GLB", "glTF Binary (.glb)", "For the web and most 3D programs; with colours, in metres"),
    ("GLTF", "glTF (.gltf)", "As glTF Binary, but readable text with its data and images beside it"),
    ("FBX", "FBX (.fbx)", "For game engines; with colours, in metres"),
    ("OBJ", "Wavefront (.obj)", "Read by nearly every program; with colours"),
    ("PLY", "Stanford (.ply)", "For scans and point clouds; with colours, in full precision"),
    ("STL", "STL (.stl)", "For 3D printing, in millimetres; no colours"),
    ("3MF", "3MF (.3mf)", "For 3D printing, in millimetres; with colours"),
    ("VRM", "VRM (.vrm)", "For avatars in virtual worlds and streams; with skeleton and colours, without motion"),
    ("USDC", "Universal Scene Description (.usdc)", "For film and Apple devices; with colours"),
    ("ABC", "Alembic (.abc)", "For film; with colours"),
    ("BLEND", "Blender (.blend)", "Only the avatar, to append or link in other files"),
)


class MIRRORSCAN_OT_export_avatar(bpy.types.Operator):
    """Write the selected avatar to a file. An existing file is replaced only when the new one is complete"""

    bl_idname = "mirror_scan.export_avatar"
    bl_label = "Export Avatar"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "PRESET"}

    filepath: StringProperty(
        name="File", description="File to write", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    check_existing: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    format: EnumProperty(
        name="Format", description="Format of the file. Taken from the file extension unless given", items=FORMATS,
        translation_context=CONTEXT,
    )  # fmt: skip

    colors: EnumProperty(
        name="Colours", description="Which colours go into the file",
        items=(
            ("CAPTURE", "Capture", "The texture or the colours of the capture, whatever the viewport shows"),
            ("SHOWN", "As Shown", "What “Colour By” shows now, without the colours of the capture"),
        ),
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        if not properties.is_property_set("format"):
            return ""
        library = missing_library(f".{properties.format}")
        if library:
            return say("This Blender was built without {library}").format(library=library)
        item = properties.bl_rna.properties["format"].enum_items[properties.format]
        text = say("Write the selected avatar as {format}. {what}")
        return text.format(format=say(item.name), what=say(item.description))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = no_mesh(context)
        if not problem and context.mode != "OBJECT":
            problem = say("Switch to Object Mode first")
        if not problem and job_operators.running(context):
            problem = say("Mirror Scan is busy; wait or press Esc")
        return scan_records.allows(cls, problem)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        import os

        if not self.filepath:
            chosen = context.scene.mirror_scan.export_folder
            folder = chosen or preferred("export_folder") or os.path.dirname(bpy.data.filepath)
            self.filepath = os.path.join(folder, file_name(context.object.name) + self._ending())
            if chosen:
                return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, context: bpy.types.Context) -> bool:
        """In the file browser: the extension of the name follows the format."""
        import os

        stem, ending = os.path.splitext(self.filepath)
        if ending.lower() == self._ending():
            return False
        self.filepath = (stem if ending.lower() in _endings() else self.filepath) + self._ending()
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        import os

        from ..scene import export

        try:
            if not self.filepath:
                raise OutputError(say("Enter the name of the file to write"))
            path = scan_records.absolute(self.filepath)
            if os.path.isdir(path):
                path = os.path.join(path, file_name(context.object.name))
            ending = os.path.splitext(path)[1].lower()
            kind = self.format
            if not self.properties.is_property_set("format") and ending:
                kind = _endings().get(ending)
                if kind is None:
                    text = say("{path}: {ending} is not one of the formats; use {formats}")
                    raise OutputError(text.format(path=path, ending=ending, formats=" ".join(sorted(_endings()))))
            wanted = next(end for end, name in _endings().items() if name == kind)
            if _endings().get(ending) != kind:
                path += wanted
            stiff = export.write_object(path, context.object, kind, self.colors == "SHOWN")
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, kept_errors.keep(context, self, error))
            return {"CANCELLED"}
        kept_errors.forget(context, self)
        if stiff:
            text = say("{name} is mirrored or sheared: written without its skeleton; apply its scale first (Ctrl A)")
            self.report({"WARNING"}, text.format(name=context.object.name))
        self.report({"INFO"}, say("{name} written to {path}").format(name=context.object.name, path=path))
        return {"FINISHED"}

    def _ending(self) -> str:
        return next(ending for ending, kind in _endings().items() if kind == self.format)


def _endings() -> dict[str, str]:
    """File extension → format, the usual extension of each format first."""
    endings = {f".{kind.lower()}": kind for kind, _, _ in FORMATS}
    return endings | {".usd": "USDC", ".usda": "USDC"}


CLASSES = (MIRRORSCAN_OT_export_avatar,)
