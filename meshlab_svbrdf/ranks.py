"""Quantiles of a texel's samples: found by counting, which compilers make vector instructions of.

numpy's own, within a kernel, sort by branches that no processor predicts, and compile for seconds.
"""

from __future__ import annotations

import numpy as np

from .jit import kernel
from .power import LANES


@kernel(fastmath=LANES)
def _at_most(values, bound):
    """How many are at most the bound (of up to 2²⁴, counted in lanes of single precision)."""
    count = np.float32(0)
    for j in range(len(values)):
        count += np.float32(1) if values[j] <= bound else np.float32(0)
    return np.int64(count)


@kernel(fastmath=LANES)
def _largest(values, bound):
    """The largest that is at most the bound."""
    found = np.float32(-np.inf)
    for j in range(len(values)):
        found = max(found, values[j] if values[j] <= bound else np.float32(-np.inf))
    return found


@kernel(fastmath=LANES)
def _least_above(values, bound):
    """The least that is above the bound."""
    found = np.float32(np.inf)
    for j in range(len(values)):
        found = min(found, values[j] if values[j] > bound else np.float32(np.inf))
    return found


@kernel
def _ranked(values, rank):
    """The value of a rank from 1, and how many are at most that."""
    low, high = _least_above(values, np.float32(-np.inf)), _largest(values, np.float32(np.inf))
    below = _at_most(values, low)
    if below >= rank:
        return low, below
    # Halve the range, below < rank ≤ within, until one value or one number is left in it
    within = len(values)
    while within - below > 1:
        middle = low + (high - low) * np.float32(0.5)
        if not low < middle < high:
            break
        count = _at_most(values, middle)
        if count >= rank:
            high, within = middle, count
        else:
            low, below = middle, count
    return _largest(values, high), within


@kernel
def quantile(values, share):
    """The quantile of finite values (n,) float32, n ≥ 1, as numpy's: linear between two ranks."""
    place = share * (len(values) - 1)
    rank = np.int64(place)
    value, within = _ranked(values, rank + 1)
    part = np.float32(place - rank)
    if part == 0 or within > rank + 1:
        return value
    return value + part * (_least_above(values, value) - value)
