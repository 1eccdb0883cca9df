"""Films of the sample project's totem and their results, made once for all tests and workers.

film     a variant of the sample project
edited   the same with another project file
solved   the result of the whole chain on it
copied   a document on a copy of a result, for tests that change it
run      all filters in a chain's order, or the first of them, on a document
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from meshlab_svbrdf.document.document import Document, Outcome
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import Project, read_project, write_project
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.script import read_script
from sample_projects.make_totem import TINY, Options, make_totem

ROOT = Path(__file__).parents[1]
CHAIN = tuple(step.name for step in read_script(ROOT / "filters" / "svbrdf_paper.mlx"))
TEXELS, VISIBILITY, SAMPLES, THRESHOLD, ENVIRONMENT, DIFFUSE, LIGHTS, PEAKS, MATERIALS, GLOSS = (
    CHAIN
)

# A video: one orbit, 4° a frame. Fine enough to see that terracotta has no gloss.
VIDEO = replace(TINY, frames=90, orbits=1, width=150, height=200, texture=192, columns=64)

# Stills: two orbits, 12° a frame.
WALK = TINY


def once(factory, key: str, make: Callable[[Path], Any]) -> Path:
    """The folder that `make` fills, once for all of pytest's workers."""
    base = factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = base / f"totem-{hashlib.sha256(key.encode()).hexdigest()[:16]}"
    with FileLock(folder.with_suffix(".lock")):
        if not folder.exists():
            part = folder.with_suffix(".part")
            part.mkdir()
            make(part)
            part.rename(folder)
    return folder


def film(factory, options: Options) -> Path:
    """`totem.mlp` of a variant, its truth beside it; not to be changed."""
    return once(factory, repr(options), lambda folder: make_totem(folder, options)) / "totem.mlp"


def edited(source: Path, folder: Path, edit: Callable[[Project], Any]) -> Path:
    """Another project in `folder` on the same frames, changed by `edit`."""
    folder.mkdir(exist_ok=True)
    project = read_project(source)
    edit(project)
    write_project(project, folder / source.name)
    return folder / source.name


def with_mesh(source: Path, folder: Path, mesh: Mesh, *textures: Path) -> Path:
    """Another project on the same frames, whose scan is `mesh`."""
    folder.mkdir(exist_ok=True)
    write_ply(folder / "scan.ply", mesh, textures=textures, dtype=np.float64)
    return edited(source, folder, lambda project: project.set_mesh("totem", folder / "scan.ply"))


def run(document: Document, last: str = GLOSS, /, **given: dict[str, Any]) -> dict[str, Outcome]:
    """The chain up to the filter `last`; given : parameters by filter. What became of each."""
    steps = CHAIN[: CHAIN.index(last) + 1]
    assert set(given) <= set(steps)
    return {name: document.apply(name, **given.get(name, {})) for name in steps}


def sized(options: Options, **given: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The parameters `given`, with textures of the truth's size."""
    return {TEXELS: {"texture_size": options.texture}, **given}


def solved(factory, options: Options, **given: dict[str, Any]) -> Path:
    """The project with the results of the whole chain, to be looked at and not to be changed."""

    def make(folder: Path) -> None:
        if given:  # go on from the plain result
            document = copied(factory, options, folder / "result")
        else:
            document = Document.open(film(factory, options), folder / "result")
        run(document, **sized(options, **given))
        document.save()

    return once(factory, f"{options} {given}", make) / "result" / "totem.mlp"


def copied(factory, options: Options, folder: Path, **given: dict[str, Any]) -> Document:
    """A copy of a result, for a test to change or to apply filters to."""
    results = solved(factory, options, **given).with_suffix(".svbrdf")
    shutil.copytree(
        results, folder / results.name, copy_function=os.link, ignore=lambda *_: [".lock"]
    )
    return Document.open(film(factory, options), folder)


def contents(folder: Path) -> dict[str, str]:
    """The digest of every file of a result; what an interrupted run left for the next is none."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock" and ".partial" not in path.parts
    }


def by_texel(document: Document, images: list[np.ndarray]) -> np.ndarray:
    """A map's values at the texels, (T, …)."""
    texels = document.texels()
    values = np.zeros((len(texels), *images[0].shape[2:]), images[0].dtype)
    for index, image in enumerate(images):
        here = texels.texture == index
        values[here] = image[texels.row[here], texels.col[here]]
    return values
