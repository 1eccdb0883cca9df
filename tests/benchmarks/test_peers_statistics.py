"""The statistics among the benchmark's peers, on samples that are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.peers.statistics import QUANTILES, statistic
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.luminance import decode
from meshlab_svbrdf.samples.observations import observe
from meshlab_svbrdf.samples.store import write_store

TEXELS, FRAMES = 40, 9


@pytest.fixture
def film(tmp_path):
    """Codes (F, T, 3), who sees whom (F, T), gains (F, 3), and the observations of it."""
    rng = np.random.default_rng(5)
    codes = rng.integers(0, 256, (FRAMES, TEXELS, 3)).astype(np.uint8)
    seen = rng.random((FRAMES, TEXELS)) < 0.6
    seen[:, 7] = False
    seen[:, 8] = np.arange(FRAMES) == 3
    gains = rng.uniform(0.5, 2, (FRAMES, 3))

    def sample(frame: int):
        texel = np.flatnonzero(seen[frame]).astype(np.int32)
        value = np.column_stack([codes[frame, texel], np.full(len(texel), 100, np.uint8)])
        return SampledFrame(texel, value)

    store = write_store(tmp_path, TEXELS, FRAMES, sample)
    zeros, index = np.zeros((TEXELS, 3), np.float32), np.arange(TEXELS, dtype=np.int32)
    texels = Texels(
        zeros, zeros, 0 * index, zeros, index.astype(np.uint8), index, index, np.zeros(3), 1.0,
        ((TEXELS, TEXELS),),
    )  # fmt: skip
    cameras = [Camera(8, 8, 8.0, 8.0, 4.0, 4.0, np.eye(3), np.zeros(3))] * FRAMES
    observations = observe(texels, store, cameras, np.zeros((1, 3), np.int32), gains=gains)
    return codes, seen, gains, observations


@pytest.mark.parametrize("name", list(QUANTILES))
def test_statistics_are_those_of_the_samples_in_linear_light(film, name):
    codes, seen, gains, observations = film
    linear = 100 * decode(codes / 255) / gains[:, None]
    expected = np.full((TEXELS, 3), np.nan)
    for texel in range(TEXELS):
        values = linear[seen[:, texel], texel]
        if len(values):
            level = QUANTILES[name]
            expected[texel] = values.mean(0) if level < 0 else np.quantile(values, level, axis=0)
    found = statistic(observations, name)
    assert np.isnan(found[7]).all()
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    np.testing.assert_allclose(found[8], linear[3, 8], rtol=1e-6)
