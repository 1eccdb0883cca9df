"""`MeshSet`: a pymeshlab.MeshSet with our filters, rasters and whole projects.

    ms = meshlab_svbrdf.MeshSet()
    ms.load_project("dwarf.mlp")
    ms.compute_svbrdf_texels(texture_size=2048)
    ms.meshing_remove_unreferenced_vertices()      # MeshLab's filters go on working between ours
    ms.save_project("result.mlp")

MeshLab never holds the rasters: frames are streamed by the filters that need them. Results live in
a working folder until `save_project` gives them a place; nothing that was loaded is changed before.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pymeshlab
from filelock import FileLock, Timeout

from . import registry
from .document.document import Document
from .document.layers import Layer
from .document.project import RasterEntry
from .document.views import OBJECT, write_views
from .errors import SvbrdfError
from .geometry.camera import Camera
from .geometry.lens import Lens
from .meshlab import Bridge, run_xml
from .plan import make_plan
from .presets import chain
from .script import Step, read_script, run_script

READABLE = (".ply", ".obj")  # by ourselves, whatever their textures are
WORK = ".svbrdf-"  # begins the name of a working folder
HELD = ".held"  # the file in it that is locked while its set lives


class MeshSet(pymeshlab.MeshSet):
    """See the module; everything that pymeshlab.MeshSet can do works as it does there."""

    def __init__(self, verbose: bool = False) -> None:
        super().__init__(verbose)
        self._bridge: Bridge
        self._forget: Callable[[], Any] = lambda: None
        self._behind = False  # MeshLab has not seen the newest results yet
        self._start(None)

    def _start(self, document: Document | None) -> None:
        """Work on `document`, or on an empty one, in a working folder of this set."""
        near = document.path.parent if document is not None else None
        work = self._new_work(near)
        if document is None:
            document = Document.new(work / "project.mlp")
        else:
            document.move_to(work / document.path.name, link=True)
        self._bridge = Bridge(document, self)
        self._stamps: dict[int, tuple[int, int] | None] = {}

    def _new_work(self, near: Path | None) -> Path:
        """A folder for results that have no place yet, in place of the one so far.

        It is on the project's disk, if that can be written, and goes with this set, or, where the
        process died before, with the next one there.
        """
        here = near if near is not None and os.access(near, os.W_OK) else None
        if here is not None:
            _sweep(here)
        folder = Path(tempfile.mkdtemp(prefix=WORK if here else WORK.lstrip("."), dir=here))
        lock = FileLock(folder / HELD)
        lock.acquire()
        self._forget()
        self._forget = weakref.finalize(self, _remove, folder, lock)
        return folder

    # Projects

    @property
    def document(self) -> Document:
        """Layers, rasters and results, as they are now."""
        self._bridge.pull()
        return self._bridge.document

    def load_project(self, file_name: str | Path) -> None:
        """Load a project with its rasters, and its results where there are any.

        A second project is appended to the first, as in MeshLab, without its results.
        """
        opened = Document.open(file_name)
        for layer in opened.layers:
            layer.read()
        if self._bridge.layers or self._bridge.document.project.rasters:
            first = self.document
            first.layers += opened.layers
            taken = {raster.label for raster in first.project.rasters}
            for raster in opened.project.rasters:
                if raster.label in taken:
                    raise SvbrdfError(f"{file_name}: a raster {raster.label!r} is loaded already")
            first.project.rasters += opened.project.rasters
        else:
            self._start(opened)
        for layer in opened.layers:
            self._stamps[self._bridge.push(layer)] = _stamp(layer.path)

    def save_project(self, file_name: str | Path) -> None:
        """Write the project, every layer and the results beside it, whole or not at all."""
        path = Path(file_name).absolute()
        document, layers = self.document, dict(self._bridge.layers)
        document.save(path)
        document.move_to(self._new_work(path.parent) / path.name, link=True)
        self._behind = True

        # Saving made our layers anew: MeshLab's meshes are theirs now
        now = {layer.label: layer for layer in document.layers if layer.ours}
        self._bridge.layers = {
            identity: now.get(layer.label, layer) if layer.ours else layer
            for identity, layer in layers.items()
        }

    def clear(self) -> None:
        super().clear()
        self._start(None)

    def load_new_mesh(self, file_name: str | Path, **parameters: Any) -> None:
        """Load a mesh as a further layer, which becomes the current one."""
        path = Path(file_name).absolute()
        if parameters or path.suffix.lower() not in READABLE:
            super().load_new_mesh(str(path), **parameters)
            return
        layer = Layer(path.stem, path)
        layer.read()
        self._bridge.document.layers.append(layer)
        self._bridge.push(layer)

    # Rasters

    @property
    def rasters(self) -> list[RasterEntry]:
        """The frames with their cameras."""
        return self._bridge.document.project.rasters

    def raster_number(self) -> int:
        return len(self.rasters)

    number_rasters = raster_number

    def add_raster(
        self,
        file_name: str | Path,
        camera: Camera,
        *,
        label: str | None = None,
        sequence: str | None = None,
        exposure: float | None = None,
        mask: str | Path | None = None,
    ) -> RasterEntry:
        """Add a registered frame; its label is the file's name unless another is given."""
        path = Path(file_name).absolute()
        if not path.is_file():
            raise SvbrdfError(f"{path}: does not exist")
        return self._bridge.document.project.add_raster(
            label or path.name, path, camera, sequence=sequence, exposure=exposure, mask=mask
        )

    def add_video(
        self,
        file_name: str | Path,
        cameras: Mapping[int, Camera],
        *,
        exposure: float | None = None,
        lens: Lens | None = None,
    ) -> list[RasterEntry]:
        """Add registered frames of a video, whose images need not be extracted.

        cameras : by the frame's index in the order of presentation, from 0
        lens : that distorts the frames; `cameras` belong to the undistorted ones
        """
        return self._bridge.document.add_video(file_name, cameras, exposure=exposure, lens=lens)

    def load_new_raster(self, file_name: str) -> None:
        raise SvbrdfError(f"a raster needs its camera: add_raster({str(file_name)!r}, camera)")

    # Filters

    def apply_filter(self, filter_name: str, **parameters: Any) -> dict[str, Any]:
        """One of our filters or of MeshLab's; what it tells, as a dictionary."""
        if filter_name not in registry.filters():
            self._sync()
            return super().apply_filter(filter_name, **parameters)
        outcome = self.document.apply(filter_name, **parameters)
        self._bridge.show()
        self._behind = self._behind or not outcome.skipped
        return {
            "message": outcome.message,
            "seconds": outcome.seconds,
            "skipped": outcome.skipped,
        }

    def apply_filter_script(self, file_name: str | Path | None = None) -> None:
        """Run a script that may mix our filters and MeshLab's; None: the one MeshLab has loaded."""
        self._sync()
        if file_name is None:
            super().apply_filter_script()
            return
        for outcome in run_script(self.document, read_script(file_name), foreign=self._run_step):
            self._behind = self._behind or not outcome.skipped
            if outcome.name in registry.filters():
                self._bridge.show()
            self._bridge.pull()

    def run(
        self,
        preset: str = "standard",
        estimator: str = "joint",
        settings: dict[str, Any] | None = None,
    ) -> list[dict[str, Any]]:
        """The whole chain, as `meshlab-svbrdf run`: what each filter tells, with its name.

        settings : values by "FILTER.NAME"; they win over the preset and over the plan
        """
        steps = make_plan(self.document, chain(estimator, preset, settings), settings or {}).steps
        return [
            {"name": step.name} | self.apply_filter(step.name, **step.parameters) for step in steps
        ]

    def _run_step(self, step: Step) -> None:
        self._sync()
        run_xml(self, step.name, step.xml())

    def __getattr__(self, name: str) -> Callable[..., dict[str, Any]]:
        if name.startswith("_") or name not in registry.filters():
            raise AttributeError(f"{type(self).__name__} has no attribute or filter {name!r}")
        return lambda **parameters: self.apply_filter(name, **parameters)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *registry.filters()})

    # What MeshLab shows

    def _sync(self) -> None:
        """Give MeshLab the layers of results that came or changed since it was last asked."""
        if not self._behind:
            return
        self._behind = False
        document, bridge = self.document, self._bridge
        current = pymeshlab.MeshSet.current_mesh_id(self)
        with document.results.locked():
            written = write_views(document)
        ours = {layer.label: layer for layer in written if layer.ours}
        for identity, layer in list(bridge.layers.items()):
            if not layer.ours:
                continue
            if layer.label in ours and _stamp(ours[layer.label].path) == self._stamps.get(identity):
                bridge.layers[identity] = ours.pop(layer.label)
            else:
                bridge.drop(identity)
        document.layers = written
        for layer in ours.values():
            self._stamps[bridge.push(layer)] = _stamp(layer.path)
        self._show_diffuse()
        if pymeshlab.MeshSet.mesh_id_exists(self, current):
            pymeshlab.MeshSet.set_current_mesh(self, current)

    def _show_diffuse(self) -> None:
        """Give MeshLab's object its diffuse texture; of several, its filters can set none."""
        document, bridge = self._bridge.document, self._bridge
        textures = document.map_paths("diffuse", "png")
        for identity, layer in bridge.layers.items():
            mesh = pymeshlab.MeshSet.mesh(self, identity)
            wears = layer.path == document.folder / OBJECT and mesh.has_wedge_tex_coord()
            if not wears or len(textures) != 1 or _stamp(textures[0]) == self._stamps.get(identity):
                continue
            self._stamps[identity] = _stamp(textures[0])
            pymeshlab.MeshSet.set_current_mesh(self, identity)
            super().apply_filter("set_texture_per_mesh", textname=str(textures[0]))
            bridge.settle(identity)


