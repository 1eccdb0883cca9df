"""The nearest of many points that lie about evenly on a surface.

In a grid whose cells are about two points wide they are all in the cells around, found in one walk
along the sorted cells. Where they are not, or a cell is crowded, a k-d tree is asked, which takes
more than twice as long.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..blocks import blocks, in_pieces, places, resting, room, taken
from ..jit import kernel

WIDE = 1.7
"""A cell's side, in distances between a point and its fourth nearest (the median of some)."""
ASKED = 5000
CROWDED = 400
"""Points in the cells around one, from which on the tree is asked."""
MOST_CELLS = 2**62
PLANTED = 1 << 22
"""Points of a tree at most: of more, several are asked one after the other."""


def tree_of(position: np.ndarray) -> cKDTree:
    """A k-d tree that is built fast."""
    return cKDTree(position, balanced_tree=False, compact_nodes=False)


def nearest_to(asked: np.ndarray, position: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """The k nearest of the points (T, 3) to each asked (n, 3), by rising distance; k ≤ T.

    Returns distances (n, k) float and indices (n, k).
    """
    far: np.ndarray = np.empty((len(asked), 0))
    those: np.ndarray = np.empty((len(asked), 0), np.int64)
    for own in blocks(len(position), PLANTED):
        away, index = tree_of(position[own]).query(asked, k=np.arange(1, k + 1), workers=-1)
        far, those = np.hstack([far, away]), np.hstack([those, index + own.start])
        if far.shape[1] > k:
            order = np.argsort(far, axis=1, kind="stable")[:, :k]
            far, those = (np.take_along_axis(each, order, 1) for each in (far, those))
    return far, those


def nearest(position: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """The k nearest of each point (T, 3), itself among them, by rising distance; k ≤ T.

    Returns distances (T, k) float32 and indices (T, k) int32.
    """
    distance, index = room((len(position), k), np.float32), room((len(position), k), np.int32)
    some = position[:: 1 + len(position) // ASKED]
    tree = tree_of(position) if len(position) <= PLANTED else None

    def ask(asked: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        if tree is None:
            return nearest_to(asked, position, count)
        return tree.query(asked, k=np.arange(1, count + 1), workers=-1)

    wide = WIDE * float(np.median(ask(some, min(5, len(position)))[0][:, -1]))
    unsure = np.ones(len(position), bool)
    if wide > 0:
        _from_grid(position, wide, distance, index, unsure)
    left = np.flatnonzero(unsure)
    if len(left):
        distance[left], index[left] = ask(position[left], k)
    return distance, index


def _from_grid(
    position: np.ndarray, wide: float, distance: np.ndarray, index: np.ndarray, unsure: np.ndarray
) -> None:
    low, high = (f(0).astype(np.float64) for f in (position.min, position.max))
    extent = np.floor((high - low) / wide) + 3
    if np.prod(extent) > MOST_CELLS:
        return
    _, rows, columns = extent.astype(np.int64)
    key = room(len(position), np.int64)
    for own in blocks(len(position)):
        x, y, z = (np.floor((position[own] - low) / wide) + 1).astype(np.int64).T
        key[own] = (x * rows + y) * columns + z
    order = resting(np.argsort(key, kind="stable"))
    key = taken(key, order)
    starts = 1 + places(np.append(key[1:] != key[:-1], True))
    cells, starts = key[starts - 1], np.append(0, starts)
    around = np.array([(i * rows + j) * columns for i in (0, -1, 1) for j in (0, -1, 1)])
    points = room((len(position), 3), np.float64)
    for own in blocks(len(position)):
        points[own] = position[order[own]]

    def walk(first: int, stop: int) -> None:
        _walk(
            first, stop, points, order, cells, starts, around, wide * wide, distance, index, unsure
        )

    in_pieces(walk, len(cells))


@kernel
def _walk(first, stop, points, order, cells, starts, around, reach, distance, index, unsure):
    """The nearest of the points in the cells first..stop.

    points : (T, 3), cell by cell; cells : (C,), ascending; starts : (C + 1,), of their points
    around : (9,), from a cell to the middles of nine columns of three cells; reach : a cell's
        side, squared: nothing beyond those columns is nearer
    """
    k, rows = distance.shape[1], len(around)
    low, high = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
    least, own = np.empty(k), np.empty(k, np.int64)
    for r in range(rows):
        if first < stop:
            low[r] = high[r] = np.searchsorted(cells, cells[first] + around[r] - 1)
    for c in range(first, stop):
        count = 0
        for r in range(rows):
            while low[r] < len(cells) and cells[low[r]] < cells[c] + around[r] - 1:
                low[r] += 1
            high[r] = max(high[r], low[r])
            while high[r] < len(cells) and cells[high[r]] <= cells[c] + around[r] + 1:
                high[r] += 1
            count += starts[high[r]] - starts[low[r]]
        if count < k or count > CROWDED:
            continue
        for i in range(starts[c], starts[c + 1]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            for n in range(k):
                least[n] = np.inf
            for r in range(rows):
                for j in range(starts[low[r]], starts[high[r]]):
                    a, b, d = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                    away = a * a + b * b + d * d
                    if away < least[k - 1]:
                        n = k - 1
                        while n > 0 and least[n - 1] > away:
                            least[n], own[n] = least[n - 1], own[n - 1]
                            n -= 1
                        least[n], own[n] = away, j
            if least[k - 1] <= reach:
                t = order[i]
                unsure[t] = False
                for n in range(k):
                    distance[t, n], index[t, n] = np.sqrt(least[n]), order[own[n]]
