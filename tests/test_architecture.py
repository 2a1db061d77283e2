"""The rules of the folders, read from the imports: data flows one way, and packages meet at their faces."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOPS = ("core", "mirror_scan_addon")
MOST_MODULES = 11
"""Of a package, its face and its subpackages aside."""


class Import(NamedTuple):
    """``module`` (dotted, below the root) imports ``target``: a package, a module, or a name in one of them."""

    module: str
    package: str
    target: tuple[str, ...]
    line: int


@cache
def sources() -> dict[str, ast.Module]:
    """Module → its tree; a package goes by its own name."""
    found = {}
    for top in TOPS:
        for path in sorted((ROOT / top).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text("utf-8"))
    return found


@cache
def packages() -> frozenset[str]:
    return frozenset(".".join(path.parent.relative_to(ROOT).parts) for top in TOPS
                     for path in (ROOT / top).rglob("__init__.py"))  # fmt: skip


@cache
def imports() -> tuple[Import, ...]:
    """All of our own, those inside functions and for type checkers among them."""
    return tuple(found for module, tree in sources().items() for found in imports_of(module, tree))


def imports_of(module: str, tree: ast.Module) -> Iterator[Import]:
    package = module if module in packages() else module.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            for alias in node.names:
                yield Import(module, package, (*above, *(node.module or "").split("."), alias.name)
                             if node.module else (*above, alias.name), node.lineno)  # fmt: skip


def module_of(target: tuple[str, ...]) -> str:
    """The module or package that an import loads."""
    whole = ".".join(target)
    return whole if whole in sources() else ".".join(target[:-1])


def face(package: str) -> list[str] | None:
    """``__all__`` of a package."""
    for node in sources()[package].body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and "__all__" in ast.unparse(node).split()[0]:
            return ast.literal_eval(node.value)
    return None


def is_inside(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def violations(found: tuple[Import, ...]) -> list[str]:
    """Imports that run back up, and those that pass a package's face by."""
    order = face("core")
    wrong = []
    for one in found:
        where = f"{one.module}:{one.line} imports {'.'.join(one.target)}"
        ours = one.target[1] if one.target[0] == "core" and len(one.target) > 1 else None
        if one.module.startswith("core."):
            mine = one.module.split(".")[1]
            if one.target[0] != "core":
                wrong.append(f"{where}: core imports nothing from outside core")
            elif ours in order and order.index(ours) > order.index(mine):
                wrong.append(f"{where}: {ours} comes after {mine}")
        for depth in range(1, len(one.target)):
            package = ".".join(one.target[:depth])
            if package not in packages():
                break
            handed_on = face(package)
            if not is_inside(one.package, package) and handed_on is not None and one.target[depth] not in handed_on:
                wrong.append(f"{where}: {one.target[depth]} is not in __all__ of {package}")
    return wrong


def test_imports_run_one_way_and_through_faces():
    assert violations(imports()) == []


def test_there_is_no_circle():
    """Among modules, lazy imports included; a package's face counts as a module."""
    graph: dict[str, set[str]] = {module: set() for module in sources() if module.startswith("core")}
    for one in imports():
        target = module_of(one.target)
        if one.module in graph and target != one.module and target in graph and not is_inside(one.module, target):
            graph[one.module].add(target)
    TopologicalSorter(graph).prepare()


def test_core_knows_nothing_of_blender():
    blender = {"bpy", "bmesh", "gpu", "blf", "mathutils", "bpy_extras"}
    for module, tree in sources().items():
        if module.startswith("core"):
            for node in ast.walk(tree):
                names = []
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and not node.level:
                    names = [node.module]
                assert not blender & {name.split(".")[0] for name in names}, module


def test_every_module_lies_in_a_package():
    assert sorted(path.name for path in (ROOT / "core").glob("*.py")) == ["__init__.py"]
    listed = face("core")
    assert sorted(listed) == sorted(p.split(".")[1] for p in packages() if p.count(".") == 1 and p.startswith("core"))
    for package in packages():
        if package.startswith("core."):
            assert face(package) is not None, f"{package} has no face"
            assert len(list((ROOT / package.replace(".", "/")).glob("*.py"))) - 1 <= MOST_MODULES, package


def test_faces_tell_the_truth():
    """Every name is there, is used by somebody outside, and is not both a module and what the face hands on."""
    for package in sorted(packages() - {"core"}):
        names = face(package) or []
        bound = {alias.asname or alias.name for node in sources()[package].body if isinstance(node, ast.ImportFrom)
                 for alias in node.names}  # fmt: skip
        modules = {child.rpartition(".")[2] for child in sources() if child.rpartition(".")[0] == package}
        assert len(set(names)) == len(names), package
        for name in names:
            assert (name in bound) != (name in modules), f"{package}: {name}"


def test_no_kernel_lies_in_a_face():
    """numba's cache and signatures.json name the module of a kernel."""
    for package in packages():
        assert not [n for n in ast.walk(sources()[package]) if isinstance(n, ast.FunctionDef) and n.decorator_list]


def test_kernels_are_made_by_our_njit():
    """Numba's own raises when its cache is damaged or its disk is full."""
    for module, tree in sources().items():
        if module.startswith("core.") and module != "core.numeric.kernels":
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").startswith("numba"):
                    assert not {"njit", "jit", "prange", "*"} & {alias.name for alias in node.names}, module
                assert not (isinstance(node, ast.Import) and any(a.name.startswith("numba") for a in node.names)), (
                    module
                )


def test_the_map_is_true():
    """CONTRIBUTING's map names each package and module of core, in the order of ``core.__all__``."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if re.match(r"\| `core/\w+/` \|", line)]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    assert [row[0].strip("`/").split("/")[1] for row in rows] == face("core")
    for place, _, named in rows:
        package = place.strip("`/").replace("/", ".")
        below = [child.removeprefix(package + ".") for child in sources() if child.startswith(package + ".")]
        assert sorted(re.findall(r"`(\w+)/?`", named)) == sorted({child.split(".")[0] for child in below}), package


def test_the_picture_is_true():
    """docs/images/architecture.svg shows the imports there are."""
    drawn = runpy.run_path(str(ROOT / "docs" / "architecture.py"))["draw"]()
    kept = (ROOT / "docs" / "images" / "architecture.svg").read_text(encoding="utf-8")
    assert drawn == kept, "run python docs/architecture.py"


@pytest.mark.parametrize(
    "module, line, said",
    [
        ("core.mesh.normals", "from ..views.view_maps import ViewMaps", "views comes after mesh"),
        (
            "core.views.ray_sorting",
            "from ..capture.kinect_disparity import HEIGHT",
            "kinect_disparity is not in __all__",
        ),
        ("core.cli.commands", "from ...mirror_scan_addon.scene import units", "nothing from outside core"),
        ("mirror_scan_addon.command", "from ..core.subject.floor_plane import raised_floor", "floor_plane is not in"),
    ],
)
def test_the_rules_can_be_broken(module, line, said):
    (one,) = violations(tuple(imports_of(module, ast.parse(line))))
    assert said in one
