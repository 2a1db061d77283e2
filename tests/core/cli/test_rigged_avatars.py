"""``dress`` on the command line, without Blender: garments in the file, kept by ``animate``, replaced if made again."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.avatar.avatar_file import Avatar, read_avatar, write_avatar
from mirror_scan.core.avatar.skin_weights import skin_weights
from mirror_scan.core.clothes import KINDS
from standing_body import standing_body


@pytest.fixture(scope="module")
def avatar(tmp_path_factory):
    """A mannequin's file."""
    mesh, skeleton = standing_body(resolution=0.02)
    path = tmp_path_factory.mktemp("avatar") / "avatar.glb"
    write_avatar(path, Avatar(mesh, skeleton, skin_weights(mesh, skeleton)))
    return path


def test_every_garment_can_be_asked_for():
    from mirror_scan.core.cli.parser import GARMENTS

    assert tuple(KINDS) == GARMENTS


def test_a_dressed_avatar_moves_with_its_garments(avatar, tmp_path, capsys):
    dressed, moving, again = (tmp_path / name for name in ("dressed.glb", "moving.glb", "again.glb"))
    assert cli.main(["dress", str(avatar), "skirt", "tshirt", "-o", str(dressed), "--ease", "12"]) == 0
    told = capsys.readouterr().out
    assert "Skirt" in told and "T-Shirt" in told and str(dressed) in told
    before, after = read_avatar(avatar), read_avatar(dressed)
    assert [garment.name for garment in after.garments] == ["Skirt", "T-Shirt"]
    np.testing.assert_array_equal(after.mesh.vertices, before.mesh.vertices)
    assert cli.main(["animate", str(dressed), "walk", "-o", str(moving)]) == 0
    kept = read_avatar(moving)
    assert len(kept.clips) == 1 and [garment.name for garment in kept.garments] == ["Skirt", "T-Shirt"]
    assert cli.main(["dress", str(moving), "skirt", "-o", str(again), "--ease", "30", "--quiet"]) == 0
    redone = read_avatar(again)
    assert sorted(garment.name for garment in redone.garments) == ["Skirt", "T-Shirt"] and len(redone.clips) == 1
    widths = [np.ptp(next(g for g in a.garments if g.name == "Skirt").mesh.vertices[:, 0]) for a in (kept, redone)]
    assert widths[1] > widths[0] + 0.02


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["skirt", "skirt", "-o", "out.glb"], "asked for twice"),
        (["skirt", "-o", "out.ply"], "garments go into"),
        (["skirt", "-o", "out.blend"], "Blender"),
    ],
)
def test_what_cannot_be_is_refused(avatar, words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["dress", str(avatar), *words]) == 1
    assert told in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_mesh_without_skeleton_is_refused(tmp_path, capsys):
    mesh, _ = standing_body(resolution=0.02)
    bare = tmp_path / "bare.glb"
    write_avatar(bare, Avatar(mesh))
    assert cli.main(["dress", str(bare), "skirt", "-o", str(tmp_path / "out.glb")]) == 1
    assert "has no skeleton" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["cape"], ["skirt", "--ease", "500"]])
def test_unknown_garments_and_eases_are_refused_by_the_parser(avatar, words, tmp_path, capsys):
    assert cli.main(["dress", str(avatar), *words, "-o", str(tmp_path / "out.glb")]) == 2
    assert capsys.readouterr().err
