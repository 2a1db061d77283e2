"""``batch``: each capture becomes an avatar once, whatever goes wrong with others."""

from __future__ import annotations

import csv
import errno
import functools
import json
import re
import shutil
import signal
from html.parser import HTMLParser

import pytest
from command_line import write_json
from mirror_scan.core import cli, cluster
from mirror_scan.core import pipeline as whole_job
from mirror_scan.core.batches import BatchFolder
from mirror_scan.core.cli import batch
from mirror_scan.core.errors import OutputError

pytest.importorskip("distributed", reason="Dask is not installed")


@pytest.fixture
def made(monkeypatch, pipeline):
    """Workers within this process, and the names of the captures that the pipeline was given."""
    names = []
    answer = whole_job.reconstruct

    def reconstruct(capture, *arguments, **options):
        names.append(capture.name)
        return answer(capture, *arguments, **options)

    monkeypatch.setattr(whole_job, "reconstruct", reconstruct)
    monkeypatch.setattr(cluster, "WorkerSettings", functools.partial(cluster.WorkerSettings, processes=False))
    start = cluster.start_workers
    monkeypatch.setattr(
        cluster,
        "start_workers",
        lambda settings, warm_up, tell: start(settings),  # nothing to compile
    )
    return names


@pytest.fixture
def scans(folder):
    """Two captures of one name in different folders, the second with other content, and one that is damaged."""
    home = folder.parent / "scans <b>&"
    home.mkdir()
    first = folder.rename(home / "Zoë's scan")
    (first / "mirrors.json").unlink()
    shutil.copytree(first, home / "more" / "Zoë's scan")
    write_json(home / "more" / "Zoë's scan" / "mirrors.json", {"mirrors": []})
    shutil.copytree(first, home / "worse")
    (home / "worse" / "intrinsic.json").write_text("{")
    return home


def run(*arguments):
    return cli.main(["batch", *map(str, arguments), "--workers", "2"])


def table(folder):
    with open(folder / "summary.csv", encoding="utf-8-sig", newline="") as file:
        return {row["capture"].rpartition("scans <b>&")[2]: row for row in csv.DictReader(file)}


def test_one_bad_capture_stops_nothing_and_nothing_is_made_twice(scans, made, capsys):
    out = scans / "out"  # within what is searched
    assert run(scans, "-o", out) == 1
    said, errors = capsys.readouterr()
    assert "2 avatars in" in said and "1 of 3 captures failed" in errors
    assert re.search("error: .*worse/intrinsic.json: is not valid JSON", errors)
    assert made == ["Zoë's scan"] * 2
    rows = table(out)
    assert [rows[name]["state"] for name in ("/Zoë's scan", "/more/Zoë's scan", "/worse")] == ["made", "made", "failed"]
    assert {rows["/Zoë's scan"]["folder"], rows["/more/Zoë's scan"]["folder"]} == {"Zoë's scan", "Zoë's scan_2"}
    for name in ("Zoë's scan", "Zoë's scan_2"):
        kept = sorted(path.name for path in (out / name).iterdir())
        assert kept == ["avatar.glb", "preview.png", "record.json", "report.json", "thumbnail.png"]
    assert sorted(p.name for p in out.iterdir() if p.is_file()) == ["batch.json", "summary.csv", "summary.html"]

    before = (out / "Zoë's scan" / "avatar.glb").stat().st_mtime_ns
    assert run(scans, "-o", out) == 1 and made == ["Zoë's scan"] * 2
    assert [row["state"] for row in table(out).values()].count("kept") == 2
    assert (out / "Zoë's scan" / "avatar.glb").stat().st_mtime_ns == before

    assert run(scans, "-o", out, "--keep-islands", "--format", "ply", "--quiet") == 1
    assert made == ["Zoë's scan"] * 4, "other settings"
    assert (out / "Zoë's scan_2" / "avatar.ply").is_file() and not (out / "Zoë's scan_2" / "avatar.glb").exists()


def test_the_page_holds_every_name_as_text_and_every_picture(scans, made):
    out = scans.parent / "out"
    assert run(scans, "-o", out) == 1
    texts, sources, links = [], [], []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attributes):
            assert tag != "b"
            sources.extend(v for k, v in attributes if k == "src")
            links.extend(v for k, v in attributes if k == "href")

        def handle_data(self, data):
            texts.append(data)

    Reader().feed((out / "summary.html").read_text("utf-8"))
    assert any("scans <b>&/Zoë's scan" in text for text in texts)
    assert len(sources) == 2 and all(source.startswith("data:image/png;base64,") for source in sources)
    assert "Zo%C3%AB%27s%20scan/avatar.glb" in links


