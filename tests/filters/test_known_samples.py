"""compute_svbrdf_samples again: frames added, a run interrupted, samples that are not kept."""

import numpy as np
import pytest
from totems import DIFFUSE, SAMPLES, TEXELS, THRESHOLD, WALK, edited, film, run

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filters._stages import read_observations
from meshlab_svbrdf.samples.capture import FrameSampler

SMALL = {TEXELS: {"texture_size": 48}}
LESS = 7  # frames that the film lacks at first


@pytest.fixture
def walk(tmp_path_factory):
    return film(tmp_path_factory, WALK)


@pytest.fixture
def projected(monkeypatch):
    """The cameras of the frames that were projected, as they come; stops at the number `stop`."""
    seen = Projected()
    sample = FrameSampler.sample

    def counted(self, camera, image, mask=None):
        if len(seen) == seen.stop:
            raise KeyboardInterrupt
        seen.append(tuple(camera.center))
        return sample(self, camera, image, mask)

    monkeypatch.setattr(FrameSampler, "sample", counted)
    return seen


class Projected(list):
    stop = -1


def samples(document):
    store = read_observations(document, visibility=False).store
    return [np.asarray(part) for part in store.read(0, store.texels)[2:]]


def same_samples(a, b):
    for x, y in zip(samples(a), samples(b), strict=True):
        np.testing.assert_array_equal(x, y)


def test_frames_that_are_added_are_all_that_is_projected(walk, tmp_path, projected):
    def fewer(project):
        del project.rasters[-LESS:]

    first = Document.open(edited(walk, tmp_path / "fewer", fewer), tmp_path / "out")
    run(first, SAMPLES, **SMALL)
    count = len(projected)
    projected.clear()

    more = Document.open(walk, tmp_path / "out")
    run(more, SAMPLES, **SMALL)
    added = [r.camera.center for r in more.rasters[-LESS:]]
    np.testing.assert_allclose(sorted(projected), sorted(map(tuple, added)), rtol=1e-9)
    assert count == len(more.rasters) - LESS

    fresh = Document.open(walk, tmp_path / "fresh")
    run(fresh, SAMPLES, **SMALL)
    same_samples(more, fresh)


def test_another_parameter_projects_all_again(walk, tmp_path, projected):
    document = Document.open(walk, tmp_path)
    run(document, SAMPLES, **SMALL)
    count = len(projected)
    run(document, SAMPLES, **SMALL | {SAMPLES: {"occlusion": 0.03}})
    assert len(projected) == 2 * count
    run(document, SAMPLES, **SMALL | {SAMPLES: {"occlusion": 0.03, "gains": "none"}})
    assert len(projected) == 2 * count  # gains are not of the samples


def test_an_interrupted_run_is_gone_on_with(walk, tmp_path, projected, monkeypatch):
    monkeypatch.setattr("meshlab_svbrdf.samples.store.MOST_FRAMES", 5)
    monkeypatch.setattr("meshlab_svbrdf.samples.store.thread_count", lambda: 1)
    document = Document.open(walk, tmp_path / "out")
    projected.stop = 17
    with pytest.raises(KeyboardInterrupt):
        run(document, SAMPLES, **SMALL)
    assert not document.has("samples")
    projected.clear()
    projected.stop = -1

    again = Document.open(walk, tmp_path / "out")
    run(again, SAMPLES, **SMALL)
    assert len(projected) == len(again.rasters) - 15  # three chunks were whole
    assert not (again.folder / ".partial").exists()

    fresh = Document.open(walk, tmp_path / "fresh")
    run(fresh, SAMPLES, **SMALL)
    same_samples(again, fresh)


def test_what_workers_have_done_is_gone_on_with(walk, tmp_path, projected, monkeypatch):
    """The workers are a plain map here; each task has five frames."""
    monkeypatch.setattr("meshlab_svbrdf.filters._samples.LEAST", 5)
    monkeypatch.setattr("meshlab_svbrdf.filters._samples.MOST", 5)
    monkeypatch.setattr("meshlab_svbrdf.samples.store.thread_count", lambda: 1)
    document = Document.open(walk, tmp_path / "out")
    document.spread = map
    projected.stop = 17
    with pytest.raises(KeyboardInterrupt):
        run(document, SAMPLES, **SMALL)
    assert not document.has("samples")
    projected.clear()
    projected.stop = -1

    run(document, SAMPLES, **SMALL)
    assert len(projected) == len(document.rasters) - 15
    assert not list(document.folder.rglob("part-*"))
    fresh = Document.open(walk, tmp_path / "fresh")
    run(fresh, SAMPLES, **SMALL)
    same_samples(document, fresh)


def test_samples_that_are_not_kept_are_the_same(walk, tmp_path, projected, caplog):
    kept, held = Document.open(walk, tmp_path / "kept"), Document.open(walk, tmp_path / "held")
    run(kept, DIFFUSE, **SMALL)
    run(held, DIFFUSE, **SMALL | {SAMPLES: {"store": "memory"}})
    same_samples(kept, held)
    for name in ("threshold", "diffuse"):
        np.testing.assert_array_equal(kept.attribute(name), held.attribute(name))
    assert not list(held.folder.rglob("chunk*"))
    assert list(kept.folder.rglob("chunk*"))

    # Another process has to project them again, once, and says so
    projected.clear()
    later = Document.open(walk, tmp_path / "held")
    assert later.apply(SAMPLES, store="memory").skipped
    for _ in range(2):
        later.apply(THRESHOLD, minimum_quality=0.1, force=True)
    np.testing.assert_array_equal(later.attribute("threshold"), kept.attribute("threshold"))
    assert len(projected) == len(later.rasters)
    assert "projected again" in caplog.text


def test_neither_threads_nor_chunks_change_the_result(walk, tmp_path, monkeypatch):
    expected = Document.open(walk, tmp_path / "a")
    run(expected, DIFFUSE, **SMALL)
    monkeypatch.setattr("meshlab_svbrdf.samples.store.thread_count", lambda: 5)
    monkeypatch.setattr("meshlab_svbrdf.samples.store.MOST_FRAMES", 3)
    document = Document.open(walk, tmp_path / "b")
    run(document, DIFFUSE, **SMALL)
    for name in ("threshold", "mean", "diffuse"):
        np.testing.assert_array_equal(document.attribute(name), expected.attribute(name))
    np.testing.assert_array_equal(document.array("samples_gain"), expected.array("samples_gain"))
    np.testing.assert_array_equal(document.image("environment"), expected.image("environment"))
