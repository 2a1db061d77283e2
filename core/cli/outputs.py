"""Files a command writes: checked before the work starts, put in place only when all are complete."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CaptureError, Notice, OutputError

if TYPE_CHECKING:
    from ..avatar.avatar_file import Avatar
    from ..mesh import Mesh
    from ..motion import Clip
    from ..pipeline import Reconstruction
    from ..printing import PrintSettings

    Write = Callable[[Path, Reconstruction], object]


Writers = Mapping[str, Callable[..., object]]
Readers = Mapping[str, Callable[["Path"], object]]

BLENDER_SUFFIXES = (".blend", ".fbx", ".usd", ".usdc")
PLAIN_SUFFIXES = (".glb", ".ply", ".obj")
PRINT_SUFFIXES = (".stl", ".3mf")
SIMULATION_ENTRIES = {"intrinsic.json", "color_intrinsic.json", "mirrors.json", "depth", "color", "truth"}


class Print:
    """An avatar made ready for a printer, once for all files."""

    def __init__(self, settings: PrintSettings) -> None:
        self._settings = settings
        self._mesh: Mesh | None = None

    def mesh(self, result: Reconstruction) -> Mesh:
        """What is printed: upright, so always in the avatar frame [m]."""
        if self._mesh is None:
            from ..printing import prepare_print

            self._mesh = prepare_print(_upright(result), self._settings)
        return self._mesh

    def problems(self, result: Reconstruction) -> list[Notice]:
        """What stands in the way of printing it."""
        from ..printing import check_print

        return check_print(self.mesh(result))


def _upright(result: Reconstruction) -> Mesh:
    """The mesh in the avatar frame."""
    return result.mesh if result.frame == "avatar" else result.mesh.transformed(result.camera_to_avatar)


@dataclass(frozen=True)
class AvatarFiles:
    """How an avatar is written.

    ``vrm``: bones of .glb have VRM's names, too. ``prints``: how .stl and .3mf are made ready for a printer; None: as
    the avatar is. ``textured`` and ``measured``: whether there will be a texture and measurements.
    """

    vrm: bool = False
    prints: Print | None = None
    textured: bool = False
    measured: bool = False


def writers_of(path: Path, writers: Writers, files: AvatarFiles = AvatarFiles()) -> list[tuple[Path, Write]]:
    """What writes ``path``, by its suffix, and the files that belong beside it."""
    suffix = path.suffix.lower()
    if suffix == ".glb":
        return [(path, lambda target, result: write_glb(target, result, files.vrm))]
    if suffix in PRINT_SUFFIXES:
        return [(path, lambda target, result: write_print(target, result, files.prints))]
    if suffix == ".csv" and not files.measured:
        raise OutputError(f"{path}: holds measurements; ask for them with --measure")
    if suffix == ".csv":
        return [(path, write_measures)]
    if suffix == ".obj" and files.textured:
        from ..io import OBJ_COMPANIONS

        beside = [path.with_suffix(end) for end in OBJ_COMPANIONS]
        _check_companions(path, beside)
        return [(path, _write_textured_obj(path)), *((file, _write_companion(file)) for file in beside)]
    if suffix in PLAIN_SUFFIXES:
        from ..io import write_mesh

        return [(path, lambda target, result: write_mesh(target, result.mesh))]
    if suffix in BLENDER_SUFFIXES and suffix in writers:
        return [(path, writers[suffix])]
    if suffix in BLENDER_SUFFIXES:
        raise OutputError(f"{_needs_blender(path)}. Without it, write .glb, .ply, .obj, .stl or .3mf")
    known = ", ".join((*PLAIN_SUFFIXES, *PRINT_SUFFIXES, ".csv", *BLENDER_SUFFIXES))
    raise OutputError(f"{path}: unknown format “{path.suffix}”; use one of {known}")


def _check_companions(path: Path, beside: Iterable[Path]) -> None:
    """Refuse to replace files ``beside`` a textured .obj that are not those of the .obj that is there."""
    there = [file for file in beside if file.exists()]
    if not there:
        return
    try:
        with open(path, "rb") as file:
            own = f"mtllib {path.stem}.mtl".encode() in file.read(1000)
    except OSError:
        own = False
    if not own:
        raise OutputError(
            f"{path}: its texture would replace {there[0].name}, which is not of an earlier {path.name}; "
            "choose another name"
        )


def _write_textured_obj(path: Path) -> Write:
    from ..io import write_mesh

    return lambda target, result: write_mesh(target, result.mesh, result.texture, path.stem)


def _write_companion(path: Path) -> Write:
    """What writes the material or the image of a textured .obj, which will be at ``path``."""

    def write(target: Path, result: Reconstruction) -> None:
        from ..io import obj_companion

        assert result.texture is not None  # it was asked for
        target.write_bytes(obj_companion(path, result.texture))

    return write


def _needs_blender(path: Path) -> str:
    return (
        f"{path}: {path.suffix.lower()} needs Blender's Python module; “pip install bpy==5.0.1” (Python 3.11), "
        "bpy==5.2.3 (Python 3.13) or bpy 4.5 LTS (Python 3.11); this is Python "
        f"{sys.version_info[0]}.{sys.version_info[1]}"
    )


def motion_writer_of(path: Path, writers: Writers, vrm: bool = False) -> Callable[[Path, Avatar, Clip], object]:
    """What writes an avatar with a motion to ``path``, by its suffix."""
    write = _avatar_writer_of(path, writers, vrm)
    if write is None:
        raise OutputError(
            f"{path}: a motion goes into one of .glb, .blend, .fbx, .usd, .usdc, not into “{path.suffix}”"
        )
    return write


def dressed_writer_of(path: Path, writers: Writers) -> Callable[[Path, Avatar], object]:
    """What writes an avatar with garments to ``path``, by its suffix."""
    write = _avatar_writer_of(path, writers)
    if write is None:
        raise OutputError(f"{path}: garments go into one of .glb, .blend, .fbx, .usd, .usdc, not into “{path.suffix}”")
    return write


def _avatar_writer_of(path: Path, writers: Writers, vrm: bool = False) -> Callable[..., object] | None:
    """What writes an avatar, and a clip if one is given, to ``path``; None when the format cannot hold them."""
    from ..avatar.avatar_file import write_avatar

    suffix = path.suffix.lower()
    if suffix == ".glb":
        return lambda target, avatar, *clips: write_avatar(
            target, replace(avatar, clips=clips) if clips else avatar, vrm
        )  # fmt: skip
    if suffix not in BLENDER_SUFFIXES:
        return None
    if suffix not in writers:
        raise OutputError(f"{_needs_blender(path)}. Without it, write .glb")
    write = writers[suffix]
    return lambda target, avatar, *clips: write(target, avatar, **({"clip": clips[0]} if clips else {}))


def reader_of(path: Path, readers: Readers) -> Callable[[Path], Any]:
    """What reads ``path`` by Blender.

    Raises
    ------
    CaptureError
        When there is no Blender.
    """
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise CaptureError(_needs_blender(path))
    return readers[suffix]


def write_glb(path: Path, result: Reconstruction, vrm: bool = False) -> None:
    """Write .glb by :mod:`..avatar.avatar_file`: glTF has an up axis, so it is always the avatar frame."""
    from ..avatar.avatar_file import Avatar, write_avatar

    mesh, skeleton = _upright(result), result.skeleton
    if result.frame == "camera":
        skeleton = None if skeleton is None else skeleton.transformed(result.camera_to_avatar)
    write_avatar(path, Avatar(mesh, skeleton, result.weights, texture=result.texture), vrm and skeleton is not None)


def write_print(path: Path, result: Reconstruction, prints: Print | None) -> None:
    """Write .stl or .3mf, in millimetres."""
    from ..io import write_mesh

    if prints is None:
        write_mesh(path, result.mesh, result.texture)
    else:
        write_mesh(path, prints.mesh(result))


def write_measures(path: Path, result: Reconstruction) -> None:
    """Write the measurements as .csv."""
    from ..measurements import write_measurements

    assert result.measurements is not None  # else there is no such file
    write_measurements(path, result.measurements)


def level_paths(paths: Iterable[Path], number: int) -> list[Path]:
    """Names of a level of detail, as avatar.lod1.glb; measurements have none."""
    return [path.with_name(f"{path.stem}.lod{number}{path.suffix}") for path in paths if path.suffix.lower() != ".csv"]


def plan_outputs(
    paths: Iterable[Path], writers: Writers, files: AvatarFiles = AvatarFiles()
) -> list[tuple[Path, Write]]:
    """Each path, and those that belong beside it, with what writes it."""
    return [planned for path in paths for planned in writers_of(path, writers, files)]


def check_targets(paths: Sequence[Path]) -> None:
    """Refuse targets that cannot be written, before any work is done."""
    seen: dict[str, Path] = {}
    for path in paths:
        parent = path.absolute().parent
        if not parent.is_dir():
            raise OutputError(f"{path}: the folder {parent} does not exist; create it first")
        if path.exists() and not path.is_file():
            raise OutputError(f"{path}: is not a regular file; give the name of a file to write")
        if not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(f"{path}: the folder {parent} cannot be written to; choose another")
        real = os.path.realpath(path)
        if real in seen:
            raise OutputError(f"{path}: is to be written twice; give each output its own name")
        seen[real] = path


def check_apart(target: Path, capture: Path) -> None:
    """Refuse to write into what is read: its content would be another one the next time."""
    if Path(os.path.realpath(target)).is_relative_to(os.path.realpath(capture)):
        raise OutputError(
            "{folder}: lies within the capture {path}; choose another folder", folder=target, path=capture
        )


def write_outputs(
    result: Reconstruction, outputs: list[tuple[Path, Callable]], report: Path | None, read_ms: float
) -> None:
    """Write all files under temporary names, then put them in place together."""
    from ..io.atomic_files import replacing

    started = time.perf_counter()
    with replacing(report) if report else contextlib.nullcontext() as temporary, _written(outputs, result):
        if report and temporary:
            timings = {"read": read_ms, **result.report.get("timings_ms", {})}
            timings["write"] = (time.perf_counter() - started) * 1e3
            text = json.dumps(plain({**result.report, "timings_ms": timings}), indent=1, ensure_ascii=False)
            with blaming(report):
                # a file name that is not UTF-8 has characters that JSON can only escape
                temporary.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")


def write_together(outputs: Sequence[tuple[Path, Callable[..., object]]], *content: object) -> None:
    """Write all files with ``content`` under temporary names, then put them in place together."""
    with _written(outputs, *content):
        pass


@contextlib.contextmanager
def _written(outputs: Sequence[tuple[Path, Callable[..., object]]], *content: object) -> Iterator[None]:
    """Each file written with ``content`` under a temporary name; all take their places when the block ends well."""
    from ..io.atomic_files import replacing

    with contextlib.ExitStack() as stack:
        temporaries = [stack.enter_context(replacing(path)) for path, _ in outputs]
        for (path, write), temporary in zip(outputs, temporaries, strict=True):
            with blaming(path):
                write(temporary, *content)
        yield


@contextlib.contextmanager
def blaming(path: Path) -> Iterator[None]:
    """Name the file an :class:`OSError` is about by the name the user gave it."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, where they do not exist yet."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made a folder: {error.strerror or error}") from error


