"""Which vertices an edge joins, as one list a vertex: for kernels that look up, add and remove edges.

Lists beat a hash table here: a vertex has about six edges. An edge set is three int32 arrays: ``head`` (V,) where each
vertex's list begins, ``after`` where it goes on, -1 at its end, and ``other`` the vertex at the edge's far end. Entries
2 k and 2 k + 1 are edge k, once for either end; the last entry of ``other`` counts edges, that of ``after`` begins the
list of those that may be used again.
"""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit


@njit(cache=True, nogil=True)
def empty_edges(vertex_count: int, room: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An edge set that holds up to ``room`` edges at a time."""
    head = np.full(vertex_count, -1, np.int32)
    after, other = np.empty(2 * room + 1, np.int32), np.empty(2 * room + 1, np.int32)
    after[-1], other[-1] = -1, 0
    return head, after, other


@njit(cache=True, nogil=True)
def join(i, j, head, after, other):
    """Add the edge i–j, which must not be there yet if it is ever to be taken away."""
    e = after[-1]
    if e >= 0:
        after[-1] = after[e]
    else:
        e = 2 * other[-1]
        other[-1] += 1
    other[e], after[e], head[i] = j, head[i], e
    other[e + 1], after[e + 1], head[j] = i, head[j], e + 1


@njit(cache=True, nogil=True)
def joined(i, j, head, after, other):
    """Whether there is an edge i–j."""
    e = head[i]
    while e >= 0:
        if other[e] == j:
            return True
        e = after[e]
    return False


@njit(cache=True, nogil=True)
def part(i, j, head, after, other):
    """Take the edge i–j away; nothing happens where there is none."""
    e = head[i]
    while e >= 0 and other[e] != j:
        e = after[e]
    if e < 0:
        return
    _unlink(i, e, head, after)
    _unlink(j, e ^ 1, head, after)
    e &= ~1
    after[e], after[-1] = after[-1], e


@njit(cache=True, nogil=True)
def _unlink(i, e, head, after):
    if head[i] == e:
        head[i] = after[e]
        return
    at = head[i]
    while after[at] != e:
        at = after[at]
    after[at] = after[e]
