"""Messages that keep their parts: they are text, cross processes whole, and fit their templates."""

from __future__ import annotations

import ast
import copy
import json
import pickle
import string
from pathlib import Path

import pytest
from mirror_scan.core.errors import CaptureError, MirrorError, MirrorScanError
from mirror_scan.core.errors.notices import Notice, without_formats

CORE = Path(__file__).resolve().parents[3] / "core"

QUOTED = Notice("the mirror “{name}”", name="left {1}", mirrors=["left {1}"])
WHOLE = Notice(
    "{share:.0%} of {mirror} by {way:.1f} m; {{so}} {kind!r}", share=0.256, mirror=QUOTED, way=2.04, kind="a"
)


def test_a_notice_is_its_english():
    text = "26% of the mirror “left {1}” by 2.0 m; {so} 'a'"
    assert WHOLE == text and str(WHOLE) == text and type(str(WHOLE)) is str and hash(WHOLE) == hash(text)
    assert json.dumps([WHOLE]) == json.dumps([text]) and f"{WHOLE}" == text and WHOLE in {text}
    assert WHOLE.template == "{share} of {mirror} by {way} m; {{so}} {kind}"
    assert WHOLE.values == {"share": "26%", "mirror": "the mirror “left {1}”", "way": "2.0", "kind": "'a'"}
    assert WHOLE.template.format(**WHOLE.values) == text
    assert without_formats(WHOLE.template) == WHOLE.template


def test_it_is_about_the_mirrors_that_its_values_are_about():
    assert QUOTED.mirrors == WHOLE.mirrors == ("left {1}",) and WHOLE.values["mirror"].template == "the mirror “{name}”"
    assert Notice("{camera}: {text}", camera="c", text=WHOLE, mirrors=["right"]).mirrors == ("right", "left {1}")
    assert Notice("{mirror:>30}", mirror=QUOTED).values["mirror"] == QUOTED.rjust(30)  # in a format it is text
    assert Notice("nobody").mirrors == ()


def same(one, other):
    return one == other and one.parts() == other.parts() and type(one) is type(other)


def test_it_does_not_change_and_is_copied_whole():
    for name in ("template", "values", "mirrors", "new"):
        with pytest.raises(AttributeError):
            setattr(WHOLE, name, "x")
    with pytest.raises(TypeError):
        WHOLE.values["share"] = "1"
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert same(pickle.loads(pickle.dumps(WHOLE, protocol)), WHOLE)
    assert same(copy.deepcopy(WHOLE), WHOLE) and same(copy.copy(WHOLE), WHOLE)
    assert same(Notice.of_parts(json.loads(json.dumps(WHOLE.parts()))), WHOLE)


def test_any_text_can_be_taken_for_one():
    for text in ("", "plain", "{", "}} {x} {0} {", "50 % of {name:.0%}"):
        notice = Notice.of(text)
        assert notice == text and not notice.values and notice.mirrors == ()
        assert same(pickle.loads(pickle.dumps(notice)), notice)
    assert Notice.of(WHOLE) is WHOLE and Notice.of(WHOLE, ["left {1}"]) is WHOLE
    more = Notice.of(Notice.of("x {", ["a"]), ["b", "a"])
    assert more == "x {" and more.mirrors == ("a", "b")
    assert Notice.of(WHOLE, ["b"]).mirrors == ("left {1}", "b") and Notice.of(WHOLE, ["b"]).values == WHOLE.values


def test_a_value_that_lacks_is_a_fault():
    with pytest.raises(KeyError):
        Notice("{name} and {other}", name="a")


def test_errors_carry_notices():
    plain = CaptureError("a{b}: is no capture")
    assert str(plain) == plain.notice == "a{b}: is no capture" and not plain.notice.values
    told = CaptureError("{path}: depth is {width}×{height}", path=Path("/x"), width=640, height=480)
    assert str(told) == "/x: depth is 640×480" and told.notice.values["width"] == "640"
    outer = MirrorError("{path}: {reason}", path="r.json", reason=told)
    assert str(outer) == "r.json: /x: depth is 640×480" and same(outer.notice.values["reason"], told.notice)
    assert same(MirrorError(WHOLE).notice, WHOLE) and str(MirrorScanError()) == ""
    for error in (plain, told, outer):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and str(again) == str(error) and same(again.notice, error.notice)


def test_every_template_in_core_gets_what_it_names():
    """Messages of rare mistakes are made by no other test."""
    count = 0
    for path in sorted(CORE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or path.name in ("notices.py", "exceptions.py"):
                continue
            name = ast.unparse(node.func).rpartition(".")[2]
            given = {keyword.arg for keyword in node.keywords} - {"mirrors", "code"}
            if name == "Notice" or name.endswith("Error") and given:
                count += 1
                where, template = f"{path}:{node.lineno}", node.args[0]
                assert isinstance(template, ast.Constant), f"{where}: filled in before it is a template"
                named = {field for _, field, *_ in string.Formatter().parse(template.value) if field is not None}
                assert named == given, where
    assert count > 10
