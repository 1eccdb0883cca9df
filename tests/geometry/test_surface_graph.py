"""The kept graph says what the one-off functions say."""

import numpy as np
import pytest

from meshlab_svbrdf.geometry.adjacency import components, neighbours, spacing
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph


@pytest.fixture(scope="module")
def globe() -> SurfaceGraph:
    normal = np.random.default_rng(0).normal(size=(3000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return SurfaceGraph(normal.astype(np.float32), normal)


def test_lengths_are_the_distances_among_the_chosen(globe):
    chosen = np.flatnonzero(globe.position[:, 0] > 0.3)
    graph = globe.lengths(chosen)
    indptr, indices = globe.adjacency
    full = np.zeros((len(globe), len(globe)), bool)
    full[np.repeat(np.arange(len(globe)), np.diff(indptr)), indices] = True
    place = globe.position.astype(float)
    away = np.linalg.norm(place[chosen][:, None] - place[chosen], axis=2)
    expected = np.where(full[np.ix_(chosen, chosen)], away, 0)
    np.testing.assert_allclose(graph.toarray(), expected, rtol=1e-12)
    assert globe.unit == spacing(globe.position)


def test_parts_are_those_of_the_one_off_function(globe):
    keep = np.abs(globe.position[:, 2]) > 0.5
    expected = components(*neighbours(globe.position, globe.normal), keep)
    np.testing.assert_array_equal(globe.components(keep), expected)
    assert expected.max() == 1


def test_all_neighbours_of_some(globe):
    indptr, indices = globe.adjacency
    some = np.array([5, 17])
    expected = np.concatenate([indices[indptr[i] : indptr[i + 1]] for i in some])
    np.testing.assert_array_equal(globe.around(some), expected)
    assert globe.around(np.zeros(0, int)).size == 0
