"""Running the chain on a scene in one of its configurations, and scoring the result.

All runs of a benchmark are made by one process, so that starting Python and loading kernels does
not count. Seconds are those that the filters need, as `meshlab-svbrdf run` prints them; a result
that goes on from another one counts the filters that both share with what they took there.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import run_script
from sample_projects.make_totem import TINY, make_totem

from .cases import Case
from .scenes.score import Scores, score

TEXTURE = "compute_svbrdf_texels.texture_size"
MATERIALS = "compute_svbrdf_materials.image"


@dataclass(frozen=True)
class Setup:
    """How a scene is solved: what `meshlab-svbrdf run` takes.

    texture : texels along a side; None: the preset's
    true_materials : take the true segmentation
    settings : further parameters, by FILTER.NAME
    """

    estimator: str = "joint"
    preset: str = "standard"
    texture: int | None = None
    true_materials: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)

    def steps(self, case: Case):
        given = dict(self.settings)
        if self.texture is not None:
            given.setdefault(TEXTURE, str(self.texture))
        if self.true_materials:
            given.setdefault(MATERIALS, str(case.truth / "material_id.png"))
        return chain(self.estimator, self.preset, given)


@dataclass(frozen=True)
class Solved:
    """document : with its results; seconds, cpu : wall clock and CPU, by filter."""

    document: Document
    seconds: dict[str, float]
    cpu: dict[str, float]

    @property
    def cost(self) -> Scores:
        return {
            "seconds": sum(self.seconds.values()),
            "cpu_seconds": sum(self.cpu.values()),
            "by_filter": self.seconds,
        }


def solve(
    case: Case,
    setup: Setup,
    folder: Path,
    start: Path | None = None,
    hold_out: bool = False,
) -> Solved:
    """Run the chain into `folder`; filters that are done there do not run again.

    start : another result's folder; filters whose inputs and parameters are the same are taken
        from there
    """
    folder.mkdir(parents=True, exist_ok=True)
    document = Document.open(case.path, start or folder)
    if start is not None:
        document.move_to(folder / case.path.name, link=True)
    document.hold_out(hold_out)
    steps = setup.steps(case)
    for _ in run_script(document, steps):
        pass
    runs = document.results.record["runs"]
    return Solved(
        document,
        {step.name: runs[step.name]["seconds"] for step in steps},
        {step.name: runs[step.name]["cpu_seconds"] for step in steps},
    )


def judge(case: Case, solved: Solved, folder: Path) -> Scores:
    """Render the views that no frame has, and compare all that there is with the truth."""
    views = folder / "views"
    shutil.rmtree(views, ignore_errors=True)
    cameras = case.truth / "views" / "project.mlp"
    solved.document.apply("generate_svbrdf_rendering", cameras=cameras, folder=views)
    center = np.asarray(solved.document.mesh().center)
    return score(solved.document.folder, case.truth, views, center) | solved.cost


def warm_up(folder: Path) -> None:
    """Load or compile every kernel, so that no measurement has to."""
    make_totem(folder / "scene", TINY)
    for estimator in ("joint", "paper"):
        document = Document.open(folder / "scene" / "totem.mlp", folder / estimator)
        for _ in run_script(document, chain(estimator, settings={TEXTURE: 64})):
            pass
        document.apply(
            "generate_svbrdf_rendering",
            cameras=folder / "scene" / "ground_truth" / "views" / "project.mlp",
            folder=folder / "views",
        )
    shutil.rmtree(folder)
