"""The layers of a saved project: the object with its diffuse texture, maps, texels and the rest.

A layer is written when what it shows has changed: `settings["shown"]` holds what each file shows.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .given_uv import GivenUv, given_path
from .layers import Layer, file_name, mesh_digest, texels_content, write_layer
from .record import digest

if TYPE_CHECKING:
    from .document import Document

OBJECT = "layers/object.ply"
QUALITY = "threshold"  # the statistic shown until another is chosen
SHOWN_MOST = 5_000_000
"""Points of the layer of texels; of more texels every n-th along the surface is shown."""


def write_views(document: Document) -> list[Layer]:
    """Write what changed; return all layers of the project to save: the user's, then ours."""
    views = _Views(document)
    kept = [layer for layer in document.layers if not layer.ours]
    for layer in kept:
        views.keep(layer)
    views.maps_and_layers()
    views.texels()
    document.set(shown=views.shown)

    # Put each of ours where it was, new ones at the end
    ours = {layer.label: layer for layer in views.ours}
    old = [layer for layer in document.layers if not layer.ours or layer.label in ours]
    result = [
        views.stand_in(ours.pop(layer.label), layer) if layer.ours else layer for layer in old
    ]
    result += ours.values()

    # Remove what is shown no more, but never a file that a layer lives in
    needed = {layer.path for layer in result}
    for entry in views.before.keys() - views.shown.keys():
        if document.folder / entry not in needed:
            (document.folder / entry).unlink(missing_ok=True)
    return result


class _Views:
    def __init__(self, document: Document) -> None:
        self.document = document
        self.before: dict[str, str] = document.settings.get("shown", {})
        self.shown: dict[str, str] = {}
        self.ours: list[Layer] = []
        self.written: set[Path] = set()
        products = document.results.record["products"]
        freshness = document._freshness()
        self.products = {n: entry for n, entry in products.items() if not freshness.stale(n)}
        self.files = {file for entry in self.products.values() for file in entry["files"]}

    def keep(self, layer: Layer) -> None:
        """The user's layers stay; the object gets its diffuse texture, unsaved ones a file."""
        diffuse = self._textures("diffuse")
        if diffuse and layer is self.document.object_layer():
            self._write_object(OBJECT, layer, diffuse)
            layer.path = self.document.folder / OBJECT
        elif layer.path is None:
            path = self._free_path(layer.label)
            write_layer(path, layer.read(), double=True)
            layer.path = path
        given = given_path(self.document.folder / OBJECT)
        if layer.path == self.document.folder / OBJECT and given.is_file():
            self.shown[given.relative_to(self.document.folder).as_posix()] = ""

    def maps_and_layers(self) -> None:
        for product in self.products.values():
            for label, layer in product["layers"].items():
                if any(known.label == label for known in self.ours):
                    continue
                if "map" in layer:
                    self._add_map(label, layer["map"])
                else:
                    matrix = np.array(layer["matrix"]).reshape(4, 4)
                    path = self.document.folder / layer["file"]
                    self.ours.append(Layer(label, path, matrix, layer["visible"]))

    def texels(self) -> None:
        """One point per texel (at most SHOWN_MOST), with every attribute of these texels."""
        document = self.document
        if "arrays/texels_face.npy" not in self.files:
            return
        names = [name for name in document.attributes() if f"texels/{name}.npy" in self.files]
        quality = document.settings.get("quality", QUALITY)
        keys = sorted(entry["key"] for entry in self.products.values())
        entry, matrix = file_name("texels"), np.eye(4)
        matrix[:3, 3] = document.array("texels_center")
        if self._changed(entry, [keys, quality]):
            images = document.map("diffuse", "png") if self._textures("diffuse") else None
            texels = document.texels()
            step = -(-len(texels) // SHOWN_MOST)
            attributes = {name: document.attribute(name, mmap=True)[::step] for name in names}
            content = texels_content(texels.every(step), attributes, images, quality)
            write_layer(self._path(entry), content)
        self._add("texels", entry, matrix)

    def stand_in(self, new: Layer, old: Layer) -> Layer:
        """Ours in the place of its former self, with what the user did to that in MeshLab."""
        new.visible, new.entry = old.visible, old.entry
        if old.path is None and new.path not in self.written:
            assert new.path is not None
            new.content, new.matrix = old.content, old.matrix
            write_layer(new.path, old.read())
        return new

    def _add_map(self, label: str, name: str) -> None:
        textures = self._textures(name)
        if textures:
            layer = self.document.object_layer()
            self._write_object(file_name(label), layer, textures)
            self._add(label, file_name(label), layer.matrix)

    def _add(self, label: str, entry: str, matrix: np.ndarray) -> None:
        self.ours.append(Layer(label, self.document.folder / entry, matrix, False))

    def _textures(self, name: str) -> list[Path]:
        return [
            path
            for path in self.document.map_paths(name, "png")
            if path.relative_to(self.document.folder).as_posix() in self.files
        ]

    def _write_object(self, entry: str, layer: Layer, textures: list[Path]) -> None:
        mesh = self.document._local_mesh(layer)
        shows = [mesh_digest(mesh, layer.matrix), [path.name for path in textures]]
        changed = self._changed(entry, shows)
        if not changed and not (entry == OBJECT and layer.path is None):
            return
        content = layer.read()
        if entry == OBJECT:
            GivenUv.beside(self._path(entry)).keep(self.document._given_mesh(layer), mesh)
        write_layer(
            self._path(entry), replace(content, mesh=mesh), textures=tuple(textures), double=True
        )

    def _changed(self, entry: str, what: Any) -> bool:
        self.shown[entry] = digest(what)
        path = self.document.folder / entry
        changed = not path.exists() or self.before.get(entry) != self.shown[entry]
        if changed:
            self.written.add(path)
        return changed

    def _free_path(self, label: str) -> Path:
        """A file for a layer of the user's that no other layer has."""
        taken = {layer.path for layer in self.document.layers}
        path, index = self._path(file_name(f"mesh {label}")), 1
        while path in taken:
            index += 1
            path = self._path(file_name(f"mesh {label} {index}"))
        return path

    def _path(self, entry: str) -> Path:
        path = self.document.folder / entry
        path.parent.mkdir(parents=True, exist_ok=True)
        return path
