"""An editing session: materials, every state since it began, and saving. No web in here.

Every change is checked against `revision`: who edits what another page has changed since is told,
and nothing is lost.
"""

from __future__ import annotations

from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np

from ..document.document import Document
from ..errors import SvbrdfError
from ..filters._clusters import find_clusters
from ..filters._materials import edit_steps, names_text
from ..progress import Progress
from ..reflectance.labels import palette
from ..reflectance.material_edits import Edit, Merge, Split, perform, rounded, to_text
from ..reflectance.materials import (
    LIGHTNESS_WEIGHT,
    MINIMUM_SHARE,
    THRESHOLD,
    segment,
)
from ..script import Step, write_script
from .coarse import Coarse
from .scene import MATERIALS, Scene
from .states import State, pack, unpack

LONGEST_NAME = 60
EDITS, NAMES = "apply_svbrdf_material_edits", "set_svbrdf_material_names"
FOUND_BY = {
    "threshold": THRESHOLD,
    "lightness_weight": LIGHTNESS_WEIGHT,
    "minimum_share": MINIMUM_SHARE,
    "join": True,
    "gloss": False,
}
"""Parameters of compute_svbrdf_materials that a new threshold keeps."""


class ConflictError(SvbrdfError):
    """Somebody else changed what was to be edited."""


