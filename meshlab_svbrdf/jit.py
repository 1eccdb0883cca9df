"""How the kernels are compiled: once, to be kept; without the interpreter's lock; and dividing as
NumPy does, by zero too."""

from typing import Any

from numba import njit


def kernel(function: Any = None, /, **options: Any) -> Any:
    """Decorates a kernel, with further options of numba's or without."""
    return njit(function, cache=True, nogil=True, error_model="numpy", **options)
