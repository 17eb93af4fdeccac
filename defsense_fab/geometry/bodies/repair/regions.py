"""The parts of a surface that are to be made anew: boxes around what crosses there."""

from __future__ import annotations

import numpy as np

from ....core.arrays import Bool, Float, Int

_MARGIN = 0.08  # of a box's longest side, on each side
_LEAST = 1e-3  # of the size


def boxes_around(vertices: Float, faces: Int, bad: Bool, size: float, wider: float) -> Float:
    """Boxes (k, 2, 3) apart from each other that hold the bad triangles with a margin, `wider`
    times what is usual."""
    corners = vertices[faces[bad]]
    grown = np.stack([corners.min(1), corners.max(1)], axis=1)
    while True:
        margin = wider * np.maximum(_MARGIN * np.ptp(grown, axis=1).max(1), _LEAST * size)
        out = grown + margin[:, None, None] * np.array([[-1.0], [1.0]])
        groups = _overlapping(out)
        names = np.unique(groups)
        if len(names) == len(out):
            return np.asarray(out)
        grown = np.array(
            [[grown[groups == g, 0].min(0), grown[groups == g, 1].max(0)] for g in names]
        )


def _overlapping(boxes: Float) -> Int:
    """A number (k,) of each box: those that overlap, by others too, have the same."""
    order = np.argsort(boxes[:, 0, 0], kind="stable")
    group = np.arange(len(boxes))

    def root(i: int) -> int:
        while group[i] != i:
            group[i] = group[group[i]]
            i = int(group[i])
        return i

    starts, highs = boxes[order, 0], boxes[order, 1]
    for i in range(len(order)):
        until = int(np.searchsorted(starts[:, 0], highs[i, 0], side="right"))
        near = np.arange(i + 1, until)
        near = near[
            (starts[near, 1] <= highs[i, 1])
            & (highs[near, 1] >= starts[i, 1])
            & (starts[near, 2] <= highs[i, 2])
            & (highs[near, 2] >= starts[i, 2])
        ]
        for j in near:
            group[root(int(order[j]))] = root(int(order[i]))
    return np.array([root(i) for i in range(len(boxes))])
