"""Normal maps: exact inverses within quantisation, mirrored charts, degenerate UVs."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.normal_maps import apply_normal_map, encode_normal_map, texel_frames
from meshlab_svbrdf.geometry.texels import rasterise_texels

SIZE = 32


def dome(n=9):
    """A bulged square seen from above; u along x, v along y."""
    a = np.linspace(0, 1, n)
    x, y = np.meshgrid(a, a, indexing="ij")
    z = x * (1 - x) + 0.5 * y * (1 - y)
    v = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    return Mesh(v, faces, uv=v[faces][..., :2])


def flat():
    mesh = dome(3)
    return replace(mesh, vertices=mesh.vertices * [1, 1, 0])


def mirrored(mesh):
    return replace(mesh, uv=mesh.uv * [-1, 1] + [1, 0])


def normals_near(texels, seed=0):
    rng = np.random.default_rng(seed)
    n = texels.normal + rng.normal(scale=0.3, size=texels.normal.shape)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def one_colour(*colour):
    return [np.tile(np.array(colour, np.uint8), (SIZE, SIZE, 1))]


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    ("space", "green"), [("tangent", "up"), ("tangent", "down"), ("object", "up")]
)
@pytest.mark.parametrize("change", [lambda m: m, mirrored])
def test_a_round_trip_is_exact_within_quantisation(bits, space, green, change):
    mesh = change(dome())
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals = normals_near(texels)
    images = encode_normal_map(texels, mesh, normals, space, green, bits)
    back, valid = apply_normal_map(texels, mesh, images, space, green)
    assert valid.all()
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, rtol=1e-6)
    # Three components, each off by half a step of 2/M at most
    assert np.linalg.norm(back - normals, axis=1).max() < np.sqrt(3) / (2**bits - 1) + 1e-6


def test_a_flat_map_changes_nothing():
    mesh = dome()
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals, valid = apply_normal_map(
        texels, mesh, encode_normal_map(texels, mesh, texels.normal, bits=16)
    )
    assert valid.all()
    np.testing.assert_allclose(normals, texels.normal, atol=4e-5)


def test_frames_are_orthonormal_and_follow_the_charts():
    for mesh, x in ((dome(), 1), (mirrored(dome()), -1)):
        texels = rasterise_texels(mesh, ((SIZE, SIZE),))
        frames, valid = texel_frames(texels, mesh)
        assert valid.all()
        np.testing.assert_allclose(
            np.einsum("tij,tik->tjk", frames, frames),
            np.tile(np.eye(3), (len(texels), 1, 1)),
            atol=1e-12,
        )
        assert (x * frames[:, 0, 0] > 0).all()
        assert (frames[:, 1, 1] > 0).all()


@pytest.mark.parametrize(
    ("colour", "green", "change", "sign"),
    [
        ((255, 128, 128), "up", lambda m: m, [1, 0, 0]),
        ((255, 128, 128), "up", mirrored, [-1, 0, 0]),
        ((128, 255, 128), "up", lambda m: m, [0, 1, 0]),
        ((128, 255, 128), "up", mirrored, [0, 1, 0]),
        ((128, 255, 128), "down", lambda m: m, [0, -1, 0]),
        ((128, 128, 255), "up", mirrored, [0, 0, 1]),
    ],
)
def test_red_is_along_u_and_green_along_v(colour, green, change, sign):
    mesh = change(flat())
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals, _ = apply_normal_map(texels, mesh, one_colour(*colour), "tangent", green)
    np.testing.assert_allclose(normals, np.tile(sign, (len(texels), 1)), atol=0.01)


def test_object_space_is_read_as_it_is():
    mesh = mirrored(dome())
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals, _ = apply_normal_map(texels, mesh, one_colour(128, 0, 128), "object")
    np.testing.assert_allclose(normals, np.tile([0, -1, 0], (len(texels), 1)), atol=0.006)


def test_object_space_turns_with_the_layer():
    """Encoded before the layer's matrix, decoded after it, and back."""
    mesh, matrix = dome(), np.eye(4)
    matrix[:3, :3] = [[0, -2, 0.5], [1, 0, 0], [0, 0, -3]]
    moved = mesh.transformed(matrix)
    own, world = (rasterise_texels(m, ((SIZE, SIZE),)) for m in (mesh, moved))
    images = encode_normal_map(own, mesh, normals_near(own), "object", bits=16)
    normals, valid = apply_normal_map(world, moved, images, "object", matrix=matrix)
    assert valid.all()
    expected = own.to_images(normals_near(own) @ np.linalg.inv(matrix[:3, :3]))[0]
    expected = expected[world.row, world.col]
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=2e-4)
    (back,) = encode_normal_map(world, moved, normals, "object", bits=16, matrix=matrix)
    assert np.abs(back.astype(int) - images[0]).max() <= 2


