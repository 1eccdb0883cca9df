"""Long arrays: where they lie changes nothing."""

from __future__ import annotations

import errno
import os

import numpy as np
import pytest

from meshlab_svbrdf import blocks as module
from meshlab_svbrdf.bench.body import body
from meshlab_svbrdf.blocks import blocks, room
from meshlab_svbrdf.document.stored import MAPPED, read_array, write_array
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.geometry.surface_shape import surface_shape
from meshlab_svbrdf.geometry.texels import rasterise_texels


def test_blocks_cover_all_in_order():
    assert [list(range(10))[own] for own in blocks(10, 4)] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]


@pytest.mark.parametrize("shape", [0, 7, (3, 5), (0, 3)])
def test_room_has_the_asked_shape_and_is_written(monkeypatch, shape):
    monkeypatch.setattr(module, "LARGE", 1)
    array = room(shape, np.float32)
    array[...] = 3
    assert type(array) is np.ndarray
    assert array.dtype == np.float32
    assert array.flags.aligned
    assert array.shape == np.empty(shape).shape
    assert (array == 3).all()


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="arrays stay in memory here")
def test_a_full_disk_is_told_before_anything_is_written(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(module, "LARGE", 1)
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SvbrdfError, match="set TMPDIR"):
        room(10, np.uint8)


def test_texels_and_their_surface_are_the_same_in_files_and_in_memory(monkeypatch):
    mesh = body(600)

    def made():
        texels = rasterise_texels(mesh, ((96, 96),))
        columns = [np.asarray(value) for value in vars(texels).values()]
        shape = surface_shape(texels.position, texels.normal)
        return [*columns, *neighbours(texels.position, texels.normal), shape]

    in_memory = made()
    monkeypatch.setattr(module, "LARGE", 1)
    for one, other in zip(in_memory, made(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_large_array_is_copied_on_writing_and_outlives_its_file(tmp_path):
    values = np.arange(MAPPED // 8)
    write_array(tmp_path / "a.npy", values)
    array = read_array(tmp_path / "a.npy")
    assert type(array) is np.ndarray
    assert not array.flags.owndata
    array[0] = -1
    assert read_array(tmp_path / "a.npy")[0] == 0
    write_array(tmp_path / "a.npy", values[::-1])
    assert array[0] == -1
    assert (array[1:] == values[1:]).all()
    assert read_array(tmp_path / "a.npy")[0] == values[-1]
