"""Spherical harmonics against scipy, quadrature, rotations and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.spatial.transform import Rotation
from scipy.special import roots_legendre, sph_harm_y

from meshlab_svbrdf.geometry.harmonics import (
    COEFFICIENTS,
    basis,
    evaluate,
    evaluate_all,
    scale_coefficients,
)


def sphere(n, seed=0):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


POLES = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0, 1, 0], [-1, 0, 0.0]])


def quadrature():
    """Exact to degree 15: Gauss-Legendre in z, even steps in azimuth."""
    z, weight = roots_legendre(8)
    phi = np.arange(16) * np.pi / 8
    z, phi = (a.ravel() for a in np.meshgrid(z, phi, indexing="ij"))
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(phi), r * np.sin(phi), z]), np.repeat(weight, 16) * np.pi / 8


@njit
def evaluate_each(k, directions, out):
    for i in range(len(directions)):
        out[i] = evaluate(k, directions[i, 0], directions[i, 1], directions[i, 2])


def test_agrees_with_scipy():
    d = np.vstack([sphere(200), POLES])
    theta, phi = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    ours = basis(d)
    for l in range(6):
        for m in range(l + 1):
            y = sph_harm_y(l, m, theta, phi) * (np.sqrt(2) * (-1) ** m if m else 1)
            np.testing.assert_allclose(ours[:, l * (l + 1) + m], y.real, atol=1e-12)
            if m:
                np.testing.assert_allclose(ours[:, l * (l + 1) - m], y.imag, atol=1e-12)


def test_orthonormal():
    d, weight = quadrature()
    y = basis(d)
    np.testing.assert_allclose(y.T @ (weight[:, None] * y), np.eye(COEFFICIENTS), atol=1e-13)


def test_first_band_is_the_direction():
    d = sphere(50)
    np.testing.assert_allclose(
        basis(d)[:, 1:4], np.sqrt(3 / (4 * np.pi)) * d[:, [1, 2, 0]], atol=1e-15
    )


def test_a_rotation_keeps_each_band_and_its_energy():
    d, weight = quadrature()
    k = np.random.default_rng(1).normal(size=COEFFICIENTS)
    rotation = Rotation.random(rng=np.random.default_rng(2)).as_matrix()
    turned = basis(d).T @ (weight * (basis(d @ rotation.T) @ k))
    for l in range(6):
        band = slice(l * l, (l + 1) ** 2)
        np.testing.assert_allclose(np.sum(turned[band] ** 2), np.sum(k[band] ** 2), rtol=1e-12)


def test_addition_theorem_at_the_poles():
    energy = basis(POLES) ** 2
    for l in range(6):
        np.testing.assert_allclose(
            energy[:, l * l : (l + 1) ** 2].sum(1), (2 * l + 1) / (4 * np.pi), rtol=1e-14
        )
    assert np.all(basis(POLES[:2])[:, 1] == 0)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_kernel_agrees_with_numpy(seed):
    d = np.vstack([sphere(20, seed), POLES])
    k = np.random.default_rng(seed).normal(size=COEFFICIENTS).astype(np.float32)
    values = np.empty(len(d))
    evaluate_each(k, d, values)
    np.testing.assert_allclose(values, basis(d) @ k, atol=1e-13 * np.abs(k).sum())


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_kernel_of_rows_agrees_to_single_precision(seed):
    d = np.vstack([sphere(21, seed), POLES]).astype(np.float32)
    k = np.random.default_rng(seed).normal(size=COEFFICIENTS).astype(np.float32)
    scaled, values = np.empty(COEFFICIENTS, np.float32), np.empty(len(d), np.float32)
    scale_coefficients(k, scaled)
    evaluate_all(scaled, *np.ascontiguousarray(d.T), values)
    np.testing.assert_allclose(values, basis(d) @ k, atol=3e-6 * np.abs(k).sum())


def test_the_kernel_takes_float32_directions():
    d = sphere(100).astype(np.float32)
    k = np.random.default_rng(3).normal(size=COEFFICIENTS).astype(np.float32)
    values = np.empty(len(d))
    evaluate_each(k, d, values)
    np.testing.assert_allclose(values, basis(d) @ k, atol=1e-5)


@pytest.mark.parametrize("bands", range(7))
def test_fewer_bands_are_the_first_columns(bands):
    d = sphere(10)
    np.testing.assert_array_equal(basis(d, bands), basis(d)[:, : bands**2])


@pytest.mark.parametrize("bands", [-1, 7])
def test_other_bands_are_refused(bands):
    with pytest.raises(ValueError, match="0 to 6"):
        basis(POLES, bands)
