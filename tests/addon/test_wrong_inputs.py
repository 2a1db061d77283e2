"""Wrong files and wrong states, each answered by one line that says what is wrong and what to do; the cure works.

``test_wrong_states.py`` tries every operator in every odd state; here each case has its own operator, its own words,
and where something can be pressed or set against it, that is done and the operator works. Nothing is lost on the way.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from wrong_inputs import CURES, FILES, INSIDE, STATES, Bench, half_size, refusal

pytest.importorskip("bpy")


@pytest.fixture(scope="module")
def half(scan, tmp_path_factory) -> Path:
    return half_size(scan[0], tmp_path_factory.mktemp("half") / "capture")


def held(bpy) -> dict[str, list[str]]:
    return {kind: sorted(item.name for item in getattr(bpy.data, kind)) for kind in
            ("objects", "meshes", "images", "materials", "collections", "armatures")}  # fmt: skip


def files(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("wrong", FILES + STATES, ids=lambda wrong: wrong.name)
def test_it_is_said_in_a_line_and_cured(bpy, half, capsule, tmp_path, capfd, wrong):
    bench = Bench(bpy, tmp_path, half, capsule)
    wrong.make(bench)
    before, there = held(bpy), files(tmp_path)
    capfd.readouterr()
    with pytest.raises(RuntimeError) as caught:
        wrong.press(bench)
    text, lines = refusal(caught.value, tmp_path)
    assert lines == 1
    assert re.search(wrong.words, text) and CURES.search(text) and not INSIDE.search(text), text
    said = capfd.readouterr()
    assert "Traceback" not in said.out + said.err
    assert held(bpy) == before and files(tmp_path) == there
    if wrong.cure is not None:
        wrong.cure(bench)
        assert (wrong.again or wrong.press)(bench) == {"FINISHED"}
