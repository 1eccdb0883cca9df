"""Whether results still belong to what they were made from.

A product's key is a hash of its filter, the parameters and the keys of what went in: the digests of
mesh, rasters and further layers, and the keys of other products. What was made from an older state
is stale.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .. import registry
from ..errors import DocumentError, MissingStageError
from ..filter import INPUTS, Filter, Namespace, Percentage
from ..geometry.mesh import Mesh
from .frames import file_stamp
from .images import companions
from .record import ResultFolder, digest

RASTER = "raster "  # before a label: one that a parameter of the kind "rasters" names
HUGE = 100_000_000  # bytes: larger files count by name, size and date
LAYER = "layer "  # before a label: an input that a parameter of the kind "layer" names


def in_words(name: str) -> str:
    """A product or input as sentences call it."""
    return name if name.startswith(LAYER) else name.replace("_", " ")


class Freshness:
    """The state of a document at one moment; mesh, rasters and layers are digested at most once.

    frames_there : whether the frames are; where they went, after the results were made from them,
        results do not grow stale by that
    layer : the digest of a layer by its label, "" where it went away, which counts as the frames'
    raster : the digest of one raster by its label, "" where there is none
    """

    def __init__(
        self,
        results: ResultFolder,
        mesh: Callable[[], str],
        rasters: Callable[[], str],
        frames_there: Callable[[], bool],
        layer: Callable[[str], str],
        raster: Callable[[str], str] = lambda label: "",
    ) -> None:
        self._results = results
        self._products: dict[str, Any] = results.record["products"]
        self._frames_there = cache(frames_there)
        self._inputs = {"mesh": cache(mesh), "rasters": cache(rasters)}
        self._layer = cache(layer)
        self._raster = cache(raster)

    def stale(self, product: str) -> str:
        """Which input of `product` is not what it was, or "" where all are."""
        for name, key in self._products[product]["inputs"].items():
            if name == "rasters" and not self._frames_there():
                continue
            if name.startswith(LAYER):
                if self._layer(name.removeprefix(LAYER)) not in ("", key):
                    return name
            elif name in INPUTS:
                if self._inputs[name]() != key:
                    return name
            elif name not in self._products or self._products[name]["key"] != key:
                return name
            elif older := self.stale(name):
                return older
        return ""

    def inputs(self, filter: Filter, parameters: Namespace) -> dict[str, str]:
        """The keys of what the filter needs; MissingStageError where a product is not there."""
        keys = {}
        for parameter in filter.parameters:
            label = getattr(parameters, parameter.name)
            if parameter.kind == "layer" and label:
                keys[LAYER + label] = self._layer(label)
            elif parameter.kind == "rasters":
                for each in split_labels(label):
                    keys[RASTER + each] = self._raster(each)
        needs = filter.needs_with(parameters)
        for need in needs:
            if need not in INPUTS and need not in self._products:
                raise MissingStageError(
                    f"{filter.name} needs the {_words(need)}: run {_makers(need)} first"
                )
        for need in needs:
            if need in INPUTS:
                keys[need] = self._inputs[need]()
                continue
            if older := self.stale(need):
                raise MissingStageError(
                    f"{filter.name} needs the {_words(need)}, but the {in_words(older)} changed "
                    f"since: run {_makers(need)} again"
                )
            keys[need] = self._products[need]["key"]
        return keys

    def unchanged(self, filter: Filter, key: str) -> bool:
        """Whether the filter's products are those of this key, with every file in its place.

        What was edited since it was made counts as made: editing is the user's work.
        """
        if not filter.writes or filter.edits:
            return False
        return all(
            name in self._products
            and key in (self._products[name]["key"], self._products[name].get("maker"))
            and not self.stale(name)
            and all((self._results.path / file).exists() for file in self._products[name]["files"])
            for name in filter.writes
        )


def _words(product: str) -> str:
    return product.replace("_", " ")


def _makers(product: str) -> str:
    return " or ".join(registry.writers(product)) or f"the filter that writes {product}"


def split_labels(text: str) -> list[str]:
    """The labels of "a; b"."""
    return [label.strip() for label in text.split(";") if label.strip()]


def filter_key(filter: Filter, parameters: Namespace, inputs: dict[str, str]) -> str:
    """SHA-256 of all that decides a filter's result; files given as parameters count by content."""
    return digest(
        [
            filter.name,
            filter.version,
            {name: _key_of(value) for name, value in vars(parameters).items()},
            inputs,
        ]
    )


def resolve_lengths(filter: Filter, parameters: Namespace, mesh: Callable[[], Mesh]) -> None:
    """Turn percentages into world units of the object's bounding box, in place."""
    for name, value in vars(parameters).items():
        if isinstance(value, Percentage):
            setattr(parameters, name, value.resolve(2 * mesh().radius))


def _key_of(value: Any) -> Any:
    if isinstance(value, Percentage):
        return f"{value.percent!r}%"
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [_key_of(item) for item in value]
    if isinstance(value, Path):
        if value.is_dir():
            return [str(value), *(file_stamp(file) for file in sorted(value.iterdir()))]
        if not value.is_file():
            return str(value)
        if value.stat().st_size > HUGE:
            return file_stamp(value)
        digests = [_file_digest(file) for file in companions(value)]
        return digests if len(digests) > 1 else digests[0]
    return value


def _file_digest(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror})") from None
