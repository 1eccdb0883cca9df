"""Files are whole or not there: full disks are told with the file's name, dead writers cleared."""

import errno
import resource
import signal
from contextlib import contextmanager

import numpy as np
import pytest

from meshlab_svbrdf.document.atomic import filling, named, remove_leftovers, replacing
from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.record import ResultFolder, write_json
from meshlab_svbrdf.document.stored import write_array
from meshlab_svbrdf.errors import DocumentError

NOISE = np.random.default_rng(0).integers(0, 256, (99, 99, 3)).astype(np.uint8)
WRITERS = {
    "a.npy": lambda path: write_array(path, np.zeros(9_000)),
    "a.json": lambda path: write_json(path, {"a": "b" * 9_000}),
    "a.png": lambda path: write_png(path, NOISE),
    "a.exr": lambda path: write_exr(path, NOISE / 7),
    "a.ply": lambda path: write_ply(path, NOISE.reshape(-1, 3) / 7),
}


@contextmanager
def room(size):
    """Files cannot grow beyond that many bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("missing", [1, 10, 1_000, 5_000, None], ids=str)
def test_a_full_disk_is_told_with_the_file_and_the_old_one_stays(tmp_path, name, missing):
    """Also where only the last byte has no room."""
    WRITERS[name](tmp_path / name)
    size = (tmp_path / name).stat().st_size
    assert size > 5_000
    path = tmp_path / "again" / name
    path.parent.mkdir()
    path.write_text("old")
    with (
        room(size - missing if missing else 0),
        pytest.raises(DocumentError, match=rf"{path}: cannot be written whole .*make room"),
    ):
        WRITERS[name](path)
    if name != "a.npy":  # staged: nobody sees it
        assert path.read_text() == "old"


def test_an_error_that_names_its_file_stays_as_it_is(tmp_path):
    with pytest.raises(FileNotFoundError), named(tmp_path / "a"):
        (tmp_path / "b").read_text()
    with pytest.raises(DocumentError, match="a: cannot be written whole"), named(tmp_path / "a"):
        raise OSError(errno.ENOSPC, "No space left on device")


def left_behind(path):
    """The temporary file of a writer that was killed."""
    with replacing(path) as temporary:
        temporary.write_text("half")
        kept = temporary.read_bytes()
    temporary.write_bytes(kept)
    path.unlink()
    return temporary


def test_what_dead_writers_left_goes_and_nothing_else(tmp_path):
    mine = [tmp_path / n for n in (".hidden", ".a.mlp", "a.0123abcd.mlp", ".b.notahash.mlp")]
    for path in mine:
        path.write_text("mine")
    other = left_behind(tmp_path / "b.mlp")
    dead = left_behind(tmp_path / "a.mlp")
    remove_leftovers(tmp_path, "a")
    assert not dead.exists()
    assert other.exists()
    remove_leftovers(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(mine)
    remove_leftovers(tmp_path / "nowhere")


def test_the_next_run_clears_the_results(tmp_path):
    folder = tmp_path / "a.svbrdf"
    (folder / "layers").mkdir(parents=True)
    dead = [left_behind(folder / "exact.mlp"), left_behind(folder / "layers" / "texels.ply")]
    ResultFolder(folder)
    assert not any(path.exists() for path in dead)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files_take_their_places_together(tmp_path):
    out = tmp_path / "a" / "b"
    with filling(out) as part:
        (part / "one").write_text("1")
        (part / "two").write_text("2")
        assert names(out) == [part.name]
    assert names(out) == ["one", "two"]
    with filling(out) as part:
        (part / "two").write_text("new")
    assert [(out / name).read_text() for name in names(out)] == ["1", "new"]


def test_what_breaks_leaves_nothing_of_its_own(tmp_path):
    out = tmp_path / "a" / "b"

    def breaks():
        with filling(out) as part:
            (part / "one").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        breaks()
    assert names(tmp_path) == []
    out.mkdir(parents=True)
    (out / "one").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        breaks()
    assert names(out) == ["one"]
    assert (out / "one").read_text() == "old"
