"""Compiling the kernels before they are called, in several processes at once; needs no bpy.

Called one after the other, the kernels of a first build take two minutes to compile, on one core. Which ones a step of
the work calls, and with what types, is known: ``signatures.json`` lists them (``tools/signatures.py`` writes it). So a
few processes share the list: each claims an entry by creating a file, and the results are shared through numba's cache.
A kernel that is not listed is compiled when it is called, as usual.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..extension_root import ADDON_FOLDER, ROOT_FOLDER, ROOT_PACKAGE

if TYPE_CHECKING:
    from ..tasks import Steps


SIGNATURES = ADDON_FOLDER / "signatures.json"
STAGES = ("load", "mirrors", "subject", "build")
"""In the order of the work; each also needs the kernels of the stages before it."""

RIG = "rig"
"""Virtual scanning: most people never use it, so it is compiled only when asked for."""

AVATAR = "avatar"
"""What is made of a built avatar: skeleton, weights, texture. Compiled when the first of them is asked for."""

SIDE_WAYS = {RIG: (STAGES[0],), AVATAR: ()}
"""Stages beside the main way, each with those whose kernels it calls too."""

STAGE_OF = {
    "load_steps": "load", "record_steps": "load", "find_mirrors_steps": "mirrors", "fit_steps": "mirrors",
    "find_subject_steps": "subject", "build_steps": "build", "scan_steps": "build", "check_steps": "build",
    "live_steps": "build",
    "simulate_steps": RIG, "sample_steps": RIG, "check_rig_steps": RIG, "find_rig_steps": RIG, "plan_steps": RIG,
    "mannequin_steps": RIG, "skeleton_steps": AVATAR, "texture_steps": AVATAR,
}  # fmt: skip
"""What a task of :mod:`..tasks` waits for; one that is not listed compiles what it needs when it calls it."""

MESSAGE = "Compiling"
LOST_S = 90.0  # after which the claim of another process is taken as abandoned
LOOK_S = 0.1  # how often it is checked whether the others are done


class Entry(NamedTuple):
    """A kernel and the types it is called with, as :func:`describe` writes them; seconds as the lister measured."""

    stage: str
    module: str
    kernel: str
    types: list
    seconds: float


@functools.cache
def entries() -> tuple[Entry, ...]:
    """All of ``signatures.json``, in the order in which they are to be compiled."""
    with open(SIGNATURES, encoding="utf-8") as file:
        return tuple(Entry(*entry) for entry in json.load(file))


def needs(stage: str) -> tuple[str, ...]:
    """The stages whose kernels a stage calls."""
    return (*SIDE_WAYS[stage], stage) if stage in SIDE_WAYS else STAGES[: STAGES.index(stage) + 1]


def last_of(stage: str) -> str:
    """The end of the way that a stage belongs to."""
    return stage if stage in SIDE_WAYS else STAGES[-1]


@functools.cache
def stamp_name(stage: str = STAGES[-1]) -> str:
    """Name of the file, beside numba's cache, that says that everything up to this stage is compiled.

    It changes with each update.
    """
    import hashlib  # not at Blender's start

    files = sorted(
        (path.relative_to(ROOT_FOLDER).as_posix(), path.stat().st_mtime_ns) for path in ROOT_FOLDER.glob("core/**/*.py")
    )
    listed = [entry for entry in entries() if entry.stage in needs(stage)]
    return "compiled_" + hashlib.sha256(repr((stage, listed, files)).encode()).hexdigest()[:16]


def compile_steps(claims: str, stage: str, stamp: str = "", patient: bool = False) -> Steps[int]:
    """Compile what ``stage`` and those before it call, together with other processes that are given the same folder.

    Returns when all of it is done, by whomever.

    Parameters
    ----------
    claims : str
        Folder through which the processes agree.
    stage : str
        One of :data:`STAGES`, or of :data:`SIDE_WAYS`.
    stamp : str
        File to make when the last stage of its way is done.
    patient : bool
        Leave the processor to others when they need it.

    Returns
    -------
    int
        How many this process compiled, or found compiled.
    """
    if patient and hasattr(os, "nice"):
        os.nice(5)
    wanted = [(k, entry) for k, entry in enumerate(entries()) if entry.stage in needs(stage)]
    whole = sum(entry.seconds for _, entry in wanted) or 1.0
    mine = 0

    def share() -> float:
        return sum(entry.seconds for k, entry in wanted if os.path.exists(_done(claims, k))) / whole

    yield share(), MESSAGE
    for k, entry in wanted:
        if _claim(claims, k):
            _compile(entry)
            open(_done(claims, k), "x").close()
            mine += 1
            yield share(), MESSAGE
    began = time.monotonic()
    for k, entry in wanted:
        while not os.path.exists(_done(claims, k)):
            if time.monotonic() - began > LOST_S:  # its process was ended
                _compile(entry)
                break
            time.sleep(LOOK_S)
            yield share(), MESSAGE
    if stamp and stage == last_of(stage):
        with contextlib.suppress(OSError):  # then it is looked at again in the next session
            open(stamp, "a").close()
    return mine


def loading_steps(stage: str) -> Steps[int]:
    """Load what ``stage`` and those before it call, all of which is compiled; how many kernels that are."""
    wanted = [entry for entry in entries() if entry.stage in needs(stage)]
    for k, entry in enumerate(wanted):
        yield k / len(wanted), "Loading the program"
        _compile(entry)
    return len(wanted)


def give_up(claims: str, process: int) -> None:
    """Free what a process that was ended had claimed and not finished."""
    for path in Path(claims).glob("claimed_*"):
        number = int(path.name.rpartition("_")[2])
        if path.read_text() == str(process) and not os.path.exists(_done(claims, number)):
            path.unlink()


def _done(claims: str, number: int) -> str:
    return os.path.join(claims, f"done_{number}")


def _claim(claims: str, number: int) -> bool:
    try:
        with open(os.path.join(claims, f"claimed_{number}"), "x") as file:
            file.write(str(os.getpid()))
        return True
    except FileExistsError:
        return False


def _compile(entry: Entry) -> None:
    """Compile an entry, or load it; one that this version does not have any more, or not with such arguments, is passed
    over: the list saves time, and what it gets wrong is compiled when it is called."""
    import logging  # not at Blender's start

    from numba.core.errors import NumbaError

    try:
        kernel = getattr(importlib.import_module(f"{ROOT_PACKAGE}.{entry.module}"), entry.kernel)
        kernel.compile(tuple(_type(text) for text in entry.types))
    except (ImportError, AttributeError, TypeError, NumbaError) as error:  # TypeError: another number of arguments
        log = logging.getLogger(__name__)
        log.warning("%s.%s: not compiled beforehand: %s", entry.module, entry.kernel, error)


# --- types as plain values -------------------------------------------------------------------------------------------


def describe(kind) -> str | list:
    """A type of numba as JSON can hold it: numbers by name, arrays, and tuples of these.

    Raises
    ------
    TypeError
        For any other type.
    """
    from numba import types

    if isinstance(kind, types.Array) and kind.mutable and kind.aligned:
        return ["array", str(kind.dtype), kind.ndim, kind.layout]
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        named = kind.instance_class
        module = named.__module__.partition(".")[2]
        return ["named", module, named.__name__, *map(describe, kind.types)]
    if isinstance(kind, types.Tuple | types.UniTuple):
        return ["tuple", *map(describe, kind.types)]
    if isinstance(kind, types.Number | types.Boolean | types.NoneType) and not isinstance(kind, types.Literal):
        return str(kind)
    raise TypeError(f"no description for {kind!r}")


def _type(described: str | list):
    from numba import types

    if isinstance(described, str):  # not every numba knows “bool” by this name
        return types.boolean if described == "bool" else getattr(types, described)
    kind, *parts = described
    if kind == "array":
        return types.Array(_type(parts[0]), parts[1], parts[2])
    if kind == "named":
        module = importlib.import_module(f"{ROOT_PACKAGE}.{parts[0]}")
        return types.BaseTuple.from_types([_type(part) for part in parts[2:]], getattr(module, parts[1]))
    return types.BaseTuple.from_types([_type(part) for part in parts])


def called(package: str) -> Iterator[tuple[str, str, tuple]]:
    """Module, kernel and types of all that was called, of the package's modules in this process."""
    from numba.core.dispatcher import Dispatcher

    for module in [value for name, value in sys.modules.items() if name.startswith(f"{package}.core.")]:
        for name, value in vars(module).items():
            if isinstance(value, Dispatcher) and value.__module__ == module.__name__:
                for signature in value.signatures:
                    yield module.__name__.partition(".")[2], name, signature
