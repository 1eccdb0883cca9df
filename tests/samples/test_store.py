"""The sample store: the transposition against brute force, whatever the chunks and threads."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import meshlab_svbrdf.samples.store as module
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.store import SampleStore, write_store


def random_frames(texels, frames, share, seed=0, bits=8):
    rng = np.random.default_rng(seed)
    kind = np.uint8 if bits == 8 else np.uint16
    out = []
    for _ in range(frames):
        texel = np.flatnonzero(rng.random(texels) < share).astype(np.int32)
        out.append(SampledFrame(texel, rng.integers(0, 1 << bits, (len(texel), 4), kind)))
    return out


def brute_force(frames, texel):
    """The (frame, *value) of one texel, in the frames' order."""
    rows = []
    for f, (texels, value) in enumerate(frames):
        for i in np.flatnonzero(texels == texel):
            rows.append((f, *value[i].tolist()))
    return rows


def rows_of(block, texel):
    i = texel - block.first
    s = slice(block.offsets[i], block.offsets[i + 1])
    columns = np.column_stack([block.frame[s], block.value[s]])
    return [tuple(row) for row in columns.tolist()]


def write(folder, texels, frames, **kw):
    folder.mkdir(exist_ok=True)
    return write_store(folder, texels, len(frames), lambda f: frames[f], **kw)


@settings(max_examples=15)
@given(
    texels=st.integers(1, 20), frames=st.integers(0, 12), share=st.floats(0, 1),
    seed=st.integers(0, 99), memory=st.sampled_from([0, 100, 1 << 20]),
    bits=st.sampled_from([8, 16]), data=st.data(),
)  # fmt: skip
def test_transposition_is_brute_forces(
    tmp_path_factory, texels, frames, share, seed, memory, bits, data
):
    history = random_frames(texels, frames, share, seed, bits)
    folder = tmp_path_factory.mktemp("store")
    store = write(folder, texels, history, memory=memory, bits=bits)
    store = data.draw(st.sampled_from([store, SampleStore.open(folder)]))
    first = data.draw(st.integers(0, texels - 1))
    stop = data.draw(st.integers(first, texels))
    block = store.read(first, stop)
    for texel in range(first, stop):
        assert rows_of(block, texel) == brute_force(history, texel)
    assert len(store) == sum(len(f[0]) for f in history) == store.counts().sum()
    assert store.seen.tolist() == [len(f[0]) for f in history]


@settings(max_examples=15)
@given(
    texels=st.integers(1, 20), frames=st.integers(0, 12), share=st.floats(0, 1),
    memory=st.sampled_from([0, 100, 1 << 20]), bits=st.sampled_from([8, 16]),
    samples=st.integers(1, 40), data=st.data(),
)  # fmt: skip
def test_some_texels_are_read_as_they_are_among_all(
    tmp_path_factory, texels, frames, share, memory, bits, samples, data
):
    history = random_frames(texels, frames, share, bits=bits)
    store = write(tmp_path_factory.mktemp("store"), texels, history, memory=memory, bits=bits)
    some = np.array(sorted(data.draw(st.sets(st.integers(0, texels - 1)))), np.int64)
    block = store.read_texels(some)
    assert (block.first, block.stop) == (0, len(some))
    for i, texel in enumerate(some):
        assert rows_of(block, i) == brute_force(history, texel)

    # In pieces: each texel once, in order, about as many samples as asked for
    pieces = store.map_texels(lambda block, own: (own, block), some, samples=samples)
    for own, part in pieces:
        expected = store.read_texels(some[own])
        for a, b in zip(part, expected, strict=True):
            np.testing.assert_array_equal(a, b)
        assert len(part.frame) < samples + frames
    assert [t for own, _ in pieces for t in some[own]] == some.tolist()


def test_more_frames_than_a_byte_counts(tmp_path):
    history = random_frames(3, 600, 0.5)
    store = write(tmp_path, 3, history)
    block = store.read(0, 3)
    assert block.frame.max() > 511
    for texel in range(3):
        assert rows_of(block, texel) == brute_force(history, texel)


@pytest.mark.parametrize("threads", [1, 5])
@pytest.mark.parametrize("memory", [1, 3000])
def test_neither_threads_nor_chunks_change_what_is_read(tmp_path, monkeypatch, threads, memory):
    history = random_frames(200, 40, 0.4)
    expected = write(tmp_path / "a", 200, history).read(0, 200)
    monkeypatch.setattr(module, "thread_count", lambda: threads)
    store = write(tmp_path / "b", 200, history, memory=memory)
    for a, b in zip(store.read(0, 200), expected, strict=True):
        np.testing.assert_array_equal(a, b)
    assert store.block_bounds(500) == SampleStore.open(tmp_path / "a").block_bounds(500)
    assert store.map(lambda b: b.first) == [b.first for b in store.blocks()]


