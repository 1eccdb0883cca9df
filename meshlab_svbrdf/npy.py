"""Writing NPY files so that a full disk is noticed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.lib import format as npy


def write_npy(path: str | Path, array: np.ndarray) -> None:
    """Write an array of numbers; OSError where the disk has no room for all of it.

    `numpy.save` and `tofile` write through a stream of C's that they close without asking how that
    went: the last few thousand bytes may be missing, and nobody is told.
    """
    array = np.asarray(array, order="C")
    with open(path, "wb") as stream:
        npy.write_array_header_1_0(stream, npy.header_data_from_array_1_0(array))
        stream.write(array.data)
