"""A generated corpus through each surface method: how often it succeeds, its accuracy, and where a peer is better.

On its own: ``python -m benchmarks.corpus [--scenes 0-9,15] [--quick] [--ours] [--pictures DIR]``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.mesh.surface_distance import evaluate
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.pipeline import Reconstruction, reconstruct
from mirror_scan.core.preview.mesh_views import KIND_COLORS, render_views

from .bridge import BLENDER, blender_bridge
from .generated import QUICK, SCENES, Recipe, make, recipes
from .isolated import PeerFailed, Worker
from .machine import installed, say
from .peers import BALLS, MESHLAB, OPEN3D, meshlab_balls, meshlab_poisson, open3d_poisson
from .quality import CORE, OURS, oriented_points, scorer
from .results import Finding, Result, Table, limits_table, number

PEERS = (OPEN3D, MESHLAB, BALLS, BLENDER)
SAMPLES = 20_000
CHECKED = 3
"""Scenes whose scores are held against the scoring tool's."""
MAX_CROSSING_PCT, MAX_VOLUME_PCT, MIN_SHARE_PCT = 0.1, 6.0, 90.0
UPRIGHT = ("A-pose", "arms down")
"""Poses whose volume is limited: nothing of them has to be hidden from two mirrors."""
FIGURES = {
    f"{side}_{what}": f"{word} {what}"
    for side, word in (("accuracy", "accuracy"), ("complete", "completeness"))
    for what in ("mean", "p95", "max")
}
MEANS = ("accuracy_mean", "complete_mean")
TAILS = tuple(key for key in FIGURES if key not in MEANS)
DIRECTIONS = ((0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0.7, 0.7, 0), (-0.7, 0.7, 0))
"""Front, left, back, right, and the two sides of the back."""
PANEL = (150, 240)
SHEET = 8
"""Scenes on one picture."""


@dataclass(frozen=True)
class Outcome:
    """What one method made of a scene: :func:`.surface_distance.evaluate`'s ``score`` and
    :func:`.soundness.mesh_report`'s ``sound``.

    ``crossing``: faces that run through others, by MeshLab, which ``../shared/tools/score.py`` asks; by core's own
    count where it is not installed.
    """

    score: dict
    sound: dict
    crossing: int
    milliseconds: float

    @property
    def crossing_pct(self) -> float:
        return 100.0 * self.crossing / max(1, self.score["faces"])

    @property
    def outward(self) -> bool:
        return self.sound["watertight"] and self.sound["volume_m3"] > 0


_worker = Worker()
Outcomes = dict[str, Outcome | str]
"""Method → what it made, or in words why it made nothing."""


# --- one scene -------------------------------------------------------------------------------------------------------


def measure(recipe: Recipe, peers: bool = True) -> tuple[Outcomes, Reconstruction | None, Mesh]:
    """Every method's outcome, our reconstruction for its picture, and the true body, camera frame."""
    scene = make(recipe)
    truth = scene.truth.body
    try:
        scan = reconstruct(scene.capture, frame="camera")
    except MirrorScanError as error:
        return {OURS: str(error)}, None, truth
    laps = scan.report["timings_ms"]
    outcomes: Outcomes = {OURS: _outcome(scan.mesh, truth, laps["zippering"] + laps["closing"])}
    if peers:
        points, normals = oriented_points(scan)
        calls = {
            OPEN3D: lambda: _worker.call(_open3d, points, normals) if installed("open3d") else None,
            MESHLAB: lambda: _worker.call(meshlab_poisson, points, normals) if installed("pymeshlab") else None,
            BALLS: lambda: _worker.call(meshlab_balls, points, normals) if installed("pymeshlab") else None,
            BLENDER: lambda: blender_bridge(merge(list(scan.patches))),
        }
        for name, call in calls.items():
            try:
                made = call()
            except PeerFailed as error:
                outcomes[name] = str(error)
                continue
            if made is not None:
                outcomes[name] = _outcome(made[0], truth, made[1])
    return outcomes, scan, truth


def _open3d(points: np.ndarray, normals: np.ndarray) -> tuple[Mesh, float]:
    return open3d_poisson(points, normals)[0]


def _outcome(mesh: Mesh, truth: Mesh, milliseconds: float) -> Outcome | str:
    if not len(mesh.triangles):
        return "no surface"
    try:
        score = evaluate(mesh, truth, samples=SAMPLES)
    except MirrorScanError as error:
        return str(error)
    sound = mesh_report(mesh)
    return Outcome(score, sound, _crossing(mesh, sound), milliseconds)


def _crossing(mesh: Mesh, sound: dict) -> int:
    if not installed("pymeshlab"):
        return sound["self_intersections"]
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.triangles))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


# --- all of them -----------------------------------------------------------------------------------------------------


