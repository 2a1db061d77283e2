"""A batch's folder: results appear whole, are found again by what they were made of, and replace nothing else."""

from __future__ import annotations

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.batches import Finished, open_batch_folder
from mirror_scan.core.batches.batch_folder import fit_name
from mirror_scan.core.errors import OutputError


def keep(folder, name, key="k", source="/a", data=b"glb"):
    return folder.keep(name, Finished(key, source, {}, {"height_m": 1.7}), {"avatar.glb": data})


def test_a_result_is_found_again_until_it_is_damaged(tmp_path):
    folder = open_batch_folder(tmp_path / "out")
    kept = keep(folder, folder.name_for("/a", "Zoë"), data=b"first")
    again = open_batch_folder(tmp_path / "out")
    assert again.finished("k", "/a") == kept and again.files_of(kept) == {"avatar.glb": b"first"}
    assert again.finished("another key", "/a") is None
    keep(again, again.name_for("/a", "Zoë"), key="k2", data=b"other")
    assert sorted(os.listdir(tmp_path / "out")) == [".unfinished", "Zoë", "batch.json"]
    (tmp_path / "out" / "Zoë" / "avatar.glb").write_bytes(b"cut")
    damaged = open_batch_folder(tmp_path / "out")
    assert damaged.finished("k2", "/a") is None
    assert damaged.name_for("/a", "Zoë") == "Zoë_2", "what is not known to be ours is left alone"


def test_names_differ_on_every_file_system(tmp_path):
    folder = open_batch_folder(tmp_path / "out")
    (tmp_path / "out" / "theirs").mkdir()
    folder = open_batch_folder(tmp_path / "out")
    names = [folder.name_for(f"/{k}", wanted) for k, wanted in enumerate(("scan", "Scan", "é", "e\u0301", "theirs"))]
    assert names == ["scan", "Scan_2", "é", "é_2", "theirs_2"]
    assert folder.name_for("/1", "scan") == "scan_2"
    with pytest.raises(OutputError, match="exists already"):
        keep(folder, "theirs")


@settings(max_examples=40, deadline=None)
@given(st.text(max_size=200))
def test_every_text_gives_a_name_that_file_systems_take(text):
    name = fit_name(text)
    assert name and len(name.encode()) <= 130 and not set(name) & set('<>:"/\\|?*\0\n')
    assert name[0] not in ". " and name[-1] not in ". " and fit_name(name) == name
    assert name.upper() not in ("CON", "NUL", "COM1")


def test_nothing_half_written_is_left(tmp_path, monkeypatch):
    folder = open_batch_folder(tmp_path / "out")
    keep(folder, "a", data=b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(OutputError, match="No space left"):
            keep(folder, "a", key="new", data=b"new")
    assert (tmp_path / "out" / "a" / "avatar.glb").read_bytes() == b"old"
    (tmp_path / "out" / ".unfinished" / "x").mkdir()  # as of a process that was killed
    open_batch_folder(tmp_path / "out")
    assert sorted(os.listdir(tmp_path / "out")) == ["a", "batch.json"]


def test_a_folder_that_is_somebody_else_s_is_refused(tmp_path):
    (tmp_path / "photo.jpg").write_bytes(b"x")
    for wrong in (tmp_path, tmp_path / "photo.jpg"):
        with pytest.raises(OutputError, match="not the folder of an earlier batch"):
            open_batch_folder(wrong)
    assert os.listdir(tmp_path) == ["photo.jpg"]
