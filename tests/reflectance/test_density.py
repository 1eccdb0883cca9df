"""The bell of a material's ρs: modes that are known, and values that have no spread."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import gaussian_kde

from meshlab_svbrdf.reflectance.density import MINIMUM_TEXELS, highest_bell, silverman


def lognormal(rho, spread, count, seed=0):
    return rho * np.exp(spread * np.random.default_rng(seed).normal(size=count))


def test_bandwidth_is_silvermans():
    values = np.random.default_rng(0).normal(3, 2, 500)
    iqr = np.subtract(*np.percentile(values, [75, 25]))
    assert silverman(values) == pytest.approx(0.9 * min(values.std(), iqr / 1.34) * 500**-0.2)


def test_bandwidth_without_quartiles_is_sigmas_alone():
    values = np.array([1.0] * 90 + [5.0] * 10)
    assert silverman(values) == pytest.approx(0.9 * values.std() * 100**-0.2)


@pytest.mark.parametrize("density", ["log", "linear"])
@pytest.mark.parametrize("bell", ["median", "mean"])
def test_one_mode_is_recovered(density, bell):
    rho, alpha = lognormal(20, 0.1, 3000), lognormal(50, 0.2, 3000, 1)
    found = highest_bell(rho, alpha, density=density, bell=bell)
    assert found.rho_s == pytest.approx(20, rel=0.03)
    assert found.alpha == pytest.approx(50, rel=0.05)
    assert found.low < found.rho_s < found.high


def test_limits_are_at_half_maximum():
    """Of a normal density of ln ρs smoothed by its bandwidth: ±1.1774 √(σ² + h²)."""
    rho = np.exp(0.3 * np.array([_normal_quantile(p) for p in (np.arange(20000) + 0.5) / 20000]))
    found = highest_bell(rho, rho)
    half = 0.3 * np.sqrt(2 * np.log(2))
    assert np.log(found.high) == pytest.approx(half, rel=0.05)
    assert np.log(found.low) == pytest.approx(-half, rel=0.05)
    assert found.texels == pytest.approx(20000 * 0.761, rel=0.05)


def _normal_quantile(p):
    from scipy.special import ndtri

    return ndtri(p)


def test_highest_mode_wins_not_the_largest_value():
    rho = np.concatenate([lognormal(10, 0.08, 1500), lognormal(60, 0.08, 500, 1)])
    alpha = np.concatenate([np.full(1500, 30.0), np.full(500, 300.0)])
    order = np.random.default_rng(2).permutation(2000)
    found = highest_bell(rho[order], alpha[order])
    assert found.rho_s == pytest.approx(10, rel=0.03)
    assert found.alpha == 30
    assert found.high < 30
    assert found.texels <= 1500


def test_density_agrees_with_scipys():
    rho = lognormal(20, 0.3, 800)
    found = highest_bell(rho, rho)
    low, high = np.quantile(np.log(rho), [0.01, 0.99])
    inner = np.log(rho)[(np.log(rho) >= low) & (np.log(rho) <= high)]
    exact = gaussian_kde(inner, silverman(inner) / inner.std(ddof=1))(np.log(found.x))
    np.testing.assert_allclose(found.density, exact, atol=0.01 * exact.max())


def test_tails_beyond_a_percent_set_no_bandwidth():
    rho = lognormal(20, 0.1, 2000)
    wild = rho.copy()
    wild[:10], wild[10:20] = 1e-6, 999
    assert highest_bell(wild, wild).rho_s == pytest.approx(highest_bell(rho, rho).rho_s, rel=0.01)
    # Nor do they where they make up two fifths of a percent on either side of a wide density
    ends = highest_bell(wild, wild, density="linear").x
    assert ends[0] > 1
    assert ends[-1] < 200


@pytest.mark.parametrize("value", [1e-3, 12.0, 999.0])
@pytest.mark.parametrize("density", ["log", "linear"])
def test_equal_values_are_their_own_bell(value, density):
    found = highest_bell(np.full(50, value), np.full(50, 70.0), density=density)
    assert found.rho_s == pytest.approx(value)
    assert found.alpha == 70
    assert found.texels == 50


@pytest.mark.parametrize("count", [0, 1, MINIMUM_TEXELS - 1, MINIMUM_TEXELS])
def test_too_few_texels_tell_nothing(count):
    rho = np.concatenate([lognormal(20, 0.1, count), [np.nan, -1.0, 0.0, np.inf]])
    alpha = np.concatenate([lognormal(20, 0.1, count), [3.0, 3.0, 3.0, 3.0]])
    found = highest_bell(rho, alpha)
    assert (found is None) == (count < MINIMUM_TEXELS)
    assert highest_bell(np.full(100, 5.0), np.full(100, np.nan)) is None


def test_what_does_not_tell_changes_nothing():
    rho, alpha = lognormal(20, 0.2, 300), lognormal(40, 0.2, 300, 1)
    more = highest_bell(np.append(rho, [np.nan] * 50), np.append(alpha, [9.0] * 50))
    plain = highest_bell(rho, alpha)
    assert (more.rho_s, more.alpha, more.texels) == (plain.rho_s, plain.alpha, plain.texels)


def test_scale_scales_and_order_does_not_matter():
    rho, alpha = lognormal(20, 0.2, 300), lognormal(40, 0.2, 300, 1)
    order = np.random.default_rng(3).permutation(300)
    plain, other = highest_bell(rho, alpha), highest_bell(7 * rho[order], alpha[order])
    assert other.rho_s == pytest.approx(7 * plain.rho_s, rel=1e-6)
    assert other.alpha == pytest.approx(plain.alpha, rel=1e-6)


@settings(max_examples=60)
@given(
    hnp.arrays(float, st.integers(MINIMUM_TEXELS, 60), elements=st.floats(1e-3, 999)),
    st.sampled_from(["log", "linear"]), st.sampled_from(["median", "mean"]),
)  # fmt: skip
def test_any_values_give_one_of_their_range(rho, density, bell):
    found = highest_bell(rho, rho, density=density, bell=bell)
    assert rho.min() * (1 - 1e-9) <= found.rho_s <= rho.max() * (1 + 1e-9)
    assert 1 <= found.texels <= len(rho)
