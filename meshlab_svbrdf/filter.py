"""What a filter is: a descriptor that shell, MeshSet, documentation and scripts are made from.

Parameter, Filter      the declarations
Filter.check           parameters given by a caller, checked and completed
Percentage             a length relative to the bounding box, as MeshLab's PercentageValue
describe, to_json      the descriptor as text for people, and as MeshLab 2 declares filters
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from .errors import SvbrdfError

Namespace = SimpleNamespace

KINDS = (
    "bool", "int", "float", "enum", "string", "path", "paths", "length", "points", "layer",
    "rasters",
)  # fmt: skip
INPUTS = ("mesh", "rasters")  # what a filter may need besides other filters' products

_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]*\Z")
_WORDS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


@dataclass(frozen=True)
class Percentage:
    """A length in percent (0..100) of the diagonal of the object's bounding box."""

    percent: float

    def resolve(self, diagonal: float) -> float:
        return self.percent / 100 * diagonal


@dataclass(frozen=True)
class Parameter:
    """One parameter of a filter.

    kind : bool, int, float, enum (one of `choices`), string, path (a Path, None where it is ""),
        paths (a tuple of Paths, in a script or shell "a; b"),
        length (a float in world units, or "2%" / PercentageValue of the bounding box's diagonal),
        points ((N, 3) float64, in a script or shell "x y z; x y z"),
        layer (a label; the layer's mesh counts as an input of the filter),
        rasters (labels, "a; b"; their cameras and files count as inputs)
    default, minimum, maximum : in `unit`; the limits belong to int, float and length
    help : what it does and how to choose it
    """

    name: str
    kind: str
    default: Any
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    help: str = ""

    def __post_init__(self) -> None:
        if not _IDENTIFIER.match(self.name) and self.name != "randomSeed":
            raise ValueError(f"parameter name {self.name!r} is not a lower-case identifier")
        if self.kind not in KINDS:
            raise ValueError(
                f"parameter {self.name}: unknown kind {self.kind!r}, use one of {KINDS}"
            )
        if (self.kind == "enum") != bool(self.choices):
            raise ValueError(f"parameter {self.name}: choices belong to enums, and enums need them")
        try:
            self.check(self.default)
        except SvbrdfError as error:
            raise ValueError(f"parameter {self.name}: bad default: {error}") from None

    def check(self, value: Any, filter_name: str = "") -> Any:
        """`value`, or the text of it from a shell or a script, as the type that `apply` receives.

        Raises SvbrdfError naming filter, parameter, what was expected and what came.
        """
        converted = getattr(self, f"_{self.kind}")(value)
        if converted is _WRONG or not self._within(converted):
            where = f"{filter_name}: " if filter_name else ""
            raise SvbrdfError(
                f"{where}parameter {self.name} is {value!r}, expected {self.expected()}"
            )
        return converted

    def expected(self) -> str:
        """What a value must be, in words."""
        if self.kind == "enum":
            return "one of " + ", ".join(self.choices)
        words = {
            "bool": "true or false",
            "int": "a whole number",
            "float": "a number",
            "string": "a text",
            "path": "the path of a file",
            "paths": 'paths of files, "a; b"',
            "layer": "the label of a layer",
            "rasters": 'labels of rasters, "a; b"',
            "length": 'a length in world units or "2%" of the bounding box\'s diagonal',
            "points": 'points of three numbers each, "x y z; x y z"',
        }[self.kind]
        if self.minimum is not None and self.maximum is not None:
            words += f" from {self.minimum:g} to {self.maximum:g}"
        elif self.minimum is not None:
            words += f" of at least {self.minimum:g}"
        elif self.maximum is not None:
            words += f" of at most {self.maximum:g}"
        return f"{words} ({self.unit})" if self.unit else words

    def _within(self, value: Any) -> bool:
        if self.kind not in ("int", "float", "length") or isinstance(value, Percentage):
            return True
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        return low <= value <= high

    def _bool(self, value: Any) -> Any:
        if isinstance(value, bool | np.bool_):
            return bool(value)
        return _WORDS.get(value.strip().lower(), _WRONG) if isinstance(value, str) else _WRONG

    def _int(self, value: Any) -> Any:
        number = self._float(value)
        return int(number) if number is not _WRONG and number == int(number) else _WRONG

    def _float(self, value: Any) -> Any:
        if isinstance(value, bool | np.bool_):
            return _WRONG
        try:
            number = float(value)
        except (TypeError, ValueError):
            return _WRONG
        return number if math.isfinite(number) else _WRONG

    def _enum(self, value: Any) -> Any:
        return value if isinstance(value, str) and value in self.choices else _WRONG

    def _string(self, value: Any) -> Any:
        return value if isinstance(value, str) else _WRONG

    _layer = _string
    _rasters = _string

    def _path(self, value: Any) -> Any:
        if value is None or value == "":
            return None
        return Path(value) if isinstance(value, str | Path) else _WRONG

    def _paths(self, value: Any) -> Any:
        if isinstance(value, str):
            value = [part.strip() for part in value.split(";") if part.strip()]
        elif value is None or isinstance(value, Path):
            value = [] if value is None else [value]
        if not isinstance(value, list | tuple):
            return _WRONG
        found = tuple(self._path(part) for part in value)
        return _WRONG if None in found or _WRONG in found else found

    def _length(self, value: Any) -> Any:
        kind = type(value).__name__  # pymeshlab's own types, without importing pymeshlab
        if kind == "PercentageValue":
            return Percentage(value.value())
        if kind == "PureValue":
            value = value.value()
        if isinstance(value, Percentage):
            return value
        if isinstance(value, str) and value.strip().endswith("%"):
            percent = self._float(value.strip()[:-1])
            return _WRONG if percent is _WRONG else Percentage(percent)
        return self._float(value)

    def _points(self, value: Any) -> Any:
        if isinstance(value, str):
            value = [row.replace(",", " ").split() for row in value.split(";") if row.strip()]
        try:
            points = np.asarray(value, np.float64)
        except (TypeError, ValueError):
            return _WRONG
        if points.size == 0:
            return np.zeros((0, 3))
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            return _WRONG
        return points


