"""The texels' graph, kept to be asked again and again: nearest texel, lengths, connected parts."""

from __future__ import annotations

from functools import cached_property
from threading import Lock

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ..jit import kernel
from .adjacency import components, neighbours, spacing


class SurfaceGraph:
    """Texels that touch on the surface.

    position, normal : (T, 3) float
    adjacency : (indptr, indices), see `adjacency.neighbours`; None: they are sought when asked for
    """

    def __init__(
        self,
        position: np.ndarray,
        normal: np.ndarray,
        adjacency: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> None:
        self.position, self.normal = np.asarray(position), np.asarray(normal)
        self._given = adjacency
        self._numbering, self._number = Lock(), np.full(len(position), -1, np.int32)

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def adjacency(self) -> tuple[np.ndarray, np.ndarray]:
        return self._given or neighbours(self.position, self.normal)

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.position, balanced_tree=False, compact_nodes=False)

    @cached_property
    def unit(self) -> float:
        """The distance between neighbouring texels, see `adjacency.spacing`."""
        return spacing(self.position)

    @cached_property
    def _place(self) -> np.ndarray:
        return np.ascontiguousarray(self.position, np.float64)

    def prepare(self) -> None:
        """Compute now what is computed once: a second or more where there are many texels."""
        _ = self.adjacency, self.tree, self.unit, self._place

    def lengths(self, chosen: np.ndarray) -> csr_array:
        """The graph among the texels `chosen`, ascending (C,), weighted with positive distances."""
        with self._numbering:
            indptr, indices, length = _among(
                np.ascontiguousarray(chosen, np.int64), *self.adjacency, self._place, self._number
            )
        return csr_array((length, indices, indptr), shape=(len(chosen),) * 2)

    def components(self, keep: np.ndarray) -> np.ndarray:
        """As `adjacency.components`: (T,) int32 parts of `keep` (T,) bool, −1 outside."""
        return components(*self.adjacency, keep)

    def around(self, texels: np.ndarray) -> np.ndarray:
        """All neighbours of some texels, without order or with repetition."""
        return _neighbours_of(np.ascontiguousarray(texels, np.int64), *self.adjacency)


@kernel
def _among(chosen, indptr, indices, place, number):
    """Rows of the graph among `chosen`, its columns numbered as in `chosen`, and their lengths.

    number : (T,) int32 of -1, and so again afterwards
    """
    most = 0
    for c in range(len(chosen)):
        number[chosen[c]] = c
        most += indptr[chosen[c] + 1] - indptr[chosen[c]]
    rows = np.zeros(len(chosen) + 1, np.int64)
    columns = np.empty(most, np.int32)
    length = np.empty(most)
    n = 0
    for c in range(len(chosen)):
        i = chosen[c]
        for e in range(indptr[i], indptr[i + 1]):
            j = indices[e]
            if number[j] >= 0:
                d2 = 0.0
                for axis in range(3):
                    d2 += (place[i, axis] - place[j, axis]) ** 2
                columns[n] = number[j]
                length[n] = max(np.sqrt(d2), 1e-300)
                n += 1
        rows[c + 1] = n
    for i in chosen:
        number[i] = -1
    return rows, columns[:n], length[:n]


@kernel
def _neighbours_of(texels, indptr, indices):
    count = 0
    for i in texels:
        count += indptr[i + 1] - indptr[i]
    found = np.empty(count, np.int64)
    n = 0
    for i in texels:
        for e in range(indptr[i], indptr[i + 1]):
            found[n] = indices[e]
            n += 1
    return found
