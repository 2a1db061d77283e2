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
    folder.close()
    again = open_batch_folder(tmp_path / "out")
    assert again.finished("k", "/a") == kept and again.files_of(kept) == {"avatar.glb": b"first"}
    assert again.finished("another key", "/a") is None
    keep(again, again.name_for("/a", "Zoë"), key="k2", data=b"other")
    assert sorted(os.listdir(tmp_path / "out")) == [".unfinished", "Zoë", "batch.json"]
    (tmp_path / "out" / "Zoë" / "avatar.glb").write_bytes(b"cut")
    again.close()
    damaged = open_batch_folder(tmp_path / "out")
    assert damaged.finished("k2", "/a") is None
    assert damaged.name_for("/a", "Zoë") == "Zoë_2", "what is not known to be ours is left alone"


def test_names_differ_on_every_file_system(tmp_path):
    folder = open_batch_folder(tmp_path / "out")
    (tmp_path / "out" / "theirs").mkdir()
    folder.close()
    folder = open_batch_folder(tmp_path / "out")
    wished = ("scan", "Scan", "é", "e\u0301", "theirs", "Summary.csv")
    names = [folder.name_for(f"/{k}", wanted) for k, wanted in enumerate(wished)]
    assert names == ["scan", "Scan_2", "é", "é_2", "theirs_2", "Summary.csv_2"]
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
    folder.close()
    (tmp_path / "out" / ".unfinished" / "x").mkdir(parents=True)  # as of a process that was killed
    folder = open_batch_folder(tmp_path / "out")
    assert sorted(os.listdir(tmp_path / "out")) == [".unfinished", "a", "batch.json"]
    assert not os.listdir(tmp_path / "out" / ".unfinished")

    replace, calls = os.replace, []

    def full_once(*names):
        calls.append(names)
        if len(calls) == 2:
            full()
        replace(*names)

    monkeypatch.setattr(os, "replace", full_once)
    with pytest.raises(OutputError, match="No space left"):
        keep(folder, "a", key="new", data=b"new")
    assert (tmp_path / "out" / "a" / "avatar.glb").read_bytes() == b"old", "what was set aside is put back"


def test_what_was_replaced_is_not_given_to_others(tmp_path):
    folder = open_batch_folder(tmp_path)
    keep(folder, folder.name_for("/a", "a"), "k", "/a", b"of k")
    assert folder.files_of(folder.finished("k", "/b")) == {"avatar.glb": b"of k"}
    keep(folder, folder.name_for("/a", "a"), "k2", "/a", b"of k2")  # recorded anew; its old content is /b's now
    assert folder.finished("k", "/b") is None and folder.finished("k2", "/b") is not None


def test_two_batches_do_not_write_to_one_folder(tmp_path):
    folder = open_batch_folder(tmp_path / "out")
    keep(folder, "a")
    with pytest.raises(OutputError, match="another batch is writing to it"):
        open_batch_folder(tmp_path / "out")
    folder.close()
    assert [one.folder for one in open_batch_folder(tmp_path / "out")] == ["a"]


def test_a_folder_that_is_somebody_else_s_is_refused(tmp_path):
    (tmp_path / "photo.jpg").write_bytes(b"x")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "batch.json").write_text("[]")  # of another program
    for wrong in (tmp_path, tmp_path / "photo.jpg", tmp_path / "other"):
        with pytest.raises(OutputError, match="not the folder of an earlier batch"):
            open_batch_folder(wrong)
    assert sorted(os.listdir(tmp_path)) == ["other", "photo.jpg"]
