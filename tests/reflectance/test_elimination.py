"""Elimination of the diffuse terms: the least squares with one column per texel, solved exactly."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from analytic import unit
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from meshlab_svbrdf.reflectance.elimination import ALPHAS, REACH, eliminate, profile
from meshlab_svbrdf.reflectance.fit_samples import FitSamples

CELL = np.log(2) / 3  # of the grid, in ln α


class Case:
    """Texels whose mirror directions pass near two lights at many distances; y is the model's."""

    def __init__(self, rho=30.0, alpha=50.0, texels=40, counts=25, noise=0.0, seed=0, blur=0.0):
        rng = np.random.default_rng(seed)
        counts = np.full(texels, counts) if np.isscalar(counts) else np.asarray(counts)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        owner, n = np.repeat(np.arange(texels), counts), int(offsets[-1])
        lights = unit([[0, 0, 1], [0.9, 0, 0.4]])
        self.rays = unit(lights + 0.05 * rng.normal(size=(texels, 2, 3))).astype(np.float32)
        self.gains = rng.uniform(0.5, 1.5, (texels, 2)).astype(np.float32)
        spread = rng.exponential(2 / np.sqrt(alpha), (n, 1)) * rng.choice([0.3, 1, 3], (n, 1))
        away = lights[rng.integers(0, 2, n)] + spread * unit(rng.normal(size=(n, 3)))
        mirror = unit(away).astype(np.float32)
        self.cos = np.einsum("nkc,nc->nk", self.rays[owner].astype(float), mirror.astype(float))
        self.owner, self.texels = owner, texels
        self.material = rng.integers(0, 2, texels).astype(np.int32)
        self.weight = rng.uniform(0.2, 1, n).astype(np.float32)
        # Pixels spread each sample's mirror direction by s1 along some axis, by s2 across it
        self.s1, self.s2 = rng.uniform(0, 2 * blur, (2, n)) / alpha
        axis = unit(np.cross(mirror, rng.normal(size=(n, 3))))
        self.blur = np.column_stack([np.sqrt(self.s1)[:, None] * axis, self.s2]).astype(np.float32)
        along = np.einsum("nkc,nc->nk", self.rays[owner].astype(float), axis) ** 2
        self.along = along / (1 - np.minimum(self.cos**2, 1 - 1e-12))
        diffuse = rng.uniform(0, 60, texels)
        y = diffuse[owner] + rho * self.phi(alpha) + noise * rng.normal(size=n)
        self.samples = FitSamples(
            np.arange(texels), self.material, offsets, y.astype(np.float32),
            np.zeros((n, 3), np.float32), np.ones(n, np.float32), np.zeros(n, bool), mirror,
            self.blur,
        )  # fmt: skip

    def phi(self, alpha):
        cos = np.clip(self.cos, 0, 1)
        h1, h2 = (1 / (1 + alpha * s)[:, None] for s in (self.s1, self.s2))
        lobe = cos ** (alpha * (h1 * self.along + h2 * (1 - self.along))) * np.sqrt(h1 * h2)
        lobe = np.where(self.cos > 0.01, lobe, 0)
        return (self.gains[self.owner] * lobe).sum(1)

    def sums(self, samples=None, weight=None, pieces=1, near=None):
        samples = samples or self.samples
        edges = np.linspace(0, self.texels, pieces + 1).astype(int)
        return eliminate(
            samples, self.weight if weight is None else weight, self.rays, self.gains, 2,
            lambda work: [work(a, b) for a, b in itertools.pairwise(edges)],
            near,
        )  # fmt: skip

    def with_luminance(self, y):
        return replace(self.samples, luminance=np.asarray(y, np.float32))


