"""The performance workload as a scene that is scored: full-HD frames, and the truth beside them.

Its own truth is kept for any texture size; here it is in the layout that `scenes/score.py` reads.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshlab_svbrdf.bench.workload import Workload, make_workload
from meshlab_svbrdf.document.images import read_exr, write_exr, write_png
from meshlab_svbrdf.document.project import read_project, write_project

from .cases import Case

NAME = "workload"


@dataclass(frozen=True)
class FullHD(Case):
    """frames : the first ones of the workload, made on first use: a turn around the object has 360,
    and each turn is at another height"""

    frames: int = 720

    @property
    def path(self) -> Path:
        return self._workload().project

    @property
    def truth(self) -> Path:
        workload = self._workload()
        folder = workload.folder / "scored"
        if not (folder / "views" / "project.mlp").is_file():
            write_scored_truth(workload, folder)
        return folder

    def _workload(self) -> Workload:
        return make_workload(self.cache, self.frames)


def write_scored_truth(workload: Workload, folder: Path) -> None:
    """Write the project of the views last: it tells that all is there."""
    (folder / "views").mkdir(parents=True, exist_ok=True)
    views = read_project(workload.views())
    own = workload.folder / "ground_truth"
    D = read_exr(own / "diffuse_shaded.exr")
    write_exr(folder / "diffuse_shaded.exr", D)
    write_png(folder / "texel_mask.png", np.where(np.isfinite(D).all(-1), 255, 0).astype(np.uint8))
    for name in ("material_id.png", "materials.json"):
        (folder / name).write_bytes((own / name).read_bytes())
    lights = json.loads((own / "lights.json").read_text())
    for emitter in lights["emitters"]:  # points, whose intensity is that at the object's centre
        emitter |= {
            "kind": "disk", "half_extent_deg": [0.0, 0.0], "phong_intensity": emitter["intensity"]
        }  # fmt: skip
    (folder / "lights.json").write_text(json.dumps(lights, indent=1))
    write_project(views, folder / "views" / "project.mlp")