_WRONG = object()


@dataclass(frozen=True)
class Filter:
    """The descriptor of a filter; `apply` is joined to it by the registry.

    name : verb first, lower case: the method of MeshSet, the word in the shell
    title : what a menu shows
    needs : products of other filters, and "mesh" or "rasters" where `apply` reads them
    needs_if : further products, each with the parameter and its value at which `apply` reads it
    writes : products that `apply` sets; a product both needed and written is edited in place
    version : raise it when the same inputs give another result, so that old results are made anew
    apply : `apply(document, parameters, progress) -> str`, one line on the outcome
    """

    name: str
    title: str
    needs: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    needs_if: Mapping[str, tuple[str, Any]] = field(default_factory=dict)
    help: str = ""
    reference: str = ""
    version: int = 1
    apply: Callable[..., str] | None = None

    def __post_init__(self) -> None:
        if not _IDENTIFIER.match(self.name):
            raise ValueError(f"filter name {self.name!r} is not a lower-case identifier")
        names = [parameter.name for parameter in self.parameters]
        needs = (*self.needs, *self.needs_if)
        for what, words in (("parameter", names), ("need", needs), ("product", self.writes)):
            if len(set(words)) < len(words):
                raise ValueError(f"{self.name}: the same {what} twice in {list(words)}")
        if "force" in names:
            raise ValueError(f"{self.name}: force is what every filter understands already")
        for parameter, value in self.needs_if.values():
            self.check({parameter: value})
        for product in (*needs, *self.writes):
            if not _IDENTIFIER.match(product):
                raise ValueError(f"{self.name}: product {product!r} is not lower case")
        if set(self.writes) & set(INPUTS):
            raise ValueError(f"{self.name}: {INPUTS} are inputs, a filter cannot write them")

    @property
    def edits(self) -> tuple[str, ...]:
        """Products that this filter changes in place."""
        return tuple(product for product in self.writes if product in self.needs)

    def needs_with(self, parameters: Namespace) -> tuple[str, ...]:
        """What it needs where it has these parameters."""
        also = (
            product
            for product, (name, value) in self.needs_if.items()
            if getattr(parameters, name) == value
        )
        return (*self.needs, *also)

    def check(self, given: dict[str, Any]) -> Namespace:
        """The parameters given by a caller, checked, with defaults for the others."""
        known = [parameter.name for parameter in self.parameters]
        for name in given:
            if name not in known:
                close = difflib.get_close_matches(name, known, 1)
                hint = f", did you mean {close[0]}?" if close else ""
                takes = ", ".join(known) or "none"
                raise SvbrdfError(
                    f"{self.name} has no parameter {name}{hint} (its parameters: {takes})"
                )
        return Namespace(
            **{
                parameter.name: parameter.check(
                    given.get(parameter.name, parameter.default), self.name
                )
                for parameter in self.parameters
            }
        )


def describe(filter: Filter) -> str:
    """The descriptor as Markdown: what the shell and the documentation show."""
    lines = [f"## {filter.name}", "", f"**{filter.title}**", ""]
    if filter.help:
        lines += [filter.help, ""]
    needs = [*filter.needs, *(f"{p} (if {k}={v})" for p, (k, v) in filter.needs_if.items())]
    lines.append(f"Needs: {', '.join(needs) or 'nothing'}. ")
    lines[-1] += f"Writes: {', '.join(filter.writes) or 'no product'}."
    if filter.parameters:
        lines.append("")
        lines += ["| parameter | default | expected | |", "|---|---|---|---|"]
        lines += [
            f"| `{p.name}` | {_default(p)} | {p.expected()} | {p.help} |" for p in filter.parameters
        ]
    if filter.reference:
        lines += ["", f"Reference: {filter.reference}"]
    return "\n".join(lines) + "\n"


def to_json(filter: Filter) -> dict[str, Any]:
    """The descriptor in the manner of MeshLab 2's `filters.json`."""
    return {
        "id": filter.name,
        "title": filter.title,
        "categories": ["Raster", "SVBRDF"],
        "description": filter.help,
        "requirements": list(filter.needs),
        "requirementsIf": {p: {k: _plain(v)} for p, (k, v) in filter.needs_if.items()},
        "modifies": list(filter.writes),
        "parameters": [_parameter_json(parameter) for parameter in filter.parameters],
        "references": [filter.reference] if filter.reference else [],
    }


def _parameter_json(parameter: Parameter) -> dict[str, Any]:
    optional = {
        "choices": list(parameter.choices),
        "minimum": parameter.minimum,
        "maximum": parameter.maximum,
        "unit": parameter.unit,
    }
    return {
        "id": parameter.name,
        "type": parameter.kind,
        "default": _plain(parameter.default),
        "description": parameter.help,
        **{key: value for key, value in optional.items() if value not in (None, [], "")},
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Percentage):
        return f"{value.percent:g}%"
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value


def _default(parameter: Parameter) -> str:
    value = _plain(parameter.default)
    return (
        f"`{str(value).lower() if isinstance(value, bool) else value}`"
        if value not in ("", ())
        else ""
    )
