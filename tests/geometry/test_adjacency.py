"""The graph of texels: symmetric, whole across seams, apart where the surface is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.adjacency import components, neighbours, pieces, spacing, thin


def sphere(count):
    """Points of a golden spiral, (count, 3) float32: evenly spread, no two distances alike."""
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    phi = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], 1).astype(np.float32)


def plane(rows, cols, step=1.0, height=0.0):
    y, x = np.mgrid[:rows, :cols] * step
    return np.stack([x.ravel(), y.ravel(), np.full(rows * cols, height)], 1).astype(np.float32)


def edges(adjacency):
    indptr, indices = adjacency
    starts = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return set(zip(starts.tolist(), indices.tolist(), strict=True))


UP = np.array([0, 0, 1], np.float32)


def test_square_grid_has_its_ring_of_eight():
    position = plane(9, 11)
    indptr, indices = neighbours(position, np.broadcast_to(UP, position.shape))
    inner = 4 * 11 + 5
    ring = indices[indptr[inner] : indptr[inner + 1]]
    assert sorted(ring) == sorted(inner + d for d in (-12, -11, -10, -1, 1, 10, 11, 12))
    assert indptr.dtype == np.int64
    assert indices.dtype == np.int32


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(
        np.float32, st.tuples(st.integers(0, 40), st.just(3)), elements=st.floats(-1, 1, width=32)
    ),
    st.integers(1, 8),
)
def test_symmetric_without_loops_or_duplicates(position, k):
    normal = np.broadcast_to(UP, position.shape)
    adjacency = neighbours(position, normal, k=k)
    found = edges(adjacency)
    assert found == {(j, i) for i, j in found}
    assert all(i != j for i, j in found)
    assert len(found) == len(adjacency[1])


def test_charts_that_meet_in_space_are_one_part():
    left, right = plane(20, 10), plane(20, 10) + np.float32([9.7, 0.4, 0])
    position = np.concatenate([left, right])
    adjacency = neighbours(position, np.broadcast_to(UP, position.shape))
    assert components(*adjacency, np.ones(400, bool)).max() == 0


def test_charts_of_unlike_density_are_one_part():
    fine, coarse = plane(80, 40, 0.25), plane(20, 10) + np.float32([10.4, 0, 0])
    position = np.concatenate([fine, coarse])
    adjacency = neighbours(position, np.broadcast_to(UP, position.shape))
    assert components(*adjacency, np.ones(len(position), bool)).max() == 0


def test_sides_of_a_thin_sheet_stay_apart():
    position = np.concatenate([plane(15, 15), plane(15, 15, height=-0.1)])
    normal = np.repeat([UP, -UP], 225, axis=0)
    part = components(*neighbours(position, normal), np.ones(450, bool))
    assert (part[:225] == part[0]).all()
    assert (part[225:] == part[225]).all()
    assert part[0] != part[225]


def test_gap_is_not_bridged():
    position = np.concatenate([plane(12, 12), plane(12, 12) + np.float32([15, 0, 0])])
    part = components(
        *neighbours(position, np.broadcast_to(UP, position.shape)), np.ones(288, bool)
    )
    assert np.array_equal(np.bincount(part), [144, 144])


def test_lonely_texel_touches_nothing():
    position = np.concatenate([plane(12, 12), np.float32([[500, 0, 0]])])
    indptr, _ = neighbours(position, np.broadcast_to(UP, position.shape))
    assert indptr[-1] == indptr[-2]


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_texels_have_no_edges(count):
    indptr, indices = neighbours(np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32))
    assert np.array_equal(indptr, np.zeros(count + 1))
    assert len(indices) == 0
    assert spacing(np.zeros((count, 3))) == 0
    assert len(components(indptr, indices, np.ones(count, bool))) == count


def test_permuted_and_rotated_texels_have_the_same_edges():
    rng = np.random.default_rng(3)
    position = sphere(800)
    order = rng.permutation(800)
    turned = (position @ Rotation.random(random_state=4).as_matrix().T).astype(np.float32)[order]
    found = edges(neighbours(turned, turned))
    assert {(order[i], order[j]) for i, j in found} == edges(neighbours(position, position))


def test_spacing_scales_with_the_object():
    position = sphere(5000)
    assert spacing(position) == pytest.approx(np.sqrt(4 * np.pi / 5000), rel=0.15)
    assert spacing(position * 1000) == pytest.approx(1000 * spacing(position), rel=1e-4)


def test_components_number_only_what_is_kept():
    position = plane(10, 12)
    adjacency = neighbours(position, np.broadcast_to(UP, position.shape))
    middle = np.isin(np.tile(np.arange(12), 10), [5, 6])
    part = components(*adjacency, ~middle)
    assert (part[middle] == -1).all()
    assert sorted(np.bincount(part[part >= 0])) == [50, 50]


def test_pieces_are_scipys_components_of_each_label():
    rng = np.random.default_rng(5)
    position = sphere(3000)
    indptr, indices = neighbours(position, position)
    labels = rng.integers(-1, 2, 3000).astype(np.int32)
    piece = pieces(indptr, indices, labels)
    assert ((piece < 0) == (labels < 0)).all()
    graph = csr_array((np.ones(len(indices)), indices, indptr), shape=(3000, 3000))
    for label in (0, 1):
        own = labels == label
        count, expected = connected_components(graph[own][:, own], directed=False)
        assert count > 10
        np.testing.assert_array_equal(np.unique(piece[own], return_inverse=True)[1], expected)


def test_thin_covers_the_surface_evenly():
    position = sphere(40000)
    chosen = thin(position, position, 2000)
    assert len(chosen) == pytest.approx(2000, rel=0.25)
    assert len(np.unique(chosen)) == len(chosen)
    octant = (position[chosen] > 0) @ np.array([1, 2, 4])
    assert np.bincount(octant, minlength=8).min() > 0.7 * len(chosen) / 8


def test_thin_keeps_all_of_few():
    assert np.array_equal(thin(sphere(10), sphere(10), 10), np.arange(10))


def test_thin_keeps_both_sides_of_a_sheet():
    position = np.concatenate([plane(40, 40), plane(40, 40, height=-0.01)])
    chosen = thin(position, np.repeat([UP, -UP], 1600, axis=0), 200)
    sides = np.bincount((chosen >= 1600).astype(int))
    assert sides.min() > 0.4 * len(chosen)
