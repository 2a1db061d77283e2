"""Terminals and pipes of any encoding, closed, full or absent, and file names that are not UTF-8."""

from __future__ import annotations

import io
import json
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.cli import terminal
from mirror_scan.core.errors import Notice
from mirror_scan.core.io.images import read_image, write_png

ROOT = Path(__file__).resolve().parents[3]
COMMANDS = (
    [], ["reconstruct"], ["calibrate"], ["demo"], ["simulate"], ["inspect"], ["convert"], ["record"], ["evaluate"],
    ["experiment"], ["experiment", "zippering"], ["experiment", "reflection"],
)  # fmt: skip
ENCODINGS = ("ascii", "latin-1", "cp1252", "cp437", "koi8-r", "shift_jis", "utf-8", "utf-16")


def stream(monkeypatch, name, encoding):
    made = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict", newline="")
    monkeypatch.setattr(sys, name, made)
    return lambda: made.buffer.getvalue().decode(encoding)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_on_any_terminal(monkeypatch, encoding, command):
    out = stream(monkeypatch, "stdout", encoding)
    assert cli.main([*command, "--help"]) == 0
    text = out()
    assert text.startswith("usage: mirror-scan") and "?" not in text
    if command == ["reconstruct"] and encoding == "ascii":
        assert 'written by "calibrate"' in text


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_errors_and_results_on_any_terminal(monkeypatch, encoding, folder, pipeline):
    out, err = stream(monkeypatch, "stdout", encoding), stream(monkeypatch, "stderr", encoding)
    (folder / "mirrors.json").unlink()
    assert cli.main(["reconstruct", str(folder), "-o", str(folder.parent / "ü人.ply")]) == 0
    assert cli.main(["reconstruct", str(folder.parent / "ü人"), "-o", str(folder.parent / "a.ply")]) == 1
    assert cli.main(["reconstruct", "“", "×", "--unknown"]) == 2
    assert ".ply" in out() and "watertight" in out()
    lines = err().splitlines()
    assert lines[0] == "warning: the left mirror shows nobody"
    assert lines[1].startswith("error: ") and "usage: " in lines[2]


@pytest.mark.parametrize(
    "text, encoding, shown",
    [
        ("“a” – b", "ascii", '"a" - b'), ("“a” – b", "cp1252", "“a” – b"), ("640×576", "latin-1", "640×576"),
        ("640×576", "ascii", "640x576"), ("人", "latin-1", "?"), ("a\udcffb", "utf-8", "a?b"), ("ü", "cp437", "ü"),
        ("…", "no such encoding", "…"), ("ü", None, "ü"),
    ],
)  # fmt: skip
def test_what_an_encoding_lacks_is_spelled_plainly(text, encoding, shown):
    class Stream:
        pass

    one = Stream()
    one.encoding = encoding
    assert terminal.spelled(text, one) == shown


def test_streams_that_are_not_there(monkeypatch, folder, pipeline):
    """As under pythonw, or a service; nothing that belongs on stderr goes to stdout either."""
    (folder / "mirrors.json").unlink()
    monkeypatch.setattr(sys, "stderr", None)
    out = stream(monkeypatch, "stdout", "utf-8")
    assert cli.main(["inspect", "/nowhere"]) == 1 and cli.main(["fly"]) == 2 and out() == ""
    monkeypatch.setattr(sys, "stdout", None)
    assert cli.main(["--help"]) == 0
    assert cli.main(["reconstruct", str(folder), "-o", str(folder.parent / "a.ply")]) == 0
    assert (folder.parent / "a.ply").is_file()


class Bad(io.StringIO):
    """A stream that cannot be written to."""

    def __init__(self, error):
        super().__init__()
        self.error = error

    def write(self, text):
        raise self.error


@pytest.mark.parametrize("command", [["--help"], ["inspect"]])
def test_a_full_disk_behind_stdout_is_an_error_in_words(monkeypatch, folder, command):
    monkeypatch.setattr(sys, "stdout", Bad(OSError(28, "No space left on device")))
    err = stream(monkeypatch, "stderr", "utf-8")
    (folder / "mirrors.json").unlink()
    arguments = command if command == ["--help"] else [*command, str(folder)]
    assert cli.main(arguments) == 1
    assert err().splitlines()[-1].endswith("cannot be written: No space left on device")


