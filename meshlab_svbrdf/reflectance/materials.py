"""Materials: areas of a perceived uniform diffuse colour, found automatically (paper §7.3).

Seeds lie where the diffuse colour is most uniform; a region grows from each while the CIE Lab
distance to the region's mean stays below the user's threshold; regions of like colour are one
material wherever they lie.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from skimage.color import xyz2lab
from skimage.color.colorconv import xyz_from_rgb

from meshlab_svbrdf.blocks import blocks, in_pieces, places, room, taken
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.adjacency import neighbours, pieces, thin
from meshlab_svbrdf.reflectance import regions

# Shading changes lightness and hardly hue. A fifth of L*, from black to white, is as wide as a
# region of the default threshold: one material stays whole from its lit side into its shadows.
LIGHTNESS_WEIGHT = 0.2
THRESHOLD = 10.0
MINIMUM_SHARE = 0.005
MOST = 1_000_000
"""Texels that regions grow over; of more, an even subset."""

# Generally don't change these: a region of a hundredth of the smallest material is a speck.
SPECKS = 100
SMOOTHING_ROUNDS = 2
SETTLING_ROUNDS = 3

# Pixels mix the colours on both sides of a border, over about two of them: a piece so thin, whose
# colour lies between its neighbours', is no material.
STRIP = 3.0
OFF_THE_LINE = 0.25
"""Of the neighbours' distance, how far off the line between them a mixture may lie."""
BETWEEN = 0.15
"""And how near to its ends."""
BOTH_SIDES = 0.2
"""Of its contacts with one neighbour, those that a strip has with the other at least."""
STRIP_ROUNDS = 2

# Below this L* the cube root of CIE Lab is a straight line, and chroma there is mostly noise.
DARKEST = 8.0
MIDDLE = 50.0


def color_space(diffuse: np.ndarray, lightness_weight: float = LIGHTNESS_WEIGHT) -> np.ndarray:
    """CIE Lab (D65) of a *shaded* diffuse colour, made less sensitive to the shading.

    Shading by a factor s takes (L* + 16, a*, b*) to s^⅓ times themselves: a*/(L* + 16) stays. So
    a* and b* are brought to L* = 50 and L* is weighted down:
    (w L*, a* g, b* g) with g = (66/(L* + 16))^(1 − w).

    Parameters
    ----------
    diffuse : (T, 3) float, linear RGB in 0..100
    lightness_weight : w in [0, 1]; 1 is CIE Lab as it is (the paper), 0 ignores lightness
        altogether. Raise it for grey objects, whose materials differ in nothing else.

    Returns
    -------
    (T, 3) float32; NaN where any channel of `diffuse` is not finite.
    """
    observed = places(np.isfinite(diffuse).all(1))
    space = room((len(diffuse), 3), np.float32)
    space[:] = np.nan

    def convert(first: int, stop: int) -> None:
        own = observed[first:stop]
        linear = np.maximum(diffuse[own], 0).astype(np.float64) / 100
        lab = xyz2lab(linear @ xyz_from_rgb.T)
        gain = ((MIDDLE + 16) / (np.maximum(lab[:, :1], DARKEST) + 16)) ** (1 - lightness_weight)
        space[own] = np.concatenate([lightness_weight * lab[:, :1], lab[:, 1:] * gain], axis=1)

    in_pieces(convert, len(observed))
    return space


