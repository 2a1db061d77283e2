"""What Blender's importers and exporters run in: a scene that goes again, an add-on for the moment, no printing."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import addon_utils
import bpy

from ...core.errors import OutputError
from ..language.texts import say

_LIBRARIES = {".usdc": ("usd", "USD"), ".usd": ("usd", "USD"), ".abc": ("alembic", "Alembic")}


_FORBIDDEN = frozenset('<>:"/\\|?*.')
_LONGEST = 180  # bytes of a file's name, so that an ending and “_texture” fit as well
_RESERVED = frozenset(
    {"CON", "PRN", "AUX", "NUL", *(f"{port}{number}" for port in ("COM", "LPT") for number in range(1, 10))}
)
"""Names that Windows gives to devices."""


def file_name(name: str) -> str:
    """A data-block's name as that of a file without its ending, on every system; letters of all scripts stay."""
    kept = "".join("_" if letter in _FORBIDDEN or not letter.isprintable() else letter for letter in name).strip()
    while len(kept.encode()) > _LONGEST:
        kept = kept[:-1]
    return f"{kept}_" if not kept or kept.upper() in _RESERVED else kept


def image_name(name: str) -> str:
    """The same for a picture that a mesh file names: some readers end such a name at a space."""
    return file_name(name).replace(" ", "_")


def missing_library(ending: str) -> str:
    """What this Blender was built without and would need for a format, as “USD”; empty where it has all."""
    option, name = _LIBRARIES.get(ending.lower(), ("", ""))
    return name if option and not getattr(bpy.app.build_options, option) else ""


def check_built_with(path: str | os.PathLike) -> None:
    """Some systems build their Blender without the libraries of a format, and so without its exporter.

    Raises
    ------
    OutputError
        This one has no exporter for the format that ``path`` ends with.
    """
    name = missing_library(Path(path).suffix)
    if name:
        text = say(
            "{path}: this Blender was built without {library}; choose another format, or use the Blender of blender.org"
        )
        raise OutputError(text.format(path=path, library=name))


def reason_of(text: str) -> str:
    """Why an exporter failed, in a line; of one that is written in Python it is the last of a traceback."""
    if "Traceback" in text:
        lines = [line for line in text.split("\nLocation:")[0].splitlines() if line and not line.startswith(" ")]
        text = lines[-1]
    return text.strip().removeprefix("Error: ")


@contextlib.contextmanager
def removed_again() -> Iterator[None]:
    """What is added to the open file meanwhile is removed at the end."""
    data = bpy.data
    collections = (data.objects, data.meshes, data.materials, data.cameras, data.lights, data.armatures, data.actions,
                   data.collections, data.images)  # fmt: skip
    before = {block for blocks in collections for block in blocks}
    try:
        yield
    finally:
        bpy.data.batch_remove([block for blocks in collections for block in blocks if block not in before])


@contextlib.contextmanager
def temporary_scene() -> Iterator[bpy.types.Scene]:
    """A scene of our own in the open file; it and all that was added meanwhile are removed at the end."""
    with removed_again():
        target = bpy.data.scenes.new("Mirror Scan")
        try:
            yield target
        finally:
            bpy.data.scenes.remove(target)


@contextlib.contextmanager
def enabled(module: str) -> Iterator[None]:
    """Have an add-on that Blender ships registered, without writing that into the user's preferences."""
    _, loaded = addon_utils.check(module)
    if not loaded and addon_utils.enable(module, default_set=False) is None:
        text = say("Blender's add-on {module} cannot be enabled; it is missing in this Blender, or broken")
        raise OutputError(text.format(module=module), code="other")
    try:
        yield
    finally:
        if not loaded:
            addon_utils.disable(module, default_set=False)


@contextlib.contextmanager
def shown(target: bpy.types.Scene) -> Iterator[None]:
    """Make ``target`` the context's scene; exporters read it from there, and glTF's switches the window to it too."""
    windows = [window for manager in bpy.data.window_managers for window in manager.windows]
    window = bpy.context.window or next(iter(windows), None)
    if window is None:
        raise OutputError(say("Blender has no window to export from; open a file first"), code="other")
    shown, layer = window.scene, window.view_layer
    try:
        with bpy.context.temp_override(window=window):
            # Not by overriding the context's scene: Blender 5.0 crashes when its view layer is updated then.
            window.scene = target
            if bpy.context.scene != target:
                raise OutputError(
                    say("Cannot export inside a context override of the scene; leave it first"), code="other"
                )
            yield
    finally:
        window.scene = shown
        window.view_layer = layer


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what exporters and importers print from the terminal: ours tell what went wrong."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Keep what Blender itself prints, below Python, from the terminal."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