def test_the_same_content_is_made_once_and_given_to_each(scans, made):
    shutil.copytree(scans / "Zoë's scan", scans / "again")
    out = scans.parent / "out"
    assert run(scans / "Zoë's scan", scans / "again", "-o", out) == 0
    assert len(made) == 1
    assert (out / "again" / "avatar.glb").read_bytes() == (out / "Zoë's scan" / "avatar.glb").read_bytes()
    (scans / "again").rename(scans / "moved")
    assert run(scans / "moved", "-o", out) == 0 and len(made) == 1
    assert (out / "moved" / "report.json").is_file()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_it_says_what_is_done_and_goes_on_from_there(scans, made, capsys, monkeypatch, number, code):
    before = signal.getsignal(number)
    out = scans.parent / "out"
    take = batch._Batch._take
    with monkeypatch.context() as patch:

        def interrupted(self, outcome):
            take(self, outcome)
            signal.raise_signal(number)

        patch.setattr(batch._Batch, "_take", interrupted)
        assert run(scans / "Zoë's scan", scans / "more", "-o", out) == code
    assert signal.getsignal(number) == before
    assert "interrupted; 1 of 2 captures are done" in capsys.readouterr().err
    assert sorted(row["state"] for row in table(out).values()) == ["left", "made"]
    assert run(scans / "Zoë's scan", scans / "more", "-o", out) == 0
    assert sorted(row["state"] for row in table(out).values()) == ["kept", "made"]


def test_what_cannot_work_is_refused_before_anything_is_written(scans, made, capsys):
    capture, there = scans / "Zoë's scan", scans.parent / "photos"
    there.mkdir()
    (there / "photo.jpg").write_bytes(b"x")
    for arguments, words in (
        ((capture, "-o", capture / "out"), "lies within the capture"),
        ((capture, "-o", there), "not the folder of an earlier batch"),
        ((capture, "-o", scans.parent / "new", "--scheduler", "tcp://x:1"), "are for this machine"),
        ((capture, "-o", scans.parent / "new", "--every-frames", "2", "--single-frame"), "leave out --single-frame"),
        ((capture, "-o", scans.parent / "new", "--remove-light"), "ask for one with --texture"),
    ):
        assert run(*arguments) == 1
        assert re.search(f"error: .*{words}", capsys.readouterr().err)
    assert not (scans.parent / "new").exists() and made == []


def test_a_recording_is_cut_into_bursts(scans, made):
    capture = scans / "Zoë's scan"
    for k in range(1, 5):
        shutil.copy(capture / "depth" / "000000.png", capture / "depth" / f"{k:06}.png")
    out = scans.parent / "out"
    assert run(capture, "-o", out, "--every-frames", "2") == 0
    assert sorted(p.name for p in out.iterdir() if p.is_dir()) == [f"Zoë's scan_{r}" for r in ("0-2", "2-4", "4-5")]


def test_pieces_of_a_recording_go_by_what_the_options_say_of_it(scans, made, capsys):
    capture, out = scans / "Zoë's scan", scans.parent / "out"
    (capture / "intrinsic.json").rename(scans / "lens.json")
    assert run(capture, "-o", out, "--every-frames", "1", "--intrinsics", scans / "lens.json") == 0 and len(made) == 1
    capsys.readouterr()
    assert run(capture, "-o", out, "--every-frames", "1", "--frames", "5:9", "--intrinsics", scans / "lens.json") == 1
    assert "has frames 0 to 0, of which “5:9” chooses none" in capsys.readouterr().err, "not left out without a word"
    assert [row["state"] for row in table(out).values()] == ["failed"]


def test_two_captures_that_change_places_keep_their_own(scans, made):
    first, second, out = scans / "Zoë's scan", scans / "more" / "Zoë's scan", scans.parent / "out"
    assert run(first, second, "-o", out) == 0
    report = {one: (out / one / "record.json").read_bytes() for one in ("Zoë's scan", "Zoë's scan_2")}
    first.rename(scans / "between")
    second.rename(first)
    (scans / "between").rename(second)
    assert run(first, second, "-o", out) == 0
    keys = {one: json.loads((out / one / "record.json").read_bytes())["key"] for one in report}
    before = [json.loads(text)["key"] for text in report.values()]
    assert list(keys.values()) == before[::-1] and len(made) == 3, "the one that was replaced first is made again"


def test_a_full_disk_ends_it_and_what_is_there_stays(scans, made, capsys, monkeypatch):
    out = scans.parent / "out"
    assert run(scans / "Zoë's scan", "-o", out) == 0

    def full(*_):
        raise OutputError("cannot be written: No space left on device") from OSError(errno.ENOSPC, "No space left")

    monkeypatch.setattr(BatchFolder, "keep", full)
    assert run(scans / "Zoë's scan", scans / "more", scans / "worse", "-o", out) == 1
    assert "the disk is full; make room" in capsys.readouterr().err
    states = [row["state"] for row in table(out).values()]
    assert states[:2] == ["kept", "failed"] and states[2] in ("failed", "left")
