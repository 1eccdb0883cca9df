"""Lobes of whole texels: NumPy's powers in double precision, blurred as `pixel_blur` says."""

import numpy as np
import pytest
from analytic import unit
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from meshlab_svbrdf.power import exp, ln
from meshlab_svbrdf.reflectance.lobes import LEAST, NOTHING, add_blurred, add_sharp
from meshlab_svbrdf.reflectance.pixel_blur import along_and_across, blurred_lobe

N, RAYS, GAINS = 200, unit([[0, 0, 1], [0.8, 0.1, 0.6], [0, 1, 0]]), np.array([1.0, 0.3, 0.0])


@njit
def each(function, x):
    out = np.empty(len(x), np.float32)
    for i in range(len(x)):
        out[i] = function(x[i])
    return out


def test_logarithms_are_exact_to_their_last_bits():
    x = np.concatenate([np.geomspace(1.2e-38, 1e38, 9999), 1 + np.linspace(-1e-3, 1e-3, 999)])
    x = x.astype(np.float32)
    np.testing.assert_allclose(each(ln, x), np.log(x.astype(float)), rtol=3e-7)
    assert each(ln, np.float32([1.0]))[0] == 0


def test_exponentials_are_exact_to_the_last_bits_of_what_they_are_of():
    x = np.linspace(-87, 87, 9999).astype(np.float32)
    exact = np.exp(x.astype(float))
    assert (np.abs(each(exp, x) / exact - 1) < 1.2e-7 * (2 + np.abs(x))).all()
    assert each(exp, np.float32([0.0]))[0] == 1
    assert 0 < each(exp, np.float32([-1e30]))[0] < 2e-38


def directions(alpha, seed=0):
    """Mirror directions at all distances from the lamps, (N, 3) float32."""
    rng = np.random.default_rng(seed)
    spread = rng.exponential(3 / np.sqrt(alpha), (N, 1))
    away = RAYS[rng.integers(0, 3, N)] + spread * unit(rng.normal(size=(N, 3)))
    return unit(away).astype(np.float32)


@pytest.mark.parametrize("alpha", [1.0, 12.0, 300.0, 2000.0])
def test_sharp_lobes_are_powers_of_cosines(alpha):
    mirror, out = directions(alpha), np.full(N, 5, np.float32)
    rays, gains = RAYS.astype(np.float32), GAINS.astype(np.float32)
    rays[2] = np.nan  # a lamp that does not shine does not count
    add_sharp(*mirror.T.copy(), rays, gains, alpha, 2.0, out)
    cos = np.maximum(mirror.astype(float) @ RAYS.T, 0)
    np.testing.assert_allclose(out, 5 + 2 * cos**alpha @ GAINS, atol=4e-6 + 3e-7 * alpha)


@given(st.integers(0, 999), st.floats(1, 2000), st.floats(0, 3))
def test_blurred_lobes_are_those_of_one_sample(seed, alpha, blur):
    """To float32, and to what is left of a lobe where it ends."""
    mirror, rng = directions(alpha, seed), np.random.default_rng(seed)
    s1 = blur / alpha * rng.random((N, 1))
    axis = np.sqrt(s1) * unit(np.cross(mirror, rng.normal(size=(N, 3))))
    spread = np.column_stack([axis, s1 * rng.random((N, 1))]).astype(np.float32)
    rays, gains = RAYS.astype(np.float32), GAINS.astype(np.float32)
    out, expected = np.zeros(N, np.float32), np.zeros(N)
    add_blurred(mirror, spread, 0, N, rays, gains, alpha, np.empty((13, N), np.float32), out)
    for j in range(N):
        bx, by, bz, s2 = spread[j].astype(float)
        wide = bx * bx + by * by + bz * bz
        for ray, gain in zip(RAYS, GAINS, strict=True):
            cos = float(ray @ mirror[j])
            if cos > LEAST:
                u1, u2 = along_and_across(cos, bx, by, bz, ray, wide)
                expected[j] += gain * blurred_lobe(alpha, u1, u2, wide, s2)
    np.testing.assert_allclose(out, expected, atol=2 * np.exp(-NOTHING) + 5e-7 * alpha + 3e-4)
