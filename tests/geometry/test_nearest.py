"""The nearest points are those that all distances tell, whatever the grid makes of them."""

import numpy as np
import pytest

from meshlab_svbrdf.geometry import nearest as module
from meshlab_svbrdf.geometry.nearest import nearest


def spread(count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    return rng.random((count, 3)) * [1, 1, 0.01]


POINTS = {
    "a surface": spread(900),
    "far away": (spread(600) + np.array([1e3, -2e3, 0])).astype(np.float32),
    "dense and sparse": np.concatenate([spread(800) * 0.02, spread(300) + 3]),
    "two": spread(2),
    "in one place": np.zeros((50, 3)),
    "one far off": np.concatenate([spread(300), [[1e7, 0, 0]]]),
    "beyond all cells": np.concatenate([spread(300), [[1e12, 1e12, 1e12]]]),
}


@pytest.mark.parametrize("name", POINTS)
@pytest.mark.parametrize("k", [1, 2, 9])
@pytest.mark.parametrize("planted", [module.PLANTED, 7])
def test_against_all_distances(monkeypatch, name, k, planted):
    monkeypatch.setattr(module, "PLANTED", planted)
    points = POINTS[name].astype(np.float64)
    k = min(k, len(points))
    away = np.linalg.norm(points[:, None] - points, axis=2)
    distance, index = nearest(POINTS[name], k)
    np.testing.assert_allclose(distance, np.sort(away, axis=1)[:, :k], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(distance, away[np.arange(len(points))[:, None], index], rtol=1e-5)
    assert all(len(set(row)) == k for row in index.tolist())
