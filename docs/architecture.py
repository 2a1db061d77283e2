"""Draw docs/images/architecture.svg from the imports of core and the add-on: ``python docs/architecture.py``."""

from __future__ import annotations

import ast
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"

STAGES = (
    ("Ground floor: knows nothing of scans", ("errors", "numeric", "camera", "mesh", "io")),
    ("Read and clean", ("capture", "depth")),
    ("Mirrors and views", ("mirrors", "views", "mirror_detection", "mirror_alignment")),
    ("Subject and light", ("subject", "light")),
    ("Surface", ("patches", "hole_filling", "zippering", "closing")),
    (
        "Result",
        (
            "checks",
            "registration",
            "avatar",
            "motion",
            "texture",
            "decimation",
            "printing",
            "measurements",
            "clothes",
            "preview",
        ),
    ),
    ("The whole job", ("pipeline", "cluster", "batches", "sequences", "guidance")),
    ("Virtual rig and experiments", ("simulation", "rig_planning", "experiments")),
    ("Faces to people", ("cli", "mirror_scan_addon")),
)
"""What the rows of the picture say, and the packages in them, in the order of ``core.__all__``."""

WIDTH, ROW, BOX, HIGH, LEFT, TOP = 1180, 104, 150, 44, 250, 56
INK, FILL, LINE = "#1d2733", "#e8f0f8", "#7a8ea3"


def package_imports() -> dict[str, set[str]]:
    """Package → packages of core that its modules import."""
    found: dict[str, set[str]] = {}
    for top in ("core", "mirror_scan_addon"):
        for path in sorted((ROOT / top).rglob("*.py")):
            parts = path.relative_to(ROOT).parts
            mine = parts[1] if top == "core" and len(parts) > 2 else top
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.level:
                    above = parts[: len(parts) - node.level]
                    names = [node.module] if node.module else [alias.name for alias in node.names]
                    for name in names:
                        target = (*above, *name.split("."))
                        if target[0] == "core" and len(target) > 1 and target[1] != mine and mine != "core":
                            found.setdefault(mine, set()).add(target[1])
    return found


def direct(imports: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Arrows worth drawing: those that no longer way along the others says already."""

    def reach(package: str, known: frozenset[str] = frozenset()) -> frozenset[str]:
        """Everything below a package."""
        for below in imports.get(package, set()) - known:
            known = reach(below, known | {below})
        return known

    return {
        (package, below)
        for package, used in imports.items()
        for below in used
        if not any(below in reach(other) for other in used - {below})
    }


def draw() -> str:
    """The picture as SVG text."""
    imports = package_imports()
    place = {}
    for row, (_, names) in enumerate(STAGES):
        for column, name in enumerate(names):
            place[name] = (LEFT + column * (BOX + 30), TOP + row * ROW)
    high = TOP + len(STAGES) * ROW
    out = [
        '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="15" '
        f'viewBox="0 0 {WIDTH} {high}">',
        f'<rect width="{WIDTH}" height="{high}" fill="white"/>',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        f'<path d="M0,0 L8,4 L0,8 z" fill="{LINE}"/></marker></defs>',
        f'<text x="20" y="30" font-size="17" fill="{INK}">Who imports whom: data flows down, an arrow points to what a '
        "package uses. Arrows that others imply are left out.</text>",
    ]
    for package, below in sorted(direct(imports)):
        (x, y), (x2, y2) = place[package], place[below]
        if y == y2:
            near = x > x2
            start, end = (x if near else x + BOX), (x2 + BOX if near else x2)
            out.append(_path(start, y + HIGH / 2, end, y2 + HIGH / 2, 0))
        else:
            out.append(_path(x + BOX / 2, y, x2 + BOX / 2, y2 + HIGH, 0.45 * (y - y2 - HIGH)))
    for row, (title, names) in enumerate(STAGES):
        out.append(f'<text x="20" y="{TOP + row * ROW + 27}" fill="{INK}">{escape(title)}</text>')
        for name in names:
            x, y = place[name]
            out.append(
                f'<rect x="{x}" y="{y}" width="{BOX}" height="{HIGH}" rx="6" fill="{FILL}" stroke="{INK}"/>'
                f'<text x="{x + BOX / 2:g}" y="{y + 27}" text-anchor="middle" fill="{INK}">{escape(name)}</text>'
            )
    return "\n".join([*out, "</svg>"]) + "\n"


def _path(x: float, y: float, x2: float, y2: float, bend: float) -> str:
    return (
        f'<path d="M{x:g},{y:g} C{x:g},{y - bend:g} {x2:g},{y2 + bend:g} {x2:g},{y2:g}" fill="none" stroke="{LINE}" '
        'stroke-width="1.4" marker-end="url(#tip)"/>'
    )


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    print(PICTURE.relative_to(ROOT))
