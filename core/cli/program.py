"""Run one command, and turn errors into one line and an exit code: :func:`main`.

Formats that need Blender come in from outside as ``writers``; this package does not use bpy.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ..errors import MirrorScanError, OutputError
from .argument_types import with_explicit_sizes
from .outputs import Readers, Writers
from .parser import build_parser
from .terminal import complain, kernels_reported

if TYPE_CHECKING:
    from ..mesh import Mesh


def main(
    argv: Sequence[str] | None = None,
    *,
    prog: str = "mirror-scan",
    writers: Writers | None = None,
    find_bridge: Callable[[], Callable[[Mesh], Mesh] | None] | None = None,
    readers: Readers | None = None,
) -> int:
    """Run one command.

    Parameters
    ----------
    argv : sequence of str or None
        Arguments after the program's name; None takes them from the process.
    prog : str
        How the user called it, for help and usage.
    writers : mapping or None
        Suffix (".blend") → ``function(path, reconstruction)`` for formats core cannot write; looking one up may raise
        :class:`OutputError` to say why it cannot be had. For a motion, ``function(path, avatar, clip=clip)``.
    find_bridge : function() or None
        Gives Blender's way of closing patches, for the zippering experiment; None where there is no Blender.
    readers : mapping or None
        Suffix → ``function(path)`` for formats core cannot read: .blend gives an :class:`.avatar_file.Avatar`, .fbx a
        :class:`.motion.Motion`; looking one up may raise, as with ``writers``.

    Returns
    -------
    int
        0 done; 1 the input or the scene is at fault, reported in one line on stderr; 2 usage; 130 interrupted; 141 its
        reader went away; 143 told to end (SIGTERM).
    """
    try:
        return _run(argv, prog, writers or {}, find_bridge, readers or {})
    except BrokenPipeError:  # the reader of a pipe had enough
        return 141
    except OutputError:  # even the error cannot be reported
        return 1
    finally:
        _leave_streams()


def _run(
    argv: Sequence[str] | None, prog: str, writers: Writers, find_bridge: Callable | None, readers: Readers
) -> int:
    try:
        options = build_parser(prog).parse_args(with_explicit_sizes(list(sys.argv[1:] if argv is None else argv)))
    except SystemExit as stop:  # argparse has said what there is to say
        return stop.code if isinstance(stop.code, int) else 2
    except OutputError as error:  # the help, into a file on a full disk
        complain("error", str(error))
        return 1
    options.find_bridge, options.readers = find_bridge, readers
    try:
        with _termination_heard(), kernels_reported():
            options.run(options, writers)
    except MirrorScanError as error:
        complain("error", str(error))
        return 1
    except KeyboardInterrupt as stop:
        complain("error", str(stop) or "interrupted; nothing was written")
        return 143 if isinstance(stop, Terminated) else 130
    return 0


class Terminated(KeyboardInterrupt):
    """The process was told to end (SIGTERM), which stops a command as Ctrl-C does."""


@contextlib.contextmanager
def _termination_heard() -> Iterator[None]:
    """Within the block SIGTERM raises :class:`Terminated`, once: ``timeout`` and others send it twice."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL if before is None else before)


def _leave_streams() -> None:
    """Keep Python from stumbling at its exit over streams that cannot be written to."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        except AttributeError:  # there is none
            pass
