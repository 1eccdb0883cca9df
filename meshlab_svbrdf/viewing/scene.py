"""What a project shows: its texels, mesh, materials and samples, read once.

What is missing is said where it is asked for: a project without samples can still be edited.
"""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from ..document.document import Document
from ..errors import MissingStageError, SvbrdfError
from ..filters._lights import read_lights
from ..filters._materials import read_edits, read_labels, read_names, start_step
from ..filters._stages import read_lights_found, read_observations
from ..geometry.surface_graph import SurfaceGraph
from ..geometry.visibility import Rays
from ..reflectance.lights import Light
from ..reflectance.material_edits import Canvas, Edit
from ..samples.luminance import luminance
from ..samples.observations import Observations
from ..script import Step

MATERIALS = "compute_svbrdf_materials"


class Scene:
    """A project, as far as pages show it.

    document : as it was opened; `key` is that of its materials then, "" where it had none
    labels : (T,) int32, all -1 where the materials are out of date; names : of materials, by id
    start, edits : the filter that made them (no step where that is not known), and what was done
        to them since
    """

    def __init__(self, path: str | Path) -> None:
        self.document = document = Document.open(path)
        if not document.has("texels"):
            raise MissingStageError(
                f"{document.path.name} has no texels to show: make them with "
                f"`meshlab-svbrdf run {document.path.name} -o out` and view out/"
                f"{document.path.name}"
            )
        if older := document.stale("texels"):
            raise MissingStageError(
                f"the texels of {document.path.name} are older than its {older}: "
                "run compute_svbrdf_texels again"
            )
        self.texels = document.texels()
        self.mesh = document.mesh()
        self.rays = Rays(self.mesh)
        self.graph = SurfaceGraph(self.texels.position, self.texels.normal)
        self.canvas = Canvas(self.graph, self.texels.center, self.texels.face)
        self._reading = Lock()
        self.painting, self.painted = Lock(), dict[str, Any]()
        self.key = document.key("materials") if document.has("materials") else ""
        self.labels = np.full(len(self.texels), -1, np.int32)
        self.names: dict[int, str] = {}
        self.start: tuple[Step, ...] = ()
        self.edits: list[Edit] = []
        if self.fresh("materials"):
            self.labels, self.names = read_labels(document), read_names(document)
            self.edits = read_edits(document)
            self.start = tuple(Step(x.name, x.parameters) for x in start_step(document))

    def fresh(self, product: str) -> bool:
        """Whether a product is there and up to date."""
        return self.document.has(product) and not self.document.stale(product)

    def attribute(self, name: str) -> np.ndarray | None:
        """A statistic per texel of results that are up to date, or None."""
        return self._attributes.get(name)

    @cached_property
    def _attributes(self) -> dict[str, np.ndarray]:
        document, found = self.document, {}
        for product, entry in document.results.record["products"].items():
            if not document.stale(product):
                for file in entry["files"]:
                    if file.startswith("texels/"):
                        name = Path(file).stem
                        found[name] = document.attribute(name)
        return {name: values for name, values in found.items() if len(values) == len(self.texels)}

    @cached_property
    def level(self) -> np.ndarray | None:
        """The diffuse luminance (T,) that peaks are measured from, 0..100."""
        diffuse = self.attribute("diffuse")
        return None if diffuse is None else luminance(diffuse)

    @cached_property
    def glosses(self) -> dict[int, dict[str, Any]]:
        """What materials.json says, by id; nothing where it is not there."""
        if not (self.document.has("material_specular") and self.document.has_json("materials")):
            return {}
        return {entry["id"]: entry for entry in self.document.json("materials")["materials"]}

    @cached_property
    def frames(self) -> list[str]:
        """The labels of the frames that the samples are of, in their order."""
        if not (self.fresh("samples") and self.document.has_json("frames")):
            return []
        told = self.document.json("frames")["frames"]
        return [frame["label"] for frame in told if "samples" in frame]

    def check_frame(self, frame: int) -> None:
        """SvbrdfError where there is no such place in `frames`."""
        if not 0 <= frame < len(self.frames):
            raise SvbrdfError(f"there are the frames 0 to {len(self.frames) - 1}, not {frame}")

    @property
    def by_direction(self) -> bool:
        """Whether the frames are photographs from all around, not a video."""
        return bool(self.frames) and bool(self.document.json("frames")["stills"])

    @cached_property
    def lights(self) -> list[Light]:
        """Those that peaks are assigned to."""
        return read_lights_found(self.document) if self.fresh("lights") else []

    @cached_property
    def lamps(self) -> list[Light]:
        """The lights as the last filter left them."""
        return read_lights(self.document) if self.document.has_json("lights") else self.lights

    @cached_property
    def _observed(self) -> Observations | str:
        if not self.fresh("samples"):
            return "the project has no samples that are up to date: run compute_svbrdf_samples"
        try:
            return read_observations(self.document, visibility=False)
        except (SvbrdfError, OSError, ValueError, KeyError, json.JSONDecodeError) as error:
            return f"the samples cannot be read ({error}): run compute_svbrdf_samples again"

    @property
    def observations(self) -> Observations:
        """The samples; SvbrdfError where they cannot be read."""
        with self._reading:
            found = self._observed
        if isinstance(found, str):
            raise SvbrdfError(found)
        return found

    def place(self, texel: int) -> np.ndarray:
        """Where a texel is in the world, (3,)."""
        return self.texels.position[texel].astype(float) + self.texels.center
