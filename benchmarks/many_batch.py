"""A batch of 32 captures against plain loops; workers and the whole batch killed at half; what a capture costs.

Each run is a process of its own: ``python -m benchmarks.many_batch loop|batch FOLDER …``. A loop calls what a worker
calls for a capture, so that both do the same work: read, reconstruct, encode, draw the preview.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mirror_scan.core import cli
from mirror_scan.core.batches import Finished, content_digest, open_batch_folder
from mirror_scan.core.batches.batch_folder import UNFINISHED, read_record
from mirror_scan.core.capture import Capture, open_capture
from mirror_scan.core.capture.rgbd_writer import write_folder
from mirror_scan.core.cli.batch import make_avatar
from mirror_scan.core.cli.parser import build_parser
from mirror_scan.core.cluster import WorkerSettings, start_workers

from .machine import installed, say
from .results import Finding, Result, Table, yes

COUNT, WORKERS = 32, 2
QUICK_KILLED = 12
"""Captures of the batches that are killed, in a quick run."""
FASTER = 0.6
"""Of a plain loop's time with one thread, the batch takes at most that share."""
LONGEST_S = 3600.0
COSTS = {
    "Azure Kinect, 10 frames": ("azure_kinect", []),
    "the same, skeleton, texture, measurements": ("azure_kinect", ["--skeleton", "--texture=2048", "--measure"]),
    "Kinect v1, 10 frames": ("kinect_v1", []),
}


class Killed(NamedTuple):
    """A batch that was hurt at half, and what the folder looked like then and in the end."""

    done_then: dict[str, int]
    done: dict[str, int]
    made_after: int
    whole: bool


def tables(quick: bool = False) -> Result:
    if not installed("distributed"):
        return Result([], [Finding("batch: 32 captures over Dask", "Dask is not installed", None)])
    with tempfile.TemporaryDirectory() as place:
        scans, fewer = Path(place, "scans"), Path(place, "fewer")
        say(f"batch: writing {COUNT} captures")
        write_captures(scans, quick)
        speed = _speed(scans, Path(place))
        few = QUICK_KILLED if quick else COUNT
        if few < COUNT:
            fewer.mkdir()
            for folder in sorted(scans.iterdir())[:few]:
                folder.rename(fewer / folder.name)
            scans = fewer
        kills = _kills(scans, few, Path(place))
        costs, around = _costs(Path(place)), _around(Path(place))
    return Result([speed.tables[0], kills.tables[0], costs, around], speed.findings + kills.findings)


def write_captures(scans: Path, quick: bool) -> None:
    """32 captures of a virtual person, as folders of PNGs, each with noise of its own on top; quick: small ones."""
    if quick:
        small = Path(__file__).resolve().parents[1] / "core" / "batches" / "small_capture.npz"
        capture = open_capture(small)
    else:
        capture = _simulated("azure_kinect", frames=4)
    for k in range(COUNT):
        noise = np.random.default_rng(k).normal(0, 0.001, capture.depth.shape)
        depth = np.where(capture.depth > 0, capture.depth + noise, 0).astype(np.float32)
        list(write_folder(scans / f"person {k}", replace(capture, depth=depth, name=f"person {k}", notes=())))


def _simulated(sensor: str, frames: int = 10) -> Capture:
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate

    return replace(simulate(mannequin(), default_rig(sensor, frames=frames)).capture, mirrors=())


def _speed(scans: Path, place: Path) -> Result:
    cores = os.cpu_count() or 1
    say("batch: plain loop, one thread")
    alone = _loop(scans, 1)
    say("batch: plain loop, all threads")
    threaded = _loop(scans, cores)
    say(f"batch: {WORKERS} workers")
    made = _batch(scans, place / "fast")
    records = [read_record(folder) for folder in (place / "fast").glob("person*")]
    cpu = sum(record.figures["processor_s"] for record in records if record is not None) / COUNT
    one, every = alone["seconds"], threaded["seconds"]
    table = Table(
        f"Batch: {COUNT} captures, warm",
        ("way", "threads", "seconds", "a capture", "of the processor"),
        [
            ("plain loop", "1", f"{one:.1f}", f"{one / COUNT:.2f}", f"{alone['cpu']:.2f}"),
            ("plain loop", f"{cores}", f"{every:.1f}", f"{every / COUNT:.2f}", f"{threaded['cpu']:.2f}"),
            (f"batch, {WORKERS} workers", "1 each", f"{made['seconds']:.1f}", f"{made['seconds'] / COUNT:.2f}",
             f"{cpu:.2f}"),
        ],
        [
            f"Apart from that: workers started in {made['start']:.1f} s and loaded their kernels in "
            f"{made['kernels']:.1f} s, compiled before. Of the processor: seconds of one core a capture."
        ],
    )  # fmt: skip
    share = made["seconds"] / one
    return Result(
        [table],
        [
            Finding(f"batch of {COUNT}, two one-thread workers: ≤ {FASTER} × a plain loop with one thread",
                    f"{share:.2f} ×", share <= FASTER),
            Finding(f"batch of {COUNT}: no slower than a plain loop with all threads",
                    f"{made['seconds'] / every:.2f} ×", made["seconds"] <= every),
        ],
    )  # fmt: skip


