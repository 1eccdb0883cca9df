"""How the kernels are compiled: once, to be kept; without the interpreter's lock; and dividing as
NumPy does, by zero too."""

from functools import partial

from numba import njit

kernel = partial(njit, cache=True, nogil=True, error_model="numpy")
