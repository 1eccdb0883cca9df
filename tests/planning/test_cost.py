"""Costs grow with the work, and the store's size is what is written."""

from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf.planning.cost import (
    GLOSS,
    RATES,
    SAMPLES,
    Work,
    memory_bytes,
    stage_seconds,
    store_bytes,
)  # fmt: skip
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.store import write_store

WORK = Work(
    frames=240, samples=5e7, texels=8e5, vertices=10_000, environment=2e6, fitted=6e6,
    directions=512, cores=2, decode=0.003, project=0.02,
)  # fmt: skip


def test_every_filter_of_the_chain_has_a_rate():
    for estimator in ("joint", "paper"):
        names = [step.name for step in chain(estimator)]
        assert list(stage_seconds(WORK, filters=names)) == names
    assert list(stage_seconds(WORK)) == list(RATES)


@pytest.mark.parametrize("name", ["frames", "samples", "texels", "vertices", "decode", "project"])
def test_more_work_takes_longer(name):
    more = replace(WORK, **{name: getattr(WORK, name) * 2})
    assert sum(stage_seconds(more).values()) > sum(stage_seconds(WORK).values())


def test_more_cores_or_a_faster_machine_take_less():
    total = sum(stage_seconds(WORK).values())
    assert sum(stage_seconds(replace(WORK, cores=8)).values()) < total
    assert sum(stage_seconds(WORK, speed=2.0).values()) < total


def test_what_is_measured_here_is_not_scaled_again():
    slow = stage_seconds(replace(WORK, project=1.0), speed=1e9)
    assert slow[SAMPLES] == pytest.approx(240 * 1.003 / 2, rel=0.2)


def test_without_a_fit_little_is_left_of_it():
    for spared in ({"estimator": "paper"}, {"gloss": "none"}):
        assert stage_seconds(WORK, **spared)[GLOSS] < 0.5 * stage_seconds(WORK)[GLOSS]


def test_memory_is_bounded_whatever_the_number_of_frames():
    held = 256 << 20
    many = replace(WORK, frames=100_000, samples=1e11)
    assert memory_bytes(many, held) == memory_bytes(replace(WORK, samples=1e9), held)


def test_memory_grows_slowly_where_arrays_lie_in_files():
    held = 128 << 20
    sizes = [memory_bytes(replace(WORK, texels=texels), held) for texels in (1e6, 4e6, 1e8, 1.03e8)]
    assert sizes[3] - sizes[2] < 0.5 * (sizes[1] - sizes[0])


@pytest.mark.parametrize(("frames", "memory"), [(3, 1 << 30), (300, 1 << 30), (60, 16_000)])
def test_the_stores_size_is_what_is_written(tmp_path, frames, memory):
    texels = 1000
    rng = np.random.default_rng(0)
    seen = [np.sort(rng.choice(texels, 300, replace=False)).astype(np.int32) for _ in range(frames)]
    store = write_store(
        tmp_path, texels, frames,
        lambda f: SampledFrame(seen[f], np.zeros((300, 4), np.uint8)), memory=memory,
    )  # fmt: skip
    written = sum(path.stat().st_size for path in tmp_path.glob("*.npy"))
    chunks = len(list(tmp_path.glob("*offsets*")))
    assert written - 4 * 128 * chunks == pytest.approx(
        store_bytes(len(store), texels, frames, memory), rel=0.15
    )
