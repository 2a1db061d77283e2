"""Compiled kernels use nothing that numba hands to scipy: Blender has no scipy, and neither do our dependencies."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

CORE = Path(__file__).resolve().parents[2] / "core"
LAPACK = {"dot", "vdot", "matmul", "roots", "polyfit", "cov", "corrcoef"}  # members of numpy, beside all of linalg


def compiled(path: Path):
    """Functions of a module that are compiled."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            names = {item.id for decorator in node.decorator_list for item in ast.walk(decorator)
                     if isinstance(item, ast.Name)}  # fmt: skip
            if names & {"njit", "jit", "vectorize", "guvectorize"}:
                yield node


@pytest.mark.parametrize("path", sorted(CORE.rglob("*.py")), ids=lambda path: path.relative_to(CORE).as_posix())
def test_kernels_need_no_scipy(path):
    for function in compiled(path):
        for node in ast.walk(function):
            where = f"{path.name}: {function.name}, line {getattr(node, 'lineno', '?')}"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np":
                assert node.attr != "linalg" and node.attr not in LAPACK, where
            if isinstance(node, ast.BinOp):
                assert not isinstance(node.op, ast.MatMult), where


def test_the_check_sees_what_it_should(tmp_path):
    file = tmp_path / "kernel.py"
    file.write_text("@njit(cache=True)\ndef f(a):\n    return np.linalg.det(a)\n\n\ndef g(a):\n    return a @ a\n")
    assert [function.name for function in compiled(file)] == ["f"]
    with pytest.raises(AssertionError):
        test_kernels_need_no_scipy(file)
