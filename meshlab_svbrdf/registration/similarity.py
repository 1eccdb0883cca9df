"""Scale, rotation and translation as a whole: cameras from elsewhere brought to the mesh.

Similarity            X' = s R X + T
similarity_of_points  from pairs of points, least squares (Umeyama 1991)
similarity_to_mesh    from the sparse points of the object, by closest points (ICP)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..geometry.camera import Camera

ROUNDS = 200
KEPT = 0.8  # share of the points that are taken for the object's, the nearest


@dataclass(frozen=True)
class Similarity:
    """scale : > 0; rotation : (3, 3); translation : (3,) — all float64."""

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) in the new world."""
        return self.scale * points @ self.rotation.T + self.translation

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees the same in the new world; its depths are `scale` times as large."""
        R = camera.R @ self.rotation.T
        return replace(camera, R=R, t=self.scale * camera.t - R @ self.translation)


def similarity_of_points(source: np.ndarray, target: np.ndarray) -> Similarity:
    """The similarity that leads `source` (N, 3) to `target` (N, 3) best.

    Raises
    ------
    ValueError : fewer than three points, or all (nearly) on a line: their turn is not determined.
    """
    if len(source) < 3:
        raise ValueError(f"{len(source)} pairs of points are given, at least 3 are needed")
    a, b = source - source.mean(0), target - target.mean(0)
    for points in (a, b):
        spread = np.linalg.svd(points, compute_uv=False)
        if not spread[1] > 1e-4 * spread[0]:
            raise ValueError("the points lie on a line: give one beside it")
    U, S, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = (U * sign) @ Vt
    s = float((S * sign).sum() / (a * a).sum())
    return Similarity(s, R, target.mean(0) - s * R @ source.mean(0))


def similarity_to_mesh(
    points: np.ndarray, vertices: np.ndarray, start: Similarity | None = None
) -> tuple[Similarity, float]:
    """Lay points of the object on the mesh, by closest vertices.

    Parameters
    ----------
    points : (N, 3) of a reconstruction; a fifth of them may belong to other things
    vertices : (V, 3) of the mesh
    start : None: tried from the boxes of both, in the 24 turns of their principal axes

    Returns
    -------
    similarity, rms : the distance of the nearest 80 % of the points, in the mesh's units

    Raises
    ------
    ValueError : fewer than 50 points.
    """
    if len(points) < 50:
        raise ValueError(f"{len(points)} points are too few to find the object by, 50 are needed")
    tree = cKDTree(vertices)
    some = points[np.linspace(0, len(points) - 1, min(len(points), 2000)).astype(int)]
    starts = [start] if start is not None else _starts(some, vertices)
    coarse = [_icp(some[:: max(1, len(some) // 400)], tree, each, 40) for each in starts]
    best = min(coarse, key=lambda found: found[1])[0]
    return _icp(some, tree, best, ROUNDS)


def _starts(points: np.ndarray, vertices: np.ndarray) -> list[Similarity]:
    """Principal axes on principal axes, in every turn of them."""
    core = points[_near_median(points)]
    (center_a, size_a, axes_a), (center_b, size_b, axes_b) = _axes(core), _axes(vertices)
    s = size_b / size_a
    found = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        for x in (1, -1):
            for y in (1, -1):
                turn = np.zeros((3, 3))
                turn[[0, 1, 2], order] = [x, y, 1]
                turn[2] *= np.linalg.det(turn)
                R = axes_b @ turn @ axes_a.T
                found.append(Similarity(s, R, center_b - s * R @ center_a))
    return found


def _near_median(points: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return distance <= np.quantile(distance, KEPT)


def _axes(points: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    center = points.mean(0)
    _, S, Vt = np.linalg.svd(points - center, full_matrices=False)
    axes = Vt.T * [1, 1, np.sign(np.linalg.det(Vt))]
    return center, float(np.linalg.norm(S) / np.sqrt(len(points))), axes


def _icp(
    points: np.ndarray, tree: cKDTree, start: Similarity, rounds: int
) -> tuple[Similarity, float]:
    """Closest points and their similarity in turn; the farthest fifth does not count."""
    found, rms = start, np.inf
    for _ in range(rounds):
        distance, index = tree.query(found.points(points))
        near = distance <= np.quantile(distance, KEPT)
        now = float(np.sqrt(np.mean(distance[near] ** 2)))
        if not now < rms * (1 - 1e-5):
            break
        rms = now
        found = similarity_of_points(points[near], tree.data[index[near]])
    return found, rms
