"""What a surface mirrors of its surroundings, rendered."""

import numpy as np
from analytic import look_at, plane, unit

from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance


def look(sheen=None, normal=None):
    none = np.full((8, 8), np.nan)
    white = np.ones((8, 8, 3))
    harmonics = np.random.default_rng(0).normal(size=36) * 0.3
    shaped = None if normal is None else np.broadcast_to(np.subtract(normal, [0, 0, 1]), (8, 8, 3))
    return Appearance(0.2 * white, none, none, white, shaped, sheen=sheen, harmonics=harmonics)


def middle(appearance, camera):
    image, coverage = AcquisitionRenderer(plane(), [appearance], []).render(camera, 1)
    row, col = round(camera.cy), round(camera.cx)
    assert coverage[row, col] == 1
    return image[row, col]


def test_sheen_multiplies_the_colour():
    eye = np.array([0.8, 0.3, 3.0])
    camera = look_at(eye, width=41, height=31, fx=60)
    for normal in ([0.0, 0, 1], unit([0.2, -0.1, 1])):
        n, v = np.array(normal), unit(eye)
        r = 2 * (n @ v) * n - v
        expected = 0.2 * np.exp(0.7 * basis(r[None])[0] @ look().harmonics)
        got = middle(look(np.full((8, 8), 0.7), n), camera)
        np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_without_sheen_the_colour_stays():
    camera = look_at([0.8, 0.3, 3.0], width=41, height=31, fx=60)
    for sheen in (None, np.full((8, 8), np.nan)):
        np.testing.assert_allclose(middle(look(sheen), camera), 0.2, rtol=1e-6)