def _sweep(folder: Path) -> None:
    """Remove the working folders of processes that died."""
    for held in folder.glob(f"{WORK}*/{HELD}"):
        lock = FileLock(held, timeout=0)
        try:
            lock.acquire()
        except (Timeout, OSError):  # its set lives, or it is not ours to touch
            continue
        _remove(held.parent, lock)


def _remove(folder: Path, lock: FileLock) -> None:
    lock.release()
    shutil.rmtree(folder, ignore_errors=True)


def _stamp(path: Path | None) -> tuple[int, int] | None:
    """What tells whether a file is the one that MeshLab was given."""
    status = path.stat() if path is not None else None
    return (status.st_mtime_ns, status.st_size) if status else None


def _looking(name: str) -> Callable[..., Any]:
    """A method of pymeshlab's that looks at the meshes: it is to see the newest results."""
    original = getattr(pymeshlab.MeshSet, name)

    def method(self: MeshSet, *arguments: Any, **parameters: Any) -> Any:
        self._sync()
        return original(self, *arguments, **parameters)

    method.__name__, method.__doc__ = name, original.__doc__
    return method


for _name in (
    "mesh", "current_mesh", "mesh_number", "number_meshes", "mesh_id_exists", "set_current_mesh",
    "save_current_mesh", "print_status", "set_mesh_visibility", "is_mesh_visible", "__iter__",
):  # fmt: skip
    setattr(MeshSet, _name, _looking(_name))
