"""Lamps of known size: what they widen is taken off again, and no more than is there."""

import numpy as np
import pytest
from analytic import unit

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.reflectance.lamp_size import under_points


@pytest.mark.parametrize("alpha", [5.0, 60.0, 300.0])
@pytest.mark.parametrize("radius", [0.0, 0.5, 2.5])
def test_undoes_what_a_disk_does_to_a_lobe(alpha, radius):
    variance = np.radians(radius) ** 2 / 4
    seen = 1 / (1 / alpha + variance)
    assert under_points(0.8 * seen / alpha, seen, radius) == pytest.approx((0.8, alpha))


def test_a_disk_widens_a_lobe_as_the_formula_says():
    """Averaged over the points of a disk: top and width of a lobe of α = 200 under 3 degrees."""
    rng, a, alpha = np.random.default_rng(0), np.radians(3.0), 200.0
    offset = a * np.sqrt(rng.random(20000)) * np.exp(2j * np.pi * rng.random(20000))
    lamp = unit(np.column_stack([offset.real, offset.imag, np.ones(20000)]))
    away = np.linspace(0, 0.15, 30)
    mirror = np.column_stack([np.sin(away), 0 * away, np.cos(away)])
    seen = (np.maximum(mirror @ lamp.T, 0) ** alpha).mean(1)
    slope, top = np.polyfit(np.log(np.cos(away)), np.log(seen), 1)
    rho_s, found = under_points(np.exp(top), slope, 3.0)
    assert rho_s == pytest.approx(1, rel=0.02)
    assert found == pytest.approx(alpha, rel=0.02)


def test_what_is_unobserved_stays_so():
    assert np.isnan(under_points(np.nan, np.nan, 2.0)).all()


def test_lamps_larger_than_their_highlights_are_refused():
    with pytest.raises(SvbrdfError, match=r"lamp_radius: lamps of 10° .* smaller than 8\.1°"):
        under_points(0.5, 200.0, 10.0)
