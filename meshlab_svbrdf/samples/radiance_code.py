"""Radiance in 16 bits: a float without sign, 6 bits of exponent and 10 of fraction.

Frames of more than 8 bits are stored as such codes. From 2⁻⁴⁰ to 2²⁴ the code nearest to a value is
within 1/2048 (.05 %) of it; what is darker is 0. Kernels work in units of `LARGEST`, so that linear
values lie in 0..1, as those of sRGB codes do.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel

LARGEST = 2.0**24
"""Radiance that no code reaches; 1 is what a frame's own white means."""
_DROPPED = 13  # of a float32's 23 bits of fraction
_FIRST = (127 - 64) << 10  # a float32's bits above those dropped, of 2⁻⁶⁴
_LAST = (1 << 16) - 1


@kernel
def code_of(linear):
    """The code of a float32 ≥ 0 in units of LARGEST."""
    bits = np.int64(np.float32(linear).view(np.uint32))
    code = ((bits + (1 << (_DROPPED - 1))) >> _DROPPED) - _FIRST
    return np.uint16(min(max(code, np.int64(0)), np.int64(_LAST)))


def table() -> np.ndarray:
    """Codes to linear values in units of LARGEST, (65536,) float32; exact inverse of `code_of`."""
    bits = (np.arange(_LAST + 1, dtype=np.uint32) + np.uint32(_FIRST)) << np.uint32(_DROPPED)
    linear = bits.view(np.float32)
    linear[0] = 0
    return linear


def encode_radiance(radiance: np.ndarray) -> np.ndarray:
    """Codes uint16 of radiances ≥ 0 of any shape; LARGEST and more become the largest code."""
    linear = np.asarray(radiance, np.float32) * np.float32(1 / LARGEST)
    bits = np.ascontiguousarray(linear).view(np.int32)
    codes = ((bits + (1 << (_DROPPED - 1))) >> _DROPPED) - _FIRST
    return np.clip(codes, 0, _LAST).astype(np.uint16)


def clipped_code(radiance: float) -> int:
    """The code from which a pixel is clipped that may be brighter than this (infinite: none is)."""
    return int(encode_radiance(np.array([radiance * (1 - 2.0**-12)]))[0])


def decode_radiance(codes: np.ndarray) -> np.ndarray:
    """Radiances float32 of codes; inverse of `encode_radiance`."""
    return table()[codes] * np.float32(LARGEST)