class Session:
    """Materials under edit. Methods may be called from several threads.

    labels : (T,) int32, of the current state
    revision : rises with every change, undo and redo
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.lock = RLock()
        self.revision = 0
        self.labels = scene.labels
        first = State(
            "opened", pack(scene.labels), dict(scene.names), scene.start, tuple(scene.edits)
        )
        self._states, self._at, self._saved = [first], 0, first
        self._coarse = Coarse(scene)

    # State

    @property
    def state(self) -> State:
        return self._states[self._at]

    @property
    def dirty(self) -> bool:
        """Whether something is not saved."""
        return self.state is not self._saved

    @property
    def threshold(self) -> float:
        """With which the clusters were found."""
        given = [step.parameters.get("threshold") for step in self.state.start]
        return float(given[0] if given and given[0] else self._options()["threshold"])

    @property
    def by_gloss(self) -> bool:
        """Whether `find` asks the highlights, too."""
        fresh = self.scene.fresh
        return bool(self._options()["gloss"]) and fresh("samples") and fresh("lights")

    def describe(self) -> dict[str, Any]:
        """Revision, clusters and history, as JSON."""
        with self.lock:
            return {
                "revision": self.revision,
                "dirty": self.dirty,
                "undo": self.state.words if self._at else "",
                "redo": self._states[self._at + 1].words
                if self._at + 1 < len(self._states)
                else "",
                "clusters": self.clusters(),
                "history": [state.words for state in self._states[: self._at + 1]],
            }

    def clusters(self) -> list[dict[str, Any]]:
        """The clusters by id: name, colour as shown, texels, share, and their gloss if estimated.

        The gloss is that of the materials when the project was opened: None after an edit of them.
        """
        known = self.labels[self.labels >= 0]
        count = np.bincount(known) if len(known) else np.zeros(0, int)
        ids = np.flatnonzero(count)
        told = []
        for color, identity in zip(palette(len(ids)).tolist(), ids.tolist(), strict=True):
            gloss = self.scene.glosses.get(identity)
            unchanged = gloss is not None and gloss["texels"] == count[identity]
            told.append(
                {
                    "id": identity, "name": self.state.names.get(identity, ""), "color": color,
                    "texels": int(count[identity]), "share": count[identity] / len(self.labels),
                    "gloss": gloss if unchanged else None,
                }
            )  # fmt: skip
        return told

    # Edits

    def merge(self, ids: list[int], revision: int | None = None) -> None:
        """Make one cluster of several."""
        self._edit(Merge(tuple(sorted(set(ids)))), revision)

    def split(self, stroke: np.ndarray, cluster: int = -1, revision: int | None = None) -> None:
        """Cut a cluster along points (S, 3) of the world; -1: the one under the middle point."""
        with self.lock:
            self._check(revision)
            stroke = np.asarray(stroke, float).reshape(-1, 3)
            if len(stroke) < 2:
                raise SvbrdfError("the stroke misses the object: draw it over the object")
            if not (self.labels >= 0).any():
                raise SvbrdfError("there are no clusters to split yet: find them first")
            if cluster < 0:
                middle = stroke[len(stroke) // 2] - self.scene.texels.center
                cluster = int(self.labels[self.scene.graph.tree.query(middle)[1]])
                if cluster < 0:
                    raise SvbrdfError(
                        "the stroke's middle lies where the object is unobserved: draw it over a "
                        "cluster, or pick the cluster first"
                    )
            self._edit(Split(cluster, rounded(stroke)), revision)

    def rename(self, identity: int, name: str, revision: int | None = None) -> None:
        """Name a cluster; an empty name takes it away."""
        with self.lock:
            self._check(revision)
            name = " ".join(name.split())
            if not (self.labels == identity).any():
                raise SvbrdfError(f"there is no material {identity} to name")
            if len(name) > LONGEST_NAME or set(name) & set(";|"):
                raise SvbrdfError(f"a name has at most {LONGEST_NAME} characters, and no ; or |")
            names = {k: v for k, v in self.state.names.items() if k != identity}
            if name:
                names[identity] = name
            if names == self.state.names:
                return
            now = self.state
            words = f"named {identity} {name}" if name else f"took the name of {identity} away"
            self._push(State(words, now.packed, names, now.start, now.edits))

    def find(self, threshold: float, revision: int | None = None) -> None:
        """Find the clusters anew, as compute_svbrdf_materials with this threshold."""
        scene = self.scene
        with self.lock:
            self._check(revision)
            begun = self.revision
        self._diffuse()
        options = {**self._options(), "threshold": threshold}
        words = f"found with threshold {threshold:g}"
        if options["gloss"] and not self.by_gloss:
            options["gloss"] = False
            words += ", by colour alone"
        labels, _ = find_clusters(scene.document, Progress(), **options)
        start = Step(MATERIALS, {name: _word(value) for name, value in options.items()})
        with self.lock:
            self._check(begun)
            self._push(State(words, pack(labels), {}, (start,), ()))

    def preview(self, threshold: float) -> np.ndarray:
        """About what `find` would give by colour, at once; nothing changes."""
        diffuse, (kept, adjacency, nearest) = self._diffuse(), self._coarse.get()
        options = {k: v for k, v in self._options().items() if k != "gloss"}
        options["threshold"] = threshold
        labels = segment(diffuse[kept], adjacency, **options)[nearest]
        return np.where(np.isfinite(diffuse).all(1), labels, -1).astype(np.int32)

    def undo(self, revision: int | None = None) -> None:
        self._step(-1, "there is nothing to undo", revision)

    def redo(self, revision: int | None = None) -> None:
        self._step(1, "there is nothing to redo", revision)

    # Saving

    def save(self) -> str:
        """Put the materials into the project, where the next filter takes them; what was done.

        Raises ConflictError where the project's materials are not those that were opened or saved
        last: another run or page changed them. Nothing is written then, and nothing lost.
        """
        with self.lock:
            if not self.dirty:
                return "nothing to save"
            document, state, before = (
                Document.open(self.scene.document.path),
                self.state,
                self._saved,
            )
            with document.results.locked():
                key = document.key("materials") if document.has("materials") else ""
                if key != self.scene.key:
                    raise ConflictError(
                        "another page or run changed the project's materials since this one read "
                        "them: nothing was saved. Keep these edits as a script (.mlx), open the "
                        "project again, and apply it there"
                    )
                self._save_labels(document, state, before)
                if state.names or before.names:
                    document.apply(NAMES, names=names_text(state.names))
                self.scene.key = document.key("materials")
                document.save()
            self._saved = state
            return f"saved to {document.path.name}"

    def steps(self) -> list[Step]:
        """The filters that make these materials from the diffuse colour."""
        with self.lock:
            state = self.state
            steps = [*state.start, *edit_steps(state.edits)]
            if state.names:
                steps.append(Step(NAMES, {"names": names_text(state.names)}))
            return steps

    def write_script(self, path: Path) -> None:
        """`steps` as a filter script (.mlx)."""
        write_script(path, self.steps())

    # How

    def _save_labels(self, document: Document, state: State, before: State) -> None:
        """Bring the materials from one state to another, by what they have in common."""
        edits, anew = state.edits, False
        if state.start != before.start:
            if not state.start:
                raise SvbrdfError("the project has no materials in this state: nothing to save")
            given: dict[str, Any] = dict(state.start[0].parameters)
            document.apply(state.start[0].name, force=True, **given)
        elif state.edits[: len(before.edits)] == before.edits:
            edits = state.edits[len(before.edits) :]
        else:
            anew = True
        if edits or anew:
            document.apply(EDITS, edits=to_text(edits), anew=anew)

    def _edit(self, edit: Edit, revision: int | None) -> None:
        with self.lock:
            self._check(revision)
            labels = perform(self.labels, edit, self.scene.canvas)
            now, words = self.state, _words(edit, self.labels, labels)
            there = set(np.unique(labels).tolist())
            names = {k: v for k, v in now.names.items() if k in there}
            self._push(State(words, pack(labels), names, now.start, (*now.edits, edit)))

    def _push(self, state: State) -> None:
        self._states = [*self._states[: self._at + 1], state]
        self._go(self._at + 1)

    def _go(self, at: int) -> None:
        self._at = at
        self.labels = unpack(self.state.packed)
        self.revision += 1

    def _step(self, by: int, nothing: str, revision: int | None) -> None:
        with self.lock:
            self._check(revision)
            if not 0 <= self._at + by < len(self._states):
                raise SvbrdfError(nothing)
            self._go(self._at + by)

    def _check(self, revision: int | None) -> None:
        if revision is not None and revision != self.revision:
            raise ConflictError(
                "another page changed the clusters meanwhile; this page shows them now and nothing "
                "was lost: do your edit again if it is still wanted"
            )

    def _diffuse(self) -> np.ndarray:
        diffuse = self.scene.attribute("diffuse")
        if diffuse is None:
            raise SvbrdfError(
                "clusters are found by the diffuse colour, which the project does not have yet: "
                "run compute_svbrdf_diffuse_color first"
            )
        return diffuse

    def _options(self) -> dict[str, Any]:
        """The parameters with which the project's materials were found, but for an image."""
        runs = self.scene.document.results.record["runs"]
        given = runs.get(MATERIALS, {}).get("parameters", {})
        return {name: given.get(name, value) for name, value in FOUND_BY.items()}


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def _words(edit: Edit, before: np.ndarray, after: np.ndarray) -> str:
    if isinstance(edit, Merge):
        return "merged " + ", ".join(map(str, edit.ids))
    new = np.setdiff1d(after, before).tolist()
    return f"split {edit.cluster} into {', '.join(map(str, [edit.cluster, *new]))}"