@pytest.mark.parametrize("samples", [1, 7, 100, 10**9])
def test_blocks_cover_all_texels_once(tmp_path, samples):
    history = random_frames(50, 20, 0.3)
    for f in history:
        f[0][f[0] == 17] = 18  # a texel without samples, its neighbour with twice as many
    store = write(tmp_path, 50, history)
    bounds = store.block_bounds(samples)
    assert [b[0] for b in bounds] == [0, *(b[1] for b in bounds[:-1])]
    assert bounds[-1][1] == 50
    whole = store.read(0, 50)
    parts = list(store.blocks(samples))
    np.testing.assert_array_equal(np.concatenate([b.frame for b in parts]), whole.frame)
    np.testing.assert_array_equal(np.concatenate([b.value for b in parts]), whole.value)
    most = store.counts().max()
    assert max(b.offsets[-1] for b in parts) <= samples + most


def test_a_block_is_within_what_was_asked_for(tmp_path):
    """About as many samples as asked for: off by at most one texel's."""
    history = random_frames(300, 30, 0.5)
    store = write(tmp_path, 300, history)
    sizes = [b.offsets[-1] for b in store.blocks(500)]
    assert max(abs(size - 500) for size in sizes[:-1]) <= 30


@pytest.mark.parametrize(("texels", "frames"), [(5, 0), (0, 0), (0, 3), (5, 3)])
def test_store_without_samples(tmp_path, texels, frames):
    store = write(tmp_path, texels, random_frames(texels, frames, 0.0))
    assert len(store) == 0
    np.testing.assert_array_equal(store.counts(), np.zeros(texels))
    block = store.read(0, texels)
    np.testing.assert_array_equal(block.offsets, np.zeros(texels + 1))
    assert len(block.frame) == len(block.value) == 0
    assert store.map(lambda b: b.stop - b.first) == ([texels] if texels else [])


def test_frames_without_samples_keep_their_number(tmp_path):
    history = random_frames(10, 9, 1.0)
    empty = random_frames(10, 1, 0.0)[0]
    for f in (0, 4, 8):
        history[f] = empty
    store = write(tmp_path, 10, history)
    np.testing.assert_array_equal(store.read(3, 4).frame, [1, 2, 3, 5, 6, 7])


def test_a_frame_that_cannot_be_read_stops_the_store(tmp_path):
    def sample(f):
        if f == 2:
            raise OSError("frame 2 is gone")
        return random_frames(4, 1, 1.0)[0]

    with pytest.raises(OSError, match="frame 2"):
        write_store(tmp_path, 4, 5, sample)
    assert not (tmp_path / "store.json").exists()


def test_a_store_that_has_been_cut_off_is_named(tmp_path):
    store = write(tmp_path, 10, random_frames(10, 9, 1.0))
    column = tmp_path / "chunk0000.value.npy"
    column.write_bytes(column.read_bytes()[:-1])
    with pytest.raises(DocumentError, match=r"chunk0000.value.npy has been cut off"):
        store.read(0, 10)


def description(key, value):
    def damage(folder):
        path = folder / "store.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))

    return damage


def column(name, change):
    def damage(folder):
        path = folder / f"chunk0000.{name}.npy"
        values = np.load(path)
        change(values)
        np.save(path, values)

    return damage


def set_to(index, value):
    def change(values):
        values[index] = value

    return change


@pytest.mark.parametrize(
    "damage",
    [
        description("texels", 11), description("texels", 10**400), description("texels", None),
        description("chunks", [4]), description("chunks", [5, 5]), description("seen", [1]),
        description("seen", [10**30] * 9), description("names", 3), description("quality", {}),
        column("offsets", set_to(3, 10**6)), column("offsets", set_to(0, 2)),
        column("offsets", set_to(-1, 5)), column("frame", set_to(0, 9)),
        lambda folder: (folder / "store.json").write_text("[" * 100_000),
        lambda folder: (folder / "store.json").unlink(),
        lambda folder: (folder / "chunk0000.frame.npy").write_bytes(b"\x93NUMPY\1\0\x10\0{'descr'"),
        lambda folder: np.save(folder / "chunk0000.value.npy", np.zeros((90, 3), np.uint8)),
    ],
)  # fmt: skip
def test_a_store_that_is_damaged_is_named_before_kernels_follow_it(tmp_path, damage):
    write(tmp_path, 10, random_frames(10, 9, 1.0))
    damage(tmp_path)
    with pytest.raises(DocumentError, match=rf"{tmp_path}: the samples are damaged .*--force"):
        SampleStore.open(tmp_path).read(0, 10)


def test_frames_that_are_none_are_seen_by_those_who_read_some_texels(tmp_path):
    write(tmp_path, 10, random_frames(10, 9, 1.0))
    column("frame", set_to(-1, 200))(tmp_path)
    with pytest.raises(DocumentError, match="one is of frame 200 of 9"):
        SampleStore.open(tmp_path).read_texels(np.array([9]))


