"""Which view each triangle's colours are taken from, and how views pass into each other at their borders."""

from __future__ import annotations

import numpy as np

from .visibility import Seen

_ROUNDS = 8
_LOYALTY = 0.35  # by how much a view is worth more where a triangle's three neighbours take it


def choose_views(seen: Seen, triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """The view (T,) int64 that shows each triangle best; -1 where none shows all its corners.

    Borders between views run where both are as good, and straight: a view is worth a little more where the neighbours
    take it (iterated conditional modes, Besag 1986).
    """
    score = seen.score[triangles]
    score = np.where((score > 0).all(axis=1), score.mean(axis=1), 0.0)
    neighbour = np.where(twin >= 0, twin // 3, np.arange(len(twin)) // 3).reshape(-1, 3)
    for _ in range(3):  # borders follow the body, not its triangles
        around = (score[neighbour] > 0) * score[neighbour]
        score = np.where(score > 0, 0.25 * score + 0.25 * around.sum(axis=1), 0.0)
    label = np.where(score.max(axis=1) > 0, score.argmax(axis=1), -1)
    views = np.arange(score.shape[1])
    for _ in range(_ROUNDS):
        alike = (label[neighbour][:, :, None] == views).mean(axis=1)
        worth = score * (1.0 + _LOYALTY * alike)
        new = np.where(score.max(axis=1) > 0, worth.argmax(axis=1), -1)
        if (new == label).all():
            break
        label = new
    return label


def view_weights(label: np.ndarray, seen: Seen, triangles: np.ndarray) -> np.ndarray:
    """Share (V, K + 1) float32 of each view at each vertex, the last of filled skin; rows sum to 1.

    That of the triangles around it that take the view, and none of views that do not show it: views pass into each
    other within the triangles along their border.
    """
    count, views = seen.score.shape
    weight = np.zeros((count, views + 1))
    taken = np.where(label < 0, views, label)
    for k in range(3):
        weight += np.bincount(triangles[:, k] * (views + 1) + taken, minlength=count * (views + 1)).reshape(
            count, views + 1
        )
    weight[:, :views][seen.score <= 0] = 0.0
    weight[weight.sum(axis=1) == 0, views] = 1.0
    return (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)
