"""Has a stage become slower? This checkout against another commit, in pairs of processes that take turns.

Seconds of CPU, not of a clock: a machine that does something else meanwhile disturbs them least. A process keeps its
place in memory and its hash seed for life, which alone makes one some per cent faster than the next; so the unit that
is counted is the pair of processes, not the run, and several pairs are started.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tarfile import TarFile
from typing import Any

import numpy as np
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from scipy import stats

from .machine import say
from .results import Finding, Result, Table

ROOT = Path(__file__).resolve().parents[1]
CHECKOUTS = ROOT / ".venv" / "guard"
"""The other commits' files and their compiled code, kept for the next time."""
RUNNER = Path(__file__).with_name("guard_runner.py")
SENSORS = ("kinect_v1", "azure_kinect")
PAIRS, ROUNDS = 8, 8
FALSE_ALARMS = 0.05
"""How often a commit against itself may be called slower, all stages together."""
SMALLEST = 0.02
"""A stage that is slower by less is not worth a word, however sure."""


class GuardFailed(Exception):
    """The other commit cannot be timed; the message says why."""


@dataclass(frozen=True)
class Verdict:
    """One stage's time here over its time at the other commit: the estimate and the interval it surely lies in."""

    stage: str
    here_ms: float
    there_ms: float
    ratio: float
    low: float
    high: float

    @property
    def slower(self) -> bool:
        return self.low > 1.0 and self.ratio > 1.0 + SMALLEST

    @property
    def faster(self) -> bool:
        return self.high < 1.0 and self.ratio < 1.0 - SMALLEST


def run(against: str, slowed: float = 0.0) -> Result:
    """Time this checkout against ``against``; ``slowed`` wastes that share of the job's time here, to try the guard."""
    try:
        commit, folder = _checkout(against)
        here, there = _rounds(folder, slowed)
    except GuardFailed as error:
        return Result([], [Finding(f"no stage slower than at {against}", str(error), None)])
    verdicts = judge(here, there)
    table = Table(
        f"Guard: this checkout against {commit[:10]}, CPU time of the stages",
        ("stage", "here [ms]", "there [ms]", "here / there", "surely between", "verdict"),
    )
    for v in verdicts:
        word = "SLOWER" if v.slower else "faster" if v.faster else "as before"
        between = f"{v.low:.3f} and {v.high:.3f}"
        table.rows.append((v.stage, f"{v.here_ms:.1f}", f"{v.there_ms:.1f}", f"{v.ratio:.3f}", between, word))
    table.notes = [
        f"{PAIRS} pairs of processes, {ROUNDS} rounds each in turn, of {len(SENSORS)} captures: {', '.join(SENSORS)}.",
        f"Surely: of the same commit against itself at most {FALSE_ALARMS:.0%} of whole tables hold a false alarm.",
    ]
    if slowed:
        table.notes.append(f"{slowed:.0%} of the job's time was wasted here on purpose.")
    slow = [v for v in verdicts if v.slower]
    measured = ", ".join(f"{v.stage} {v.ratio - 1:+.1%}" for v in slow) or "none"
    return Result([table], [Finding(f"no stage slower than at {commit[:10]}", measured, not slow)])


def judge(here: list[list[dict[str, float]]], there: list[list[dict[str, float]]]) -> list[Verdict]:
    """The verdict on each stage that both sides have, and on the whole job.

    Parameters
    ----------
    here, there : list of list of dict
        A list for each pair of processes, of the rounds' seconds by stage; at least two pairs.

    Returns
    -------
    list of Verdict
        In the stages' order, "whole job" last. The interval of each is Student's, of the pairs' logarithms of the
        ratio of both sides' lower quartiles, Bonferroni over the stages.
    """
    if len(here) < 2 or len(here) != len(there):
        raise ValueError(f"at least two pairs of processes are needed, got {len(here)} and {len(there)}")
    stages = [stage for stage in here[0][0] if stage in there[0][0]]
    alpha = FALSE_ALARMS / (len(stages) + 1)
    sure = stats.t.ppf(1.0 - alpha, len(here) - 1) / math.sqrt(len(here))
    verdicts = []
    for stage in [*stages, "whole job"]:
        ours, theirs = (np.array([_quiet(rounds, stage) for rounds in side]) for side in (here, there))
        logs = np.log(ours / theirs)
        middle, width = logs.mean(), sure * logs.std(ddof=1)
        ends = np.exp([middle, middle - width, middle + width])
        verdicts.append(Verdict(stage, 1e3 * float(np.median(ours)), 1e3 * float(np.median(theirs)), *map(float, ends)))
    return verdicts


