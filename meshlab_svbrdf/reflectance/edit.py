"""What the user does to the automatic materials: pick, merge, split along a stroke (paper §7.3).

labels : (T,) int32, −1 for none. An edit returns new labels and keeps the ids it does not touch.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph

# A point farther than this from every texel, in texel spacings, is not on the object.
OFF_THE_OBJECT = 10.0

# Half the stroke's width in lengths of an edge, 1.2 spacings on a square grid: no edge of the graph
# (at most 2.5 spacings) crosses it with both ends outside.
HALF_WIDTH = 1.5
RINGS = 3
"""Of neighbours around the stroke, within which all lies that is so near."""

# Fewer texels than this between stroke and border are fringe, not a part.
SMALLEST_PART = 10


def merge(labels: np.ndarray, ids: Iterable[int]) -> np.ndarray:
    """All of `ids` become one material, which keeps the smallest of them.

    Raises SvbrdfError for ids that no texel has, and for fewer than two.
    """
    ids = sorted(set(ids))
    if len(ids) < 2:
        raise SvbrdfError(f"merging needs at least two different materials, got {ids}")
    for material in ids:
        _check_material(labels, material)
    return np.where(np.isin(labels, ids), ids[0], labels).astype(np.int32)


def pick(positions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The texels (S,) nearest to points (S, 3) on the object, in the frame of `positions` (T, 3).

    Raises SvbrdfError, with its number, for a point farther from it than 10 texel spacings.
    """
    return _on_object(SurfaceGraph(positions, positions), np.asarray(points, float))


def pick_on(surface: SurfaceGraph, point: np.ndarray) -> int:
    """`pick` of one point (3,) on a surface that is kept."""
    return int(_on_object(surface, np.reshape(point, (1, 3)))[0])


def carve(labels: np.ndarray, chosen: np.ndarray, cluster: int = -1) -> np.ndarray:
    """Make the texels `chosen` (T,) bool a material of their own, `labels.max() + 1`.

    cluster : only those of this material; -1: those of any, so that what was painted is one

    Raises SvbrdfError for an unknown material, and where nothing, or all of it, would be taken.
    """
    if cluster >= 0:
        _check_material(labels, cluster)
        inside = labels == cluster
    else:
        inside = labels >= 0
    taken = inside & chosen
    what = f"material {cluster}" if cluster >= 0 else "any material"
    if not taken.any():
        raise SvbrdfError(f"what was chosen holds no texel of {what}: nothing to split off")
    whole = np.unique(labels[taken])
    if len(whole) == 1 and taken.sum() == np.count_nonzero(labels == whole[0]):
        raise SvbrdfError(
            f"what was chosen is all of material {whole[0]}: choose a part of it to split off"
        )
    return np.where(taken, labels.max() + 1, labels).astype(np.int32)


