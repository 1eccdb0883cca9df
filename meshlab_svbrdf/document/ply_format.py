"""The PLY container: header, scalars and lists, text or binary of either byte order, as columns.

plyfile reads text and lists of unequal length row by row, and refuses comments (texture names)
outside ASCII; the tests hold the two readers against each other.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..blocks import room
from ..errors import DocumentError

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


class Lists(NamedTuple):
    """A list property: `counts` (N,) int64 items in each row, `values` one after the other."""

    counts: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Property:
    """`length` is the type of a list's length, None for a scalar; types are NumPy's ("<f4")."""

    name: str
    type: str
    length: str | None = None


@dataclass
class Element:
    """`count` rows of `properties`; after reading, `columns` by name: scalars (N,) or `Lists`."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)
    columns: dict[str, np.ndarray | Lists] = field(default_factory=dict)


def read_ply_columns(path: Path) -> tuple[list[str], dict[str, Element]]:
    """All comments and elements of a PLY file; `DocumentError` when it is cut off or malformed."""
    data = path.read_bytes()
    stop = data.find(b"end_header")
    newline = data.find(b"\n", stop)
    if not data.startswith(b"ply") or stop < 0 or newline < 0:
        raise DocumentError(
            f"{path}: is not a PLY file: it has no header from 'ply' to 'end_header'"
        )
    lines = data[:stop].decode("utf-8", "surrogateescape").splitlines()
    try:
        kind, comments, elements = _parse_header(lines)
    except (ValueError, KeyError, IndexError) as error:
        raise DocumentError(f"{path}: malformed PLY header ({error})") from error
    body = memoryview(data)[newline + 1 :]
    if kind == "ascii":
        body = memoryview(_as_doubles(bytes(body), path))
    at = 0
    for element in elements.values():
        at = _read_element(body, at, element, path)
    return comments, elements


def _parse_header(lines: list[str]) -> tuple[str, list[str], dict[str, Element]]:
    kind, comments = "", []
    elements: dict[str, Element] = {}
    for line in lines[1:]:
        word, _, rest = line.strip().partition(" ")
        words = rest.split()
        if word == "format":
            kind = words[0]
        elif word == "comment":
            comments.append(rest.strip())
        elif word == "element":
            element = Element(words[0], int(words[1]))
            if element.name in elements or element.count < 0:
                raise ValueError(f"element {rest}")
            elements[element.name] = element
        elif word == "property":
            # Text is parsed into doubles, lengths included
            types = words[1:3] if words[0] == "list" else words[:1]
            known = [TYPES[t] for t in types]
            types = ["f8" if kind == "ascii" else ORDERS[kind] + t for t in known]
            list(elements.values())[-1].properties.append(
                Property(words[-1], types[-1], *types[:-1])
            )
    if kind not in ORDERS:
        raise ValueError(f"format {kind!r}")
    return kind, comments, elements


def _as_doubles(text: bytes, path: Path) -> bytes:
    text = text.strip()  # NumPy reads a number out of bare white space
    try:
        return np.fromstring(text, np.float64, sep=" ").tobytes() if text else b""
    except ValueError as error:
        raise DocumentError(f"{path}: its numbers cannot be read ({error})") from error


def _read_element(body: memoryview, at: int, element: Element, path: Path) -> int:
    """Fill in `element.columns` from byte `at` on; returns the byte after the element."""
    lists = [p for p in element.properties if p.length is not None]
    try:
        lengths = _walk(body, at, element, rows=min(element.count, 1))[1]
        row = _row_type(element, [int(n) for n in lengths[0]] if len(lengths) else [0] * len(lists))
        end = at + element.count * row.itemsize
        table = np.frombuffer(body[at:end], row) if end <= len(body) else None

        # Take whole columns where every row is like the first, else walk from row to row
        if table is not None and all(
            len(table) == element.count and (table[f"{p.name}\nlength"] == lengths[0][i]).all()
            for i, p in enumerate(lists)
            if element.count
        ):
            for p in element.properties:
                column = table[p.name]
                element.columns[p.name] = (
                    _native(column)
                    if p.length is None
                    else Lists(np.full(len(table), row[p.name].shape[0]), _native(column).ravel())
                )
            return end
        starts, lengths, end = _walk(body, at, element, rows=element.count)
    except (struct.error, ValueError) as error:
        raise DocumentError(
            f"{path}: is cut off or damaged in its {element.count} {element.name} rows ({error})"
        ) from error
    pixels = np.frombuffer(body, np.uint8)
    for i, p in enumerate(element.properties):
        if p.length is None:
            element.columns[p.name] = _gather(pixels, starts[:, i], p.type)
        else:
            counts = lengths[:, lists.index(p)]
            within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            first = np.repeat(starts[:, i], counts)
            values = _gather(pixels, first + within * np.dtype(p.type).itemsize, p.type)
            element.columns[p.name] = Lists(counts, values)
    return end


def _row_type(element: Element, lengths: list[int]) -> np.dtype:
    remaining = iter(lengths)
    fields: list[tuple] = []
    for p in element.properties:
        if p.length is None:
            fields.append((p.name, p.type))
        else:
            fields += [(f"{p.name}\nlength", p.length), (p.name, p.type, (next(remaining),))]
    return np.dtype(fields)


def _walk(
    body: memoryview, at: int, element: Element, *, rows: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Where the values of each row start (rows, P), list lengths (rows, L), and the end."""
    plan = []
    for p in element.properties:
        length = None if p.length is None else struct.Struct(_struct_code(p.length))
        plan.append((np.dtype(p.type).itemsize, length))
    starts, lengths = [], []
    for _ in range(rows):
        for size, length in plan:
            if length is None:
                starts.append(at)
                at += size
            else:
                count = int(length.unpack_from(body, at)[0])
                if count < 0:
                    raise ValueError(f"a list of {count} items")
                at += length.size
                starts.append(at)
                lengths.append(count)
                at += count * size
        if at > len(body):
            raise ValueError(f"the file ends {at - len(body)} bytes too early")
    shape = (rows, len(plan)), (rows, sum(length is not None for _, length in plan))
    return (
        np.array(starts, np.int64).reshape(shape[0]),
        np.array(lengths, np.int64).reshape(shape[1]),
        at,
    )


def _struct_code(type_: str) -> str:
    code = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
    order = type_[0] if type_[0] in "<>" else "="
    return order + code[type_[-2:]]


def _gather(data: np.ndarray, starts: np.ndarray, type_: str) -> np.ndarray:
    size = np.dtype(type_).itemsize
    return _native(data[starts[:, None] + np.arange(size)].reshape(-1).view(type_))


def _native(column: np.ndarray) -> np.ndarray:
    """A contiguous copy in the machine's byte order: nothing keeps the file's bytes alive."""
    copy = room(column.shape, column.dtype.newbyteorder("="))
    copy[...] = column
    return copy
