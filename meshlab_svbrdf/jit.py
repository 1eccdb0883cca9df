"""How the kernels are compiled: once, to be kept; without the interpreter's lock; dividing as NumPy
does, by zero too; and not to be called from C, which would be a second wrapper for each.

kernel   decorates one
inner    decorates one that only others call: it has no wrapper for Python either
"""

from typing import Any

from numba import njit
from numba.core.registry import CPUDispatcher


def kernel(function: Any = None, /, **options: Any) -> Any:
    """Decorates a kernel, with further options of numba's or without."""
    own: dict[str, Any] = {
        "cache": True,
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
    }
    return njit(function, **own, **options)


def inner(function: Any = None, /, **options: Any) -> Any:
    """Decorates a kernel that only other kernels call; that takes less to compile."""
    if function is None:
        return lambda given: inner(given, **options)
    made = kernel(**options, no_cpython_wrapper=True)(function)
    if isinstance(made, CPUDispatcher):  # else numba is switched off
        made.__class__ = _Inner
    return made


class _Inner(CPUDispatcher):
    """A kernel whose call from Python is an error, for numba would call what is not there."""

    def __call__(self, *arguments: Any) -> Any:
        raise TypeError(f"{self.py_func.__name__} is called by kernels only: decorate it by kernel")
