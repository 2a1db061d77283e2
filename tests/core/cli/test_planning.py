"""``plan`` refuses what cannot be planned, in one line, before anything is written."""

import pytest
from mirror_scan.core.cli.program import main


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--room", "1.6x1.9x2.4"], 1, "too small"),
        (["--room", "3x3.5"], 2, "is not 3 lengths in metres"),
        (["--room", "small", "--mirrors", "0.8"], 2, "is not 2 lengths in metres"),
        (["--room", "small", "--frame", "2"], 1, "no width of a frame"),
    ],
)
def test_bad_rooms_and_mirrors_are_refused(arguments, code, text, tmp_path, capsys) -> None:
    folder = tmp_path / "plan"
    with pytest.raises(SystemExit) as raised:
        raise SystemExit(main(["plan", *arguments, "--quiet", "-o", str(folder)]))
    said = capsys.readouterr().err
    assert raised.value.code == code and text in said and not folder.exists()
    assert code == 2 or said.count("\n") == 1
