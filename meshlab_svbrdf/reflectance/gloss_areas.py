"""Materials by their gloss: clusters alike in it become one, parts of one that differ in it two.

Colour finds areas; ρs and α are what a material is. The sums N, Q, T of an area over a grid of
shininesses (reflectance/elimination.py) add up, so that what one lobe leaves unexplained where two
areas had one each is exact: loss = RSS(a + b) − RSS(a) − RSS(b).

by_gloss      labels of colour in, labels of colour and gloss out
part_unlike   clusters whose patches fall into two kinds of gloss
join_silent   clusters on which no lamp is mirrored, by colour
join_alike    clusters whose highlights one lobe explains
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..blocks import blocks, counted, rowwise, taken
from ..samples.observations import Observations
from ..threads import side_by_side, thread_count
from .elimination import ALPHAS, eliminate, profile
from .fit_samples import choose_texels, collect, flat_limits
from .fit_state import FitState
from .joint import FIRST_ALPHA, JointFit, fit
from .lights import Light

ALIKE = 0.003
"""Share of what either's own lobe explains that one lobe for both may lose: ρs that differ by 8 %,
α by 16 %."""
UNLIKE = 0.05
"""Such a share that two parts must lose at least to be two: ρs that differ by a third."""
WORTH = 0.05
"""Of what two lobes explain, what one must leave: strips along a border are not worth a cluster."""
APART = 4.0
"""Between-parts over within-parts spread of patches, from which on they are of two kinds: one kind,
cut in the middle, has 1.8 (normal) to 3 (even)."""
SURE = 9.0
"""Noise variances that a lobe must leave more than none, to be contradicted."""
HELD = 0.5
"""Of the gain on the patches' one half, what must be there on the other."""
DEPTH = 2
"""Times that clusters may come apart in two."""
CELLS = 12
"""Patches across the object."""
FEWEST = 6
"""Patches of each part."""
ROUNDS, FIT_SAMPLES = 6, 200_000
AREA_SAMPLES, BORDER_SAMPLES = 400_000, 1_500_000
TOGETHER, VOTES = (4, 12, 36, 108, 324), 5
"""Texels that are asked together what their place is, until they are clear; that vote on one that
was not asked: a border is as sharp as the highlights are."""
FARTHEST = 25.0
"""Of a sample, in noise variances, what counts."""
LOUDEST, CLEAR = 6.0, 8.0
"""Of one texel's evidence, in noise variances, what counts; of several's, what is clear."""
CURVATURE = 0.8


@dataclass(frozen=True)
class Lit:
    """What the areas are judged under: samples, lights and how fast the normals turn (T,)."""

    observations: Observations
    turn: np.ndarray
    found: JointFit

    @property
    def lights(self) -> list[Light]:
        return self.found.lights


def by_gloss(
    observations: Observations, labels: np.ndarray, colors: np.ndarray, lights: list[Light],
    turn: np.ndarray, reach: float,
) -> np.ndarray:  # fmt: skip
    """Labels (T,) int32 after clusters came apart whose gloss is of two kinds, and were joined
    whose gloss is one: by falling size, -1 for none.

    labels : (T,) int32, of like colour, ids from 0 without a gap; colors : (T, 3), those it was
    told by, see `materials.color_space`; lights : as the environment map shows them; turn : (T,)
    radians per radius that the normals turn by

    A cluster whose own gloss the samples do not tell joins the one of nearest colour, up to `reach`
    away, whose lobe they do not contradict; without such a one it stays as it is.
    """
    lit = light_up(observations, labels, lights, turn)
    for _ in range(DEPTH):
        if not lit.lights:
            return labels
        parted = part_unlike(lit, labels)
        if parted.max() == labels.max():
            break
        labels = parted
        lit = light_up(observations, labels, lights, turn)
    if not lit.lights:
        return labels
    materials = lit.found.materials
    observed = np.array([m.observed for m in materials])
    sums = area_sums(lit, labels, np.arange(len(observed)))
    noise = np.array([m.noise for m in materials])
    followed = join_silent(labels, sums, observed, noise, colors, reach)
    return by_size(join_alike(followed, sums, observed))


