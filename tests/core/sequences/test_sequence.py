"""From a recording to closed meshes: made once, held where a frame shows nothing, gone on with."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.capture.rgbd_writer import FolderWriter
from mirror_scan.core.cli import main
from mirror_scan.core.errors import CaptureError, OutputError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.sequences import SequenceFrame, open_recording
from mirror_scan.core.sequences.sequence_files import SequenceFolder


@pytest.fixture(scope="module")
def recording(simulated, tmp_path_factory):
    """Four frames of a person who stands; the third shows a wall only."""
    capture = simulated("ideal").capture
    folder = tmp_path_factory.mktemp("sequence") / "standing"
    writer = FolderWriter(folder, capture.intrinsics, "ideal")
    for place in range(4):
        writer.add(np.full_like(capture.depth[0], 1.0) if place == 2 else capture.depth[0])
    writer.set_color(capture.color)
    from mirror_scan.core.capture.folders.rgbd_folder import mirrors_to

    writer.write_json("mirrors.json", {"mirrors": mirrors_to(capture.mirrors)})
    return folder


def test_frames_are_chosen_and_counted(recording):
    assert open_recording(recording).numbers == (0, 1, 2, 3)
    assert open_recording(recording, "1:", 2).numbers == (1, 3)
    assert open_recording(recording).sample(2) == (1, 3)
    assert len(open_recording(recording).read(1).depth) == 1
    with pytest.raises(CaptureError, match="chooses none"):
        open_recording(recording, "9:")


@pytest.mark.slow
def test_every_frame_is_closed_and_the_one_without_a_person_is_bridged(recording, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["sequence", str(recording), "-o", str(out), "--frames", "0:3", "--fps", "15"]) == 0
    said = capsys.readouterr()
    assert "2 frames made, 1 bridged, 0 lost" in said.out and "frame 2: the frame before is held" in said.err
    report = json.loads((out / "sequence.json").read_text(encoding="utf-8"))
    assert [row["state"] for row in report["frames"]] == ["made", "made", "bridged"] and report["rate"] == 15
    meshes = [read_mesh(out / f"frame_{place:06d}.ply") for place in range(3)]
    for mesh in meshes:
        checked = mesh_report(mesh)
        assert checked["watertight"] and checked["manifold"]
    np.testing.assert_array_equal(meshes[1].vertices, meshes[2].vertices)
    assert abs(meshes[0].vertices[:, 2].min()) < 0.03  # the floor of all frames


def test_a_sequence_is_gone_on_with_where_it_was_left(tmp_path):
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    report = {"mesh": {"vertices": 3, "triangles": 1, "watertight": True, "manifold": True, "volume_l": 1.0,
                       "height_m": 1.0}}  # fmt: skip
    first = SequenceFolder(tmp_path / "out", [".ply"], {"recording": "a"})
    for place in range(3):
        first.add(SequenceFrame(place, place, "made", mesh, report=report))
    first.finish({"rig": {"sensor": "ideal"}})
    (tmp_path / "out" / "frame_000001.ply").unlink()
    with pytest.raises(OutputError, match="already"):
        SequenceFolder(tmp_path / "out", [".ply"], {"recording": "a"})
    with pytest.raises(OutputError, match="other settings"):
        SequenceFolder(tmp_path / "out", [".ply"], {"recording": "b"}, resume=True)
    again = SequenceFolder(tmp_path / "out", [".ply"], {"recording": "a"}, resume=True)
    assert [again.has(place) for place in range(4)] == [True, False, True, False]
    assert again.kept == {"rig": {"sensor": "ideal"}} and again.places() == [0, 2]
    assert again.mesh_if_any(0) is not None
    np.testing.assert_array_equal(again.mesh(0).triangles, mesh.triangles)


@pytest.mark.parametrize(
    ("outputs", "said"),
    [
        (["a.mp4"], "0 folders are given"),
        (["a", "b"], "2 folders are given"),
        (["a", "b.glb"], "ask for them with --skeleton"),
        ([None], "lies within the capture"),
    ],
)
def test_what_cannot_be_written_is_said_at_once(recording, tmp_path, capsys, outputs, said):
    paths = [recording / "frames" if name is None else tmp_path / name for name in outputs]
    given = [part for path in paths for part in ("-o", str(path))]
    assert main(["sequence", str(recording), *given]) == 1
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_volume_that_jumps_is_no_whole_body():
    from mirror_scan.core.sequences.rig_placement import SequenceRig
    from mirror_scan.core.sequences.sequence import BRIDGED, MADE, FrameMade, SequenceSettings, _Job, _Judge

    rig = SequenceRig(None, np.eye(4), np.zeros((2, 2)), None, (0,), {})  # type: ignore[arg-type]  # its frame only
    judge = _Judge(SequenceSettings(hold=2))
    mesh = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))

    def frame(place, litres):
        report = {"mesh": {"watertight": True, "manifold": True, "volume_l": litres}}
        return judge.judged(replace(_Job(place, place), made=FrameMade(mesh, report, 0.1)), rig)

    states = [frame(k, v) for k, v in enumerate((70.0, 71.0, 69.0, 70.0, 30.0, 31.0, 29.0, 70.5))]
    assert [one.state for one in states] == [MADE] * 4 + [BRIDGED] * 2 + ["lost", MADE]
    assert "30 l" in states[4].reason


REPORT = {"mesh": {"vertices": 3, "triangles": 1, "watertight": True, "manifold": True, "volume_l": 70.0,
                   "height_m": 1.0}}  # fmt: skip
TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))


def test_who_is_ended_by_force_can_be_gone_on_with_and_nothing_is_left_of_nothing(tmp_path):
    first = SequenceFolder(tmp_path / "out", [".ply"], {})
    first.add(SequenceFrame(0, 0, "made", TRIANGLE, report=REPORT))
    first.add(SequenceFrame(1, 1, "lost", None, "nobody"))
    first.add(SequenceFrame(2, 2, "bridged", TRIANGLE, "a worker was lost", again=True))
    first.finish({})
    again = SequenceFolder(tmp_path / "out", [".ply"], {}, resume=True)
    assert [again.has(place) for place in range(3)] == [True, True, False]
    again.add(SequenceFrame(2, 2, "lost", None, "nobody"))
    assert not (tmp_path / "out" / "frame_000002.ply").exists() and again.first_reason() == "nobody"
    # no finish: what the first frame wrote is enough
    killed = SequenceFolder(tmp_path / "killed", [".ply"], {})
    killed.add(SequenceFrame(0, 0, "made", TRIANGLE, report=REPORT), {"rate": 15})
    assert SequenceFolder(tmp_path / "killed", [".ply"], {}, resume=True).has(0)
    SequenceFolder(tmp_path / "none", [".ply"], {}).finish({})
    assert not (tmp_path / "none").exists()


def test_another_rig_file_or_recording_is_not_gone_on_with(recording, tmp_path):
    from mirror_scan.core.cli import sequence as command
    from mirror_scan.core.cli.parser import build_parser

    rig, copy = tmp_path / "rig.json", tmp_path / "copy"
    shutil.copytree(recording, copy)

    def folder(*options, resume=True):
        given = build_parser("x").parse_args(["sequence", str(copy), "-o", "out", *options])
        facts = command._facts(given, open_recording(copy))
        return SequenceFolder(tmp_path / "out", [".ply"], facts, resume)

    rig.write_text("{}")
    first = folder("--rig", str(rig), resume=False)
    first.add(SequenceFrame(0, 0, "made", TRIANGLE, report=REPORT))
    first.finish({})
    rig.rename(tmp_path / "moved.json")
    assert folder("--rig", str(tmp_path / "moved.json"), "--workers", "2").has(0), "a file is what is in it"
    rig.write_text('{"mirrors": []}')
    with pytest.raises(OutputError, match=r"other settings \(--rig\)"):
        folder("--rig", str(rig))
    with pytest.raises(OutputError, match=r"\(--rig, --unfiltered\)"):
        folder("--unfiltered")
    report = tmp_path / "out" / "sequence.json"
    content = json.loads(report.read_text(encoding="utf-8"))
    named = content["made_of"] | {"options": content["made_of"]["options"] | {"rig": str(rig)}}
    of_before = content | {"made_of": {key: value for key, value in named.items() if key not in ("content", "beside")}}
    report.write_text(json.dumps(of_before), encoding="utf-8")  # as version 0.7 wrote it: files by their paths
    assert folder("--rig", str(rig)).has(0)
    with pytest.raises(OutputError, match=r"other settings \(--rig\)"):
        folder()
    report.write_text(json.dumps(content), encoding="utf-8")
    next(copy.glob("depth/*.png")).write_bytes(b"recorded anew")
    with pytest.raises(OutputError, match=r"\(content of the recording\)"):
        folder("--rig", str(tmp_path / "moved.json"))


def a_sequence(count, monkeypatch, faults=(), **named):
    """The states of a sequence whose frames are made of nothing, but for the ``faults`` by place."""
    from mirror_scan.core.camera import Intrinsics
    from mirror_scan.core.capture import Capture
    from mirror_scan.core.pipeline import KnownScene
    from mirror_scan.core.sequences import FilterSettings, Recording, SequenceSettings, sequence
    from mirror_scan.core.sequences.rig_placement import SequenceRig

    lens = Intrinsics(4, 3, 4.0, 4.0, 1.5, 1.0)
    read, made = [], []

    def capture(recording, number):
        read.append(number)
        return Capture(np.full((1, 3, 4), 1.0 + number, np.float32), None, lens)

    def frame(taken, scene, settings):
        number = round(float(taken.depth[0, 0, 0]) - 1.0)
        made.append(number)
        if number in dict(faults):
            raise dict(faults)[number]
        return sequence.FrameMade(TRIANGLE, REPORT, 0.1)

    monkeypatch.setattr(Recording, "read", capture)
    monkeypatch.setattr(sequence, "frame_made", frame)
    principle = type("P", (), {"sensor": "ideal"})()
    scene = KnownScene((), (), principle, None)  # type: ignore[arg-type]  # its sensor only
    rig = SequenceRig(scene, np.eye(4), np.zeros((3, 4), np.float32), None, (0,), {})
    settings = SequenceSettings(FilterSettings(use=False))
    frames = list(sequence.reconstruct_sequence(Recording("a", tuple(range(count))), rig, sequence=settings, **named))
    return frames, read, sorted(made)


def test_a_fault_of_the_program_takes_one_frame_only(monkeypatch):
    faults = {1: ZeroDivisionError("it happens"), 2: CaptureError("nobody stands there")}
    frames, _, _ = a_sequence(4, monkeypatch, faults)
    assert [frame.state for frame in frames] == ["made", "bridged", "bridged", "made"]
    assert "ZeroDivisionError: it happens" in frames[1].reason and frames[1].again
    assert frames[2].reason == "nobody stands there" and not frames[2].again


def test_what_is_there_is_not_read_again_and_bridges_what_follows(monkeypatch):
    there = Mesh(2.0 * np.eye(3), np.array([[0, 1, 2]], np.int32))
    frames, read, made = a_sequence(
        5, monkeypatch, {3: CaptureError("gone by")}, skip=lambda place: place < 3, kept=lambda place: there
    )
    assert [(frame.place, frame.state) for frame in frames] == [(3, "bridged"), (4, "made")]
    assert frames[0].mesh is there and (read, made) == ([3, 4], [3, 4])


def test_workers_give_frames_in_order(monkeypatch):
    from mirror_scan.core.cluster import ClusterError, Outcome

    class Runner:
        """Ends tasks in pairs, the second first; one is lost."""

        def run(self, function, tasks):
            held = []
            for number, arguments in enumerate(tasks):
                error = ClusterError("lost") if number == 3 else None
                held.append(Outcome(number, None if error else function(*arguments), error))
                if len(held) == 2:
                    yield from held[::-1]
                    held = []
            yield from held

    frames, _, made = a_sequence(5, monkeypatch, runner=Runner())
    assert [(frame.place, frame.state) for frame in frames] == list(
        enumerate(("made", "made", "made", "bridged", "made"))
    )
    assert frames[3].again and made == [0, 1, 2, 4]


def test_a_body_that_stays_another_is_believed_in_the_end():
    from mirror_scan.core.sequences.rig_placement import SequenceRig
    from mirror_scan.core.sequences.sequence import FrameMade, SequenceSettings, _Job, _Judge

    rig = SequenceRig(None, np.eye(4), np.zeros((2, 2)), None, (0,), {})  # type: ignore[arg-type]  # its frame only
    judge = _Judge(SequenceSettings(hold=6))
    states = []
    for place in range(16):
        report = {"mesh": REPORT["mesh"] | {"volume_l": 30.0 if place < 4 else 70.0}}
        states.append(judge.judged(_Job(place, place, made=FrameMade(TRIANGLE, report, 0.1)), rig).state)
    assert states == ["made"] * 4 + ["bridged"] * 6 + ["made"] * 6