def write_simulation(
    folder: Path, *, sensor: str, frames: int, seed: int, mirrors: int, body: Path | None, optics: str = "ideal",
    frequencies: tuple[float, ...] | None = None, color_scale: int = 1,
) -> None:  # fmt: skip
    """Simulate into a folder beside ``folder``, then swap; only a simulation may be replaced, never a recording."""
    from ..io.atomic_files import fresh_folder
    from ..simulation.mannequin import mannequin
    from ..simulation.optics import EFFECTS
    from ..simulation.scene import default_rig, with_real_optics
    from ..simulation.simulate import simulate, write_simulation

    if folder.exists():
        entries = {entry.name for entry in folder.iterdir()} if folder.is_dir() else None
        if entries is None or (entries and not ("truth" in entries and entries <= SIMULATION_ENTRIES)):
            raise OutputError(f"{folder}: exists and is not an earlier simulation; choose another name or remove it")
    subject = stand(read_surface(body), body) if body else mannequin()
    rig = default_rig(sensor=sensor, mirrors=mirrors, frames=frames, seed=seed, color_scale=color_scale)
    if optics != "ideal":
        rig = with_real_optics(rig, frequencies, EFFECTS if optics == "real" else optics.split(","))
    simulation = simulate(subject, rig)
    with fresh_folder(folder, replace=True) as fresh:
        write_simulation(simulation, fresh)


def read_surface(path: Path) -> Mesh:
    """A mesh from a file, refused when it has no faces: points have no surface to measure or to scan."""
    from ..io import read_mesh

    mesh = read_mesh(path)
    if not len(mesh.triangles):
        raise CaptureError(f"{path}: holds points but no faces; a surface is needed, save the mesh with its faces")
    return mesh


def stand(subject: Mesh, path: Path) -> Mesh:
    """A mesh from a file, put on the floor where the rig expects it."""
    import numpy as np

    low, high = subject.vertices.min(axis=0), subject.vertices.max(axis=0)
    if not 0.2 <= high[2] - low[2] <= 3.0:
        raise CaptureError(f"{path}: is {high[2] - low[2]:.3g} m tall; give a body of 0.2 to 3 m, in metres, Z up")
    move = np.eye(4)
    move[:3, 3] = -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]
    return subject.transformed(move)


def plain(value: object) -> object:
    """Values JSON can hold: numpy scalars unwrapped, not-a-number as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
