"""Region growing over a graph of texels, in an order that no numbering of the texels can change.

colors : (T, 3) float32, a colour per texel in a space where Euclidean distance is what matters;
NaN where unobserved. indptr, indices : the graph as CSR (see geometry.adjacency).
"""

from __future__ import annotations

import numpy as np

from ..blocks import in_pieces
from ..jit import inner, kernel


@kernel
def _smooth(first, stop, colors, indptr, indices, reach, mean, spread):
    for i in range(first, stop):
        if np.isnan(colors[i, 0]):
            mean[i, 0] = mean[i, 1] = mean[i, 2] = np.nan
            spread[i] = np.inf
            continue
        sums = colors[i].astype(np.float64)
        near, seen, square = 1, 0, 0.0
        for e in range(indptr[i], indptr[i + 1]):
            j = indices[e]
            if np.isnan(colors[j, 0]):
                continue
            d2 = _distance2(colors[i], colors[j])
            seen += 1
            square += d2
            if d2 < reach * reach:
                near += 1
                for axis in range(3):
                    sums[axis] += colors[j, axis]
        for axis in range(3):
            mean[i, axis] = sums[axis] / near
        spread[i] = np.sqrt(square / max(seen, 1))


def smooth(
    colors: np.ndarray, indptr: np.ndarray, indices: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean of a texel and those neighbours whose colour is nearer than `reach`, and their spread.

    Returns (T, 3) float32 means, which keep edges that are higher than `reach`, and (T,) float32
    root mean square distance of *all* neighbours from the texel (inf where unobserved).
    """
    mean, spread = np.empty_like(colors), np.empty(len(colors), np.float32)
    in_pieces(
        lambda a, b: _smooth(a, b, colors, indptr, indices, float(reach), mean, spread), len(colors)
    )
    return mean, spread


@kernel
def grow(colors, indptr, indices, seeds, threshold):
    """Grow a region from each seed in turn over the texels that no region before it took.

    A texel joins when its colour is nearer than `threshold` to the region's mean. The mean moves
    after each ring of texels, not within it: the order inside a ring does not matter.
    seeds : (S,) int64, best first. Returns (T,) int32 regions from 0, −1 where none came.
    """
    region = np.full(len(colors), -1, np.int32)
    asked = np.full(len(colors), -1, np.int32)
    ring = np.empty(len(colors), np.int64)
    count = 0
    for seed in seeds:
        if region[seed] >= 0:
            continue
        sums = np.zeros(3)
        mean = colors[seed].astype(np.float64)
        members = 1
        ring[0] = seed
        region[seed] = count
        asked[seed] = count
        first = 0
        while first < members:
            last = members
            for position in range(first, last):
                for axis in range(3):
                    sums[axis] += colors[ring[position], axis]
            for axis in range(3):
                mean[axis] = sums[axis] / members
            for position in range(first, last):
                i = ring[position]
                for e in range(indptr[i], indptr[i + 1]):
                    j = indices[e]
                    if region[j] >= 0 or asked[j] == count or np.isnan(colors[j, 0]):
                        continue
                    asked[j] = count
                    if _distance2(colors[j], mean) < threshold * threshold:
                        region[j] = count
                        ring[members] = j
                        members += 1
            first = last
        count += 1
    return region


@kernel
def fill(colors, indptr, indices, labels, means):
    """Give texels without a label the neighbouring label of nearest mean, ring by ring.

    labels : (T,) int32, changed in place; means : (M, 3) float64. Unobserved texels, and islands
    without any labelled texel, keep −1.
    """
    wave = np.empty(len(labels), np.int64)
    queued = labels >= 0
    size = 0
    for i in range(len(labels)):
        if queued[i] or np.isnan(colors[i, 0]):
            continue
        if _nearest_around(i, colors, indptr, indices, labels, means) >= 0:
            wave[size] = i
            queued[i] = True
            size += 1
    chosen = np.empty(len(labels), np.int32)
    first = 0
    while first < size:
        last = size
        for position in range(first, last):
            i = wave[position]
            chosen[position] = _nearest_around(i, colors, indptr, indices, labels, means)
        for position in range(first, last):
            labels[wave[position]] = chosen[position]
        for position in range(first, last):
            i = wave[position]
            for e in range(indptr[i], indptr[i + 1]):
                j = indices[e]
                if not queued[j] and not np.isnan(colors[j, 0]):
                    queued[j] = True
                    wave[size] = j
                    size += 1
        first = last


@kernel
def _settle(first, stop, colors, indptr, indices, labels, means, settled):
    for i in range(first, stop):
        if labels[i] >= 0:
            settled[i] = _nearest_around(i, colors, indptr, indices, labels, means)


def settle(
    colors: np.ndarray, indptr: np.ndarray, indices: np.ndarray, labels: np.ndarray,
    means: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Labels after every texel took the nearest mean among its own and its neighbours' labels."""
    settled = labels.copy()
    in_pieces(
        lambda a, b: _settle(a, b, colors, indptr, indices, labels, means, settled), len(labels)
    )
    return settled


@kernel
def depths(indptr, indices, labels, piece, deepest):
    """Steps to the border with another label: (T,) int32 from 1, 0 where there is no way to one.

    deepest : (P,) becomes the largest of each piece (T,), where that is above what it was
    """
    depth = np.zeros(len(labels), np.int32)
    queue = np.empty(len(labels), np.int64)
    last = 0
    for i in range(len(labels)):
        if labels[i] < 0:
            continue
        for e in range(indptr[i], indptr[i + 1]):
            if labels[indices[e]] >= 0 and labels[indices[e]] != labels[i]:
                depth[i] = 1
                queue[last] = i
                last += 1
                break
    first = 0
    while first < last:
        i = queue[first]
        first += 1
        for e in range(indptr[i], indptr[i + 1]):
            j = indices[e]
            if labels[j] == labels[i] and depth[j] == 0:
                depth[j] = depth[i] + 1
                queue[last] = j
                last += 1
    for i in range(len(labels)):
        if piece[i] >= 0:
            deepest[piece[i]] = max(deepest[piece[i]], depth[i])
    return depth


@kernel
def contacts(indptr, indices, labels, piece, counts):
    """Add to counts (P, M) int64 how often each piece touches each other label."""
    for i in range(len(labels)):
        if labels[i] < 0:
            continue
        for e in range(indptr[i], indptr[i + 1]):
            other = labels[indices[e]]
            if other >= 0 and other != labels[i]:
                counts[piece[i], other] += 1


@kernel
def add_colors(colors, labels, sums, counts):
    """Add the colours of each label to sums (M, 3) float64, and their number to counts (M,)."""
    for i in range(len(labels)):
        if labels[i] >= 0:
            counts[labels[i]] += 1
            for axis in range(3):
                sums[labels[i], axis] += colors[i, axis]


@inner
def _nearest_around(i, colors, indptr, indices, labels, means):
    best = labels[i]
    least = np.inf
    if best >= 0:
        least = _distance2(colors[i], means[best])
    for e in range(indptr[i], indptr[i + 1]):
        label = labels[indices[e]]
        if label >= 0 and label != best:
            d2 = _distance2(colors[i], means[label])
            if d2 < least:
                least = d2
                best = label
    return best


@kernel(inline="always")
def _distance2(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
