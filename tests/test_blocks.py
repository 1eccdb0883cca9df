"""Long arrays: where they lie changes nothing."""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf import blocks as module
from meshlab_svbrdf.bench.body import body
from meshlab_svbrdf.bench.walk import frame_camera
from meshlab_svbrdf.blocks import blocks, counted, places, resting, room, rowwise, taken
from meshlab_svbrdf.document.layers import mesh_digest
from meshlab_svbrdf.document.stored import MAPPED, read_array, write_array
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry import adjacency
from meshlab_svbrdf.geometry.adjacency import neighbours, thin
from meshlab_svbrdf.geometry.raster import DepthMaps
from meshlab_svbrdf.geometry.surface_shape import surface_shape
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.udim import split_tiles
from meshlab_svbrdf.geometry.uv_checks import check_uv
from meshlab_svbrdf.geometry.visibility import _edges, vertex_visibility
from meshlab_svbrdf.reflectance.ambient import openness
from meshlab_svbrdf.reflectance.fit_samples import choose_texels
from meshlab_svbrdf.reflectance.gloss_areas import patches


@pytest.fixture
def small(monkeypatch):
    """Every array is large, and a block has seven rows."""
    monkeypatch.setattr(module, "LARGE", 1)
    monkeypatch.setattr(module.blocks, "__defaults__", (7,))


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


def test_rows_are_worked_on_taken_and_found_in_blocks(small):
    values = np.random.default_rng(0).normal(size=(50, 3))
    mask = values[:, 0] > 0
    np.testing.assert_array_equal(places(mask), np.flatnonzero(mask))
    np.testing.assert_array_equal(taken(values, places(mask)), values[mask])
    np.testing.assert_array_equal(taken(values, np.arange(50), np.arange(50) % 3)[7], values[7, 1])
    np.testing.assert_array_equal(resting(values), values)
    norm = rowwise(lambda some, by: np.linalg.norm(some, axis=1) * by, values, values[:, 1])
    np.testing.assert_array_equal(norm, np.linalg.norm(values, axis=1) * values[:, 1])
    assert rowwise(lambda some: some.astype(np.int8), values[:0]).shape == (0, 3)


def test_labels_are_counted_in_blocks(small):
    labels = np.random.default_rng(0).integers(-1, 5, 50).astype(np.int32)
    np.testing.assert_array_equal(counted(labels), np.bincount(labels[labels >= 0]))
    assert len(counted(np.full(3, -1))) == len(counted(labels[:0])) == 0


def test_a_mesh_is_checked_and_lit_the_same_in_blocks(monkeypatch):
    mesh, numbers = split_tiles(body(600, tiles=True))
    assert numbers.tolist() == [1001, 1002, 1003, 1011, 1012, 1013]
    sizes = ((40, 40),) * len(numbers)
    camera = frame_camera(3, 64, 48, 1.2, 20.0)
    material = np.random.default_rng(1).integers(-1, 4, 500).astype(np.int32)
    coefficients = np.random.default_rng(3).random((len(mesh.vertices), 36), np.float32)
    matrix = np.array([[0, -2, 0, 3], [2, 0, 0, 4], [0, 0, 2, 5], [0, 0, 0, 1.0]])
    counts, turn = np.arange(500) % 20, np.random.default_rng(2).random(500)

    def made():
        whole, _ = split_tiles(body(600, tiles=True))
        texels, placed = rasterise_texels(mesh, sizes), mesh.transformed(matrix)
        chosen, lacking = choose_texels(material, counts, turn, np.full(4, 0.5), 900)
        return {
            "closed": (mesh.is_closed(), mesh.winding()),
            "uv": (whole.uv, whole.texture_index),
            "report": list(vars(check_uv(mesh, sizes)).values()),
            "visibility": vertex_visibility(mesh, 32),
            "normals": replace(mesh, normals=None).vertex_normals(),
            "edges": _edges(mesh),
            "placed": (placed.vertices, placed.normals),
            "open": [openness(texels, mesh.faces, coefficients, texels.normal)],
            "depth": DepthMaps(mesh.vertices, mesh.faces, -1).of(camera),
            "owner": texels.face,
            "images": texels.to_images(texels.position),
            "patches": patches(material, texels.position[:500]),
            "thin": thin(texels.position, texels.normal, 200),
            "chosen": (chosen, lacking),
            "digest": mesh_digest(mesh, np.eye(4)),
        }

    at_once = made()
    monkeypatch.setattr(module, "LARGE", 1)
    monkeypatch.setattr(module.blocks, "__defaults__", (37,))
    monkeypatch.setattr(adjacency, "MERGED", 41)
    in_blocks = made()
    assert at_once.pop("digest") == in_blocks.pop("digest")
    for name, one in at_once.items():
        for a, b in zip(one, in_blocks[name], strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12, err_msg=name)


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
