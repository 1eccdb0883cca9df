"""The materials at one moment of a session, small enough to keep every one."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from ..reflectance.material_edits import Edit
from ..script import Step


@dataclass(frozen=True)
class State:
    """The materials at one moment.

    words : what led here; packed : the labels, compressed; names : by id
    start : the filter that made them, a step of a script; none where that is not known
    edits : since that start
    """

    words: str
    packed: bytes
    names: dict[int, str]
    start: tuple[Step, ...]
    edits: tuple[Edit, ...]


def pack(labels: np.ndarray) -> bytes:
    """Labels (T,) int32 in tens of kilobytes: neighbours in memory are so on the surface."""
    return zlib.compress(np.ascontiguousarray(labels, np.int32).tobytes(), 1)


def unpack(packed: bytes) -> np.ndarray:
    """The inverse of `pack`."""
    return np.frombuffer(zlib.decompress(packed), np.int32)
