"""Quantiles by counting are numpy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from meshlab_svbrdf.ranks import quantile

NUMBERS = st.floats(-1e6, 1e6, width=32)


@given(arrays(np.float32, st.integers(1, 50), elements=NUMBERS), st.floats(0, 1))
def test_quantiles_are_those_of_numpy(values, share):
    exact = np.quantile(values.astype(np.float64), share)
    assert abs(quantile(values, share) - exact) <= 3e-7 * np.abs(values).max()


@pytest.mark.parametrize("codes", [1, 2, 5])
def test_many_equal_values(codes):
    values = np.random.default_rng(0).integers(0, codes, 1001).astype(np.float32)
    assert quantile(values, 0.5) == np.median(values)


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_the_order_does_not_matter(order):
    values = np.geomspace(1e-30, 1e30, 777).astype(np.float32)[order]
    assert quantile(np.ascontiguousarray(values), 0.5) == np.median(values)