@pytest.mark.parametrize("index", [0, 3, 12, 20, 33])
def test_is_least_squares_with_a_column_per_texel(index):
    case = Case(noise=1.0)
    sums = case.sums()
    y, root = case.samples.luminance.astype(float), np.sqrt(case.weight.astype(float))
    for m in (0, 1):
        own = case.material[case.owner] == m
        texel = np.unique(case.owner[own], return_inverse=True)[1]
        columns = np.column_stack([np.eye(texel.max() + 1)[texel], case.phi(ALPHAS[index])[own]])
        a, b = root[own, None] * columns, root[own] * y[own]
        solution, rss, *_ = np.linalg.lstsq(a, b)
        n, q, t = sums[m, :, index]
        assert n / q == pytest.approx(solution[-1], rel=1e-4, abs=1e-6)
        assert t - n * n / q == pytest.approx(rss[0], rel=1e-5)


@pytest.mark.parametrize("alpha", [1.5, 4.0, 11.0, 12.0, 64.0, 150.0, 500.0, 1300.0])
@pytest.mark.parametrize("rho", [0.5, 30.0, 900.0])
def test_recovers_the_lobe_without_noise(rho, alpha):
    """Within a tenth of a cell of the grid in ln α, on it and off it, and .03 in ln ρ."""
    for sums in Case(rho, alpha).sums():
        found = profile(sums)
        assert not found.at_end
        assert abs(np.log(found.alpha / alpha)) < 0.15 * CELL
        assert abs(np.log(found.rho_s / rho)) < 0.05


@pytest.mark.parametrize("alpha", [1.0, 2048.0])
def test_a_lobe_at_an_end_of_the_grid_says_so(alpha):
    for sums in Case(alpha=alpha).sums():
        assert profile(sums).at_end


@pytest.mark.parametrize("offset", [0, 1, 2**10])
def test_adding_any_diffuse_term_changes_nothing(offset):
    """With luminances that float32 holds exactly, to the last bit."""
    case = Case()
    y = np.rint(case.samples.luminance * 256) / 256
    terms = np.random.default_rng(1).integers(-offset, offset + 1, case.texels)
    a, b = case.sums(case.with_luminance(y)), case.sums(case.with_luminance(y + terms[case.owner]))
    np.testing.assert_array_equal(a, b)


def test_offsets_of_ten_million_cost_nothing():
    """Raw float32 sums would lose all: 1e7 squared, times a thousand samples."""
    case = Case(rho=1000.0)
    y = np.rint(case.samples.luminance)
    a, b = case.sums(case.with_luminance(y)), case.sums(case.with_luminance(y + 1e7))
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_brightness_scales_rho_and_leaves_alpha(scale):
    case = Case(noise=0.5)
    for a, b in zip(
        case.sums(), case.sums(case.with_luminance(case.samples.luminance * scale)), strict=True
    ):
        assert profile(b).rho_s == pytest.approx(scale * profile(a).rho_s, rel=1e-4)
        assert profile(b).alpha == pytest.approx(profile(a).alpha, rel=1e-4)


def test_samples_without_weight_are_not_there():
    case = Case()
    rng = np.random.default_rng(2)
    out = rng.random(len(case.samples)) < 0.3
    out[case.samples.offsets[:-1]] = True  # the first of each texel: the origin of its sums
    wild = np.where(out, 1e4 * rng.normal(size=len(out)), case.samples.luminance)
    weight = np.where(out, 0, case.weight).astype(np.float32)
    for sums in case.sums(case.with_luminance(wild), weight):
        found = profile(sums)
        assert found.rho_s == pytest.approx(30, rel=0.05)
        assert found.alpha == pytest.approx(50, rel=0.05)


def test_one_sample_tells_nothing_of_a_texel():
    case = Case(counts=1)
    assert np.abs(case.sums()).max() < 1e-9


def test_texels_without_samples_are_not_there():
    """Also at the end, where there is nothing to read."""
    counts = np.where(np.arange(40) % 3, 25, 0)
    counts[-1] = 0
    case = Case(counts=counts)
    for sums in case.sums():
        assert profile(sums).alpha == pytest.approx(50, rel=0.05)
    assert not Case(counts=0).sums().any()


