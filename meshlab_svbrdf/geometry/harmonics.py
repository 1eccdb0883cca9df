"""Real spherical harmonics of six bands: the basis of visibility (Palma et al. 2012, §3.1).

Convention: pole along +z, azimuth from +x towards +y, coefficient l(l + 1) + m, and no
Condon-Shortley phase, so that band 1 is √(3/4π)·(y, z, x). In terms of the complex harmonics Y of
`scipy.special.sph_harm_y(l, m, theta, phi)` (theta the polar angle; with the phase), for m > 0:

    Y_l0 = Y(l, 0),   Y_lm = √2 (−1)^m Re Y(l, m),   Y_l,−m = √2 (−1)^m Im Y(l, m)

Every harmonic is a polynomial: Y_l,±m = P_lm(z) · {C_m, S_m}(x, y), C_m + i S_m = (x + i y)^m.
"""

from __future__ import annotations

from math import factorial, pi, sqrt

import numpy as np

from ..jit import kernel

BANDS = 6
COEFFICIENTS = BANDS**2


def _norm(l: int, m: int) -> float:
    ratio = factorial(l - m) / factorial(l + m) * (2 if m else 1)
    return sqrt((2 * l + 1) / (4 * pi) * ratio)


(
    N00, N10, N11, N20, N21, N22, N30, N31, N32, N33, N40, N41, N42, N43, N44,
    N50, N51, N52, N53, N54, N55,
) = (_norm(l, m) for l in range(BANDS) for m in range(l + 1))  # fmt: skip


@kernel
def _legendre(z):
    """Normalised P_lm(z) / sin^m, at l(l + 1)/2 + m."""
    zz = z * z
    return (
        N00,
        N10 * z,
        N11,
        N20 * 0.5 * (3.0 * zz - 1.0),
        N21 * 3.0 * z,
        N22 * 3.0,
        N30 * 0.5 * (5.0 * zz - 3.0) * z,
        N31 * 1.5 * (5.0 * zz - 1.0),
        N32 * 15.0 * z,
        N33 * 15.0,
        N40 * 0.125 * ((35.0 * zz - 30.0) * zz + 3.0),
        N41 * 2.5 * (7.0 * zz - 3.0) * z,
        N42 * 7.5 * (7.0 * zz - 1.0),
        N43 * 105.0 * z,
        N44 * 105.0,
        N50 * 0.125 * ((63.0 * zz - 70.0) * zz + 15.0) * z,
        N51 * 1.875 * ((21.0 * zz - 14.0) * zz + 1.0),
        N52 * 52.5 * (3.0 * zz - 1.0) * z,
        N53 * 52.5 * (9.0 * zz - 1.0),
        N54 * 945.0 * z,
        N55 * 945.0,
    )


@kernel
def _azimuth(x, y):
    """C_0 … C_5 and S_0 … S_5."""
    c2 = x * x - y * y
    s2 = 2.0 * x * y
    c3 = x * c2 - y * s2
    s3 = x * s2 + y * c2
    c4 = c2 * c2 - s2 * s2
    s4 = 2.0 * c2 * s2
    c5 = x * c4 - y * s4
    s5 = x * s4 + y * c4
    return (1.0, 1.0 * x, c2, c3, c4, c5), (0.0, 1.0 * y, s2, s3, s4, s5)


