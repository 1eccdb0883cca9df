"""The document that filters read and write: a project of MeshLab's, and its NAME.svbrdf beside it.

Document.open    a project and the folder of its results
Document.apply   run a filter, unless its result is there already
Document.save    the project with every result as a layer that MeshLab shows
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from operator import is_not
from pathlib import Path
from typing import Any

import numpy as np

from .. import registry
from ..blocks import rowwise
from ..errors import DocumentError, SvbrdfError
from ..filter import Filter
from ..geometry.camera import Camera
from ..geometry.lens import Lens
from ..geometry.mesh import Mesh
from ..progress import Progress, Show
from ..spread import Spread
from .atomic import remove_leftovers
from .exact import remember, restore
from .frames import Frames, file_stamp
from .freshness import RASTER, Freshness, filter_key, resolve_lengths
from .given_uv import GivenUv
from .layers import Layer, mesh_digest
from .products import Products, plain
from .project import MeshEntry, Project, RasterEntry, new_project, read_project, write_project
from .record import RECORD, ResultFolder, digest, replace_folder
from .registered import missing_sources, place_rasters
from .video_rasters import add_video, bring_videos, follow_folder
from .views import OBJECT, write_views

log = logging.getLogger("meshlab_svbrdf")

PROJECTS = (".mlp", ".mlb")
MESHES = (".ply", ".obj")
RESULTS = ".svbrdf"
HELD_OUT = slice(3, None, 8)  # every 8th frame by name, starting with the 4th


@dataclass(frozen=True)
class Outcome:
    """What became of one filter: its own line on it, wall clock and CPU seconds."""

    name: str
    message: str
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    skipped: bool = False


class Document(Products):
    """Layers and rasters of a project, and the results made from them.

    path : where `save` writes the project
    layers : mesh layers in the project's order, those of earlier results included
    rasters : the frames that filters see: held-out ones are in `held_out`
    spread : where filters have done what workers can do; None: in this process
    """

    def __init__(self, project: Project, path: Path, folder: Path | None = None) -> None:
        super().__init__(folder or path.with_suffix(RESULTS))
        self.project = project
        self.path = path
        if restored := restore(project, self.folder):
            log.warning(
                "MeshLab saved %s with six digits and without svbrdf_ attributes; restored from "
                "%s/exact.mlp: %s", path.name, self.folder.name, restored,
            )  # fmt: skip
        self.layers = [Layer(m.label, m.path, m.matrix, m.visible, entry=m) for m in project.meshes]
        self.spread: Spread | None = None
        self._told = ""
        self._numbers: tuple[list[Camera], list[list[Any]]] = [], []
        self._world: tuple[Mesh, np.ndarray, Mesh] | None = None  # a layer's, and where
        self._remembered: list[Any] | None = None  # what `remember` wrote last
        self._placing: dict[str, Any] | None = None  # rasters that the filter that runs now sets

    @classmethod
    def open(cls, path: str | Path, output: str | Path | None = None) -> Document:
        """Read a project.

        output : a project file (.mlp, .mlb) or a folder for one of the same name; results lie
            beside it. None: beside the input, which `save` replaces. A project that MeshLab saved
            under another name sees the results of the first, and copies them when it changes them.
        """
        path = Path(path).absolute()
        if path.suffix.lower() not in PROJECTS:
            raise DocumentError(f"{path}: expected a MeshLab project, .mlp or .mlb")
        project = read_project(path)
        return cls(project, place(path, output), None if output else _results_of(project, path))

    @classmethod
    def new(cls, path: str | Path) -> Document:
        """A document without layers and rasters, to be saved as `path`."""
        return cls(new_project(), Path(path).absolute())

    @classmethod
    def of_mesh(cls, path: str | Path, output: str | Path) -> Document:
        """A document whose only layer is a mesh file; output : as for `open`.

        Raises DocumentError where the file is no PLY or OBJ.
        """
        path = Path(path).absolute()
        if path.suffix.lower() not in MESHES:
            raise DocumentError(
                f"{path}: expected a MeshLab project (.mlp, .mlb) or a mesh ({', '.join(MESHES)}); "
                "open other meshes in MeshLab and save a project"
            )
        document = cls.new(place(path, output))
        document.layers.append(Layer(path.stem, path))
        document.layers[0].read()
        return document

    @property
    def name(self) -> str:
        return self.path.stem

    # What the suite works on

    @property
    def settings(self) -> dict[str, Any]:
        """What the user chose: "object" (a label), "held_out" (labels), "quality" (attribute)."""
        return self.results.record["settings"]

    def set(self, **settings: Any) -> None:
        """Change settings, and record them; not while a filter runs."""
        if self._writing is not None:
            raise RuntimeError("settings are the user's: a filter cannot change them")
        self._own_results()
        with self.results.locked():
            record = self.results.record
            self.results.commit(record | {"settings": record["settings"] | settings})

    @property
    def rasters(self) -> list[RasterEntry]:
        held_out = set(self.settings.get("held_out", ()))
        return [raster for raster in self.project.rasters if raster.label not in held_out]

    @property
    def held_out(self) -> list[RasterEntry]:
        """Frames that no filter sees, kept for judging the result."""
        held_out = set(self.settings.get("held_out", ()))
        return [raster for raster in self.project.rasters if raster.label in held_out]

    def hold_out(self, hold: bool = True) -> None:
        """Hold out every 8th frame by name, starting with the 4th, or use all of them again."""
        frames = sorted(self.project.rasters, key=lambda raster: (raster.path.name, raster.label))
        labels = [raster.label for raster in frames[HELD_OUT]] if hold else []
        if labels != self.settings.get("held_out", []):
            self.set(held_out=labels)

    def set_json(self, name: str, value: dict[str, Any]) -> None:
        """Stage NAME.json; frames.json also tells which frames were held out."""
        if name == "frames":
            held_out = [{"label": r.label, "left_out": "held out"} for r in self.held_out]
            known = {frame.get("label") for frame in value.get("frames", ())}
            added = [frame for frame in held_out if frame["label"] not in known]
            value = {**value, "frames": [*value.get("frames", ()), *added]}
        super().set_json(name, value)

    def add_video(
        self,
        path: str | Path,
        cameras: Mapping[int, Camera],
        *,
        exposure: float | None = None,
        lens: Lens | None = None,
    ) -> list[RasterEntry]:
        """Add registered frames of a video as rasters; the video is not extracted.

        cameras : by the frame's index in the order of presentation, from 0
        exposure : of all its frames, relative to other rasters
        lens : that distorts its frames; they are undistorted when they are read, and `cameras`,
            with the focal length and centre of `lens.pinhole()`, belong to the undistorted ones

        Raises
        ------
        DocumentError : the video cannot be read, a frame is not there, or is added already.
        """
        self._own_results()
        with self.results.locked():
            return add_video(self.project, self.folder, Path(path), cameras, exposure, lens)

    def set_rasters(self, told: dict[str, Any]) -> str:
        """Stage rasters, as `registered` tells them; the project has them when `apply` returned.

        NAME.json holds them, where NAME is the first product of the filter: a run that finds it
        unchanged brings them again. Returns NAME.
        """
        name = self._writing_now().products[0]
        self.set_json(name, told)
        self._placing = told
        return name

    def _bring_rasters(self, filter: Filter) -> bool:
        """Place the rasters of an unchanged filter again; False where that cannot be.

        A project that was read anew has them not yet.
        """
        product = filter.writes[0] if filter.writes else ""
        if not product or not self.has_json(product):
            return True
        told = self.json(product)
        if "clips" not in told:
            return True
        if missing_sources(told):
            return False
        place_rasters(self.project, self.folder, told)
        return True

    def object_layer(self) -> Layer:
        """The mesh that the suite works on: the layer chosen by label, else the visible one.

        Raises DocumentError where no layer of the project is a mesh.
        """
        meshes = [layer for layer in self.layers if not layer.ours and len(layer.read().mesh.faces)]
        wanted = self.settings.get("object")
        if wanted:
            meshes = [layer for layer in meshes if layer.label == wanted]
        if not meshes:
            labels = ", ".join(repr(layer.label) for layer in self.layers) or "none"
            what = f"mesh layer {wanted!r}" if wanted else "mesh layer with faces"
            raise DocumentError(f"{self.path.name} has no {what} (its layers: {labels})")
        chosen = next((layer for layer in meshes if layer.visible), meshes[0])
        if len(meshes) > 1 and self._told != chosen.label:
            self._told = chosen.label
            log.warning(
                "%d mesh layers: working on %r (choose another by its label)",
                len(meshes),
                chosen.label,
            )
        return chosen

    def mesh(self, layer: Layer | None = None) -> Mesh:
        """A layer's mesh (None: the object's) in world coordinates.

        The object's has the texture coordinates of `set_uv`, where that was called.

        Raises DocumentError where it has no extent.
        """
        layer = layer or self.object_layer()
        local = self._local_mesh(layer)
        if self._world and self._world[0] is local and (self._world[1] == layer.matrix).all():
            return self._world[2]
        mesh = local.transformed(layer.matrix)
        if not mesh.radius > 0:
            raise DocumentError(
                f"{self.path.name}: all vertices of the layer {layer.label!r} lie in one place; "
                "scan or export it again, or choose another layer (--layer)"
            )
        self._world = local, layer.matrix.copy(), mesh
        return mesh

    def set_uv(self, uv: np.ndarray, texture_index: np.ndarray | None = None) -> None:
        """Stage texture coordinates (F, 3, 2) for the object, in place of its file's, as float32.

        texture_index : (F,) int32; None: they lie in one texture. A filter that does not call this
            leaves the file's in force.
        """
        self.set_array("uv", np.asarray(uv, np.float32))
        if texture_index is not None:
            self.set_array("uv_texture", np.asarray(texture_index, np.int32))

    def _local_mesh(self, layer: Layer) -> Mesh:
        if layer is not self.object_layer():
            return layer.read().mesh
        mesh = self._given_mesh(layer)
        if self.has_array("uv"):
            index = self.array("uv_texture") if self.has_array("uv_texture") else None
            uv = rowwise(lambda some: some.astype(np.float64), self.array("uv"))
            mesh = replace(mesh, uv=uv, texture_index=index)
        return mesh

    def _given_mesh(self, layer: Layer) -> Mesh:
        """As the user gave it: texture coordinates that `save` wrote for `set_uv` are left out."""
        return GivenUv.beside(layer.path or self.folder / OBJECT).undo(layer.read().mesh)

    def _given_digest(self) -> str:
        layer = self.object_layer()
        return mesh_digest(self._given_mesh(layer), layer.matrix)

    def _layer_digest(self, label: str) -> str:
        """Of the user's layer of that label, "" where it went away."""
        layer = next((x for x in self.layers if x.label == label and not x.ours), None)
        return mesh_digest(layer.read().mesh, layer.matrix) if layer else ""

    # Filters

    def apply(
        self,
        name: str | Filter,
        /,
        force: bool = False,
        show: Show | None = None,
        **parameters: Any,
    ) -> Outcome:
        """Run a filter and commit what it sets, whole or not at all.

        Not run where its last result was made from the same parameters and inputs, even if that was
        edited since, unless `force`.

        Raises
        ------
        SvbrdfError : a wrong parameter. MissingStageError : which filter has to run first.
        """
        filter = registry.get(name) if isinstance(name, str) else name
        if filter.apply is None:
            raise SvbrdfError(f"filter {filter.name} has no apply: get it from the registry")
        given = filter.check(parameters)
        self._own_results()
        with self.results.locked():
            fresh = self._freshness()
            inputs = fresh.inputs(filter, given)
            key = filter_key(filter, given, inputs)
            if not force and fresh.unchanged(filter, key) and self._bring_rasters(filter):
                edited = any(self.edited(product) for product in filter.writes)
                message = "unchanged but for edits (kept)" if edited else "unchanged"
                return Outcome(filter.name, message, skipped=True)
            resolve_lengths(filter, given, self.mesh)

            run: dict[str, Any] = {
                "key": key,
                "version": filter.version,
                "parameters": _words(given),
            }
            wall, cpu = time.perf_counter(), time.process_time()
            with self.write(
                *filter.writes,
                edits=filter.edits,
                filter=filter.name,
                key=key,
                inputs=inputs,
                run=run,
            ):
                self._placing = None
                message = filter.apply(self, given, Progress(show)) or "done"
                outcome = Outcome(
                    filter.name,
                    message,
                    time.perf_counter() - wall,
                    time.process_time() - cpu,
                )
                run["message"] = outcome.message
                run["seconds"] = round(outcome.seconds, 3)
                run["cpu_seconds"] = round(outcome.cpu_seconds, 3)
                run["date"] = time.strftime("%Y-%m-%dT%H:%M:%S%z")
                if self._placing is not None:  # the project's rasters are no longer those it saw
                    for name in [n for n in inputs if n == "rasters" or n.startswith(RASTER)]:
                        del inputs[name]
            if self._placing is not None:
                place_rasters(self.project, self.folder, plain(self._placing))
            elif "rasters" in filter.needs:
                self._remember()
        return outcome

    def stale(self, product: str) -> str:
        """Why `product` no longer belongs to this document, or "" where it does."""
        return self._freshness().stale(product)

    def edited(self, product: str) -> bool:
        """Whether another filter changed `product` since it was made."""
        return "maker" in self.results.record["products"].get(product, {})

    def _freshness(self) -> Freshness:
        frames = cache(lambda: Frames(self.rasters))
        return Freshness(
            self.results,
            self._given_digest,
            lambda: raster_digest(self.rasters, frames(), self._camera_numbers()),
            lambda: _there(frames(), self.rasters),
            self._layer_digest,
            self._raster_digest,
        )

    def _camera_numbers(self) -> list[list[Any]]:
        """Of all rasters; made anew where a camera is another one."""
        cameras = [raster.camera for raster in self.rasters]
        known, numbers = self._numbers
        if len(known) != len(cameras) or any(map(is_not, known, cameras)):
            numbers = _camera_numbers(cameras)
            self._numbers = cameras, numbers
        return numbers

    def _raster_digest(self, label: str) -> str:
        """Of the raster of that label, "" where there is none."""
        found = [raster for raster in self.project.rasters if raster.label == label]
        return raster_digest(found) if found else ""

    # Saving

    def save(self, path: str | Path | None = None) -> Path:
        """Write the project with the results as layers; where it was written.

        path : a project file; None: the document's own. Elsewhere the results go along: the project
            there is complete, and the one here stays as it is.
        """
        if path is not None and Path(path).absolute() != self.path:
            self.move_to(Path(path).absolute())
        self._own_results()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.results.record["products"] or any(layer.path is None for layer in self.layers):
            with self.results.locked():
                self.layers = write_views(self)
        self.project.meshes = [_entry(layer) for layer in self.layers]
        write_project(self.project, self.path)
        if self.folder.is_dir():
            with self.results.locked():
                remove_leftovers(self.path.parent, self.path.stem)
                self._remember()
        return self.path

    def _remember(self) -> None:
        self._remembered = remember(self.project, self.layers, self.folder, self._remembered)

    def _own_results(self) -> None:
        """Before results change, copy those that another project lent, and names of its videos."""
        if self.folder != self.path.with_suffix(RESULTS):
            self.move_to(self.path, link=True)
        bring_videos(self.project.rasters, self.folder)

    def move_to(self, path: Path, *, link: bool = False) -> None:
        """Work on a copy of the results beside another project, the results there replaced.

        link : share the files until either side replaces them (it never writes into them)
        """
        if path.suffix.lower() not in PROJECTS:
            raise DocumentError(f"{path}: expected a name for a MeshLab project, .mlp or .mlb")
        old, target = self.folder, path.with_suffix(RESULTS)
        path.parent.mkdir(parents=True, exist_ok=True)
        if target != old and old.is_dir():
            with self.results.locked():
                replace_folder(old, target, link=link)
        for layer in self.layers:
            layer.move(old, target)
        follow_folder(self.project.rasters, old, target)
        self.path, self.results = path, ResultFolder(target)


