"""The kernels that a run compiles, in its order, with the types of their arguments: kernels.json.

listed     read it
to_json    the inverse, of one kernel

The list is made by `python -m meshlab_svbrdf.bench.first_run`. Kernels that others call are
compiled with those, and are not in it.
"""

from __future__ import annotations

import json
from importlib import import_module
from importlib.resources import files
from typing import Any

import numpy as np
from numba import from_dtype, types

LIST = files(__package__) / "kernels.json"


def listed() -> list[tuple[Any, tuple[types.Type, ...]]]:
    """Kernels and the types of their arguments."""
    entries = json.loads(LIST.read_text(encoding="utf-8"))
    return [(_named(name), tuple(map(_type, arguments))) for name, arguments in entries]


def to_json(kernel: Any, arguments: tuple[types.Type, ...]) -> list[Any]:
    """[MODULE:NAME, [argument …]]: scalars and arrays as "DTYPE" and "DTYPE DIMENSIONS LAYOUT",
    with "readonly" where it is; a tuple as [type, …], a named one as {"MODULE:NAME": [type, …]}."""
    return [_name(kernel.py_func), [_argument(each) for each in arguments]]


def _argument(each: Any) -> Any:
    if isinstance(each, types.Array):
        readonly = " readonly" * (not each.mutable)
        return f"{each.dtype} {each.ndim} {each.layout}{readonly}"
    is_tuple, is_named = (
        isinstance(each, kind) for kind in (types.BaseTuple, types.BaseNamedTuple)
    )
    if is_tuple:
        parts = [_argument(part) for part in each.types]
        return {_name(each.instance_class): parts} if is_named else parts
    return str(each)


def _type(told: Any) -> types.Type:
    if isinstance(told, dict):
        ((name, parts),) = told.items()
        return types.BaseTuple.from_types(tuple(map(_type, parts)), _named(name))
    if isinstance(told, list):
        return types.BaseTuple.from_types(tuple(map(_type, told)))
    if told == "none":
        return types.none
    dtype, *array = told.split()
    scalar = from_dtype(np.dtype(dtype))
    if not array:
        return scalar
    return types.Array(scalar, int(array[0]), array[1], readonly="readonly" in array)


def _name(thing: Any) -> str:
    return f"{thing.__module__.removeprefix(__package__)}:{thing.__qualname__}"


def _named(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(import_module(module, __package__), attribute)