def run(
    numbers: tuple[int, ...] | None = None, quick: bool = False, peers: bool = True, pictures: Path | None = None
) -> Result:
    """The scenes numbered, the quick choice, or all; each is reported as it comes."""
    numbers = numbers or (QUICK if quick else tuple(range(SCENES)))
    done: list[tuple[Recipe, Outcomes]] = []
    panels: list[np.ndarray] = []
    tool, name = scorer(SAMPLES)
    deviations: list[float] = []
    for recipe in recipes(numbers):
        outcomes, scan, truth = measure(recipe, peers)
        done.append((recipe, outcomes))
        say(f"corpus: {recipe}\n        " + "; ".join(_brief(method, found) for method, found in outcomes.items()))
        if scan is not None and name != CORE and len(deviations) < CHECKED:
            theirs, ours = tool(scan.mesh, truth), outcomes[OURS].score
            deviations.append(max(abs(ours[key] / theirs[key] - 1) for key in MEANS))
        if pictures is not None:
            panels.append(_panel(recipe, scan))
            if len(panels) % SHEET == 0 or len(done) == len(numbers):
                pictures.mkdir(parents=True, exist_ok=True)
                first = (len(panels) - 1) // SHEET * SHEET
                write_png(pictures / f"corpus_{first // SHEET + 1:02d}.png", np.concatenate(panels[first:]))
    tables = [_soundness(done), _distances(done), _by_kind(done), _nearer(done)]
    tables[1].notes += [
        f"Mean distances within {100 * max(deviations):.1f} % of {name}'s in the first {len(deviations)} scenes."
        if deviations
        else "No ../shared/tools/score.py to check the distances against."
    ]
    return Result(tables, _findings(done, peers))


def _brief(method: str, found: Outcome | str) -> str:
    if isinstance(found, str):
        return f"{method}: {found}"
    s = found.score
    flaws = [word for word, flawed in (("open", not s["watertight"]), ("not manifold", not found.sound["manifold"]),
                                       (f"{s['components']} pieces", s["components"] != 1)) if flawed]  # fmt: skip
    volume = "" if s["volume_error_pct"] is None else f" vol {s['volume_error_pct']:+.1f} %"
    return (
        f"{method} {s['accuracy_mean']:.2f}/{s['complete_mean']:.2f} max {s['accuracy_max']:.0f}/"
        f"{s['complete_max']:.0f} mm{volume} crossing {found.crossing_pct:.2f} %" + "".join(f", {f}" for f in flaws)
    )


Done = list[tuple[Recipe, Outcomes]]


def _made(done: Done, method: str) -> list[tuple[Recipe, Outcome]]:
    return [(r, found[method]) for r, found in done if isinstance(found.get(method), Outcome)]


def _tried(done: Done, method: str) -> bool:
    return any(method in found for _, found in done)


def _share(flags: Iterable[bool]) -> str:
    flags = list(flags)
    return f"{100 * sum(flags) / len(flags):.0f} %" if flags else "–"


def _soundness(done: Done) -> Table:
    table = Table(
        f"Corpus of {len(done)} scenes: soundness",
        ("surface by", "failed", "watertight", "manifold", "outward", "one component", "crossing faces: median %",
         "worst %", "by core: worst %", "volume error: median %", "worst %"),
    )  # fmt: skip
    for method in (OURS, *PEERS):
        made = _made(done, method)
        if not made:
            table.rows.append((method, "not run", *["–"] * (len(table.columns) - 2)))
            continue
        failed = sum(method in found for _, found in done) - len(made)
        outcomes = [o for _, o in made]
        upright = [abs(o.score["volume_error_pct"]) for r, o in made
                   if r.pose in UPRIGHT and o.score["volume_error_pct"] is not None]  # fmt: skip
        shares = [
            _share(bool(flag(o)) for o in outcomes)
            for flag in (lambda o: o.score["watertight"], lambda o: o.sound["manifold"], lambda o: o.outward,
                         lambda o: o.score["components"] == 1)
        ]  # fmt: skip
        core = max(100.0 * o.sound["self_intersections"] / o.score["faces"] for o in outcomes)
        crossing = [o.crossing_pct for o in outcomes]
        table.rows.append((
            method, str(failed), *shares, number(median(crossing), 3), number(max(crossing), 2), number(core, 2),
            number(median(upright), 1) if upright else "–", number(max(upright), 1) if upright else "–",
        ))  # fmt: skip
    table.notes = [
        "Virtual snapshots of people, a statue and mannequins in varied proportions and poses (A-pose, arms down, arms "
        "forward, a step), 1.52 to 1.88 m, with each sensor, bursts of 1 to 30, with and without interference, one to "
        "three mirrors at 100 to 130° (a third 32° behind one of them), camera tilted and rolled; seeded.",
        "Mirrors are given by eight picks on each frame, off by up to 0.7 px; the true planes are not used.",
        "Three mirrors come without interference: the back is lit three times, and almost nothing could be read.",
        f"Volume error: of what is watertight, {' and '.join(UPRIGHT)}, one mirror included.",
        "Crossing faces as MeshLab counts them, which takes triangles beside each other in one plane, as on soles, for "
        "crossing; and as core does.",
    ]
    return table