def test_pieces_do_not_matter():
    case = Case(noise=1.0)
    np.testing.assert_allclose(case.sums(pieces=7), case.sums(), rtol=1e-12)


def test_lights_that_do_not_shine_do_not_count():
    case = Case()
    dark = case.gains.copy()
    dark[:, 1] = 0
    case.gains, case.rays = dark, case.rays.copy()
    y = np.random.default_rng(0).uniform(0, 60, 40)[case.owner] + 30 * case.phi(50.0)
    a = case.sums(case.with_luminance(y))
    case.rays[:, 1] = np.nan
    np.testing.assert_array_equal(case.sums(case.with_luminance(y)), a)
    assert profile(a[0]).alpha == pytest.approx(50, rel=0.05)


# Lobes that pixels blur, and shininesses that are already about known


@pytest.mark.parametrize("rho", [30.0, 900.0])
def test_recovers_blurred_lobes(rho):
    """Pixels widen every sample's lobe by another share, of half its own width on average."""
    case = Case(rho, blur=0.5)
    for sums in case.sums():
        found = profile(sums)
        assert abs(np.log(found.alpha / 50)) < 0.15 * CELL
        assert abs(np.log(found.rho_s / rho)) < 0.05
    sharp = replace(case.samples, blur=np.zeros_like(case.blur))
    for sums in case.sums(sharp):
        assert profile(sums).alpha < 42


def test_about_a_shininess_only_its_neighbours_are_tried():
    case = Case(noise=1.0, blur=0.2)
    everything, nearest = case.sums(), int(np.argmin(np.abs(np.log(ALPHAS / 45))))
    some = case.sums(near=np.array([45.0, 1.0]))
    inside = slice(nearest - REACH, nearest + REACH + 1)
    np.testing.assert_array_equal(some[0, :, inside], everything[0, :, inside])
    np.testing.assert_array_equal(some[:, 2], everything[:, 2])
    assert not some[0, :2, : nearest - REACH].any()
    assert not some[0, :2, nearest + REACH + 1 :].any()
    # A shininess of 1 is that of materials that have shown none yet
    np.testing.assert_array_equal(some[1], everything[1])
    assert profile(some[0]).alpha == profile(everything[0]).alpha
    assert profile(some[0]).rho_s == profile(everything[0]).rho_s


# The profile


def test_samples_that_darken_towards_the_light_have_no_gloss():
    """ρ = N/Q < 0 is no lobe: 0, not a small number."""
    for sums in Case(rho=-5.0).sums():
        assert profile(sums).rho_s == 0


def test_no_evidence_at_all_is_an_end_of_the_range():
    found = profile(np.zeros((3, len(ALPHAS))))
    assert found.rho_s == 0
    assert found.at_end
    np.testing.assert_array_equal(found.rss, 0)


def test_flat_parabola_does_not_divide_by_nothing():
    """Of equal least residuals α is between the first two; with all equal it is not determined."""
    n, q = np.zeros((2, len(ALPHAS)))
    q[:], n[9:12] = 1.0, 2.0
    found = profile(np.array([n, q, np.full(len(ALPHAS), 9.0)]))
    assert found.alpha == pytest.approx(np.sqrt(ALPHAS[9] * ALPHAS[10]))
    assert profile(np.array([n * 0 + 1, q, q * 9])).at_end


@given(hnp.arrays(float, (3, len(ALPHAS)), elements=st.floats(-1e6, 1e6)))
def test_any_sums_give_a_profile_without_warning(sums):
    sums[2] = np.abs(sums[2, 0])
    found = profile(sums)
    assert found.rho_s >= 0
    assert ALPHAS[0] <= found.alpha <= ALPHAS[-1]
    assert found.rss.min() == pytest.approx(min(found.rss))
