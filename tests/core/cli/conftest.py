"""A small capture, and a pipeline that answers at once, for the tests of the command line."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import HEIGHT, PICKS, TETRAHEDRON, WIDTH, intrinsic, write_json
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.io.images import write_png


@pytest.fixture
def folder(tmp_path):
    """A small capture of a flat wall, with one mirror's picks."""
    path = tmp_path / "scan"
    (path / "depth").mkdir(parents=True)
    write_png(path / "depth" / "000000.png", np.full((HEIGHT, WIDTH), 2000, np.uint16))
    write_json(path / "intrinsic.json", intrinsic())
    write_json(path / "mirrors.json", {"mirrors": [{"name": "right", "frame_pixels": PICKS}]})
    return path


@pytest.fixture
def pipeline(monkeypatch):
    """Stands in for the reconstruction, to look at what the command line does with its answer or its error."""
    from mirror_scan.core import pipeline

    def reconstruct(capture, mirrors=None, settings=None, progress=None, frame="avatar"):
        if mirrors:
            raise ReconstructionError("nobody stands\nbetween camera and mirrors")
        report = {
            "mesh": {"vertices": 4, "triangles": 4, "watertight": True, "height_m": 1.0, "volume_l": 166.7},
            "timings_ms": {"total": 1.5},
            "frames": len(capture.depth),
            "quality": float("nan"),
        }
        return pipeline.Reconstruction(TETRAHEDRON, frame, np.eye(4), report, ("the left mirror shows nobody",))

    monkeypatch.setattr(pipeline, "reconstruct", reconstruct, raising=False)