def segment(
    diffuse: np.ndarray,
    adjacency: tuple[np.ndarray, np.ndarray],
    *,
    threshold: float = THRESHOLD,
    lightness_weight: float = LIGHTNESS_WEIGHT,
    minimum_share: float = MINIMUM_SHARE,
    join: bool = True,
    strip: float = STRIP,
) -> np.ndarray:
    """Label every observed texel with a material.

    Parameters
    ----------
    diffuse : (T, 3) float, linear RGB in 0..100, NaN where unobserved
    adjacency : (indptr, indices), see `geometry.adjacency.neighbours`
    threshold : largest distance of a colour to its region's mean, in units of CIE Lab after
        `color_space`. 10 tells skin from hair and keeps a stained bronze together; halve it when
        two materials share a label, raise it when one is in pieces. Too many materials do less
        harm than too few: each is estimated by itself.
    lightness_weight : see `color_space`
    minimum_share : materials with a smaller share of the observed texels are dissolved into their
        neighbours: too few texels to see a highlight on
    join : whether regions of like colour are one material wherever they lie; False gives one
        label per connected region
    strip : half the width, in texels, of the strips where a pixel shows both sides of a border;
        0 keeps them

    Returns
    -------
    (T,) int32, materials from 0 by falling size; −1 where unobserved. Texels on islands without
    a region of their own take the material of nearest colour.

    Source: Palma et al. 2012, §7.3. Distances use shading-tolerant Lab; the paper's are those of
    `lightness_weight=1`.
    """
    if not 0 < threshold < np.inf:
        raise SvbrdfError(f"threshold must be a positive Lab distance, not {threshold}")
    if not 0 <= lightness_weight <= 1:
        raise SvbrdfError(f"lightness_weight must lie in 0..1, not {lightness_weight}")
    if not 0 <= minimum_share < 1:
        raise SvbrdfError(f"minimum_share must lie in 0..1 (1 excluded), not {minimum_share}")
    colors = color_space(diffuse, lightness_weight)
    observed = np.isfinite(colors[:, 0])
    if not observed.any():
        return np.full(len(diffuse), -1, np.int32)

    # Take the noise off, keep the edges
    for _ in range(SMOOTHING_ROUNDS):
        colors, spread = regions.smooth(colors, *adjacency, threshold)

    # Seed where the colour is most uniform
    uniform = spread <= max(threshold / 2, float(np.median(spread[observed])))
    seeds = np.argsort(spread, kind="stable")[: np.count_nonzero(uniform)]
    labels = regions.grow(colors, *adjacency, seeds, threshold)

    # Dissolve specks, join like colours, dissolve what is still small
    smallest = minimum_share * np.count_nonzero(observed)
    labels = _keep_largest(labels, smallest / SPECKS if join else smallest)
    if join:
        labels = _keep_largest(_join(labels, colors, threshold), smallest)
    means = _means(labels, colors)[0]
    regions.fill(colors, *adjacency, labels, means)
    _claim_islands(labels, colors, means, observed)

    # Let texels at the borders go to the nearest colour
    for _ in range(SETTLING_ROUNDS):
        labels = regions.settle(colors, *adjacency, labels, _means(labels, colors)[0])
    if join:
        labels = _without_strips(diffuse, colors, adjacency, labels, strip, smallest)
    return _keep_largest(labels, 0)


def segment_surface(
    position: np.ndarray,
    normal: np.ndarray,
    diffuse: np.ndarray,
    *,
    adjacency: tuple[np.ndarray, np.ndarray] | None = None,
    most: int = MOST,
    **options: Any,
) -> np.ndarray:
    """`segment` from the texels themselves; above `most` texels on an even subset of the surface.

    position : (T, 3) float, finite; normal : (T, 3) float, unit; diffuse : as in `segment`, which
    also takes the `options`; adjacency : their `neighbours`, if all are observed and these are
    known: regions grow across what is not observed. The texels left out take the label of the
    nearest one that was kept on their side of the surface. Returns (T,) int32.
    """
    if adjacency is not None:
        return segment(diffuse, adjacency, **options)
    left_out = np.isfinite(diffuse).all(1)
    observed = places(left_out)
    kept = observed[thin(taken(position, observed), taken(normal, observed), most)]
    graph = neighbours(position[kept], normal[kept])
    labels = room(len(diffuse), np.int32)
    labels[:] = -1
    labels[kept] = segment(diffuse[kept], graph, **options)

    # Spread the labels to the texels that were thinned out
    left_out[kept] = False
    left = places(left_out)
    if not len(left):
        return labels
    tree = cKDTree(position[kept])
    for block in blocks(len(left)):
        own = left[block]
        near = kept[tree.query(position[own], k=4, workers=-1)[1]]
        facing = np.einsum("ld,lkd->lk", normal[own], normal[near]) > 0
        labels[own] = labels[near[np.arange(len(own)), facing.argmax(1)]]
    return labels


def _without_strips(
    diffuse: np.ndarray, colors: np.ndarray, adjacency: tuple[np.ndarray, np.ndarray],
    labels: np.ndarray, strip: float, smallest: float,
) -> np.ndarray:  # fmt: skip
    """Labels after mixtures along borders, specks, and what is small without them, are gone."""
    for _ in range(STRIP_ROUNDS):
        means, count = _means(labels, colors)
        piece = pieces(*adjacency, labels)
        if piece.max(initial=-1) < 0:
            break
        sides = _mixtures(colors, adjacency, labels, piece, means, strip)
        mixed = (piece >= 0) & (sides[piece, 0] >= 0)
        size = np.bincount(piece[piece >= 0])
        gone = (size < smallest / SPECKS) & (size < size.max())
        labels = _unmixed(diffuse, labels, mixed, sides[piece])
        labels = np.where(gone[piece] & (piece >= 0) & ~mixed, -1, labels).astype(np.int32)
        few = np.bincount(labels[labels >= 0], minlength=len(means)) < smallest
        few[count.argmax()] = False
        labels = np.where(np.append(few, False)[labels], -1, labels).astype(np.int32)
        regions.fill(colors, *adjacency, labels, means)
    island = np.isfinite(colors[:, 0]) & (labels < 0)
    if island.any():
        there = np.unique(labels[labels >= 0])
        labels[island] = there[cKDTree(means[there]).query(colors[island])[1]]
    return labels