def _distances(done: Done) -> Table:
    table = Table(
        f"Corpus of {len(done)} scenes: medians of distances [mm]",
        ("surface by", *FIGURES.values(), "ours nearer: accuracy", "completeness", "both", "ms"),
    )
    for method in (OURS, *PEERS):
        made = _made(done, method)
        if not made:
            table.rows.append((method, "not run", *["–"] * (len(table.columns) - 2)))
            continue
        cells = [number(median(o.score[key] for _, o in made), 2 if key in MEANS else 1) for key in FIGURES]
        wins = ["", "", ""] if method == OURS else [_share(w) for w in _wins(done, method)]
        table.rows.append((method, *cells, *wins, number(median(o.milliseconds for _, o in made), 0)))
    table.notes = [
        "All methods get the same patches, with overlaps cut and in place: Poisson and ball pivoting their points and "
        "normals, Blender the patches, of which the runs nearest to each other are bridged and the rest is filled.",
        f"By core.mesh.surface_distance.evaluate with {SAMPLES} samples, after a small rigid alignment of each.",
        "Ours nearer: share of scenes in which the mean distance is smaller; where a method failed it lost.",
        "ms: the surface step alone, one cold run each; ours is zippering + closing.",
        f"All {SCENES} scenes take about 15 minutes on two free cores, most of it the peers' and the scoring.",
    ]
    return table


def _wins(done: Done, peer: str) -> list[list[bool]]:
    """For accuracy, completeness and both: in each scene that the peer was run on, whether ours is nearer."""
    rows = []
    for _, found in done:
        if peer not in found:
            continue
        ours, other = found[OURS], found[peer]
        if isinstance(ours, str) or isinstance(other, str):
            rows.append([isinstance(other, str) and not isinstance(ours, str)] * 2)
        else:
            rows.append([ours.score[key] <= other.score[key] for key in MEANS])
    return [[row[0] for row in rows], [row[1] for row in rows], [all(row) for row in rows]]


def _by_kind(done: Done) -> Table:
    """Ours, by what makes scenes differ."""
    table = Table(
        "Corpus: ours by kind of scene, medians [mm]", ("scenes", "number", *FIGURES.values(), "volume error %")
    )
    kinds: dict[str, Callable[[Recipe], object]] = {
        "": lambda r: r.rig.sensor, "mirrors": lambda r: r.mirrors, " ": lambda r: r.pose,
    }  # fmt: skip
    for word, kind in kinds.items():
        for value in sorted({kind(r) for r, _ in done}):
            made = [o for r, o in _made(done, OURS) if kind(r) == value]
            if made:
                cells = [number(median(o.score[key] for o in made), 2 if key in MEANS else 1) for key in FIGURES]
                volumes = [abs(o.score["volume_error_pct"]) for o in made if o.score["volume_error_pct"] is not None]
                table.rows.append((f"{value} {word}".strip(), str(len(made)), *cells,
                                   number(median(volumes), 1) if volumes else "–"))  # fmt: skip
    return table


def _nearer(done: Done) -> Table:
    columns = ("scene", "peer", "figure", "ours", "peer's", "but")
    table = Table("Corpus: scenes in which a peer's mean is smaller", columns, left=3)
    for recipe, found in done:
        ours = found[OURS]
        for peer in PEERS:
            other = found.get(peer)
            if not isinstance(ours, Outcome) or not isinstance(other, Outcome):
                continue
            for key in MEANS:
                if other.score[key] < ours.score[key]:
                    table.rows.append((str(recipe), peer, FIGURES[key], number(ours.score[key]),
                                       number(other.score[key]), _flaws(other)))  # fmt: skip
    if not table.rows:
        table.rows.append(("none", *["–"] * (len(table.columns) - 1)))
    table.notes = [
        "A surface with holes, pieces or layers through each other can lie nearer: what is left open cannot be wrong, "
        "and of two layers that disagree, as where a mirror is misplaced, one is often the nearer to the truth. Ours "
        "keeps one and closes it. The last column says what is the matter with the peer's.",
    ]
    return table


def _flaws(found: Outcome) -> str:
    s = found.score
    flaws = [f"{s['boundary_edges']} open edges"] if s["boundary_edges"] else []
    flaws += [f"{s['components']} components"] if s["components"] != 1 else []
    flaws += [f"{found.crossing_pct:.1f} % crossing"] if found.crossing_pct > MAX_CROSSING_PCT else []
    return ", ".join(flaws) or "it is sound"


