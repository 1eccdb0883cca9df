"""How fast the normals turn over the surface, from the texels' own normals, whatever they are from.

surface_shape   the linear map S with δn = S δx of every texel
steepest_turn   its norm
"""

from __future__ import annotations

import numpy as np

from ..blocks import in_pieces, room
from ..jit import kernel
from .adjacency import neighbours
from .tangents import tangents

FLATTEST_CELL = 1e-3
"""Least of the neighbours' spread, det / trace², that still tells two directions."""


@kernel
def _surface_shape(first, stop, indptr, indices, position, normal, shape):
    """Least squares of n_j − n_i = S (x_j − x_i) over the neighbours, in the tangent plane."""
    n, axes, b, moment = np.empty(3), np.empty((2, 3)), np.empty(3), np.empty((2, 3))
    for i in range(first, stop):
        for c in range(3):
            n[c] = normal[i, c]
        (axes[0, 0], axes[0, 1], axes[0, 2], axes[1, 0], axes[1, 1], axes[1, 2]) = tangents(
            n[0], n[1], n[2]
        )
        aa, ab, bb = 0.0, 0.0, 0.0
        for c in range(3):
            moment[0, c] = moment[1, c] = 0.0
        for e in range(indptr[i], indptr[i + 1]):
            j = indices[e]
            p, q = 0.0, 0.0
            for c in range(3):
                step = np.float64(position[j, c]) - np.float64(position[i, c])
                p += step * axes[0, c]
                q += step * axes[1, c]
                b[c] = np.float64(normal[j, c]) - n[c]
            aa, ab, bb = aa + p * p, ab + p * q, bb + q * q
            for c in range(3):
                moment[0, c] += p * b[c]
                moment[1, c] += q * b[c]
        det = aa * bb - ab * ab
        if not det > FLATTEST_CELL * (aa + bb) ** 2:
            for c in range(3):
                for d in range(3):
                    shape[i, c, d] = np.nan
            continue
        for c in range(3):
            u = (bb * moment[0, c] - ab * moment[1, c]) / det
            v = (aa * moment[1, c] - ab * moment[0, c]) / det
            for d in range(3):
                shape[i, c, d] = u * axes[0, d] + v * axes[1, d]


def surface_shape(
    position: np.ndarray,
    normal: np.ndarray,
    adjacency: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """How the normal turns along the surface: S (T, 3, 3) float32 with δn = S δx, per unit of x.

    position, normal : (T, 3), of texels that cover the surface; NaN where neighbours do not tell
    adjacency : their `neighbours`, where these are known
    """
    indptr, indices = adjacency or neighbours(position, normal)
    position, normal = np.ascontiguousarray(position), np.ascontiguousarray(normal)
    shape = room((len(position), 3, 3), np.float32)

    def fit(first: int, stop: int) -> None:
        _surface_shape(first, stop, indptr, indices, position, normal, shape)

    in_pieces(fit, len(position))
    return shape


def steepest_turn(shape: np.ndarray) -> np.ndarray:
    """The largest turn of the normal per unit of x in any direction, (T,); inf where not known."""
    turn = room(len(shape), np.float64)

    def fill(first: int, stop: int) -> None:
        # Of SᵀS two eigenvalues are not 0: they follow from their sum and that of their squares
        own = shape[first:stop].astype(np.float64)
        square = own.transpose(0, 2, 1) @ own
        trace, squares = np.einsum("tii->t", square), np.einsum("tij,tij->t", square, square)
        largest = (trace + np.sqrt(np.maximum(2 * squares - trace**2, 0))) / 2
        turn[first:stop] = np.where(np.isfinite(largest), np.sqrt(largest), np.inf)

    in_pieces(fill, len(shape))
    return turn
