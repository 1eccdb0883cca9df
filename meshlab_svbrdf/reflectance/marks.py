"""What was marked on a mesh, by selection or by paint, as edits of the materials."""

from __future__ import annotations

import numpy as np

from ..errors import SvbrdfError
from .edit import merge
from .material_edits import Carve, Edit, Merge

FEWEST = 0.1
"""Of the vertices of the commonest paint: rarer colours are soft edges, and go to the nearest."""
MOST_PAINTS = 64
TOUCHED = 0.01
"""Share of a mark's texels from which on a cluster under it counts as meant."""


def selection_marks(selected: np.ndarray) -> np.ndarray:
    """Marks (F,) int32 of faces (F,) bool: 0 where selected, -1 elsewhere."""
    return np.where(selected, 0, -1).astype(np.int32)


def paint_marks(colors: np.ndarray, unpainted: np.ndarray) -> np.ndarray:
    """Which paint each of some colours (N, 3) uint8 is: (N,) int32, -1 for `unpainted` (3,).

    A brush with soft edges leaves mixtures: rare colours go to the nearest that is not rare.
    Raises SvbrdfError where nothing is painted, or no paints stand out.
    """
    table, which, count = np.unique(colors[:, :3], axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    bare = (table == unpainted).all(1)
    if bare.all():
        raise SvbrdfError("nothing is painted: every colour is that of what is unpainted")
    common = ~bare & (count >= max(FEWEST * count[~bare].max(), 1))
    if common.sum() > MOST_PAINTS:
        raise SvbrdfError(
            f"the paint has {common.sum()} colours, expected at most {MOST_PAINTS}: paint with one "
            "plain colour for each material, without soft edges or shading"
        )
    paints = np.flatnonzero(common)
    anchors = np.concatenate([paints, np.flatnonzero(bare)])
    number = np.concatenate([np.arange(len(paints)), np.full(bare.sum(), -1)])
    away = np.linalg.norm(table[:, None].astype(float) - table[anchors].astype(float), axis=2)
    return number[away.argmin(1)][which].astype(np.int32)


def marks_of_faces(vertex_marks: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """A face has the mark that two of its corners have, else that of its first; (F,) int32."""
    a, b, c = vertex_marks[faces].T
    return np.where((b == c) & (a != b), b, a)


def edits_of_marks(
    marks: np.ndarray, labels: np.ndarray, face: np.ndarray, *, merges: bool, cluster: int = -1
) -> list[Edit]:
    """What marks on faces (F,) int32 mean, mark by mark.

    labels, face : (T,) the texels' materials and faces
    merges : the clusters under a mark become one; else the marked part becomes one of its own
    cluster : splits touch only this one; -1: any

    Raises SvbrdfError for a mark that means nothing: over no texels, or within one cluster alone.
    """
    edits: list[Edit] = []
    for mark in range(int(marks.max(initial=-1)) + 1):
        faces = np.flatnonzero(marks == mark)
        if not merges:
            edits.append(Carve(cluster, faces))
            continue
        under = labels[(marks[face] == mark) & (labels >= 0)]
        ids, count = np.unique(under, return_counts=True)
        meant = ids[count >= TOUCHED * max(len(under), 1)]
        if len(meant) < 2:
            what = f"material {meant[0]} alone" if len(meant) else "no material"
            raise SvbrdfError(f"a mark lies on {what}: a merge is marked across two or more")
        edits.append(Merge(tuple(meant.tolist())))
        labels = merge(labels, meant.tolist())
    if not edits:
        raise SvbrdfError("nothing is marked")
    return edits
