"""Peers in a process of their own.

A scan can crash them or make them run for ever (Open3D's Poisson has ended in a segmentation fault), and bpy cannot be
loaded together with the libraries of the others. Neither must end the run.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

LIMIT_S = 120.0


class PeerFailed(Exception):
    """A peer crashed, took too long, or raised; the message says which."""


class Worker:
    """One process that calls functions for us, one at a time; after a crash the next call starts another."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None

    def call(self, function: Callable, *arguments: Any, limit: float = LIMIT_S) -> Any:
        """What ``function``, of a module's top level, returns there; PeerFailed also after ``limit`` seconds."""
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, other = context.Pipe()
            self._process = context.Process(target=_serve, args=(other,), daemon=True)
            self._process.start()
            other.close()  # so that the pipe ends when the process does
        try:
            self._pipe.send((function, arguments))
            if not self._pipe.poll(limit):
                self.stop()
                raise PeerFailed(f"stopped after {limit:.0f} s")
            answered, value = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            code = self._process.exitcode
            self.stop()
            raise PeerFailed(f"crashed with signal {-code}" if code < 0 else f"ended with code {code}") from None
        if not answered:
            raise PeerFailed(value)
        return value

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = self._pipe = None


def _serve(pipe: Connection) -> None:
    while True:
        try:
            function, arguments = pipe.recv()
        except EOFError:  # nobody asks any more
            return
        try:
            answer = True, function(*arguments)
        except Exception as error:  # reported where it was called
            answer = False, f"{type(error).__name__}: {error}"
        pipe.send(answer)
