"""The command line: pip's ``mirror-scan`` and ``blender --command mirror_scan`` share the parser of core.

This module adds the formats that need Blender. bpy is imported when the first of them is used; a Python without bpy
writes all the others.
"""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence

BLENDER_FORMATS = {".blend": "write_blend", ".glb": "write_glb", ".fbx": "write_fbx", ".usd": "write_usd",
                   ".usdc": "write_usd"}  # fmt: skip
SEQUENCE = "sequence"
"""In place of a suffix: what writes a whole sequence into one file, .abc or .usd; see :mod:`.scene.sequence_cache`."""
READ_BY_BLENDER = {".blend": ("blend_avatar", "read_blend_avatar"), ".fbx": ("fbx_motion", "read_fbx_motion")}
BPY_PYTHONS = {(3, 11): "bpy 4.5 and 5.0", (3, 13): "bpy 5.1 and later"}

_handles: list[object] = []  # Blender removes a command only by the handle it returned


class BlenderWriters(Mapping):
    """Suffix → ``function(path, reconstruction)``; looking up a writer imports bpy.

    Raises
    ------
    OutputError
        From the look-up, if bpy cannot be imported: it names the Pythons that have it.
    """

    def __getitem__(self, suffix: str) -> Callable:
        if suffix == SEQUENCE:
            _require_bpy("a sequence as .abc or .usd")
            from .scene.sequence_cache import write_sequence

            return write_sequence
        name = BLENDER_FORMATS[suffix]
        _require_bpy(suffix)
        from .scene import export

        if suffix == ".blend":
            return functools.partial(export.write_blend, own_process=True)
        return getattr(export, name)

    def __contains__(self, suffix: object) -> bool:
        return suffix in BLENDER_FORMATS or suffix == SEQUENCE

    def __iter__(self) -> Iterator[str]:
        return iter(BLENDER_FORMATS)

    def __len__(self) -> int:
        return len(BLENDER_FORMATS)


class BlenderReaders(Mapping):
    """Suffix → ``function(path)``: avatars of .blend, motions of .fbx; looking one up imports bpy.

    Raises
    ------
    OutputError
        As :class:`BlenderWriters`.
    """

    def __getitem__(self, suffix: str) -> Callable:
        module, name = READ_BY_BLENDER[suffix]
        _require_bpy(suffix)
        return getattr(importlib.import_module(f"{__package__}.scene.{module}"), name)

    def __contains__(self, suffix: object) -> bool:
        return suffix in READ_BY_BLENDER

    def __iter__(self) -> Iterator[str]:
        return iter(READ_BY_BLENDER)

    def __len__(self) -> int:
        return len(READ_BY_BLENDER)


def find_bridge() -> Callable | None:
    """:func:`.bridge_edge_loops.bridge_and_fill`; None in a Python that has no bpy."""
    try:
        import bpy  # noqa: F401
    except ImportError:
        return None
    from .bridge_edge_loops import bridge_and_fill

    return bridge_and_fill


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of pip's script ``mirror-scan``; returns the exit code."""
    from ..core import cli

    return cli.main(argv, writers=BlenderWriters(), find_bridge=find_bridge, readers=BlenderReaders())


def blender_main(argv: Sequence[str]) -> int:
    """Entry point of ``blender --command mirror_scan``; returns the exit code."""
    from ..core import cli
    from ..core.errors import MirrorScanError
    from .background.numba_setup import prepare_kernels

    try:
        prepare_kernels()
    except MirrorScanError as error:
        if not {"-h", "--help"}.intersection(argv):
            print(f"error: {error}", file=sys.stderr)
            return 1
    return cli.main(
        argv,
        prog="blender --command mirror_scan",
        writers=BlenderWriters(),
        find_bridge=find_bridge,
        readers=BlenderReaders(),
    )


def register() -> None:
    import bpy

    _handles.append(bpy.utils.register_cli_command("mirror_scan", blender_main))


def unregister() -> None:
    import bpy

    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())


def _require_bpy(suffix: str) -> None:
    from ..core.errors import OutputError

    try:
        import bpy  # noqa: F401
    except ImportError as error:
        have = " and ".join(f"Python {major}.{minor} ({what})" for (major, minor), what in BPY_PYTHONS.items())
        here = f"Python {sys.version_info[0]}.{sys.version_info[1]}"
        if sys.version_info[:2] in BPY_PYTHONS:
            remedy = "install it with “pip install bpy”"
        else:
            remedy = f"there is no bpy for this {here}, only for {have}; use one of those"
        raise OutputError(
            f"writing {suffix} needs Blender's Python module bpy, which cannot be imported ({error}): {remedy}, "
            "or write .ply, .obj or .stl"
        ) from error
