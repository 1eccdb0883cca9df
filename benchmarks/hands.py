"""A minute by hand: what a user who knows the object does to the clusters, by a fixed rule.

Six operations at most, about ten seconds each, the most useful first; what would not help is not
done. One merge picks up to four clusters that are mostly of one material. One split follows the
border of a piece that lies in a foreign cluster: a point every twenty-fifth of the radius, each off
by about a two-hundredth (a few pixels on the screen), drawn a little beyond the ends. A stroke that
divides nothing has cost its ten seconds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse.csgraph import dijkstra

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph
from meshlab_svbrdf.reflectance.edit import merge, split_on

from .scenes.score import adjusted_rand

OPERATIONS, PICKED = 6, 4
SEEN = 0.002  # of the object: a smaller mistake is not noticed
STEP, TREMBLE, BEYOND = 0.04, 0.005, 0.02  # radii
WORTH = 0.001  # of adjusted Rand: what is done at all

Work = Callable[[np.ndarray], np.ndarray]


def a_minute(
    surface: SurfaceGraph, labels: np.ndarray, truth: np.ndarray, radius: float
) -> tuple[np.ndarray, list[str]]:
    """Labels (T,) after it, and what was done.

    truth : (T,) int, the material a user sees there, -1 where nobody judges
    """
    rng, done = np.random.default_rng(0), list[str]()
    tried = set[str]()
    now = adjusted_rand(truth, labels)
    while len(done) < OPERATIONS:
        best, words, failed = labels, "", ""
        most = now + WORTH
        for said, work in [*_merges(labels, truth), *_splits(surface, labels, truth, radius, rng)]:
            if said in tried:
                continue
            try:
                after = work(labels)
            except SvbrdfError:
                failed = failed or said
                continue
            if (rand := adjusted_rand(truth, after)) > most:
                best, words, most = after, said, rand
        if words:
            labels, now = best, most
            done.append(words)
            tried.clear()
        elif failed:
            tried.add(failed)
            done.append(f"{failed}: divided nothing")
        else:
            break
    return labels, done


def _table(labels: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Texels by cluster and material."""
    judged = (labels >= 0) & (truth >= 0)
    table = np.zeros((labels.max() + 1, truth.max() + 1), int)
    np.add.at(table, (labels[judged], truth[judged]), 1)
    return table


def _merges(labels: np.ndarray, truth: np.ndarray) -> list[tuple[str, Work]]:
    table = _table(labels, truth)
    mostly = np.where(table.sum(1) > 0, table.argmax(1), -1)
    found: list[tuple[str, Work]] = []
    for material in range(table.shape[1]):
        own = np.flatnonzero(mostly == material)
        own = own[np.argsort(-table[own].sum(1), kind="stable")][:PICKED]
        if len(own) > 1:
            ids = own.tolist()
            found.append((f"merge {ids}", lambda before, ids=ids: merge(before, ids)))
    return found


def _splits(
    surface: SurfaceGraph, labels: np.ndarray, truth: np.ndarray, radius: float,
    rng: np.random.Generator,
) -> list[tuple[str, Work]]:  # fmt: skip
    """Of every cluster, and each material that it is not mostly of, the largest piece."""
    table = _table(labels, truth)
    least = SEEN * np.count_nonzero(truth >= 0)
    found: list[tuple[str, Work]] = []
    for cluster, row in enumerate(table):
        for material in np.flatnonzero(row >= least):
            if material == row.argmax():
                continue
            inside = labels == cluster
            piece = surface.components(inside & (truth == material))
            size = np.bincount(piece[piece >= 0])
            if size.max() < least:
                continue
            line = _border(surface, piece == size.argmax(), inside & (truth != material))
            if len(line) < 2:
                continue
            stroke = _by_hand(surface.position[line].astype(float), radius, rng)
            found.append((
                f"split {cluster} around material {material}",
                lambda before, c=cluster, s=stroke: split_on(surface, before, c, s),
            ))  # fmt: skip
    return found


def _border(surface: SurfaceGraph, piece: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Texels along the longest way on the rim of a piece towards the rest, back to its start where
    it goes around."""
    indptr, indices = surface.adjacency
    owner = np.repeat(np.arange(len(piece)), np.diff(indptr))
    rim = np.unique(owner[piece[owner] & rest[indices]])
    if len(rim) < 2:
        return rim
    part = surface.components(np.isin(np.arange(len(piece)), rim))[rim]
    rim = rim[part == np.bincount(part).argmax()]
    graph = surface.lengths(rim)

    def way(start: int, end: int | None = None) -> np.ndarray:
        away, before = dijkstra(graph, indices=start, return_predecessors=True)
        at = int(np.where(np.isfinite(away), away, -1).argmax()) if end is None else end
        path = [at] if np.isfinite(away[at]) else []
        while path and before[path[-1]] >= 0:
            path.append(int(before[path[-1]]))
        return np.array(path[::-1], int)

    there = way(int(way(0)[-1]))
    # Around the other side, clear of the first way
    clear = np.ones(len(rim), bool)
    for texel in there[2:-2]:
        near = graph.indices[graph.indptr[texel] : graph.indptr[texel + 1]]
        clear[near] = clear[texel] = False
    clear[[there[0], there[-1]]] = True
    shut = ~clear
    weight = shut[graph.indices] | np.repeat(shut, np.diff(graph.indptr))
    graph.data[weight] = np.inf
    back = way(int(there[-1]), int(there[0]))
    return rim[np.concatenate([there, back[1:]])] if len(back) else rim[there]


def _by_hand(line: np.ndarray, radius: float, rng: np.random.Generator) -> np.ndarray:
    """Points (S, 3) as a hand sets them along a line (P, 3)."""
    walked = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    count = max(2, round(walked[-1] / (STEP * radius)) + 1)
    at = np.linspace(0, walked[-1], count)
    points = np.stack([np.interp(at, walked, line[:, axis]) for axis in range(3)], 1)
    closed = np.linalg.norm(line[0] - line[-1]) < STEP * radius
    points += rng.normal(0, TREMBLE * radius, points.shape)
    if closed:
        return np.concatenate([points, points[:1]])
    for end, inner in ((0, 1), (-1, -2)):
        out = points[end] - points[inner]
        points[end] += BEYOND * radius * out / max(float(np.linalg.norm(out)), 1e-12)
    return points