def test_the_mean_quality_of_a_frame_is_kept(tmp_path):
    frames = random_frames(50, 3, 0.8)
    store = write(tmp_path, 50, frames)
    np.testing.assert_allclose(store.quality, [(f.quality & 127).mean() / 127 for f in frames])


def test_progress_counts_frames_and_blocks(tmp_path):
    calls = []
    history = random_frames(10, 5, 1.0)
    store = write(tmp_path, 10, history, progress=lambda d, t: calls.append((d, t)))
    assert calls == [(k, 5) for k in range(1, 6)]
    calls.clear()
    store.map(lambda b: None, lambda d, t: calls.append((d, t)))
    assert calls == [(1, 1)]


def test_more_chunks_than_files_may_be_open(tmp_path):
    history = random_frames(5, 100, 1.0)
    resource = pytest.importorskip("resource", reason="limits of open files are Unix's")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, before[1]))
    try:
        store = write(tmp_path, 5, history, memory=0)
        assert rows_of(store.read(0, 5), 3) == brute_force(history, 3)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


# Frames that are known already


def counting(frames):
    """The frames' sampler, and the list of those that it was asked for."""
    asked = []
    return asked, lambda f: asked.append(f) or frames[f]


def same(a, b):
    assert (a.texels, a.frames, a.names) == (b.texels, b.frames, b.names)
    np.testing.assert_array_equal(a.seen, b.seen)
    np.testing.assert_array_equal(a.quality, b.quality)
    for x, y in zip(a.read(0, a.texels), b.read(0, b.texels), strict=True):
        np.testing.assert_array_equal(x, y)


@settings(max_examples=25, deadline=None)
@given(
    old=st.lists(st.integers(0, 30), unique=True, max_size=12),
    new=st.lists(st.integers(0, 30), unique=True, max_size=16), memory=st.sampled_from([0, 300]),
)  # fmt: skip
def test_known_frames_are_not_projected_and_change_nothing(tmp_path_factory, old, new, memory):
    """Whatever was added, removed or moved: the store is that of a first run."""
    every = random_frames(20, 31, 0.4)
    first, then, fresh = (tmp_path_factory.mktemp(name) for name in ("first", "then", "fresh"))

    def written(folder, which, sample, **kw):
        names = [f"frame {k}" for k in which]
        return write_store(folder, 20, len(which), sample, names=names, memory=memory, **kw)

    earlier = written(first, old, lambda f: every[old[f]])
    asked, sample = counting([every[k] for k in new])
    store = written(then, new, sample, earlier=[earlier])
    same(store, written(fresh, new, lambda f: every[new[f]]))
    same(SampleStore.open(then), store)
    if memory == 0:  # a chunk a frame
        assert sorted(new[f] for f in asked) == sorted(set(new) - set(old))


def test_frames_that_are_added_are_all_that_is_projected(tmp_path):
    history = random_frames(30, 9, 0.5)
    names = [f"{k}" for k in range(9)]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    a = write_store(tmp_path / "a", 30, 6, lambda f: history[f], names=names[:6])
    asked, sample = counting(history)
    write_store(tmp_path / "b", 30, 9, sample, names=names, earlier=[a])
    assert sorted(asked) == [6, 7, 8]


def test_frames_without_names_are_never_known(tmp_path):
    history = random_frames(5, 3, 0.5)
    a = write(tmp_path / "a", 5, history)
    asked, sample = counting(history)
    (tmp_path / "b").mkdir()
    write_store(tmp_path / "b", 5, 3, sample, earlier=[a])
    assert sorted(asked) == [0, 1, 2]


@pytest.mark.parametrize("stop", [1, 4, 8])
def test_what_an_interrupted_run_wrote_is_taken_up(tmp_path, stop):
    history = random_frames(30, 9, 0.5)
    names = [f"{k}" for k in range(9)]
    for name in "abc":
        (tmp_path / name).mkdir()

    def until(f):
        if f == stop:
            raise KeyboardInterrupt
        return history[f]

    with pytest.raises(KeyboardInterrupt):
        write_store(tmp_path / "a", 30, 9, until, names=names, memory=0)
    partial = SampleStore.open(tmp_path / "a")
    assert partial.names == names[:stop]
    asked, sample = counting(history)
    store = write_store(tmp_path / "b", 30, 9, sample, names=names, earlier=[partial], memory=0)
    assert sorted(asked) == list(range(stop, 9))
    same(store, write_store(tmp_path / "c", 30, 9, lambda f: history[f], names=names))


def test_in_memory_it_is_the_same(tmp_path):
    history = random_frames(30, 9, 0.5)
    held = write_store(None, 30, 9, lambda f: history[f], memory=400)
    same(held, write(tmp_path / "a", 30, history, memory=400))
    some = np.array([3, 4, 29])
    for x, y in zip(
        held.read_texels(some), SampleStore.open(tmp_path / "a").read_texels(some), strict=True
    ):
        np.testing.assert_array_equal(x, y)
