"""Blender's Bridge Edge Loops and Fill Holes on our patches: what is done without a zipper, to compare with.

Used by the benchmarks and by ``mirror-scan experiment zippering``; no part of making an avatar.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import bmesh
import bpy
import numpy as np
from mathutils.kdtree import KDTree

from ..core.mesh import Mesh
from ..core.mesh.boundary_loops import boundary_loops

REACH = 0.2
"""Widest gap that is bridged [m]: as wide as the zipper goes."""
SHORTEST = 6
"""Vertices: a shorter run is left to Fill Holes."""
EVEN = 3
"""Vertices to either side among which the most frequent neighbour counts, so that single ones do not part a run."""


Run = list[int]


def bridge_and_fill(mesh: Mesh, pairs: list[tuple[Run, Run]] | None = None) -> Mesh:
    """Close patches with Blender's tools, selecting what a careful user would.

    Two runs of boundary edges at a time, on two patches each of which is the other's nearest there, are bridged
    (``bridge_loops``, that is Bridge Edge Loops); what is then open is filled, whatever its size (``holes_fill``, that
    is Fill Holes), triangulated, and normals are recalculated outside.

    Parameters
    ----------
    mesh : Mesh
        Patches beside each other, told apart by ``view``; every vertex with one fan.
    pairs : list of (run, run), optional
        What is bridged with what; by default :func:`facing_runs`.

    Returns
    -------
    Mesh
        Triangles alone; not always closed.
    """
    if pairs is None:
        pairs = facing_runs(mesh)
    held = bpy.data.meshes.new("mirror_scan_bridging")
    work = bmesh.new()
    try:
        held.from_pydata(mesh.vertices, (), mesh.triangles)
        work.from_mesh(held)
        work.verts.ensure_lookup_table()
        for pair in pairs:
            edges = [work.edges.get((work.verts[i], work.verts[j])) for run in pair for i, j in pairwise(run)]
            try:
                bmesh.ops.bridge_loops(work, edges=edges)
            except RuntimeError:  # Blender sees no two loops in them: left to Fill Holes, as its user would
                continue
        bmesh.ops.holes_fill(work, edges=[edge for edge in work.edges if edge.is_boundary], sides=0)
        bmesh.ops.triangulate(work, faces=[face for face in work.faces if len(face.verts) > 3])
        bmesh.ops.recalc_face_normals(work, faces=work.faces[:])
        work.to_mesh(held)
        vertices = np.empty(3 * len(held.vertices), np.float32)
        triangles = np.empty(3 * len(held.polygons), np.int32)
        held.vertices.foreach_get("co", vertices)
        held.loops.foreach_get("vertex_index", triangles)
    finally:
        work.free()
        bpy.data.meshes.remove(held)
    return Mesh(vertices.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3))


def facing_runs(mesh: Mesh, reach: float = REACH) -> list[tuple[Run, Run]]:
    """Pairs of runs of boundary vertices on two patches, each nearest to the other one, longest first.

    Every boundary edge is in one run at most.
    """
    loops = [loop.tolist() for loop in boundary_loops(mesh.triangles, len(mesh.vertices))]
    if not loops:
        return []
    points, view = mesh.vertices.tolist(), mesh.view.tolist()
    trees: dict[int, KDTree] = {}
    for patch in sorted(set(view)):
        rim = [i for loop in loops for i in loop if view[i] == patch]
        trees[patch] = KDTree(len(rim))
        for i in rim:
            trees[patch].insert(points[i], i)
        trees[patch].balance()
    nearest: dict[int, int] = {}
    for i in (i for loop in loops for i in loop):
        found = [trees[patch].find(points[i]) for patch in trees if patch != view[i]]
        found = [(distance, j) for _, j, distance in found if j is not None and distance <= reach]
        if found:
            nearest[i] = min(found)[1]
    runs: list[Run] = []
    for loop in loops:
        runs += _runs(loop, [view[nearest[i]] if i in nearest else -1 for i in loop])
    of_vertex = {i: number for number, run in enumerate(runs) for i in run}
    # the run most of a run's vertices are nearest to; pairs that choose each other are bridged
    choice = {}
    for number, run in enumerate(runs):
        votes = Counter(of_vertex[nearest[i]] for i in run if nearest.get(i) in of_vertex)
        if votes:
            choice[number] = min(votes, key=lambda other: (-votes[other], other))
    mutual = [(a, b) for a, b in choice.items() if choice.get(b) == a and a < b]
    mutual.sort(key=lambda pair: -len(runs[pair[0]]) - len(runs[pair[1]]))
    return [(runs[a], runs[b]) for a, b in mutual]


def _runs(loop: Run, target: list[int]) -> list[Run]:
    """Parts of a loop along which the nearest patch is the same; a whole loop comes closed, its first vertex twice."""
    count = len(loop)
    even = [Counter(target[(k + d) % count] for d in range(-EVEN, EVEN + 1)).most_common(1)[0][0] for k in range(count)]
    if len(set(even)) == 1:
        return [[*loop, loop[0]]] if even[0] >= 0 and count >= SHORTEST else []
    first = next(k for k in range(count) if even[k] != even[k - 1])
    runs, run = [], []
    for k in range(first, first + count):
        if run and even[k % count] != even[(k - 1) % count]:
            runs.append((even[(k - 1) % count], run))
            run = []
        run.append(loop[k % count])
    runs.append((even[first - 1], run))
    return [run for patch, run in runs if patch >= 0 and len(run) >= SHORTEST]
