"""Whether a record of results (svbrdf.json) is one: anybody may have written or changed the file.

Its entries are removed, moved and replaced. None may lead out of the folder.
"""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from math import isfinite
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

TEXTS, NUMBERS = list[str], list[float]
SETTINGS = {"object": str, "held_out": TEXTS, "quality": str, "shown": dict}
PRODUCT = {"filter": str, "key": str, "inputs": dict, "files": TEXTS, "layers": dict}
LAYERS = ({"map": str}, {"file": str, "matrix": NUMBERS, "visible": bool})
RUN = {"parameters": dict}
LONGEST = 250  # bytes of an entry; file systems take 255 of a name


def check_record(record: dict[str, Any]) -> None:
    """Raises ValueError, with the place, where a part is missing or not what it should be."""
    settings, products = _part(record, "settings"), _part(record, "products")
    for name, kind in SETTINGS.items():
        if name in settings:
            _check(settings[name], kind, f"settings, {name}")
    for entry in settings.get("shown", {}):
        _check_entry(entry, "settings, shown")
    for name, product in products.items():
        where = f"products, {name}"
        _check_parts(product, PRODUCT, where)
        for file in product["files"]:
            _check_entry(file, f"{where}, files")
        for label, layer in product["layers"].items():
            _check_layer(layer, f"{where}, layers, {label}")
        for need, key in product["inputs"].items():
            _check(key, str, f"{where}, inputs, {need}")
    _check_order(products)
    for name, run in _part(record, "runs").items():
        _check_parts(run, RUN, f"runs, {name}")


def finite(text: str) -> float:
    """A number of the record; ValueError for NaN and infinity, which could not be written again."""
    if not isfinite(float(text)):
        raise ValueError(f"{text} is no finite number")
    return float(text)


def leads_out(folder: Path) -> Path | None:
    """A link among the results through which something outside of `folder` would be changed."""
    levels = (folder.glob("*"), folder.glob("*/*"))
    links = (path for level in levels for path in level if path.is_symlink())
    inside = folder.resolve()
    return next((link for link in links if not link.resolve().is_relative_to(inside)), None)


def _part(record: dict[str, Any], name: str) -> dict[str, Any]:
    _check(record[name], dict, name)
    return record[name]


def _check_parts(value: Any, parts: dict[str, Any], where: str) -> None:
    _check(value, dict, where)
    for name, kind in parts.items():
        if name not in value:
            raise ValueError(f"{where}: has no {name}")
        _check(value[name], kind, f"{where}, {name}")


def _check(value: Any, kind: Any, where: str) -> None:
    if kind in (TEXTS, NUMBERS):
        kinds = str if kind == TEXTS else (int, float)
        fits = isinstance(value, list) and all(isinstance(each, kinds) for each in value)
    else:
        fits = isinstance(value, kind)
    if not fits:
        name = getattr(kind, "__name__", str(kind))
        raise ValueError(f"{where}: expected {kind if kind in (TEXTS, NUMBERS) else name}")


def _check_layer(layer: Any, where: str) -> None:
    _check(layer, dict, where)
    _check_parts(layer, LAYERS["map" not in layer], where)
    if "map" in layer:
        _check_entry(layer["map"], where)
        return
    _check_entry(layer["file"], where)
    if len(layer["matrix"]) != 16:
        raise ValueError(f"{where}: expected 16 numbers")


def _check_entry(entry: str, where: str) -> None:
    path, windows = PurePosixPath(entry), PureWindowsPath(entry)
    outside = not path.parts or ".." in windows.parts or windows.anchor or path.anchor
    if outside or "\0" in entry or len(entry.encode("utf-8", "replace")) > LONGEST:
        raise ValueError(f"{where}: {entry[:200]!r} does not lie in the folder of the results")


def _check_order(products: dict[str, Any]) -> None:
    """Products made from each other have no beginning."""
    needs = {name: [n for n in p["inputs"] if n in products] for name, p in products.items()}
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        raise ValueError(f"products made from themselves: {', '.join(error.args[1])}") from None
