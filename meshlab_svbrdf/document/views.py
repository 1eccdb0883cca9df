"""The layers of a saved project: the object with its diffuse texture, maps, texels and the rest.

A layer is written when what it shows has changed: `settings["shown"]` holds what each file shows.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .layers import Layer, file_name, texels_layer, write_layer
from .record import digest

if TYPE_CHECKING:
    from .document import Document

OBJECT = "layers/object.ply"
QUALITY = "threshold"  # the statistic shown until another is chosen


def write_views(document: Document) -> list[Layer]:
    """Write what changed; return all layers of the project to save: the user's, then ours."""
    views = _Views(document)
    kept = [layer for layer in document.layers if not layer.ours]
    for layer in kept:
        views.keep(layer)
    views.maps_and_layers()
    views.texels()
    document.set(shown=views.shown)
    for entry in views.before.keys() - views.shown.keys():
        (document.folder / entry).unlink(missing_ok=True)

    # Put each of ours where it was, new ones at the end
    ours = {layer.label: layer for layer in views.ours}
    old = [layer for layer in document.layers if not layer.ours or layer.label in ours]
    result = [_stand_in(ours.pop(layer.label), layer) if layer.ours else layer for layer in old]
    return result + list(ours.values())


def _stand_in(new: Layer, old: Layer) -> Layer:
    """Ours in the place of its former self: the user may have hidden or shown it."""
    new.visible, new.entry = old.visible, old.entry
    return new


class _Views:
    def __init__(self, document: Document) -> None:
        self.document = document
        self.before: dict[str, str] = document.settings.get("shown", {})
        self.shown: dict[str, str] = {}
        self.ours: list[Layer] = []
        products = document.results.record["products"]
        freshness = document._freshness()
        self.products = {n: entry for n, entry in products.items() if not freshness.stale(n)}
        self.files = {file for entry in self.products.values() for file in entry["files"]}
        self.geometry = document._given_digest() if self.products else ""

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
        """One point per texel, with every attribute that belongs to these texels."""
        document = self.document
        if "arrays/texels_face.npy" not in self.files:
            return
        names = [name for name in document.attributes() if f"texels/{name}.npy" in self.files]
        quality = document.settings.get("quality", QUALITY)
        keys = sorted(entry["key"] for entry in self.products.values())
        entry, images = file_name("texels"), None
        if self._textures("diffuse"):
            images = [image for image in document.map("diffuse", "png") if image.ndim == 3] or None
        layer = texels_layer(
            document.texels(), {name: document.attribute(name) for name in names}, images, quality
        )
        if self._changed(entry, [keys, quality]):
            write_layer(self._path(entry), layer.read())
        self._add("texels", entry, layer.matrix)

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
        if not self._changed(entry, [self.geometry, [path.name for path in textures]]):
            return
        content = layer.read()
        mesh = self.document._local_mesh(layer)
        write_layer(
            self._path(entry), replace(content, mesh=mesh), textures=tuple(textures), double=True
        )

    def _changed(self, entry: str, what: Any) -> bool:
        self.shown[entry] = digest(what)
        there = (self.document.folder / entry).exists()
        return not there or self.before.get(entry) != self.shown[entry]

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
