"""Powers in single precision, without branches: compilers make vector instructions of them."""

from __future__ import annotations

import numpy as np

from .jit import kernel

FAST = {"nsz", "arcp", "contract", "reassoc"}
"""Sums may be taken in lanes; what is not a number stays so."""
LANES = FAST | {"nnan"}
"""Extremes too, of what is a number."""
_ROOT_HALF = np.int32(0x3F3504F3)
_LN = np.array(
    [7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1,
     -1.6668057665e-1, 2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1],
    np.float32,
)  # fmt: skip
_EXP2 = np.array(
    [1.535336188319500e-4, 1.339887440266574e-3, 9.618437357674640e-3, 5.550332471162809e-2,
     2.402264791363012e-1, 6.931472028550421e-1],
    np.float32,
)  # fmt: skip


@kernel(fastmath=FAST)
def ln(x):
    """Natural logarithm of x > 0, float32, to 2e-7 of itself (Cephes' polynomial)."""
    # Part the number into 2^e (1 + f), √½ ≤ 1 + f < √2
    bits = np.float32(x).view(np.int32)
    e = (bits - _ROOT_HALF) >> np.int32(23)
    f = np.int32(bits - (e << np.int32(23))).view(np.float32) - np.float32(1)
    p = np.float32(0)
    for k in range(9):
        p = p * f + _LN[k]
    return f + f * f * (f * p - np.float32(0.5)) + np.float32(e) * np.float32(0.6931471806)


@kernel(fastmath=FAST)
def exp(x):
    """e^x, float32, to 1e-7 (1 + |x|) of itself (Cephes' polynomial); never less than 1e-38."""
    x = max(np.float32(x) * np.float32(1.4426950409), np.float32(-126))
    whole = np.floor(x + np.float32(0.5))
    rest, p = x - whole, np.float32(0)
    for k in range(6):
        p = p * rest + _EXP2[k]
    scale = np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)
    return (p * rest + np.float32(1)) * scale