def place(path: Path, output: str | Path | None) -> Path:
    """The project that results of the project `path` go to: see `Document.open`."""
    if output is None:
        return path
    output = Path(output).absolute()
    return output if output.suffix.lower() in PROJECTS else output / f"{path.stem}.mlp"


def _results_of(project: Project, path: Path) -> Path | None:
    """Where a project without a folder of results has layers that were saved as results."""
    if path.with_suffix(RESULTS).exists():
        return None
    folders = {mesh.path.parent.parent for mesh in project.meshes}
    lent = [f for f in folders if f.suffix == RESULTS and (f / RECORD).is_file()]
    return lent[0] if len(lent) == 1 else None


def raster_digest(
    rasters: list[RasterEntry],
    frames: Frames | None = None,
    numbers: list[list[Any]] | None = None,
) -> str:
    """SHA-256 of cameras, exposures, sequences and of the files' names, sizes and dates.

    Of a frame of a video, the video's file counts, and the frame's time.
    A sequence counts by its members: its name, a folder's, depends on where the project lies. Files
    that are missing count as such. `frames` : of these rasters or more, to look nothing up again.

    numbers : of their cameras, where they are known
    """
    if not rasters:
        raise DocumentError(
            "the project has no rasters: add them with `meshlab-svbrdf register`, or in MeshLab"
        )
    frames = frames or Frames(rasters)
    sequences = list(dict.fromkeys(raster.sequence for raster in rasters))
    numbers = numbers or _camera_numbers([raster.camera for raster in rasters])
    return digest(
        [
            [
                r.label,
                camera,
                frames.stamp(r),
                None if r.mask is None else file_stamp(r.mask),
                r.exposure,
                sequences.index(r.sequence),
            ]
            for r, camera in zip(rasters, numbers, strict=True)
        ]
    )


