"""Hashes of what a checkout computes, to hold two commits against each other bit for bit.

    python tools/hashes.py [--checkout DIR] [--only scenes corpus experiments] > hashes.txt
    python tools/hashes.py --compare OLD.txt NEW.txt

One line a result: the eight benchmark scenes, sixteen of the corpus, and the three experiments' tables. A mesh is
hashed as its arrays, a report as its numbers: texts and times are left out. Run it once for each checkout.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

PARTS = ("scenes", "corpus", "experiments")
EVERY = 4
"""Of the scenes of the corpus."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Hash what a checkout computes, or compare two such lists.")
    parser.add_argument("--checkout", type=Path, default=Path(__file__).resolve().parents[1], metavar="DIR")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("OLD", "NEW"))
    options = parser.parse_args()
    if options.compare:
        return compare(*options.compare)
    os.chdir(options.checkout)
    sys.path.insert(0, str(options.checkout))
    runpy.run_path(str(options.checkout / "tests" / "conftest.py"))
    for part in options.only:
        for name, digest in {"scenes": scenes, "corpus": corpus, "experiments": experiments}[part]():
            print(f"{digest}  {name}", flush=True)
    return 0


def compare(old: Path, new: Path) -> int:
    """Print what differs between two lists; 1 when anything does."""
    before, after = (dict(line.split("  ", 1)[::-1] for line in path.read_text().splitlines()) for path in (old, new))
    wrong = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    for name in wrong:
        print(f"differs: {name}")
    print(f"{len(before.keys() | after.keys()) - len(wrong)} the same, {len(wrong)} differ")
    return int(bool(wrong))


def scenes() -> Iterator[tuple[str, str]]:
    from mirror_scan.core.pipeline import reconstruct

    from benchmarks.scenes import scenes as all_scenes

    for scene in all_scenes():
        yield from _reconstruction(f"scene {scene.name}", reconstruct(scene.capture, frame="camera"))


def corpus() -> Iterator[tuple[str, str]]:
    from mirror_scan.core.pipeline import reconstruct

    from benchmarks.generated import make, recipes

    for number, recipe in enumerate(list(recipes())[::EVERY]):
        yield from _reconstruction(f"corpus {EVERY * number:02d}", reconstruct(make(recipe).capture, frame="camera"))


def experiments() -> Iterator[tuple[str, str]]:
    from mirror_scan.core.experiments import distance, reflection, zippering
    from mirror_scan.core.simulation.mannequin import mannequin

    body = mannequin()
    for module in (reflection, distance, zippering):
        name = module.__name__.rpartition(".")[2]
        yield f"experiment {name}", _digest(numbers([dataclasses.asdict(row) for row in module.run(body)]))


def _reconstruction(name: str, made) -> Iterator[tuple[str, str]]:
    mesh = made.mesh
    yield f"{name}: mesh", _digest([mesh.vertices, mesh.triangles, mesh.colors, mesh.view, mesh.kind])
    yield f"{name}: report", _digest(numbers({k: v for k, v in made.report.items() if k != "timings_ms"}))


def numbers(value: object) -> object:
    """A report without its texts."""
    if isinstance(value, dict):
        return {str(key): numbers(item) for key, item in value.items() if not isinstance(item, str)}
    if isinstance(value, list | tuple):
        return [numbers(item) for item in value if not isinstance(item, str)]
    return value


def _digest(value: object) -> str:
    found = hashlib.sha256()

    def feed(item: object) -> None:
        if isinstance(item, np.ndarray):
            found.update(f"{item.dtype.str}{item.shape}".encode())
            found.update(np.ascontiguousarray(item).tobytes())
        elif isinstance(item, dict):
            for key in sorted(item):
                found.update(str(key).encode())
                feed(item[key])
        elif isinstance(item, list | tuple):
            found.update(f"[{len(item)}]".encode())
            for one in item:
                feed(one)
        else:
            found.update(json.dumps(item, default=repr).encode())

    feed(value)
    return found.hexdigest()[:16]


if __name__ == "__main__":
    sys.exit(main())
