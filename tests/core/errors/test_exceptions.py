"""Errors keep their codes: through other errors, pickling and subclasses."""

from __future__ import annotations

import errno
import pickle

import pytest
from mirror_scan.core.errors import CaptureError, MirrorError, MirrorScanError, OutputError, PicksDisagreeError, code_of


def test_an_error_has_the_code_it_was_given_else_that_of_its_class():
    assert CaptureError("a", code="unit").code == "unit" and CaptureError("a").code == "damaged"
    assert OutputError("a").code == "writing" and MirrorScanError("a").code == "other"
    assert PicksDisagreeError("a").code == MirrorError("a").code == "mirror"
    with pytest.raises(ValueError, match="units"):
        MirrorScanError("a", code="units")


def test_an_error_that_quotes_another_or_comes_of_one_has_its_code():
    inner = CaptureError("{path}: no lens", path="a", code="lens_missing")
    assert MirrorScanError("{name}: {error}", name="b", error=inner).code == "lens_missing"
    try:
        raise OutputError("b") from inner
    except OutputError as outer:
        assert outer.code == "lens_missing"
        assert pickle.loads(pickle.dumps(outer)).code == "lens_missing"  # where the cause does not come along
    try:
        raise OutputError("b", code="other") from inner
    except OutputError as outer:
        assert outer.code == "other"


def test_a_pickled_error_keeps_class_parts_and_code():
    error = MirrorError("{name}: bad", name="left", mirrors=["left"], code="no_mirror")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is MirrorError and str(again) == "left: bad" and again.code == "no_mirror"
    assert again.notice.mirrors == ("left",) and again.notice.template == "{name}: bad"


@pytest.mark.parametrize("number, code", [(errno.ENOSPC, "writing"), (errno.ENOMEM, "memory"), (errno.ENOENT, "gone")])
def test_errors_of_the_operating_system(number, code):
    assert code_of(OSError(number, "x")) == code