@pytest.mark.parametrize("arguments", [["--help"], ["inspect", "/nowhere"], ["fly"]])
def test_a_reader_that_went_away(monkeypatch, arguments):
    monkeypatch.setattr(sys, "stdout", Bad(BrokenPipeError()))
    monkeypatch.setattr(sys, "stderr", Bad(BrokenPipeError()))
    assert cli.main(arguments) == 141


@pytest.mark.skipif(os.name != "posix", reason="pipes and descriptors of POSIX")
def test_nothing_is_said_at_exit_about_a_stream(tmp_path):
    """Python itself complains when it cannot flush at its end."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r}); import conftest\n"
        "from mirror_scan.core import cli\nsys.exit(cli.main(sys.argv[1:]))"
    )
    run = [sys.executable, "-c", code, "reconstruct", "--help"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(run, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "No space left" in done.stderr
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(run, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(writer)
    assert done.returncode == 141 and done.stderr == ""


def test_the_cache_of_compiled_code_is_warned_of_in_one_line(monkeypatch, capsys, folder):
    from mirror_scan.core.numeric import kernels
    from mirror_scan.core.pipeline import inspection

    def inspect_capture(capture, settings):
        kernels.LOG.warning("%s", Notice("Compiled code cannot be kept in {folder}", folder="/x"))
        return SimpleNamespace(lines=["looks well"], warnings=(), cleaned=None)

    monkeypatch.setattr(inspection, "inspect_capture", inspect_capture)
    (folder / "mirrors.json").unlink()
    assert cli.main(["inspect", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert out == "looks well\n" and err == "warning: Compiled code cannot be kept in /x\n"
    assert not kernels.LOG.handlers and kernels.LOG.propagate
    assert logging.getLogger("mirror_scan.core.numeric.kernels") is kernels.LOG


class Terminal(io.StringIO):
    encoding = "ascii"

    def isatty(self):
        return True

    def write(self, text):
        text.encode(self.encoding)
        return super().write(text)


def test_a_progress_bar_of_ascii_and_lines_between(monkeypatch):
    pytest.importorskip("tqdm")
    one = Terminal()
    monkeypatch.setattr(sys, "stderr", one)
    monkeypatch.setenv("TERM", "xterm")
    with terminal.progress_bar(False) as progress:
        progress(0.5, "Find “mirrors” …")
        terminal.complain("warning", "a ‘line’")
        progress(0.7, "Next")
    lines = one.getvalue().replace("\r", "\n").split("\n")
    assert "warning: a 'line'" in lines and any('Find "mirrors"' in line for line in lines)


def test_no_progress_bar_where_it_cannot_be_drawn(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("TERM", "dumb")
    with terminal.progress_bar(False) as progress:
        assert progress is None
    assert sys.stderr.getvalue() == ""


@pytest.mark.skipif(sys.platform != "linux", reason="file names are bytes on Linux alone")
def test_file_names_that_are_not_utf8(tmp_path, folder, capsys, pipeline):
    odd = tmp_path / os.fsdecode(b"b\xff\xe9")
    try:
        odd.mkdir()
    except OSError:
        pytest.skip("this disk takes UTF-8 names only")
    pixels = np.arange(12, dtype=np.uint16).reshape(3, 4)
    write_png(odd / "a.png", pixels)
    assert np.array_equal(read_image(odd / "a.png"), pixels)
    (folder / "mirrors.json").unlink()
    capture = odd / "scan"
    shutil.copytree(folder, capture)
    report = odd / "r.json"
    assert cli.main(["reconstruct", str(capture), "-o", str(odd / "a.ply"), "--report", str(report)]) == 0
    assert (odd / "a.ply").is_file() and json.loads(report.read_text(encoding="utf-8"))
    assert cli.main(["inspect", str(odd / "gone")]) == 1
    assert cli.main(["convert", str(capture), str(odd / "copy")]) == 0 and (odd / "copy").is_dir()
    assert "b??" in capsys.readouterr().err


def test_a_report_with_a_name_that_is_not_utf8(tmp_path):
    from mirror_scan.core.cli.outputs import write_outputs
    from mirror_scan.core.mesh import Mesh
    from mirror_scan.core.pipeline import Reconstruction

    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    result = Reconstruction(mesh, "avatar", np.eye(4), {"capture": "b\udcff ü"}, ())
    write_outputs(result, [], tmp_path / "r.json", 0.0)
    assert json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["capture"] == "b\udcff ü"