def basis(directions: np.ndarray, bands: int = BANDS) -> np.ndarray:
    """All harmonics of some directions.

    Parameters
    ----------
    directions : (N, 3) unit vectors
    bands : 0 to 6; fewer bands are the first columns of more

    Returns
    -------
    (N, bands²) float64
    """
    if not 0 <= bands <= BANDS:
        raise ValueError(f"bands={bands}: expected 0 to {BANDS}")
    x, y, z = np.asarray(directions, dtype=np.float64).T
    legendre = _legendre.py_func(z)
    cosine, sine = _azimuth.py_func(x, y)
    out = np.empty((len(z), bands**2))
    for l in range(bands):
        for m in range(l + 1):
            out[:, l * (l + 1) - m] = legendre[l * (l + 1) // 2 + m] * sine[m]
            out[:, l * (l + 1) + m] = legendre[l * (l + 1) // 2 + m] * cosine[m]
    return out


@kernel
def evaluate(k, x, y, z):
    """Σ k_lm Y_lm of one unit direction; k (36,); for other kernels.

    Fewer bands: the coefficients of the others are zero.
    """
    p = _legendre(z)
    c, s = _azimuth(x, y)
    total = k[0] * p[0] + k[2] * p[1] + k[6] * p[3] + k[12] * p[6] + k[20] * p[10] + k[30] * p[15]
    total += c[1] * (k[3] * p[2] + k[7] * p[4] + k[13] * p[7] + k[21] * p[11] + k[31] * p[16])
    total += s[1] * (k[1] * p[2] + k[5] * p[4] + k[11] * p[7] + k[19] * p[11] + k[29] * p[16])
    total += c[2] * (k[8] * p[5] + k[14] * p[8] + k[22] * p[12] + k[32] * p[17])
    total += s[2] * (k[4] * p[5] + k[10] * p[8] + k[18] * p[12] + k[28] * p[17])
    total += c[3] * (k[15] * p[9] + k[23] * p[13] + k[33] * p[18])
    total += s[3] * (k[9] * p[9] + k[17] * p[13] + k[27] * p[18])
    total += c[4] * (k[24] * p[14] + k[34] * p[19])
    total += s[4] * (k[16] * p[14] + k[26] * p[19])
    return total + (k[35] * c[5] + k[25] * s[5]) * p[20]


FACTORS = np.array(
    [
        N00, N10, N11, N20 * 0.5, N21 * 3, N22 * 3, N30 * 0.5, N31 * 1.5, N32 * 15, N33 * 15,
        N40 * 0.125, N41 * 2.5, N42 * 7.5, N43 * 105, N44 * 105,
        N50 * 0.125, N51 * 1.875, N52 * 52.5, N53 * 52.5, N54 * 945, N55 * 945,
    ],
)  # fmt: skip
"""What stands before the polynomials of `_legendre`, at l(l + 1)/2 + m."""


@kernel
def scale_coefficients(k, out):
    """k_lm times the factor that stands before Y_lm, for `evaluate_all`, to out (36,)."""
    for l in range(BANDS):
        for m in range(l + 1):
            factor = FACTORS[l * (l + 1) // 2 + m]
            out[l * (l + 1) - m] = k[l * (l + 1) - m] * factor
            out[l * (l + 1) + m] = k[l * (l + 1) + m] * factor


@kernel(fastmath={"contract", "nsz"})
def evaluate_all(k, x, y, z, out):
    """`evaluate` for n directions, float32, as loops that the compiler makes vectors of.

    k : (36,) float32 from `scale_coefficients`; x, y, z, out : (n,) float32
    """
    one, three, five, seven = np.float32(1), np.float32(3), np.float32(5), np.float32(7)
    k0, k1, k2, k3, k4, k5, k6, k7, k8 = k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8]
    k9, k10, k11, k12, k13, k14, k15 = k[9], k[10], k[11], k[12], k[13], k[14], k[15]
    k16, k17, k18, k19, k20, k21, k22 = k[16], k[17], k[18], k[19], k[20], k[21], k[22]
    k23, k24, k25, k26, k27, k28, k29 = k[23], k[24], k[25], k[26], k[27], k[28], k[29]
    k30, k31, k32, k33, k34, k35 = k[30], k[31], k[32], k[33], k[34], k[35]
    for j in range(len(x)):
        a, b, c = x[j], y[j], z[j]
        q = c * c
        # Polynomials of z, one for each band and order
        p20, p30, p31 = three * q - one, (five * q - three) * c, five * q - one
        p40 = (np.float32(35) * q - np.float32(30)) * q + three
        p41, p42 = (seven * q - three) * c, seven * q - one
        p50 = ((np.float32(63) * q - np.float32(70)) * q + np.float32(15)) * c
        p51 = (np.float32(21) * q - np.float32(14)) * q + one
        p52, p53 = p20 * c, np.float32(9) * q - one
        # Order by order, with cosines and sines of the azimuth
        total = k0 + k2 * c + k6 * p20 + k12 * p30 + k20 * p40 + k30 * p50
        total += a * (k3 + k7 * c + k13 * p31 + k21 * p41 + k31 * p51)
        total += b * (k1 + k5 * c + k11 * p31 + k19 * p41 + k29 * p51)
        c2, s2 = a * a - b * b, np.float32(2) * a * b
        total += c2 * (k8 + k14 * c + k22 * p42 + k32 * p52)
        total += s2 * (k4 + k10 * c + k18 * p42 + k28 * p52)
        c3, s3 = a * c2 - b * s2, a * s2 + b * c2
        total += c3 * (k15 + k23 * c + k33 * p53) + s3 * (k9 + k17 * c + k27 * p53)
        c4, s4 = c2 * c2 - s2 * s2, np.float32(2) * c2 * s2
        total += c4 * (k24 + k34 * c) + s4 * (k16 + k26 * c)
        c5, s5 = a * c4 - b * s4, a * s4 + b * c4
        out[j] = total + c5 * k35 + s5 * k25
