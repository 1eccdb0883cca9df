"""How far a film is blurred is found where it clearly shows, and pixels' own blur is the least."""

import numpy as np
import pytest

from meshlab_svbrdf.reflectance.blur_fit import TIMES, fit_blur


@pytest.mark.parametrize("truth", [1.3, 2.0, 3.7, 6.0])
def test_finds_the_least_between_what_it_tries(truth):
    found = fit_blur(lambda times: 100 + 30 * np.log(times / truth) ** 2)
    assert found == pytest.approx(truth, rel=1e-6)


@pytest.mark.parametrize(
    "rest",
    [
        lambda times: 100 + times,  # less blur than pixels have would be better still
        lambda times: 100.0,
        lambda times: 0.0,
        lambda times: 100 - 1e-3 * times,  # better, but by nothing to speak of
    ],
)
def test_else_it_is_that_of_pixels(rest):
    assert fit_blur(rest) == 1.0


def test_there_is_a_most():
    assert fit_blur(lambda times: 100 / times) == TIMES[-1]


def test_tries_no_more_than_it_needs():
    tried = []
    fit_blur(lambda times: tried.append(times) or 100 + times)
    assert tried == list(TIMES[:2])