def by_size(labels: np.ndarray) -> np.ndarray:
    """Labels numbered from 0 by falling size, -1 for none."""
    count = counted(labels)
    number = np.full(len(count) + 1, -1, np.int32)
    order = np.argsort(-count, kind="stable")[: np.count_nonzero(count)]
    number[order] = np.arange(len(order))
    return taken(number, labels)


def light_up(
    observations: Observations, labels: np.ndarray, lights: list[Light], turn: np.ndarray
) -> Lit:
    """A short joint fit of clusters (T,), ids from 0 without a gap, refines the lights."""
    found = fit(
        observations, labels, lights, turn, observations.footprint, rounds=ROUNDS,
        samples=FIT_SAMPLES,
    )  # fmt: skip
    return Lit(observations, turn, found)


def patches(labels: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Clusters cut by a grid: (T,) int32 from 0, -1 for none, and the cluster (P,) of each patch.

    position : (T, 3), about the object's centre
    """
    far = rowwise(lambda some: np.linalg.norm(some, axis=1), position).max(initial=0)
    cell = 2 * float(far) / CELLS

    def keys(label: np.ndarray, place: np.ndarray) -> np.ndarray:
        key = label.astype(np.int64)
        for axis in (np.floor(place / max(cell, 1e-30)).astype(np.int64) + CELLS).T:
            key = key * (2 * CELLS + 1) + axis
        return np.where(label >= 0, key, -1)

    key = rowwise(keys, labels, position)
    known = np.unique(np.concatenate([[-1], *(np.unique(key[own]) for own in blocks(len(key)))]))

    def number(some: np.ndarray) -> np.ndarray:
        return np.asarray(np.searchsorted(known, some) - 1, np.int32)

    return rowwise(number, key), (known[1:] // (2 * CELLS + 1) ** 3).astype(np.int32)


def area_sums(lit: Lit, area: np.ndarray, of: np.ndarray, *, half: int = 0) -> np.ndarray:
    """N, Q, T of areas over the grid, (P, 3, A) float64.

    area : (T,) int32, -1 for none; of : (P,) the cluster of each, whose lobe weighs the samples
    half : 0 or 1, of two sets of texels
    """
    with ThreadPoolExecutor(thread_count()) as pool:
        state = _state(lit, area, len(of), AREA_SAMPLES, half, pool)
        rho, alpha = _lobes(lit.found)
        state.predict(rho[of], alpha[of])
        state.reweigh(True)
        return eliminate(
            state.samples, state.weight, state.rays, state.gains, len(of), state.chunks
        )


def join_alike(labels: np.ndarray, sums: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Labels (T,) after clusters (M,) joined whose highlights one lobe explains; best first.

    sums : (M, 3, A) of the clusters; observed : (M,) bool, those whose gloss the samples determine
    """
    sums, into = sums.copy(), np.arange(len(sums))
    alive = np.flatnonzero(observed).tolist()
    while len(alive) > 1:
        pairs = [(a, b) for i, a in enumerate(alive) for b in alive[i + 1 :]]
        losses = [_loss(sums[a], sums[b]) for a, b in pairs]
        best = int(np.argmin(losses))
        if losses[best] > ALIKE:
            break
        a, b = pairs[best]
        sums[a] += sums[b]
        into[into == b] = a
        alive.remove(b)
    return np.append(into, -1)[labels].astype(np.int32)


def join_silent(
    labels: np.ndarray, sums: np.ndarray, observed: np.ndarray, noise: np.ndarray,
    colors: np.ndarray, reach: float,
) -> np.ndarray:  # fmt: skip
    """Labels (T,) after clusters that show no gloss of their own followed the nearest colour.

    noise : (M,) of the residuals; colors : (T, 3); reach : the farthest that a colour may be
    """
    mean = np.array([colors[labels == m].mean(0, dtype=float) for m in range(len(sums))])
    into = np.arange(len(sums))
    for m in np.flatnonzero(~observed):
        best = profile(sums[m]).rss.min()
        near = [
            (float(np.linalg.norm(mean[k] - mean[m])), int(k))
            for k in np.flatnonzero(observed)
            if _under(sums[m][None], _fitted(sums[k][None]))[0] - best < SURE * noise[m] ** 2
        ]
        away, nearest = min(near, default=(np.inf, -1))
        if away <= reach:
            into[m] = nearest
    return np.append(into, -1)[labels].astype(np.int32)


def part_unlike(lit: Lit, labels: np.ndarray) -> np.ndarray:
    """Labels (T,) after clusters came apart whose patches are of two kinds of gloss."""
    patch, of = patches(labels, lit.observations.texels.position)
    first, second = side_by_side(
        lambda: area_sums(lit, patch, of, half=0), lambda: area_sums(lit, patch, of, half=1)
    )
    parted = labels.copy()
    for cluster in np.unique(of):
        own = np.flatnonzero(of == cluster)
        lobes = _two_kinds(first[own], second[own])
        if lobes is not None:
            rarer = _texels_of(lit, labels == cluster, lobes)
            parted[rarer] = parted.max() + 1
    return parted


Lobe = tuple[float, float]


def _state(
    lit: Lit, area: np.ndarray, areas: int, samples: int, half: int, pool: ThreadPoolExecutor
) -> FitState:
    counts = lit.observations.store.counts()
    limits = flat_limits(np.full(areas, FIRST_ALPHA), CURVATURE, lit.observations.footprint)
    chosen, _ = choose_texels(area, counts, lit.turn, limits, samples, half)
    taken = collect(lit.observations, chosen, area[chosen])
    state = FitState(lit.observations, taken, areas, pool)
    state.light(lit.lights)
    return state


def _lobes(found: JointFit) -> tuple[np.ndarray, np.ndarray]:
    rho = np.array([m.rho_s if m.observed else 0.0 for m in found.materials])
    return rho, np.array([m.alpha if m.observed else 1.0 for m in found.materials])


def _loss(a: np.ndarray, b: np.ndarray) -> float:
    """What one lobe for both loses, as a share of what either's own explains (the lesser)."""
    own, other, both = profile(a), profile(b), profile(a + b)
    lost = both.rss.min() - own.rss.min() - other.rss.min()
    explained = min(p.total - float(p.rss.min()) for p in (own, other))
    return float(lost / explained) if explained > 0 else np.inf


def _under(sums: np.ndarray, lobe: Lobe) -> np.ndarray:
    """What a lobe leaves unexplained of areas (P, 3, A)."""
    rho, alpha = lobe
    n, q, t = sums[:, :, int(np.abs(np.log(ALPHAS / alpha)).argmin())].T
    return t - 2 * rho * n + rho * rho * q


def _fitted(sums: np.ndarray) -> Lobe:
    """The best lobe of areas together, at a shininess of the grid."""
    n, q, _ = sums.sum(0)
    rho = np.maximum(
        np.divide(n, q, out=np.zeros_like(n), where=q > 1e-12 * max(q.max(), 1e-300)), 0
    )
    best = int(np.argmax(rho * (2 * n - rho * q)))
    return float(rho[best]), float(ALPHAS[best])


def _two_kinds(first: np.ndarray, second: np.ndarray) -> tuple[Lobe, Lobe] | None:
    """The lobes of two kinds of patches (P, 3, A), or None where they are of one.

    first, second : of two sets of texels; the kinds are told by one, and judged by the other
    """
    if len(first) < 2 * FEWEST:
        return None
    kind = _sorted_in_two(first)
    if min(kind.sum(), (~kind).sum()) < FEWEST:
        return None
    whole, lobes = _fitted(first), (_fitted(first[~kind]), _fitted(first[kind]))
    free = sum(float(_under(s[None], _fitted(s[None]))[0]) for s in first)
    two = _under(first[~kind], lobes[0]).sum() + _under(first[kind], lobes[1]).sum()
    gain, within = _under(first, whole).sum() - two, two - free
    held = _under(second, whole).sum() - (
        _under(second[~kind], lobes[0]).sum() + _under(second[kind], lobes[1]).sum()
    )
    unlike = _loss(first[~kind].sum(0), first[kind].sum(0)) >= UNLIKE
    explained = first[:, 2, 0].sum() - two
    worth = gain > WORTH * explained
    if not (unlike and worth and gain > APART * within and held > HELD * gain):
        return None
    commoner_first = first[~kind, 1].max(1).sum() >= first[kind, 1].max(1).sum()
    return lobes if commoner_first else lobes[::-1]


def _sorted_in_two(sums: np.ndarray) -> np.ndarray:
    """Patches (P,) bool after a few rounds of fitting two lobes, from the strongest contrast on."""
    whole = _fitted(sums)
    own = np.array([_fitted(s[None])[0] for s in sums])
    weight = sums[:, 1, int(np.abs(np.log(ALPHAS / whole[1])).argmin())]
    order = np.argsort(own, kind="stable")
    half = np.cumsum(weight[order]) > weight.sum() / 2
    kind = np.zeros(len(sums), bool)
    kind[order[half]] = True
    for _ in range(20):
        if not kind.any() or kind.all():
            break
        a, b = _fitted(sums[~kind]), _fitted(sums[kind])
        after = _under(sums, b) < _under(sums, a)
        if (after == kind).all():
            break
        kind = after
    return kind


def _texels_of(lit: Lit, inside: np.ndarray, lobes: tuple[Lobe, Lobe]) -> np.ndarray:
    """Which texels (T,) bool of a cluster the second lobe clearly describes better."""
    area = np.where(inside, 0, -1).astype(np.int32)
    with ThreadPoolExecutor(thread_count()) as pool:
        state = _state(lit, area, 1, BORDER_SAMPLES, 0, pool)
        left = []
        for rho, alpha in lobes:
            state.predict(np.array([rho]), np.array([alpha]))
            left.append(np.square(state.residual))
        noise2 = max(2.2 * float(np.median(np.minimum(*left))), 0.01)  # 1.48²
        left = [np.minimum(e2 / noise2, FARTHEST) for e2 in left]
        quality = np.where(state.samples.clipped, 0, state.samples.quality)
        evidence = np.add.reduceat(quality * (left[0] - left[1]), state.samples.offsets[:-1])
        texel = state.samples.texel
    # As many neighbours speak together as it takes to be clear; the silent follow the nearest
    evidence = np.clip(evidence, -LOUDEST, LOUDEST)
    tree = cKDTree(lit.observations.texels.position[texel])
    kind, silent = np.zeros(len(texel)), np.arange(len(texel))
    for together in TOGETHER:
        near = _nearest(tree, tree.data[silent], together)
        said = evidence[near].sum(1)
        clear = np.abs(said) > CLEAR
        kind[silent[clear]] = np.sign(said[clear])
        silent = silent[~clear]
    heard = np.flatnonzero(kind)
    if not len(heard):
        return np.zeros(len(inside), bool)
    tree, kind = cKDTree(tree.data[heard]), kind[heard]
    second = np.zeros(len(inside), bool)
    for block in blocks(len(inside)):
        own = block.start + np.flatnonzero(inside[block])
        votes = kind[_nearest(tree, lit.observations.texels.position[own], VOTES)].sum(1)
        second[own[votes > 0]] = True
    return second


def _nearest(tree: cKDTree, place: np.ndarray, count: int) -> np.ndarray:
    """The nearest points (N, count) of a tree, fewer where there are no more."""
    count = min(count, tree.n)
    return tree.query(place, k=count, workers=-1)[1].reshape(len(place), count)