def _mixtures(colors, adjacency, labels, piece, means, strip) -> np.ndarray:
    """The labels (P, 2) between whose colours a thin piece's lies; -1 where it is no such one."""
    sides = np.full((piece.max() + 1, 2), -1)
    if strip <= 0:
        return sides
    indptr, indices = adjacency
    deepest = np.zeros(len(sides), np.int32)
    regions.depths(indptr, indices, labels, piece, deepest)
    thin_ones = np.flatnonzero((deepest > 0) & (deepest <= strip))
    if not len(thin_ones):
        return sides
    counts = np.zeros((len(sides), len(means)), np.int64)
    regions.contacts(indptr, indices, labels, piece, counts)
    own, _ = _means(piece, colors)
    for p in thin_ones:
        b, a = np.argsort(counts[p], kind="stable")[-2:]
        if counts[p, b] < max(BOTH_SIDES * counts[p, a], 1):
            continue
        line = means[b] - means[a]
        share = (own[p] - means[a]) @ line / (line @ line)
        off = np.linalg.norm(own[p] - means[a] - share * line)
        if BETWEEN < share < 1 - BETWEEN and off < OFF_THE_LINE * np.linalg.norm(line):
            sides[p] = a, b
    return sides


def _unmixed(diffuse, labels, mixed, sides) -> np.ndarray:
    """Labels after mixed texels (T,) bool went to the one of their sides (T, 2) that is more of
    their colour: D = a A + b B in linear light, by least squares."""
    mean, _ = _means(labels, np.nan_to_num(diffuse))
    chosen = np.flatnonzero(mixed)
    first, second = mean[sides[chosen, 0]], mean[sides[chosen, 1]]
    aa, bb, ab = ((x * y).sum(1) for x, y in ((first, first), (second, second), (first, second)))
    da, db = ((diffuse[chosen] * x).sum(1) for x in (first, second))
    more = da * (bb + ab) > db * (aa + ab)  # a > b
    unmixed = labels.copy()
    unmixed[chosen] = np.where(more, sides[chosen, 0], sides[chosen, 1])
    return unmixed


def _means(labels: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean colours (M, 3) float64 and texel counts (M,) int64 of the labels."""
    count = np.zeros(int(labels.max(initial=-1)) + 1, np.int64)
    sums = np.zeros((len(count), 3))
    regions.add_colors(colors, labels, sums, count)
    return sums / np.maximum(count, 1)[:, None], count


def _keep_largest(labels: np.ndarray, smallest: float) -> np.ndarray:
    """Labels numbered by falling size; those of fewer than `smallest` texels become −1.

    The largest always stays.
    """
    count = np.bincount(labels[labels >= 0])
    order = np.argsort(-count, kind="stable")
    kept = order[: max(1, np.count_nonzero(count >= max(smallest, 1)))]
    number = np.full(len(count) + 1, -1, np.int32)
    number[kept] = np.arange(len(kept))
    return number[labels]


def _join(labels: np.ndarray, colors: np.ndarray, threshold: float) -> np.ndarray:
    """One label for all regions, in falling size, whose mean is nearer than `threshold`."""
    means, count = _means(labels, colors)
    joined = np.empty(len(count) + 1, np.int32)
    joined[-1] = -1
    centers = np.empty_like(means)
    weights = np.zeros(len(count))
    found = 0
    for region, (mean, size) in enumerate(zip(means, count, strict=True)):
        distance = np.linalg.norm(centers[:found] - mean, axis=1)
        material = int(np.argmin(distance)) if found else 0
        if not found or distance[material] >= threshold:
            material, found = found, found + 1
            centers[material] = 0
        weights[material] += size
        centers[material] += (mean - centers[material]) * size / weights[material]
        joined[region] = material
    return joined[labels]


def _claim_islands(labels, colors, means, observed) -> None:
    """Texels on islands that no region reaches take the nearest mean of all, in place."""
    island = observed & (labels < 0)
    labels[island] = cKDTree(means).query(colors[island])[1]
