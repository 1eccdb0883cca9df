"""What filters read and set: attributes, arrays, JSON, maps, images and layers of NAME.svbrdf.

Setting stages; `write(...)` commits when its block ends, and forgets everything if it raises.

texels/NAME.npy   attribute: (T,) or (T, k), one row per texel
arrays/NAME.npy   any other array; texels themselves are arrays/texels_*.npy
maps/NAME.png|exr one image per texture of the object; NAME.1.png for the second, or NAME.1001.png,
                  NAME.1002.png … where the textures are UDIM tiles
layers/LABEL.ply  layers that a filter made
frames/NAME.jpg   extracted frames of videos
NAME.json, NAME.png|exr, samples/ …   at the top
"""

from __future__ import annotations

import copy
import re
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import MissingStageError
from ..geometry.texels import Texels
from .images import read_exr, read_image, write_exr, write_jpeg, write_png
from .layers import MAP, Layer, attribute_name, file_name, write_layer
from .record import ResultFolder, write_json
from .stored import read_array, read_json, write_array
from .video_names import FRAMES

ImageKind = Literal["exr", "png"]


@dataclass
class _Writing:
    """What the filter that runs now has set so far."""

    products: tuple[str, ...]
    edits: tuple[str, ...]
    hidden: set[str]
    files: set[str] = field(default_factory=set)
    held: dict[str, Any] = field(default_factory=dict)
    layers: dict[str, dict[str, Any]] = field(default_factory=dict)


