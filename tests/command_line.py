"""What tests of the command line share: a small capture's parts, and how a refusal looks."""

from __future__ import annotations

import json
import re

import numpy as np
from mirror_scan.core import cli
from mirror_scan.core.mesh import Mesh

WIDTH, HEIGHT = 64, 48
PICKS = [[5, 5], [5, 40], [20, 22]]
TETRAHEDRON = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
)


def intrinsic(fx=60.0, width=WIDTH):
    return {"width": width, "height": HEIGHT, "intrinsic_matrix": [fx, 0, 0, 0, 60, 0, 31.5, 23.5, 1]}


def write_json(path, content):
    path.write_text(json.dumps(content))


def refused(capsys, arguments, words):
    """The command ends with 1, says one line on stderr and nothing on stdout."""
    assert cli.main([str(a) for a in arguments]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"error: [^\n]+\n", err), err
    assert re.search(words, err), err


def listing(path):
    return sorted((p.relative_to(path), p.stat().st_mtime_ns) for p in path.rglob("*") if p.is_file())


def remove(folder, name):
    (folder / name).unlink()
