"""UDIM tiles: coordinates by tile, and back to a texture each."""

from dataclasses import replace

import numpy as np
import pytest

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.udim import split_tiles

GRID = 2.0**-20
TILES = np.array([[0, 0], [1, 0], [9, 0], [0, 1], [3, 12]])
NUMBERS = [1001, 1002, 1010, 1011, 1124]


@pytest.fixture
def patches() -> Mesh:
    """A triangle in each of five textures, its coordinates exact in any tile."""
    rng = np.random.default_rng(4)
    uv = np.rint(rng.random((5, 3, 2)) / GRID) * GRID
    vertices = rng.random((15, 3))
    return Mesh(vertices, np.arange(15, dtype=np.int32).reshape(5, 3), None, uv, np.arange(5))


def tiled(mesh: Mesh, tiles: np.ndarray) -> Mesh:
    return replace(mesh, uv=mesh.uv + tiles[:, None], texture_index=None)


def test_a_texture_for_each_tile_is_what_the_tiles_were_made_from(patches):
    mesh, numbers = split_tiles(tiled(patches, TILES))
    assert numbers.tolist() == NUMBERS
    np.testing.assert_array_equal(mesh.uv, patches.uv)
    np.testing.assert_array_equal(mesh.texture_index, patches.texture_index)
    sizes = ((32, 32),) * 5
    one, other = rasterise_texels(mesh, sizes), rasterise_texels(patches, sizes)
    assert len(one) > 100
    for name in ("position", "face", "texture", "row", "col"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_an_image_for_each_tile_and_an_index_that_says_the_same_are_one(patches):
    images = np.array([2, 0, 1, 4, 3])
    mesh, numbers = split_tiles(replace(tiled(patches, TILES), texture_index=images))
    assert numbers.tolist() == NUMBERS
    np.testing.assert_array_equal(mesh.texture_index, np.arange(5))


def test_two_images_in_one_tile_stay_two(patches):
    images = np.array([0, 0, 0, 0, 1])
    tiles = np.where(images[:, None] == 1, [0, 0], TILES)
    mesh, numbers = split_tiles(replace(tiled(patches, tiles), texture_index=images))
    assert numbers.tolist() == [1001, 1001, 1002, 1010, 1011]
    assert mesh.texture_index.tolist() == [0, 2, 3, 4, 1]


def test_corners_on_the_border_belong_to_their_face(patches):
    square = np.array([[[1, 0], [2, 0], [2, 1]], [[1, 0], [2, 1], [1, 1]]], float)
    mesh, numbers = split_tiles(Mesh(patches.vertices, patches.faces[:2], None, square))
    assert numbers.tolist() == [1002]
    np.testing.assert_array_equal(mesh.uv, square - [1, 0])


def test_faces_without_a_texture_keep_none(patches):
    index = np.array([-1, 0, 0, 0, 0])
    mesh, numbers = split_tiles(replace(tiled(patches, TILES), texture_index=index))
    assert (numbers.tolist(), mesh.texture_index.tolist()) == (NUMBERS[1:], [-1, 0, 1, 2, 3])


@pytest.mark.parametrize("tile", [[0.5, 0], [0, 0.5], [-1, 0], [0, -1], [10, 0], [0, 0]])
def test_what_is_no_udim_is_left_alone(patches, tile):
    tiles = np.zeros((5, 2))
    tiles[2] = tile
    mesh = replace(patches, uv=0.1 + 0.8 * patches.uv)
    assert split_tiles(tiled(mesh, tiles)) is None
    assert split_tiles(replace(mesh, uv=None)) is None