class Products:
    """Access to the results in a folder. A filter never sees what its own last run left behind,
    except of products that it needs: the same inputs give the same result."""

    def __init__(self, folder: Path) -> None:
        self.results = ResultFolder(folder)
        self._writing: _Writing | None = None
        self._held: dict[str, tuple[str, Any]] = {}

    @property
    def folder(self) -> Path:
        """NAME.svbrdf: every result lives there."""
        return self.results.path

    def has(self, product: str) -> bool:
        """Whether `product` has been made (it may be older than its inputs)."""
        return product in self.results.record["products"]

    # Per texel

    def attributes(self) -> list[str]:
        """Names of all attributes of texels."""
        entries = self.results.files() | (self._writing.files if self._writing else set())
        names = (re.fullmatch(r"texels/(.+)\.npy", entry) for entry in entries)
        return sorted(name[1] for name in names if name and self._visible(name[0]))

    def attribute(self, name: str, *, mmap: bool = False) -> np.ndarray:
        """An attribute of the texels, (T,) or (T, k); `svbrdf_NAME` and NAME are the same.

        mmap : read only and left in its file
        """
        path = self._find(f"texels/{attribute_name(name)}.npy", f"attribute {name}")
        return read_array(path, mmap=mmap)

    def set_attribute(self, name: str, values: np.ndarray) -> None:
        """Stage one value, or row of values, per texel."""
        values = np.asarray(values)
        count = len(self.array("texels_face", mmap=True))
        if values.ndim not in (1, 2) or len(values) != count:
            raise ValueError(f"attribute {name} has shape {values.shape}, expected ({count}, …)")
        write_array(self._stage(f"texels/{attribute_name(name)}.npy"), values)

    # Arrays

    def array(self, name: str, *, mmap: bool = False) -> np.ndarray:
        """An array by name, in memory, or (`mmap`) read only and left in its file."""
        return read_array(self._find(f"arrays/{name}.npy", f"array {name}"), mmap=mmap)

    def set_array(self, name: str, values: np.ndarray) -> None:
        write_array(self._stage(f"arrays/{name}.npy"), np.asarray(values))

    def has_array(self, name: str) -> bool:
        return self._look(f"arrays/{name}.npy") is not None

    def tiles(self) -> list[int]:
        """The numbers of the textures that are UDIM tiles; [] where they are none."""
        return self.array("tiles").tolist() if self.has_array("tiles") else []

    def texels(self) -> Texels:
        """The texels, as the filter that rasterised them set them."""
        values: dict[str, Any] = {
            item.name: self.array(f"texels_{item.name}") for item in fields(Texels)
        }
        sizes = tuple((int(height), int(width)) for height, width in values.pop("sizes"))
        return Texels(**{**values, "radius": float(values["radius"])}, sizes=sizes)

    def set_texels(self, texels: Texels) -> None:
        for item in fields(Texels):
            self.set_array(f"texels_{item.name}", np.asarray(getattr(texels, item.name)))

    # Small results

    def json(self, name: str) -> dict[str, Any]:
        """The content of NAME.json; NaN was written as null."""
        return read_json(self._find(f"{name}.json", f"{name}.json"))

    def set_json(self, name: str, value: dict[str, Any]) -> None:
        """Stage NAME.json; numpy numbers and arrays become plain ones, NaN and infinity null."""
        write_json(self._stage(f"{name}.json"), plain(value))

    def has_json(self, name: str) -> bool:
        return self._look(f"{name}.json") is not None

    def set_text(self, name: str, text: str) -> None:
        """Stage a text file at the folder's top (registration.csv)."""
        self._stage(name).write_text(text, encoding="utf-8")

    def staged_file(self, entry: str) -> Path:
        """Where to write a file of any other kind, by its place in the folder."""
        return self._stage(entry)

    # Scripts

    def find_script(self, name: str) -> Path | None:
        """Where NAME.mlx is, or None."""
        return self._look(f"{name}.mlx")

    def stage_script(self, name: str) -> Path:
        """Where to write NAME.mlx, a script of what made a product."""
        return self._stage(f"{name}.mlx")

    # Images

    def map(self, name: str, kind: ImageKind = "exr") -> list[np.ndarray]:
        """A map's images, one per texture of the object."""
        paths = self.map_paths(name, kind)
        if not paths:
            raise MissingStageError(f"there is no map {name}.{kind} in {self.folder.name}")
        return [_read(path) for path in paths]

    def map_paths(self, name: str, kind: ImageKind = "exr") -> list[Path]:
        """Where a map's images are; empty if there is none."""
        found: list[Path] = []
        while path := self._look(self._map_entry(name, len(found), kind)):
            found.append(path)
        return found

    def map_places(self, name: str, count: int, kind: ImageKind = "exr") -> list[Path]:
        """Where the images of a map of `count` textures are, or will be."""
        return [self.folder / self._map_entry(name, index, kind) for index in range(count)]

    def set_map(
        self, name: str, images: np.ndarray | Iterable[np.ndarray], *, kind: ImageKind = "exr"
    ) -> None:
        """Stage a map: float32 for "exr", uint8 or uint16 for "png"; one image per texture."""
        for index, image in enumerate([images] if isinstance(images, np.ndarray) else images):
            _write(self._stage(self._map_entry(name, index, kind)), image)

    def image(self, name: str, kind: ImageKind = "exr") -> np.ndarray:
        return _read(self._find(f"{name}.{kind}", f"image {name}.{kind}"))

    def set_image(self, name: str, image: np.ndarray, *, kind: ImageKind = "exr") -> None:
        """Stage an image at the folder's top (environment.exr)."""
        _write(self._stage(f"{name}.{kind}"), image)

    def set_frame_image(self, name: str, image: np.ndarray) -> None:
        """Stage the JPEG that a raster names for a frame of a video, (H, W, 3) uint8."""
        write_jpeg(self._stage(f"{FRAMES}/{name}"), image)

    # Folders

    def result_folder(self, name: str) -> Path:
        """A folder that a filter filled (samples)."""
        return self._find(f"{name}/", name)

    def staged_folder(self, name: str) -> Path:
        """An empty folder to fill; it replaces NAME/ as a whole when the filter returns."""
        return self._stage(f"{name}/")

    def earlier(self, name: str) -> list[Path]:
        """Folders NAME of an interrupted run and of the last one: what they hold may be linked."""
        return self.results.earlier(f"{name}/")

    # In memory

    def key(self, product: str) -> str:
        """What `product` was made from, as one word."""
        return self.results.record["products"][product]["key"]

    def hold(self, product: str, value: Any) -> None:
        """Keep part of a product in this process alone, as long as the product is not made anew."""
        if self._writing is not None and product in self._writing.products:
            self._writing.held[product] = value
        else:
            self._held[product] = self.key(product), value

    def held(self, product: str) -> Any:
        """What was held, or None."""
        key, value = self._held.get(product, ("", None))
        return value if key and self.has(product) and key == self.key(product) else None

    # Layers

    def set_layer(self, layer: Layer) -> None:
        """Stage a layer (environment, materials); its textures lie in the folder."""
        entry = file_name(layer.label)
        content = layer.read()
        staged = self.results.stage("")
        textures = tuple(
            staged / path.relative_to(self.folder) if path.is_relative_to(self.folder) else path
            for path in content.textures
        )
        write_layer(self._stage(entry), content, textures=textures)
        self._writing_now().layers[layer.label] = {
            "file": entry,
            "matrix": layer.matrix.ravel().tolist(),
            "visible": layer.visible,
        }

    def show_map(self, name: str, image: str | None = None) -> None:
        """Stage a layer `map: NAME`: the object with maps/IMAGE.png as its texture."""
        self._writing_now().layers[MAP + name] = {"map": image or name}

    # Staging

    @contextmanager
    def write(
        self,
        *products: str,
        edits: tuple[str, ...] = (),
        filter: str = "",
        key: str = "",
        inputs: dict[str, str] | None = None,
        run: dict[str, Any] | None = None,
    ) -> Iterator[None]:
        """Commit everything set in the block as `products`, whole or not at all.

        edits : those of `products` that are changed in place: what is not set again stays
        key, inputs : the product's key and those of what went into it
        run : filled by the block, recorded under the name of `filter`
        """
        if self._writing is not None:
            raise RuntimeError("a filter is running already; filters do not nest")
        with self.results.locked():
            record = copy.deepcopy(self.results.record)
            before = {name: entry for name, entry in record["products"].items() if name in products}
            others = [e for n, e in record["products"].items() if n not in products or n in edits]
            mine = {file for entry in before.values() for file in entry["files"]}
            hidden = mine - {file for entry in others for file in entry["files"]}
            self._writing = _Writing(products, edits, hidden)
            try:
                yield
                if not products:  # a filter that only writes files elsewhere
                    return
                made = self._product(before, filter, key or secrets.token_hex(32), inputs or {})
                _mark_overwritten(record["products"], products, self._writing.files)
                for name in products:
                    record["products"][name] = copy.deepcopy(made)
                    if name in edits and name in before:
                        maker = before[name].get("maker", before[name]["key"])
                        record["products"][name]["maker"] = maker
                if filter:
                    record["runs"][filter] = run
                self.results.commit(record)
                self._held |= {n: (made["key"], value) for n, value in self._writing.held.items()}
            finally:
                self._writing = None
                self.results.discard()

    def _product(
        self, before: dict[str, Any], filter: str, key: str, inputs: dict[str, str]
    ) -> dict[str, Any]:
        """The record of what was written; an edit inherits files, layers and inputs."""
        writing = self._writing_now()
        edited = [before[name] for name in writing.edits if name in before]
        inherited = {name: value for entry in edited for name, value in entry["inputs"].items()}
        files = set(writing.files).union(*(entry["files"] for entry in edited))
        layers = {label: layer for entry in edited for label, layer in entry["layers"].items()}
        return {
            "filter": filter,
            "key": key,
            "inputs": {n: v for n, v in (inherited | inputs).items() if n not in writing.products},
            "files": sorted(files),
            "layers": layers | writing.layers,
        }

    def _writing_now(self) -> _Writing:
        if self._writing is None or not self._writing.products:
            raise RuntimeError("results are set by a filter that declares `writes`, while it runs")
        return self._writing

    def _stage(self, entry: str) -> Path:
        self._writing_now().files.add(entry)
        return self.results.stage(entry)

    def _map_entry(self, name: str, index: int, kind: ImageKind) -> str:
        tiles = self.tiles()
        number = tiles[index] if index < len(tiles) else index
        return f"maps/{name}.{number}.{kind}" if number else f"maps/{name}.{kind}"

    def _visible(self, entry: str) -> bool:
        writing = self._writing
        return writing is None or entry in writing.files or entry not in writing.hidden

    def _look(self, entry: str) -> Path | None:
        return self.results.find(entry) if self._visible(entry) else None

    def _find(self, entry: str, what: str) -> Path:
        path = self._look(entry)
        if path is None:
            raise MissingStageError(
                f"there is no {what} in {self.folder.name}: run the filter that makes it first"
            )
        return path


def _read(path: Path) -> np.ndarray:
    return read_exr(path) if path.suffix == ".exr" else read_image(path)


def _write(path: Path, image: np.ndarray) -> None:
    if path.suffix == ".exr":
        write_exr(path, image)
    else:
        write_png(path, image)


def _mark_overwritten(products: dict[str, Any], written: tuple[str, ...], files: set[str]) -> None:
    """Make stale what was made from `written` and had put its own results into the same files."""
    for name, product in products.items():
        if (
            name not in written
            and files & set(product["files"])
            and _made_from(products, name, written)
        ):
            product["inputs"] |= dict.fromkeys(written, "overwritten")


def _made_from(products: dict[str, Any], name: str, origins: tuple[str, ...]) -> bool:
    inputs = products[name]["inputs"] if name in products else {}
    return any(need in origins or _made_from(products, need, origins) for need in inputs)


def plain(value: Any) -> Any:
    """JSON's own types: numpy's unpacked, NaN and infinity null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