def _kills(scans: Path, count: int, place: Path) -> Result:
    say(f"batch: a worker killed at half of {count}")
    worker = _killed(scans, count, place / "worker killed", whole=False)
    say(f"batch: all of it killed at half of {count}")
    all_of_it = _killed(scans, count, place / "all killed", whole=True)
    rows, findings = [], []
    for name, kill in (("a worker", worker), ("the whole batch", all_of_it)):
        same = all(kill.done.get(source) == stamp for source, stamp in kill.done_then.items())
        rows.append(
            (name, f"{len(kill.done_then)}", f"{kill.made_after}", f"{len(kill.done)}", yes(same), yes(kill.whole))
        )
        finished = len(kill.done) == count and len(kill.done_then) + kill.made_after == count
        findings.append(
            Finding(f"batch, {name} killed at half: all {count} done, none twice, no half-written file",
                    f"{len(kill.done)} done, {len(kill.done_then)} kept as they were, {kill.made_after} made after",
                    finished and same and kill.whole and 0 < len(kill.done_then) < count)
        )  # fmt: skip
    columns = ("SIGKILL to", "done before", "made after", "done", "what was done is as it was", "every file whole")
    return Result([Table("Batch: killed at half", columns, rows)], findings)


def _killed(scans: Path, count: int, out: Path, whole: bool) -> Killed:
    """Kill a worker, or everything, at half, and let it go on, or start it again."""
    import psutil

    process = _start("batch", str(scans), str(out), stdout=subprocess.PIPE, text=True)
    deadline = time.monotonic() + LONGEST_S
    while len(_done(out)) < count // 2 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    family = psutil.Process(process.pid).children(recursive=True)
    workers = [one for one in family if "spawn_main" in " ".join(one.cmdline())]
    for victim in workers[:1] if not whole else [psutil.Process(process.pid), *family]:
        victim.send_signal(signal.SIGKILL)
    done_then = _done(out)
    said, _ = process.communicate(timeout=LONGEST_S)
    if whole:
        psutil.wait_procs(family, timeout=30)
        made_after = _batch(scans, out)["made"]
    else:
        made_after = int(_figures(said)["made"]) - len(done_then)
    return Killed(done_then, _done(out), int(made_after), _is_whole(out, count))


def _done(out: Path) -> dict[str, int]:
    """Captures whose result is there, and when it was written [ns]."""
    found = [(read_record(folder), folder) for folder in out.glob("person*")]
    return {one.source: (folder / "record.json").stat().st_mtime_ns for one, folder in found if one is not None}


def _is_whole(out: Path, count: int) -> bool:
    """Whether nothing in the folder is half written: every result as its record says, every .glb as long as it says."""
    folders = [path for path in out.iterdir() if path.is_dir()]
    for folder in folders:
        if folder.name == UNFINISHED or read_record(folder) is None:
            return False
        data = (folder / "avatar.glb").read_bytes()
        if data[:4] != b"glTF" or int.from_bytes(data[8:12], "little") != len(data):
            return False
    return len(folders) == count


