"""Nothing of the user's is lost, and nothing half-made is left behind."""

from __future__ import annotations

import os

import pytest
from mirror_scan.core.errors import OutputError
from mirror_scan.core.io.atomic_files import fresh_folder, replacing


def contents(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def fill(folder, text):
    folder.mkdir()
    (folder / "data.txt").write_text(text)


def test_folder_appears_whole_or_not_at_all(tmp_path):
    folder = tmp_path / "scan"
    with fresh_folder(folder) as fresh:
        fill(fresh, "first")
        assert not folder.exists()
    assert contents(tmp_path) == {os.path.join("scan", "data.txt"): "first"}
    with pytest.raises(OutputError, match="exists already"), fresh_folder(folder):
        pytest.fail("a folder that holds something was handed out")
    with pytest.raises(ValueError), fresh_folder(folder, replace=True) as fresh:
        fill(fresh, "half")
        raise ValueError
    assert contents(tmp_path) == {os.path.join("scan", "data.txt"): "first"}
    assert [path.name for path in tmp_path.iterdir()] == ["scan"]
    with fresh_folder(folder, replace=True) as fresh:
        fill(fresh, "second")
    assert contents(tmp_path) == {os.path.join("scan", "data.txt"): "second"}


def test_folder_comes_back_when_its_successor_was_not_made(tmp_path):
    folder = tmp_path / "scan"
    fill(folder, "kept")
    with pytest.raises(OutputError, match="cannot be written"), fresh_folder(folder, replace=True):
        pass  # nothing is made
    assert contents(tmp_path) == {os.path.join("scan", "data.txt"): "kept"}


@pytest.mark.parametrize("make", [fresh_folder, replacing])
def test_missing_parent_is_told(tmp_path, make):
    with pytest.raises(OutputError, match="does not exist; create it first"), make(tmp_path / "none" / "scan"):
        pytest.fail("a name in a missing folder was handed out")


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
def test_link_stays_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with fresh_folder(tmp_path / "link") as fresh:
        fill(fresh, "through")
    assert (tmp_path / "link").is_symlink()
    assert contents(tmp_path / "real") == {"data.txt": "through"}


def test_replacing_follows_links_and_keeps_permissions(tmp_path):
    (tmp_path / "real.ply").write_text("old")
    (tmp_path / "real.ply").chmod(0o640)
    (tmp_path / "link.ply").symlink_to("real.ply")
    with replacing(tmp_path / "link.ply") as temporary:
        assert temporary.suffix == ".ply"
        temporary.write_text("new")
    assert (tmp_path / "link.ply").is_symlink()
    assert (tmp_path / "real.ply").read_text() == "new"
    assert (tmp_path / "real.ply").stat().st_mode & 0o777 == 0o640


def test_an_empty_file_replaces_nothing(tmp_path):
    path = tmp_path / "a.glb"
    path.write_text("old")
    with pytest.raises(OutputError, match="empty file"), replacing(path) as temporary:
        temporary.touch()
    assert contents(tmp_path) == {"a.glb": "old"}


@pytest.mark.parametrize("stem", ["人" * 80, "x" * 250, "e\u0301" * 80, "\U0001f9cd" * 60])
def test_long_names(tmp_path, stem):
    """A name may have 255 bytes; the temporary one must not need more."""
    path = tmp_path / f"{stem}.ply"
    with replacing(path) as temporary:
        temporary.write_text("new")
    assert contents(tmp_path) == {path.name: "new"}
