"""Tables as text and as markdown, and what was found about each limit."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from .machine import say


@dataclass
class Table:
    """Cells are text already; the first ``left`` columns are set flush left, the others right."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left: int = 1

    def text(self) -> str:
        widths = [max(map(len, column)) for column in zip(self.columns, *self.rows, strict=True)]
        lines = [self.title, "=" * len(self.title), self._line(self.columns, widths)]
        lines.append("  ".join("-" * width for width in widths))
        lines += [self._line(row, widths) for row in self.rows]
        return "\n".join(lines + [f"  {note}" for note in self.notes])

    def markdown(self) -> str:
        rule = [":--" if k < self.left else "--:" for k in range(len(self.columns))]
        lines = [f"## {self.title}\n"]
        lines += [f"| {' | '.join(row)} |" for row in (self.columns, rule, *self.rows)]
        return "\n".join(lines) + "".join(f"\n\n{note}" for note in self.notes)

    def _line(self, cells: tuple[str, ...], widths: list[int]) -> str:
        pairs = enumerate(zip(cells, widths, strict=True))
        return "  ".join(c.ljust(w) if k < self.left else c.rjust(w) for k, (c, w) in pairs).rstrip()


@dataclass(frozen=True)
class Finding:
    """One limit, what was measured, and whether it holds; None = it could not be measured."""

    limit: str
    measured: str
    passed: bool | None


@dataclass
class Result:
    """What one module of the benchmark hands back."""

    tables: list[Table] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def run_parts(parts: Mapping[str, Callable[[bool], Result]], quick: bool) -> Result:
    """The tables of several parts, by name. A part that breaks down is a limit that does not hold."""
    whole = Result()
    for name, tables in parts.items():
        began = time.perf_counter()
        try:
            part = tables(quick)
        except Exception as error:  # the other parts' figures, which took minutes, are worth having
            traceback.print_exc()
            part = Result([], [Finding(f"{name}: measured to the end", f"{type(error).__name__}: {error}", False)])
        say(f"{name}: {time.perf_counter() - began:.0f} s")
        whole.tables += part.tables
        whole.findings += part.findings
    return whole


def limits_table(findings: list[Finding]) -> Table:
    verdict = {True: "pass", False: "FAIL", None: "not measured"}
    rows = [(f.limit, f.measured, verdict[f.passed]) for f in findings]
    return Table("Limits", ("limit", "measured", "verdict"), rows, left=3)


def number(value: float | None, digits: int = 2) -> str:
    """Fixed digits; a dash for what does not exist."""
    return "–" if value is None else f"{value:.{digits}f}"


def yes(value: bool) -> str:
    return "yes" if value else "no"
