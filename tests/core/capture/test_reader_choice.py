"""What is no capture, or cannot be read, is told in one line that names it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import write_png
from writers import HEIGHT, WIDTH, assert_one_line_naming, write_folder


def test_a_folder_is_read_without_numba(tmp_path):
    """Compiling takes seconds; who only looks at a capture, or mistyped its name, must not wait for it."""
    folder, larger = write_folder(tmp_path / "a"), write_folder(tmp_path / "b")
    write_png(larger / "color" / "000000.png", np.zeros((4 * HEIGHT, 4 * WIDTH, 3), np.uint8))
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import conftest\n"
        "from mirror_scan.core.capture import open_capture\n"
        f"open_capture({str(folder)!r})\n"
        f"open_capture({str(larger)!r})\n"
        "sys.exit('numba' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("make", ["missing", "empty", "file"])
def test_what_is_no_capture(tmp_path, make):
    path = tmp_path / "a"
    if make == "empty":
        path.mkdir()
    elif make == "file":
        path.write_text("hello")
    with pytest.raises(CaptureError, match="no such file" if make == "missing" else "is not a capture") as caught:
        open_capture(path)
    assert_one_line_naming(caught.value, path)


def test_what_the_system_refuses_is_named(tmp_path, monkeypatch):
    """Not by taking permissions away, which the superuser does not notice."""
    folder = write_folder(tmp_path / "a")
    read = Path.read_bytes

    def guarded(path):
        if path.name == "000001.png":
            raise PermissionError(13, "Permission denied", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", guarded)
    with pytest.raises(CaptureError, match="000001.png: cannot be read: Permission denied"):
        open_capture(folder)


def test_links_in_a_circle(tmp_path):
    (tmp_path / "a").mkdir()
    for link, target in (("a/a", "../a"), ("a/depth", "."), ("self", "self")):
        (tmp_path / link).symlink_to(target)
    for path in ("a", "self"):
        with pytest.raises(CaptureError, match=path):
            open_capture(tmp_path / path)
