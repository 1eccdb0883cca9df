"""Which texels touch on the surface, whatever the charts of the texture cut apart.

neighbours   the graph as CSR          pieces, components   its connected parts
spacing      how far texels are apart  thin                 a subset that covers the surface evenly
"""

from __future__ import annotations

import numpy as np

from ..blocks import blocks, in_pieces, room
from ..jit import kernel
from .nearest import nearest, nearest_to

# Generally don't change these: a square grid has its diagonal at 1.4 spacings and a seam between
# two charts puts a texel at most about 2 away; k = 8 is a square's ring.
NEIGHBOURS = 8
REACH = 2.5

MERGED = 1 << 22
"""Keys among which each one's first is sought at once."""

# A texel far from all others must not call its loneliness the local spacing.
COARSEST_CHART = 8.0


def neighbours(
    position: np.ndarray, normal: np.ndarray, *, k: int = NEIGHBOURS, reach: float = REACH
) -> tuple[np.ndarray, np.ndarray]:
    """The k nearest texels that lie on the same side of the surface, made symmetric.

    Two texels touch when one is among the other's k nearest, no farther than `reach` local
    spacings, and their normals agree (n·n > 0: the two sides of a thin sheet stay apart).

    Parameters
    ----------
    position : (T, 3) float, any unit; finite
    normal : (T, 3) float, unit vectors
    k : neighbours asked for; more bridge wider seams and cost time
    reach : largest distance, in local texel spacings (see `spacing`)

    Returns
    -------
    indptr : (T + 1,) int64
    indices : (E,) int32; texel i touches indices[indptr[i]:indptr[i + 1]], each edge both ways
    """
    texels = len(position)
    k = min(k, texels - 1)
    if k < 1:
        return np.zeros(texels + 1, np.int64), np.zeros(0, np.int32)
    distance, index = nearest(position, k + 1)
    limit = reach * _local_spacing(distance)
    return _symmetrise(distance, index, limit, np.ascontiguousarray(normal, np.float32))


