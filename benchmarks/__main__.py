"""``python -m benchmarks [--only quality|speed|corpus|… …] [--quick] [--captures DIR] [--pictures DIR]
[--markdown FILE]``"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import sys
import time
from pathlib import Path

from .machine import describe
from .results import Finding, limits_table

MODULES = {"quality": "quality", "speed": "speed", "cleaning": "cleaning", "mirrors": "mirrors", "subject": "subject",
           "dtw": "dtw", "import": "imports", "blender": "blender", "corpus": "corpus", "seams": "seams",
           "growth": "growth", "rigs": "rigs", "experiment": "experiment", "real": "real",
           "optics": "optics", "honesty": "honesty", "rig": "rig", "look": "look", "waits": "waits",
           "many": "many", "shutter": "shutter", "guard": "guard"}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks", description="Measure Mirror Scan against named peers.")
    parser.add_argument("--only", nargs="+", choices=tuple(MODULES), help="these tables only")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a few scenes of the corpus, rigs of `optics`, bodies of `rig` and `look`, cases of `shutter` only",
    )
    parser.add_argument(
        "--captures", type=Path, metavar="DIR", help="clones of public repositories for the table `real`"
    )
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="write sheets of results there (corpus, optics, real, rig)"
    )
    parser.add_argument("--against", metavar="COMMIT", help="the commit that `guard` holds this checkout against")
    parser.add_argument(
        "--slowed", type=float, default=0.0, metavar="SHARE", help="waste this share of the time here, to try `guard`"
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the tables there as well")
    options = parser.parse_args()
    if "guard" in (options.only or ()) and options.against is None:
        parser.error("guard needs the commit to compare with: --against COMMIT")
    if importlib.util.find_spec("mirror_scan") is None:
        print("error: mirror_scan is not installed in this Python; run `make bench`", file=sys.stderr)
        return 1

    start = time.perf_counter()
    heading = describe()
    print("\n".join(heading), flush=True)
    pages = ["# Figures", "Written by `python -m benchmarks --markdown`; run `make bench` for your own."]
    pages.append("\n".join(f"- {line}" for line in heading))
    findings: list[Finding] = []
    for name in options.only or [name for name in MODULES if name != "guard" or options.against is not None]:
        module = importlib.import_module(f".{MODULES[name]}", __package__)
        if name in ("corpus", "rig"):
            result = module.run(quick=options.quick, pictures=options.pictures)
        elif name in ("look", "many", "shutter"):
            result = module.run(quick=options.quick)
        elif name == "optics":
            result = module.run(range(8) if options.quick else None, pictures=options.pictures)
        elif name == "guard":
            result = module.run(options.against, options.slowed)
        elif name == "real":
            result = module.run(captures=options.captures, pictures=options.pictures)
        else:
            result = module.run()
        findings += result.findings
        for table in result.tables:
            print(f"\n{table.text()}", flush=True)
            pages.append(table.markdown())
    table = limits_table(findings)
    print(f"\n{table.text()}")
    pages.append(table.markdown())
    print(f"\n{time.perf_counter() - start:.0f} s in all")
    if options.markdown is not None:
        options.markdown.parent.mkdir(parents=True, exist_ok=True)
        options.markdown.write_text("\n\n".join(pages) + "\n", encoding="utf-8")
    return 0


sys.exit(main())
