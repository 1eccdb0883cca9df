"""Normals of a detailed layer, carried over to the texels of a simpler one close to it."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh
from .visibility import Rays

# Surfaces that face the other way (the far side of a thin wall) are passed through, at most these.
LAYERS = 8

# How far behind the texel a ray starts, in radii: just above float32's rounding. Of two sheets
# closer together than this, the first one met is taken and not the nearest.
SLACK = 1e-6


def bake_normals(
    position: np.ndarray, normal: np.ndarray, high: Mesh, max_distance: float
) -> tuple[np.ndarray, np.ndarray]:
    """The interpolated normal of the detailed surface nearest to each texel along its normal.

    Parameters
    ----------
    position : (T, 3) world (a texel's position about its centre, plus that centre)
    normal : (T, 3) unit, the simple surface's
    high : the detailed mesh, in the same world
    max_distance : > 0, world units; how far the two surfaces may lie apart. Choose it a few times
        the largest gap: too large, and texels take the normal of another part of the object

    Returns
    -------
    normals : (T, 3) float64 unit; where nothing was hit, the texel's own
    hit : (T,) bool, a surface within max_distance, outwards or inwards, whose normal agrees
        (n·n > 0)
    """
    if not max_distance > 0:
        raise ValueError(f"max_distance={max_distance}: expected a length > 0, in world units")
    rays, high_normals = Rays(high), high.vertex_normals()
    local = position - rays.center
    # A texel on the surface itself must be hit in spite of rounding: rays start a little behind
    slack = SLACK * rays.radius
    normals = np.array(normal, dtype=np.float64)
    nearest = np.full(len(position), np.inf)
    for side in (1.0, -1.0):
        outward = side * np.asarray(normal, dtype=np.float64)
        travelled = np.full(len(position), -slack)
        alive = np.flatnonzero(outward.any(axis=1))
        for _ in range(LAYERS):
            if not len(alive):
                break
            # Shoot on from where the last surface was left
            ray = outward[alive]
            face, barycentric, length = rays.nearest(
                local[alive] + travelled[alive, None] * ray,
                ray,
                (max_distance - travelled[alive]).astype(np.float32),
            )
            met = face >= 0
            alive, ray = alive[met], ray[met]
            travelled[alive] += length[met]

            # Interpolate the normal there, and keep it if it agrees and is the nearest
            n = np.einsum("ij,ijk->ik", barycentric[met], high_normals[high.faces[face[met]]])
            size = np.linalg.norm(n, axis=1)
            agrees = np.einsum("ij,ij->i", n, normal[alive]) > 1e-6 * size
            distance = np.abs(travelled[alive])
            better = agrees & (distance < nearest[alive])
            nearest[alive[better]] = distance[better]
            normals[alive[better]] = n[better] / size[better, None]
            alive = alive[~agrees]
            travelled[alive] += slack
    return normals, np.isfinite(nearest)
