"""Sums over a texel's samples: threshold, mean, diffuse colour, against double precision."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.reflectance.diffuse import diffuse_color
from meshlab_svbrdf.reflectance.environment import environment_map
from meshlab_svbrdf.reflectance.threshold import MINIMUM_SAMPLES, luminance_threshold
from meshlab_svbrdf.samples.luminance import decode
from tests.analytic import REC709, ball, look_at, observations_of, orbit

from .checks import Case

COUNTS = (1, 7, 8, 100, 1_000, 10_000, 100_000)
CONTENTS = ("constant", "black", "clipped", "one colour", "noise", "one spike")
SINGLE = 1e-5  # of 100: a unit in the last place of single precision is 8e-6
DARK = np.zeros((16, 32))


def cases(folder: Path) -> Iterator[Case]:
    for count in COUNTS:
        yield (f"{count:,} samples a texel", "threshold, of 100", SINGLE,
               partial(_threshold, folder, "noise", count))  # fmt: skip
    for content in CONTENTS:
        for what, measure in (("threshold", _threshold), ("mean colour", _mean), ("D", _diffuse)):
            yield content, f"{what}, of 100", SINGLE, partial(measure, folder, content, 1_000)
    yield "10⁷ terms in one pixel of the map", "radiance, relative", 1e-6, partial(_map, folder)
    yield "10⁷ terms in one mean", "mean, relative", 1e-6, partial(_long_mean, folder)


def _codes(content: str, texels: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    codes = np.full((texels, count, 3), 90, np.uint8)
    if content == "black":
        codes[:] = 0
    elif content == "clipped":
        codes[:] = 255
    elif content == "one colour":
        codes[:] = [0, 0, 200]
    elif content == "noise":
        codes = rng.integers(0, 256, codes.shape, np.uint8)
    elif content == "one spike":
        codes[:, count // 2] = 255
    return codes


def _seen(folder: Path, content: str, count: int):
    texels = ball(3)
    cameras = orbit(min(count, 64))
    cameras = [cameras[k % len(cameras)] for k in range(count)]
    codes = _codes(content, len(texels), count)
    quality = np.full(codes.shape[:2], 127, np.uint8)
    quality[codes.max(2) >= 254] |= 128
    name = f"{content}{count}".replace(" ", "_")
    observations = observations_of(folder / name, codes, quality, texels, cameras)
    linear = 100 * decode(codes / 255.0)
    return observations, linear, linear @ REC709


def _threshold(folder: Path, content: str, count: int) -> float:
    observations, _, y = _seen(folder, content, count)
    found = luminance_threshold(observations)
    if count < MINIMUM_SAMPLES:
        return 0.0 if not found.observed.any() else np.inf
    mean = y.mean(1)
    expected = mean + np.abs(y - mean[:, None]).mean(1)
    return max(np.abs(found.threshold - expected).max(), np.abs(found.minimum - y.min(1)).max())


def _mean(folder: Path, content: str, count: int) -> float:
    observations, linear, _ = _seen(folder, content, count)
    return np.abs(luminance_threshold(observations).color - linear.mean(1)).max()


def _diffuse(folder: Path, content: str, count: int) -> float:
    """Without any light, D is the mean below weighted mean and deviation, with equal weights."""
    observations, linear, y = _seen(folder, content, count)
    found = diffuse_color(observations, luminance_threshold(observations), DARK)
    mean = y.mean(1)
    bound = mean + np.abs(y - mean[:, None]).mean(1) + 1e-4
    low = (y < bound[:, None])[..., None]
    return np.abs(found - (linear * low).sum(1) / low.sum(1)).max()


def _still(folder: Path, texels: int, frames: int):
    """Frames of one camera, all codes alike."""
    surface = ball(texels)
    surface = type(surface)(**{**vars(surface), "position": surface.position * 0,
                               "normal": surface.position * 0 + np.float32([0, 0, 1])})  # fmt: skip
    codes = np.broadcast_to(np.uint8([90, 90, 90]), (texels, frames, 3))
    quality = np.full((texels, frames), 127, np.uint8)
    camera = look_at([0, 0, 4])
    return observations_of(folder, codes, quality, surface, [camera] * frames)


def _map(folder: Path) -> float:
    """Every sample falls into one pixel, and exceeds its threshold by the same."""
    observations = _still(folder / "map", 10_000, 1_000)
    statistics = luminance_threshold(observations)
    y = float(100 * decode(np.array(90 / 255.0)))
    statistics.threshold[:] = np.float32(y / 2)
    found = environment_map(observations, statistics, samples=20_000_000)
    return abs(found.radiance.max() / (y - float(np.float32(y / 2))) - 1)


def _long_mean(folder: Path) -> float:
    observations = _still(folder / "mean", 100, 100_000)
    y = 100 * decode(np.array(90 / 255.0))
    found = luminance_threshold(observations)
    return max(np.abs(found.mean / y - 1).max(), np.abs(found.threshold / y - 1).max())
