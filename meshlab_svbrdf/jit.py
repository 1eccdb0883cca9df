"""How the kernels are compiled: once, to be kept; without the interpreter's lock; dividing as NumPy
does, by zero too; and not to be called from C, which would be a second wrapper for each."""

from typing import Any

from numba import njit


def kernel(function: Any = None, /, **options: Any) -> Any:
    """Decorates a kernel, with further options of numba's or without."""
    own: dict[str, Any] = {
        "cache": True,
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
    }
    return njit(function, **own, **options)