def _quiet(rounds: list[dict[str, float]], stage: str) -> float:
    """The lower quartile: what disturbs a round only ever makes it longer."""
    return float(np.quantile([sum(laps.values()) if stage == "whole job" else laps[stage] for laps in rounds], 0.25))


def _rounds(there: Path, slowed: float) -> tuple[list[list[dict[str, float]]], list[list[dict[str, float]]]]:
    """The seconds by stage of this checkout's rounds and the other's, a list for each pair of processes."""
    ours, theirs = [], []
    with tempfile.TemporaryDirectory() as made:
        captures = _captures(Path(made))
        for k in range(PAIRS):
            say(f"guard: pair {k + 1} of {PAIRS}")
            pair = _pair_of_processes(there, captures, slowed, first=k % 2)
            ours.append(pair[0])
            theirs.append(pair[1])
    return ours, theirs


def _captures(folder: Path) -> list[Path]:
    body = mannequin()
    paths = []
    for sensor in SENSORS:
        paths.append(folder / f"{sensor}.npz")
        write_npz(paths[-1], simulate(body, default_rig(sensor, frames=3)).capture)
    return paths


def _checkout(commit: str) -> tuple[str, Path]:
    """The commit's whole name, and the folder that holds its files as the package ``mirror_scan``."""
    named = subprocess.run(
        ["git", "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"], cwd=ROOT, capture_output=True, text=True
    )
    if named.returncode:
        raise GuardFailed(f"this repository has no commit {commit}")
    name = named.stdout.strip()
    folder = CHECKOUTS / name[:12]
    package = folder / "mirror_scan"
    if not package.is_dir():
        archive = subprocess.run(["git", "archive", name], cwd=ROOT, capture_output=True, check=True).stdout
        unpacked = folder / "unpacking"
        with TarFile(fileobj=BytesIO(archive)) as tar:
            tar.extractall(unpacked, filter="data")
        unpacked.rename(package)
    return name, folder


def _pair_of_processes(
    there: Path, captures: list[Path], slowed: float, first: int
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Each side's rounds; the side that begins a round changes from round to round."""
    sides = [_Side(None, captures, slowed), _Side(there, captures, 0.0)]
    try:
        for side in sides:  # one after the other: the compiling of one must not share the machine with the other's
            side.get_ready()
        for k in range(ROUNDS):
            for side in sides if (k + first) % 2 == 0 else sides[::-1]:
                side.one_round()
    finally:
        for side in sides:
            side.stop()
    return sides[0].rounds, sides[1].rounds


class _Side:
    """One process: of this checkout as it is installed here, or of the package in the folder ``parent``."""

    def __init__(self, parent: Path | None, captures: list[Path], slowed: float) -> None:
        self.rounds: list[dict[str, float]] = []
        self._package = ROOT if parent is None else (parent / "mirror_scan").resolve()
        self._environment = dict(os.environ)
        if parent is not None:
            self._environment |= {"PYTHONPATH": str(parent), "NUMBA_CACHE_DIR": str(parent / "numba_cache")}
        self._command = [sys.executable, "-P", str(RUNNER), str(slowed), *map(str, captures)]
        self._process: subprocess.Popen[str] | None = None

    def get_ready(self) -> None:
        """Start the process; the first time for a commit its code is compiled now, which takes minutes."""
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=self._environment
        )
        found = [Path(path).resolve() for path in self._answer()]
        if self._package not in found:
            raise GuardFailed(f"the process would time {found[0]} in place of {self._package}")

    def one_round(self) -> None:
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        self.rounds.append(self._answer())

    def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()

    def _answer(self) -> Any:
        assert self._process is not None and self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            code = self._process.wait()
            raise GuardFailed(f"the process that timed {self._package} ended with code {code}; its message is above")
        return json.loads(line)
