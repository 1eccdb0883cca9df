"""Charts: histograms that hold every value, marks where they belong, round ticks."""

import re

import numpy as np
import pytest
from pages import parsed

from meshlab_svbrdf.rendering.colors import viridis
from meshlab_svbrdf.reporting.html import css
from meshlab_svbrdf.reporting.plots import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Series,
    chart,
    color_bar,
    histogram,
    ticks,
)


def test_a_histogram_holds_every_finite_value():
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.lognormal(size=5000), [np.nan, 1e9]])
    for log in (False, True):
        found = histogram(values, log=log)
        assert found.y.sum() == pytest.approx(100)
        assert len(found.x) == len(found.y) + 1
        assert (np.diff(found.x) > 0).all()
    steps = np.diff(np.log(found.x))
    np.testing.assert_allclose(steps, steps[0])
    assert histogram(np.array([np.nan])) is None
    assert histogram(np.array([-1.0]), log=True) is None
    one = histogram(np.full(7, 3.0))
    assert one.y.max() == 100
    k = int(np.argmax(one.y))
    assert one.x[k] <= 3 <= one.x[k + 1]


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-3, 7), (0, 12345), (0.001, 0.0042)])
def test_ticks_are_round_within_and_few(low, high):
    found = ticks(low, high)
    assert 2 <= len(found) <= 7
    assert low - 1e-12 <= min(found) <= max(found) <= high * (1 + 1e-9)
    steps = np.diff(found)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    assert float(f"{steps[0]:.0e}"[0]) in (1, 2, 5)


def test_a_line_runs_from_corner_to_corner():
    drawn = chart([Series(np.array([1.0, 3]), np.array([0, 8.0]))], "x", y_most=8)
    assert f"M{LEFT} {HEIGHT - BOTTOM}L{WIDTH - RIGHT} {TOP}" in drawn


def test_every_kind_is_drawn_and_labels_are_escaped():
    x = np.array([1, 10, 100.0])
    drawn = chart(
        [
            Series(x, x, label="<a>"), Series(x, x[:2], kind="bars"),
            Series(x, np.array([1, np.nan, 3]), kind="dots"), Series(x[:1], x[:1], kind="mark"),
        ],
        "<x>", "y & z", log_x=True,
    )  # fmt: skip
    names = [name for name, _ in parsed(drawn)]
    assert names.count("path") == 2
    assert names.count("circle") == 2
    assert "&lt;a&gt;" in drawn
    assert "&lt;x&gt;" in drawn
    assert "stroke-dasharray" in drawn
    inside = [float(v) for v in re.findall(r'c[xy]="([\d.]+)"', drawn)]
    assert min(inside) >= 0
    assert max(inside) <= WIDTH


def test_nothing_to_plot_is_said():
    nothing = np.full(3, np.nan)
    assert "nothing to plot" in chart([Series(nothing, nothing)], "x")


@pytest.mark.parametrize("log", [False, True])
def test_a_scale_has_its_values_where_its_colours_are(log):
    """A tick of what is halfway, by the values or by their logarithms, stands in the middle."""
    low, high, half = (1.0, 100.0, 10) if log else (0.0, 20.0, 10)
    colors = viridis(np.linspace(0, 1, 64))
    drawn = color_bar(colors, low, high, log, "<x>")
    bars = [given for name, given in parsed(drawn) if name == "rect"]
    assert [given["fill"] for given in bars] == [css(color) for color in colors]
    assert float(bars[0]["x"]) == LEFT
    assert float(bars[-1]["x"]) + float(bars[-1]["width"]) == pytest.approx(WIDTH - RIGHT, abs=0.6)
    middle = LEFT + (WIDTH - LEFT - RIGHT) / 2
    assert f'x="{middle:g}" y="28" text-anchor="middle">{half}<' in drawn
    assert "&lt;x&gt;" in drawn
