"""Small stored values, JSON and NPY: what is damaged is named, not a traceback.

read_json    the content of a JSON file
read_array   an array of an NPY file
write_array  the inverse
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from ..errors import DocumentError
from ..npy import write_npy
from .atomic import named


def read_json(path: Path) -> Any:
    """The content of a JSON file; `DocumentError` where it is missing, damaged or no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{path}: is no JSON ({error})") from None


MAPPED = 1 << 20  # bytes of a file
REPLACEABLE = os.name == "posix"  # whether a file that is mapped may be replaced or taken away


def read_array(path: Path, *, mmap: bool = False) -> np.ndarray:
    """An array of numbers, which may be written into, or (`mmap`) read only.

    A large one stays in its file: pages come when they are read, and go when memory is wanted. What
    is written into is copied, and the file is not touched: numba would compile its kernels anew for
    arrays that are read only.

    Raises DocumentError where the file is missing, cut off or no NPY file.
    """
    try:
        if mmap:
            return np.load(path, mmap_mode="r", allow_pickle=False)
        large = REPLACEABLE and path.stat().st_size >= MAPPED
        return np.asarray(np.load(path, mmap_mode="c" if large else None, allow_pickle=False))
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror or error})") from None
    except MemoryError as error:
        raise DocumentError(f"{path}: holds more than memory does ({error})") from None
    except (ValueError, SyntaxError, TypeError, KeyError, TokenError, OverflowError, EOFError) as e:
        raise DocumentError(
            f"{path}: is cut off or damaged ({str(e).splitlines()[0]}): run the filter that makes "
            "it again"
        ) from None


def write_array(path: Path, values: np.ndarray) -> None:
    """Write an NPY file; `DocumentError` where the disk is full.

    An old one is replaced, never written into: somebody may have it mapped.
    """
    with named(path):
        path.unlink(missing_ok=True)
        write_npy(path, values)