def _costs(place: Path) -> Table:
    rows = []
    for name, (sensor, wanted) in COSTS.items():
        say(f"batch: cost of {name}")
        folder = place / "costs" / sensor
        if not folder.exists():
            list(write_folder(folder / "scan", _simulated(sensor)))
        told = _loop(folder, 1, wanted)
        figures = told["figures"]
        rows.append(
            (name, f"{figures['seconds']:.1f}", f"{told['cpu']:.1f}", f"{figures['memory_mb']:.0f}",
             f"{content_digest(folder / 'scan')[1] / 1e6:.1f}", f"{figures['bytes_out'] / 1e6:.1f}")
        )  # fmt: skip
    notes = ["Memory is the most that the worker's process had, with Python, numba and all kernels."]
    columns = ("capture", "seconds, one thread", "of the processor", "memory MB", "read MB", "sent back MB")
    return Table("Batch: what a capture costs", columns, rows, notes)


def _around(place: Path) -> Table:
    """What the one machine that runs the command does around the work; the first to have enough in a large cluster."""
    say("batch: what the machine does around the work")
    block, results, tasks = os.urandom(5_000_000), 60, 200
    rows = []
    (place / "block").mkdir()
    for k in range(40):
        (place / "block" / f"{k}.bin").write_bytes(block)
    seconds = _seconds(lambda: content_digest(place / "block"))
    rows.append(("tell captures by their bytes", f"{40 * len(block) / 1e6 / seconds:.0f} MB/s"))
    folder = open_batch_folder(place / "around")

    def keep() -> None:
        for k in range(results):
            files = {"avatar.glb": block, "preview.png": block[:60_000], "report.json": block[:6_000]}
            folder.keep(f"person {k}", Finished(str(k), f"/{k}", {}, {}), files)

    rows.append(("write results of 5 MB", f"{results / _seconds(keep):.0f} /s"))
    folder.close()
    rows.append(("find what is done already", f"{results / _seconds(lambda: open_batch_folder(folder.path)):.0f} /s"))
    with start_workers(WorkerSettings(workers=WORKERS, threads=1)) as runner:
        empty = _seconds(lambda: list(runner.run(len, [((),)] * tasks)))
        full = _seconds(lambda: list(runner.run(bytes, [(len(block),)] * tasks)))
    rows.append(("hand out tasks, results empty", f"{tasks / empty:.0f} /s"))
    rows.append(("hand out tasks, results of 5 MB", f"{tasks / full:.0f} /s"))
    return Table("Batch: what the machine that runs it does itself", ("work", "rate"), rows)


def _seconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def _loop(scans: Path, threads: int, wanted: list[str] | None = None) -> dict[str, Any]:
    done = _start("loop", str(scans), *(wanted or []), threads=threads, stdout=subprocess.PIPE, text=True)
    said, _ = done.communicate(timeout=LONGEST_S)
    return json.loads(said.splitlines()[-1])


def _batch(scans: Path, out: Path) -> dict[str, float]:
    process = _start("batch", str(scans), str(out), stdout=subprocess.PIPE, text=True)
    said, _ = process.communicate(timeout=LONGEST_S)
    return _figures(said)


def _figures(said: str) -> dict[str, float]:
    """Made, seconds, start and kernels, as the command says them."""
    pattern = r"(\d+) avatars? in ([\d.]+) s; workers had started after ([\d.]+) s and had their kernels ([\d.]+) s"
    found = re.search(pattern, said)
    if found is None:
        raise RuntimeError(f"the batch did not end well: {said[-500:]}")
    return dict(zip(("made", "seconds", "start", "kernels"), map(float, found.groups()), strict=True))


def _start(*arguments: str, threads: int = 0, **options: Any) -> subprocess.Popen:
    environment = os.environ | ({"NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)} if threads else {})
    return subprocess.Popen([sys.executable, "-m", "benchmarks.many_batch", *arguments], env=environment, **options)


def main(way: str, scans: str, *rest: str) -> int:
    if way == "batch":
        return cli.main(["batch", scans, "-o", rest[0], "--workers", str(WORKERS), "--threads", "1"])
    options = build_parser("loop").parse_args(["batch", scans, "-o", "unused", *rest])
    options.formats = ("glb",)
    for name in ("run", "captures", "folder"):
        delattr(options, name)
    options = argparse.Namespace(**vars(options))
    folders = sorted(path for path in Path(scans).iterdir())
    make_avatar(str(folders[0]), None, options)  # warm
    began = time.perf_counter()
    began_cpu = time.process_time()
    made = [make_avatar(str(folder), None, options) for folder in folders]
    cpu = (time.process_time() - began_cpu) / len(made)
    print(json.dumps({"seconds": time.perf_counter() - began, "cpu": cpu, "figures": made[-1].figures}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
