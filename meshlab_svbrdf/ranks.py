"""Quantiles of a texel's samples: found by counting, which compilers make vector instructions of.

numpy's own, within a kernel, sort by branches that no processor predicts, and compile for seconds.
"""

from __future__ import annotations

import numpy as np

from .jit import inner, kernel
from .power import LANES

TIGHTENED = 4
"""Rounds after which it is asked whether one value is left: eight bits have many that are equal."""
_LOWEST, _HIGHEST = np.int32(-0x7F800001), np.int32(0x7F800000)
"""`_key` of the infinities."""


@inner(fastmath=LANES)
def _at_most(values, bound):
    """How many are at most the bound (of up to 2²⁴, counted in lanes of single precision)."""
    count = np.float32(0)
    for j in range(len(values)):
        count += np.float32(1) if values[j] <= bound else np.float32(0)
    return np.int64(count)


@inner
def _key(bits):
    """Whole numbers in the order of the numbers in single precision with these bits, and back.

    Compilers make vectors of their extremes, and not of numbers'.
    """
    return np.int32(bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF)))


@inner
def _largest(values, bound):
    """The largest that is at most the bound."""
    bits, found = values.view(np.int32), _LOWEST
    for j in range(len(values)):
        key = _key(bits[j]) if values[j] <= bound else _LOWEST
        found = key if key > found else found
    return np.int32(_key(found)).view(np.float32)


@inner
def _least_above(values, bound):
    """The least that is above the bound."""
    bits, found = values.view(np.int32), _HIGHEST
    for j in range(len(values)):
        key = _key(bits[j]) if values[j] > bound else _HIGHEST
        found = key if key < found else found
    return np.int32(_key(found)).view(np.float32)


@inner
def smallest(values):
    """The least of finite values (n,) float32, n ≥ 1."""
    return _least_above(values, np.float32(-np.inf))


@kernel(fastmath=LANES)
def _mean(values):
    total = np.float32(0)
    for j in range(len(values)):
        total += values[j]
    return total / np.float32(len(values))


@inner
def _ranked(values, rank):
    """The value of a rank from 1, and how many are at most that."""
    low, high = smallest(values), _largest(values, np.float32(np.inf))
    below = _at_most(values, low)
    if below >= rank:
        return low, below
    # Narrow the range, below < rank ≤ within, until one value or one number is left in it
    within, middle, rounds = len(values), _mean(values), 0
    while within - below > 1:
        if not low < middle < high:
            middle = low + (high - low) * np.float32(0.5)
            if not low < middle < high:
                break
        count = _at_most(values, middle)
        if count >= rank:
            high, within = middle, count
        else:
            low, below = middle, count
        rounds += 1
        if rounds % TIGHTENED == 0:
            high = _largest(values, high)
            if _least_above(values, low) == high:
                break
        # Look where the rank would be if all in the range were spread evenly
        share = np.float32(rank - below) / np.float32(within - below + 1)
        middle = low + (high - low) * share
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