def spacing(position: np.ndarray) -> float:
    """The distance between neighbouring texels: the median of the fourth nearest; 0 for one texel.

    position : (T, 3) float; of more than 20000 texels every n-th is asked.
    """
    k = min(4, len(position) - 1)
    if k < 1:
        return 0.0
    asked = position[:: 1 + len(position) // 20000]
    return float(np.median(nearest_to(asked, position, k + 1)[0][:, -1]))


@kernel
def pieces(indptr, indices, labels):
    """Connected pieces of each label: (T,) int32 from 0, −1 where there is no label."""
    piece = np.full(len(labels), -1, np.int32)
    queue = np.empty(len(labels), np.int32)
    count = 0
    for start in range(len(labels)):
        if labels[start] < 0 or piece[start] >= 0:
            continue
        piece[start] = count
        queue[0] = start
        first, last = 0, 1
        while first < last:
            i = queue[first]
            first += 1
            for e in range(indptr[i], indptr[i + 1]):
                j = indices[e]
                if piece[j] < 0 and labels[j] == labels[i]:
                    piece[j] = count
                    queue[last] = j
                    last += 1
        count += 1
    return piece


def components(indptr: np.ndarray, indices: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Connected parts of the graph among the texels of `keep` (T,) bool.

    Returns (T,) int32: the part's number from 0, −1 outside `keep`.
    """
    return pieces(indptr, indices, np.where(keep, np.int32(0), np.int32(-1)))


def thin(position: np.ndarray, normal: np.ndarray, count: int) -> np.ndarray:
    """About `count` texels spread evenly over the surface, at most one per cell of a grid and side.

    position, normal : (T, 3); the side is the octant of the normal, so that thin sheets keep both.
    Returns the chosen texels' indices, ascending int64; all of them when there are no more.
    """
    if len(position) <= count:
        return np.arange(len(position))
    low, high = position.min(0), position.max(0)
    key = room(len(position), np.int64)

    def keys(cell: float) -> np.ndarray:
        extent = np.floor((high - low) / cell).astype(np.int64) + 1
        for own in blocks(len(position)):
            grid = np.floor((position[own] - low) / cell).astype(np.int64)
            octant = (normal[own] > 0) @ np.array([1, 2, 4])
            key[own] = ((grid[:, 0] * extent[1] + grid[:, 1]) * extent[2] + grid[:, 2]) * 8 + octant
        return key

    # Occupied cells go with the inverse square of their size
    cell = spacing(position) * np.sqrt(len(position) / count)
    for _ in range(3):
        cell *= np.sqrt(_different(keys(cell)) / count)
    return np.sort(_first(keys(cell)))


def _different(key: np.ndarray) -> int:
    """How many keys (T,) there are."""
    known = np.empty(0, np.int64)
    for own in blocks(len(key), MERGED):
        known = np.unique(np.concatenate([known, key[own]]))
    return len(known)


def _first(key: np.ndarray) -> np.ndarray:
    """Where each key (T,) comes first, by rising keys."""
    known, first = np.empty(0, np.int64), np.empty(0, np.int64)
    for own in blocks(len(key), MERGED):
        all_of = np.concatenate([known, key[own]])
        where = np.concatenate([first, np.arange(own.start, own.stop)])
        known, found = np.unique(all_of, return_index=True)
        first = where[found]
    return first


def _local_spacing(distance: np.ndarray) -> np.ndarray:
    """Distance to the fourth nearest, where a square grid has its last direct neighbour; (T,)."""
    fourth = distance[:, min(4, distance.shape[1] - 1)]
    return np.minimum(fourth, COARSEST_CHART * np.median(fourth))


def _symmetrise(
    distance: np.ndarray, index: np.ndarray, limit: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Every texel's own neighbours, and the mirror of an edge that the other end did not find."""
    touches, edge = room(index.shape, np.bool_), room(index.shape, np.uint8)
    in_pieces(lambda a, b: _touch(a, b, distance, index, limit, normal, touches), len(index))
    in_pieces(lambda a, b: _match(a, b, index, touches, edge), len(index))
    cursor, indptr = room(len(index), np.int64), room(len(index) + 1, np.int64)
    cursor[:] = 0
    _enter(index, edge, cursor, np.empty(0, np.int32))
    indptr[0] = 0
    np.cumsum(cursor, out=indptr[1:])
    indices = room(int(indptr[-1]), np.int32)
    cursor[:] = indptr[:-1]
    _enter(index, edge, cursor, indices)
    return indptr, indices


@kernel
def _touch(first, stop, distance, index, limit, normal, touches):
    for i in range(first, stop):
        for c in range(index.shape[1]):
            j = index[i, c]
            touches[i, c] = False
            if j != i and distance[i, c] <= limit[i]:
                facing = 0.0
                for axis in range(3):
                    facing += normal[i, axis] * normal[j, axis]
                touches[i, c] = facing > 0


@kernel
def _match(first, stop, index, touches, edge):
    """2 where the other end found the edge too, 1 where it did not, 0 where there is none."""
    for i in range(first, stop):
        for c in range(index.shape[1]):
            edge[i, c] = 0
            if not touches[i, c]:
                continue
            j, mutual = index[i, c], False
            for other in range(index.shape[1]):
                mutual |= index[j, other] == i and touches[j, other]
            edge[i, c] = 2 if mutual else 1


@kernel
def _enter(index, edge, cursor, indices):
    """Write the edges where the cursors of their texels stand; only count where there is no room.

    The cursors move on.
    """
    for i in range(index.shape[0]):
        for c in range(index.shape[1]):
            if edge[i, c] == 0:
                continue
            j = index[i, c]
            if len(indices):
                indices[cursor[i]] = j
            cursor[i] += 1
            if edge[i, c] == 1:
                if len(indices):
                    indices[cursor[j]] = i
                cursor[j] += 1