def _there(frames: Frames, rasters: list[RasterEntry]) -> bool:
    """Whether the files of all rasters are."""
    return all(os.path.isfile(file) for file in {str(frames.file(raster)) for raster in rasters})


def _camera_numbers(cameras: list[Camera]) -> list[list[Any]]:
    """Rounded to nine digits: writing a project in its other format may turn the last one."""
    intrinsics = np.array([[c.width, c.height, c.fx, c.fy, c.cx, c.cy] for c in cameras])
    turns, shifts = np.array([c.R for c in cameras]), np.array([c.t for c in cameras])
    digits = 9 - np.ceil(np.log10(np.maximum(np.abs(shifts).max(1), 1e-9))).astype(int)
    for count in np.unique(digits):
        shifts[digits == count] = np.round(shifts[digits == count], count)
    numbers = np.round(intrinsics, 6), np.round(turns, 9), shifts
    lists = [(values + 0.0).tolist() for values in numbers]
    return [list(each) for each in zip(*lists, strict=True)]


def _words(parameters: Any) -> dict[str, Any]:
    return {name: _word(value) for name, value in vars(parameters).items()}


def _word(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value if value is None or isinstance(value, bool | int | float) else str(value)


def _entry(layer: Layer) -> MeshEntry:
    assert layer.path is not None
    entry = layer.entry or MeshEntry(layer.label, layer.path, layer.matrix, layer.visible)
    entry.label, entry.path = layer.label, layer.path
    entry.matrix, entry.visible = layer.matrix, layer.visible
    layer.entry = entry
    return entry