def split(
    labels: np.ndarray,
    cluster: int,
    stroke: np.ndarray,
    positions: np.ndarray,
    normals: np.ndarray,
    adjacency: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Cut a material in two (or more) along a stroke over the object.

    The stroke follows the surface from point to point, as straight as it can. Only the connected
    pieces of the material that it touches are cut; of each the largest part, and every piece that
    was not cut, keep the id, the others take new ones from `labels.max() + 1`, the larger first.
    Texels under the stroke go to the nearest part. `merge` of the ids is the inverse.

    Parameters
    ----------
    labels : (T,) int32
    cluster : the material to cut
    stroke : (S, 3) float, S >= 2 points on the object, in the frame of `positions`; it may go on
        beyond the material, and should: it must reach its border on both ends, or close a loop
    positions, normals : (T, 3) float
    adjacency : (indptr, indices), see `geometry.adjacency.neighbours`

    Raises
    ------
    SvbrdfError : unknown material, stroke not on the object or not over the material, points that
        the surface does not connect, or a stroke that divides nothing, with how far it got
    """
    return split_on(SurfaceGraph(positions, normals, adjacency), labels, cluster, stroke)


def split_on(
    surface: SurfaceGraph, labels: np.ndarray, cluster: int, stroke: np.ndarray
) -> np.ndarray:
    """`split` on a surface that is kept from stroke to stroke."""
    _check_material(labels, cluster)
    path = _over_surface(stroke, surface)
    ribbon = _ribbon(path, surface)
    inside = labels == cluster
    if not (ribbon & inside).any():
        raise SvbrdfError(
            f"the stroke does not touch material {cluster}: draw it over the material"
        )

    # Take the ribbon out of the pieces that it touches
    piece = surface.components(inside)
    touched = np.isin(piece, np.unique(piece[ribbon & inside])) & inside
    part = surface.components(touched & ~ribbon)
    count = np.bincount(part[part >= 0], minlength=1)
    part[(part >= 0) & (count[part] < SMALLEST_PART)] = -1
    order = [p for p in np.argsort(-count, kind="stable") if count[p] >= SMALLEST_PART]

    # The largest part of a piece keeps the id
    of_piece = {p: piece[np.argmax(part == p)] for p in order}
    largest = {of_piece[p]: p for p in reversed(order)}
    severed = [p for p in order if largest[of_piece[p]] != p]
    if not severed:
        raise SvbrdfError(_not_divided(cluster, path, inside, surface.position))
    part = _nearest_part(part, touched, surface)
    result = labels.astype(np.int32)
    for new, p in enumerate(severed, int(labels.max()) + 1):
        result[part == p] = new
    return result


def _check_material(labels: np.ndarray, material: int) -> None:
    known = np.unique(labels[labels >= 0])
    if material not in known:
        some = ", ".join(map(str, known[:20])) + (", …" if len(known) > 20 else "")
        raise SvbrdfError(f"there is no material {material}; there are: {some or 'none'}")


def _on_object(surface: SurfaceGraph, points: np.ndarray) -> np.ndarray:
    """Nearest texel of each point (S, 3); all must be near the object."""
    if not len(surface):
        raise SvbrdfError("there are no texels to pick from")
    if not np.isfinite(points).all():
        raise SvbrdfError("a point on the object must be three finite numbers")
    distance, texel = surface.tree.query(points)
    worst, unit = int(distance.argmax()), surface.unit
    if unit > 0 and distance[worst] > OFF_THE_OBJECT * unit:
        raise SvbrdfError(
            f"point {worst} {points[worst].tolist()} lies {distance[worst]:.4g} off the object, "
            f"expected at most {OFF_THE_OBJECT * unit:.4g}"
        )
    return texel


def _over_surface(stroke: np.ndarray, surface: SurfaceGraph) -> np.ndarray:
    """Texels (P,) along the stroke, neighbours each to the next."""
    stroke = np.asarray(stroke, float)
    if stroke.ndim != 2 or stroke.shape[1] != 3 or len(stroke) < 2:
        raise SvbrdfError(f"a stroke needs two or more points (S, 3), got shape {stroke.shape}")
    texels = _on_object(surface, stroke)
    path = [texels[:1]]
    for start, end in pairwise(texels):
        if start != end:
            path.append(_straightest(start, end, surface)[1:])
    return np.concatenate(path)


def _straightest(start: int, end: int, surface: SurfaceGraph) -> np.ndarray:
    """Texels from start to end, over the surface and near the plane that both normals span."""
    positions, normals, unit = surface.position, surface.normal, surface.unit
    chord = positions[end].astype(float) - positions[start]
    across = np.cross(chord, normals[start].astype(float) + normals[end])
    across /= max(float(np.linalg.norm(across)), 1e-12 * unit * unit)

    # A detour of more than twice the chord is not what was drawn
    reach = 2 * float(np.linalg.norm(chord)) + 4 * unit
    around = np.sort(
        surface.tree.query_ball_point((positions[start] + positions[end]) / 2.0, reach)
    )
    off_plane = np.abs((positions[around] - positions[start].astype(float)) @ across) / unit
    graph = surface.lengths(around)
    graph.data *= 1 + off_plane[graph.indices] + np.repeat(off_plane, np.diff(graph.indptr))

    first, last = np.searchsorted(around, [start, end])
    before = dijkstra(graph, indices=first, return_predecessors=True)[1]
    path = [last]
    while before[path[-1]] >= 0:
        path.append(before[path[-1]])
    if path[-1] != first:
        raise SvbrdfError(
            f"no way over the surface from {positions[start].tolist()} to "
            f"{positions[end].tolist()} near the stroke: draw it with points closer together"
        )
    return around[path[::-1]]


def _ribbon(path: np.ndarray, surface: SurfaceGraph) -> np.ndarray:
    """Texels (T,) bool under the stroke, not those on the other side of a thin sheet."""
    positions, (indptr, indices) = surface.position, surface.adjacency
    ends = np.concatenate([indices[indptr[i] : indptr[i + 1]] for i in path])
    starts = np.repeat(path, indptr[path + 1] - indptr[path])
    edge = np.median(np.linalg.norm(positions[starts] - positions[ends], axis=1))
    around = path
    for _ in range(RINGS):
        around = np.unique(np.concatenate([around, surface.around(around)]))
    distance, _ = cKDTree(positions[path]).query(
        positions[around], distance_upper_bound=HALF_WIDTH * float(edge)
    )
    near = np.zeros(len(positions), bool)
    near[around[np.isfinite(distance)]] = True
    near[path] = True
    part = surface.components(near)
    return near & np.isin(part, np.unique(part[path]))


def _nearest_part(part: np.ndarray, touched: np.ndarray, surface: SurfaceGraph) -> np.ndarray:
    """Parts (T,) after every texel of `touched` without one joined the nearest on the surface.

    The way to the nearest texel with a part leads over texels without one alone.
    """
    bare = np.flatnonzero(touched & (part < 0))
    beside = surface.around(bare)
    chosen = np.unique(np.concatenate([bare, beside[part[beside] >= 0]]))
    sources = np.flatnonzero(part[chosen] >= 0)
    graph = surface.lengths(chosen)
    nearest = dijkstra(graph, indices=sources, min_only=True, return_predecessors=True)[2]
    reached = nearest >= 0
    joined = part.copy()
    joined[chosen[reached]] = part[chosen[nearest[reached]]]
    return joined


def _not_divided(cluster, path, inside, positions) -> str:
    """Why the stroke divides nothing: how deep in the material its ends lie."""
    share = f"{np.count_nonzero(inside[path])} of its {len(path)} texels lie on the material"
    if inside.all():
        return (
            f"the stroke does not divide material {cluster}, which covers the object: close it to "
            f"a loop ({share})"
        )
    outside = cKDTree(positions[~inside])
    depth = outside.query(positions[path[[0, -1]]])[0] * inside[path[[0, -1]]]
    return (
        f"the stroke does not divide material {cluster}: {share}, its ends are {depth[0]:.4g} and "
        f"{depth[1]:.4g} away from the border; draw it beyond the border on both sides"
    )
