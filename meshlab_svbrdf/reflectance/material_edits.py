"""Edits of materials as values: said in words, done again to the same effect.

Merge, Split, Carve   what a hand did
perform               labels after it
to_text, from_text    one line each: "merge 0 3", "split 4 stroke x y z; …", "split 4 faces 0-9 12"
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import SvbrdfError
from ..geometry.surface_graph import SurfaceGraph
from .edit import carve, merge, split_on

DIGITS = 9
"""Of a stroke's coordinates: what is written is what was done."""


@dataclass(frozen=True, eq=False)
class Merge:
    """ids : the clusters that become one, which keeps the smallest"""

    ids: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Split:
    """cluster : the one to cut; stroke : (S, 3) float64, points of the world"""

    cluster: int
    stroke: np.ndarray


@dataclass(frozen=True, eq=False)
class Carve:
    """faces : (n,) int64 ascending, whose texels become a cluster of their own
    cluster : only those of this one; -1: those of any"""

    cluster: int
    faces: np.ndarray


Edit = Merge | Split | Carve


@dataclass(frozen=True)
class Canvas:
    """What is edited: the texels' graph about `center` (3,), and the face (T,) of each texel."""

    graph: SurfaceGraph
    center: np.ndarray
    face: np.ndarray


def perform(labels: np.ndarray, edit: Edit, canvas: Canvas) -> np.ndarray:
    """Labels (T,) int32 after the edit; SvbrdfError where it does nothing."""
    if isinstance(edit, Merge):
        return merge(labels, edit.ids)
    if isinstance(edit, Split):
        return split_on(canvas.graph, labels, edit.cluster, edit.stroke - canvas.center)
    return carve(labels, np.isin(canvas.face, edit.faces), edit.cluster)


def rounded(stroke: np.ndarray) -> np.ndarray:
    """A stroke with as many digits as are written."""
    return np.array([[float(f"{x:.{DIGITS}g}") for x in point] for point in stroke])


def points_text(points: np.ndarray) -> str:
    """ "x y z; x y z" """
    return "; ".join(" ".join(f"{x:.{DIGITS}g}" for x in point) for point in points)


def faces_text(faces: np.ndarray) -> str:
    """Runs of whole numbers, "0-9 12"; the inverse of `read_faces`."""
    faces = np.unique(faces)
    if not len(faces):
        return ""
    starts = np.flatnonzero(np.diff(faces, prepend=faces[0] - 2) > 1)
    stops = np.append(starts[1:], len(faces)) - 1
    return " ".join(
        f"{faces[a]}" if a == b else f"{faces[a]}-{faces[b]}"
        for a, b in zip(starts, stops, strict=True)
    )


def read_faces(text: str) -> np.ndarray:
    """Ascending int64; SvbrdfError for anything but runs of whole numbers."""
    found = []
    for word in text.replace(",", " ").split():
        first, dash, last = word.partition("-")
        if not first.isdecimal() or not (last if dash else first).isdecimal():
            raise SvbrdfError(f"faces has {word!r}, expected numbers and runs, such as 0-9 12")
        found.append(np.arange(int(first), int(last or first) + 1))
    return np.unique(np.concatenate(found)) if found else np.zeros(0, np.int64)


def to_text(edits: Iterable[Edit]) -> str:
    """One line an edit."""
    lines = []
    for edit in edits:
        if isinstance(edit, Merge):
            lines.append("merge " + " ".join(map(str, edit.ids)))
        elif isinstance(edit, Split):
            lines.append(f"split {edit.cluster} stroke {points_text(edit.stroke)}")
        else:
            lines.append(f"split {edit.cluster} faces {faces_text(edit.faces)}")
    return "\n".join(lines)


def from_text(text: str) -> list[Edit]:
    """The inverse of `to_text`; lines may also be parted by "|"."""
    edits: list[Edit] = []
    for line in text.replace("|", "\n").splitlines():
        words = line.split()
        if not words:
            continue
        try:
            if words[0] == "merge":
                edits.append(Merge(tuple(map(int, words[1:]))))
            elif words[0] == "split" and words[2] == "stroke":
                rows = line.split("stroke", 1)[1].split(";")
                stroke = np.array([[float(x) for x in row.split()] for row in rows if row.strip()])
                if stroke.ndim != 2 or stroke.shape[1] != 3 or not np.isfinite(stroke).all():
                    raise ValueError
                edits.append(Split(int(words[1]), stroke))
            elif words[0] == "split" and words[2] == "faces":
                edits.append(Carve(int(words[1]), read_faces(" ".join(words[3:]))))
            else:
                raise ValueError
        except (ValueError, IndexError):
            short = line.strip() if len(line) < 60 else line.strip()[:57] + "…"
            raise SvbrdfError(
                f"cannot read the edit {short!r}; expected 'merge 0 3', 'split 4 stroke x y z; "
                "x y z' or 'split 4 faces 0-9 12'"
            ) from None
    return edits
