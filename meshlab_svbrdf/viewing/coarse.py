"""A coarse copy of the surface, on which clusters are found while a slider moves."""

from __future__ import annotations

from threading import Lock

import numpy as np
from scipy.spatial import cKDTree

from ..errors import SvbrdfError
from ..geometry.adjacency import neighbours, thin
from .scene import Scene

PREVIEWED = 40_000
"""Texels that a preview of a threshold grows regions on; the others follow the nearest."""

Subset = tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]


class Coarse:
    """An even subset of the observed texels, its graph, and of each texel the nearest in it."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._lock = scene, Lock()
        self._found: Subset | None = None

    def get(self) -> Subset:
        """Computed when first asked for; (K,) of the subset, its graph, (T,) places in it."""
        with self._lock:
            if self._found is None:
                self._found = self._find()
            return self._found

    def _find(self) -> Subset:
        position, normal = self._scene.texels.position, self._scene.texels.normal
        diffuse = self._scene.attribute("diffuse")
        if diffuse is None or not np.isfinite(diffuse).all(1).any():
            raise SvbrdfError("no texel has a diffuse colour: there is nothing to find clusters in")
        observed = np.flatnonzero(np.isfinite(diffuse).all(1))
        kept = observed[thin(position[observed], normal[observed], PREVIEWED)]
        nearest = cKDTree(position[kept]).query(position, workers=-1)[1]
        return kept, neighbours(position[kept], normal[kept]), nearest
