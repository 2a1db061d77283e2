"""Output files: checked before anything is read, written all or none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from command_line import listing, refused, remove
from mirror_scan.core import cli
from mirror_scan.core.errors import OutputError


@pytest.mark.parametrize(
    "outputs, words",
    [
        (["-o", "a.xyz"], "unknown format “.xyz”"),
        (["-o", "a"], "unknown format"),
        (["-o", "nowhere/a.ply"], "does not exist"),
        (["-o", "scan"], "unknown format"),
        (["-o", "folder.ply"], "not a regular file"),
        (["-o", "a.ply", "-o", "./a.ply"], "written twice"),
        (["-o", "a.ply", "--report", "nowhere/r.json"], "does not exist"),
        (["-o", "a.csv"], "ask for them with --measure"),
        (["-o", "a.ply", "--hollow", "2"], "--hollow: is for .stl and .3mf"),
        (["-o", "a.ply", "--remove-light"], "ask for one with --texture"),
        (["-o", "a.ply", "--measure", "--object"], "is for persons"),
        (["-o", "theirs.obj", "--texture"], "theirs.obj: its texture would replace theirs.png"),
        (["-o", "a.blend"], "pip install bpy==5.0.1.*3.11.*5.2.3.*3.13"),
    ],
)
def test_outputs_are_checked_before_anything_is_read(folder, capsys, monkeypatch, outputs, words):
    monkeypatch.chdir(folder.parent)
    Path("folder.ply").mkdir()
    Path("theirs.png").write_bytes(b"of somebody else")
    remove(folder, "intrinsic.json")  # would be told if it were looked at first
    refused(capsys, ["reconstruct", "scan", *outputs], words)


def test_a_writer_that_fails_leaves_every_output_as_it_was(folder, capsys, pipeline):
    here = folder.parent
    (here / "a.ply").write_text("old")
    before = listing(here)

    def full_disk(path, reconstruction):
        Path(path).write_text("half")
        raise OSError(28, "No space left on device")

    arguments = ["reconstruct", str(folder), "-o", str(here / "a.ply"), "-o", str(here / "b.blend")]
    assert cli.main([*arguments, "--report", str(here / "r.json")], writers={".blend": full_disk}) == 1
    assert re.search(r"error: .*b\.blend: cannot be written: No space left", capsys.readouterr().err)
    assert listing(here) == before


def test_writers_come_from_outside(folder, capsys, pipeline):
    class Unavailable(dict):
        def __getitem__(self, suffix):
            raise OutputError(f"{suffix} is not to be had today")

    arguments = ["reconstruct", str(folder), "-o", str(folder.parent / "a.fbx"), "--frame", "camera"]
    assert cli.main(arguments, writers=Unavailable({".fbx": None})) == 1
    assert "not to be had" in capsys.readouterr().err
    assert cli.main(arguments, writers={".fbx": lambda path, result: path.write_text(result.frame)}) == 0
    assert (folder.parent / "a.fbx").read_text() == "camera"