def _findings(done: Done, peers: bool) -> list[Finding]:
    total = len(done)
    ours = _made(done, OURS)
    lost = [r.name for r, found in done if isinstance(found[OURS], str)]

    def every(limit: str, holds: Callable[[Outcome], bool]) -> Finding:
        bad = sorted([r.name for r, o in ours if not holds(o)] + lost)
        return Finding(f"corpus: {limit}", f"not {', '.join(bad)}" if bad else f"all {total}", not bad)

    def below(limit: str, among: list, value: Callable[[Outcome], float], most: float) -> Finding:
        top = max((value(o) for _, o in among), default=0.0)
        bad = [f"{r.name} {value(o):.2f}" for r, o in among if value(o) > most] + [f"{name} failed" for name in lost]
        text = f"worst {top:.2f} %" + (f": {', '.join(bad)}" if bad else "")
        return Finding(f"corpus: {limit} <= {most:g} %", text, not bad)

    def volume(outcome: Outcome) -> float:
        error = outcome.score["volume_error_pct"]
        return 100.0 if error is None else abs(error)

    upright = [(r, o) for r, o in ours if r.pose in UPRIGHT]
    found = [
        every("no crash", lambda o: True),
        every("watertight", lambda o: o.score["watertight"]),
        every("2-manifold", lambda o: o.sound["manifold"]),
        every("outward", lambda o: o.outward),
        every("one component", lambda o: o.score["components"] == 1),
        below("self-intersecting faces", ours, lambda o: o.crossing_pct, MAX_CROSSING_PCT),
        below(f"volume error, {' and '.join(UPRIGHT)},", upright, volume, MAX_VOLUME_PCT),
    ]
    for peer in PEERS if peers else ():
        other = _made(done, peer)
        if not ours or not other:
            found.append(Finding(f"corpus: nearer than {peer}", f"{peer} was not run", None))
            continue
        for what, keys in (("mean accuracy, completeness", MEANS), ("their p95 and max", TAILS)):
            pairs = [[median(o.score[key] for _, o in made) for made in (ours, other)] for key in keys]
            text = ", ".join(f"{a:.2f} / {b:.2f}" for a, b in pairs)
            found.append(Finding(f"corpus, median: {what} <= {peer}", f"{text} mm", all(a <= b for a, b in pairs)))
        accurate, complete, _ = _wins(done, peer)
        shares = [100.0 * sum(w) / len(w) for w in (accurate, complete)]
        text = f"accuracy {shares[0]:.0f} %, completeness {shares[1]:.0f} %"
        limit = f"corpus: nearer than {peer} in >= {MIN_SHARE_PCT:g} % of scenes"
        found.append(Finding(limit, text, min(shares) >= MIN_SHARE_PCT))
    return found


# --- pictures --------------------------------------------------------------------------------------------------------


def _panel(recipe: Recipe, scan: Reconstruction | None) -> np.ndarray:
    """One scene's sides beside each other, by kind of surface, with its description where Pillow is installed."""
    width, height = PANEL
    picture = np.full((height, width * len(DIRECTIONS), 3), 255, np.uint8)
    if scan is not None:
        colors = np.array([KIND_COLORS[kind] for kind in (SURFACE, SEAM, FILL)], np.uint8)[scan.mesh.kind]
        picture = render_views(scan.mesh.transformed(scan.camera_to_avatar), colors, DIRECTIONS, width, height)
    if not installed("PIL"):
        return picture
    from PIL import Image, ImageDraw

    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text((6, 3), str(recipe) + ("" if scan else ": FAILED"), fill=(0, 0, 0))
    return np.array(image)


# --- command line ----------------------------------------------------------------------------------------------------


def scene_numbers(text: str) -> tuple[int, ...]:
    """``"0-3,7"`` → (0, 1, 2, 3, 7)."""
    numbers: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    if not all(0 <= n < SCENES for n in numbers):
        raise argparse.ArgumentTypeError(f"scenes are numbered 0 to {SCENES - 1}")
    return tuple(numbers)


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.corpus", description="The generated corpus alone.")
    parser.add_argument("--scenes", type=scene_numbers, metavar="0-9,15", help="these only")
    parser.add_argument("--quick", action="store_true", help=f"{len(QUICK)} scenes")
    parser.add_argument("--ours", action="store_true", help="without the peers")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write sheets of all results there")
    options = parser.parse_args()
    result = run(options.scenes, options.quick, not options.ours, options.pictures)
    for table in (*result.tables, limits_table(result.findings)):
        print(f"\n{table.text()}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