@pytest.mark.parametrize("change", [lambda m: m, mirrored])
def test_a_mirrored_layer_mirrors_the_tangent_spaces_normals(change):
    mesh, matrix = change(dome()), np.diag([1.0, -1, 1, 1])
    moved = mesh.transformed(matrix)
    own, world = (rasterise_texels(m, ((SIZE, SIZE),)) for m in (mesh, moved))
    images = encode_normal_map(own, mesh, normals_near(own), bits=16)
    before, after = (
        texels.to_images(apply_normal_map(texels, m, images)[0])[0]
        for texels, m in ((own, mesh), (world, moved))
    )
    np.testing.assert_allclose(after, before * [1, -1, 1], atol=1e-5)


def test_degenerate_uvs_keep_the_normal_and_say_so():
    mesh = dome(3)
    uv = mesh.uv.copy()
    uv[0] = uv[0, 0]
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals, valid = apply_normal_map(texels, replace(mesh, uv=uv), one_colour(255, 128, 200))
    np.testing.assert_array_equal(valid, texels.face != 0)
    np.testing.assert_array_equal(normals[~valid], texels.normal[~valid])


def test_a_map_that_says_nothing_keeps_the_normal():
    mesh = dome(3)
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    normals, valid = apply_normal_map(texels, mesh, one_colour(128, 128, 128), "object")
    assert not valid.any()
    np.testing.assert_array_equal(normals, texels.normal)


@pytest.mark.parametrize("size", [SIZE // 2, SIZE * 2])
def test_a_map_of_another_size_is_resampled(size):
    mesh = dome()
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    wave = np.rint(127 + 60 * np.cos(np.linspace(0, 3, SIZE))[:, None]).repeat(SIZE, 1)
    image = np.dstack([wave, wave, 0 * wave + 230]).astype(np.uint8)
    same, _ = apply_normal_map(texels, mesh, [image])
    other, _ = apply_normal_map(texels, mesh, [cv2.resize(image, (size, size))])
    inside = (texels.row > 1) & (texels.row < SIZE - 2)
    np.testing.assert_allclose(other[inside], same[inside], atol=0.03)


def test_each_texture_has_its_own_map():
    mesh = flat()
    index = (np.arange(len(mesh.faces)) % 2).astype(np.int32)
    mesh = replace(mesh, texture_index=index)
    texels = rasterise_texels(mesh, ((SIZE, SIZE), (2 * SIZE, 2 * SIZE)))
    maps = one_colour(255, 128, 128) + one_colour(128, 255, 128)
    normals, _ = apply_normal_map(texels, mesh, maps)
    assert (normals[texels.texture == 0, 0] > 0.99).all()
    assert (normals[texels.texture == 1, 1] > 0.99).all()
    with pytest.raises(SvbrdfError, match="1 normal maps for 2 textures"):
        apply_normal_map(texels, mesh, maps[:1])


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8), np.zeros((4, 4, 3))]
)
def test_other_images_are_refused(image):
    mesh = flat()
    with pytest.raises(SvbrdfError, match="8- or 16-bit RGB"):
        apply_normal_map(rasterise_texels(mesh, ((4, 4),)), mesh, [image])


def test_a_mesh_without_uvs_is_refused():
    mesh = flat()
    texels = rasterise_texels(mesh, ((4, 4),))
    with pytest.raises(SvbrdfError, match="parametrise"):
        apply_normal_map(texels, replace(mesh, uv=None), one_colour(1, 2, 3))
