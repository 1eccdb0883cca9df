"""How well areas of one material are found, and what a minute by hand adds: adjusted Rand index.

On every scene clusters of like colour, and of like colour and gloss; then `hands.a_minute` on each.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.geometry.surface_graph import SurfaceGraph
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import run_script

from .cases import Case
from .hands import a_minute
from .ledger import Ledger, Row, Task
from .scenes.score import adjusted_rand, like_truth
from .solve import TEXTURE
from .tables import Column, Table, table

PART, FILTER, AFTER = "materials", "compute_svbrdf_materials", "compute_svbrdf_material_specular"
WAYS = {"colour": False, "colour and gloss": True}
COLUMNS = (
    Column("true", "true"),
    Column("clusters", "clusters"),
    Column("Rand", "adjusted_rand", "{:.3f}"),
    Column("operations", "operations"),
    Column("clusters then", "clusters_by_hand"),
    Column("Rand then", "adjusted_rand_by_hand", "{:.3f}"),
    Column("s", "seconds", "{:.1f}"),
)


def tasks(ledger: Ledger, cases: Sequence[Case], texture: int) -> list[Task]:
    """Both ways on every scene."""
    return [
        Task(PART, case.name, name, f"{texture} texels", partial(_find, ledger, case, texture, by))
        for case in cases
        for name, by in WAYS.items()
    ]


def _find(ledger: Ledger, case: Case, texture: int, by_gloss: bool, folder: Path) -> Row:
    document = Document.open(case.path, ledger.work / PART / case.name)
    steps = chain(settings={TEXTURE: texture})
    for _ in run_script(document, [s for s in steps if s.name not in (FILTER, AFTER)]):
        pass
    document.apply(FILTER, gloss=by_gloss)
    texels, labels = document.texels(), document.attribute("material").astype(int)
    shown, inside = like_truth(read_image(document.folder / "maps" / "material.png"), case.truth)
    truth = np.where(inside, shown.astype(int), -1)[texels.row, texels.col]
    surface = SurfaceGraph(texels.position, texels.normal)
    edited, done = a_minute(surface, labels, truth, texels.radius)
    described = json.loads((case.truth / "materials.json").read_text())["materials"]
    return {
        "true": len(described), "clusters": len(np.unique(labels[labels >= 0])),
        "adjusted_rand": adjusted_rand(truth, labels),
        "operations": len(done), "done": done,
        "clusters_by_hand": len(np.unique(edited[edited >= 0])),
        "adjusted_rand_by_hand": adjusted_rand(truth, edited),
        "seconds": document.results.record["runs"][FILTER]["seconds"],
    }  # fmt: skip


def tables(rows: Sequence[Row]) -> list[Table]:
    note = (
        "Operations: merges and splits of a minute by hand, six at most (benchmarks/hands.py); "
        "then: after them."
    )
    return [table("Adjusted Rand index of the materials", rows, COLUMNS, note)]
