"""Texels: each lies where its pixel centre is on the chart, and on the surface."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import plane, sphere, unit

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import _unit_or_face, rasterise_texels

SIZE = (48, 96)


def charts(seed=0, faces=30):
    """Triangles with disjoint random charts: each in its own cell of a grid."""
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(6), np.arange(5)), -1).reshape(-1, 1, 2)[:faces]
    uv = (cells + rng.uniform(0.02, 0.98, (faces, 3, 2))) / [6, 5]
    return Mesh(
        rng.normal(size=(3 * faces, 3)),
        np.arange(3 * faces, dtype=np.int32).reshape(-1, 3),
        None,
        uv,
    )


def turn(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def identity(texels):
    """What tells texels apart: texture, row, column, as a set."""
    return set(zip(texels.texture.tolist(), texels.row.tolist(), texels.col.tolist(), strict=True))


@pytest.mark.parametrize(
    "mesh", [sphere(), plane(cells=7), charts()], ids=["sphere", "plane", "charts"]
)
def test_barycentrics_reproduce_the_pixel_centre(mesh):
    texels = rasterise_texels(mesh, (SIZE,))
    uv = np.einsum("tc,tcd->td", texels.barycentric.astype(float), mesh.uv[texels.face])
    np.testing.assert_allclose(uv[:, 0] * SIZE[1] - 0.5, texels.col, atol=1e-4)
    np.testing.assert_allclose((1 - uv[:, 1]) * SIZE[0] - 0.5, texels.row, atol=1e-4)
    np.testing.assert_allclose(texels.barycentric.sum(1), 1, atol=1e-6)
    assert texels.barycentric.min() >= 0


def test_every_pixel_centre_inside_a_triangle_is_a_texel_and_no_other():
    mesh = charts()
    inside = np.zeros(SIZE, bool)
    col, row = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    p = np.stack([(col + 0.5) / SIZE[1], 1 - (row + 0.5) / SIZE[0]], -1)
    for a, b, c in mesh.uv:
        side = [turn(q - o, p - o) for o, q in ((a, b), (b, c), (c, a))]
        inside |= np.all(np.array(side) >= 0, 0) | np.all(np.array(side) <= 0, 0)
    texels = rasterise_texels(mesh, (SIZE,))
    image = texels.to_images(np.ones(len(texels), bool), fill=False)[0]
    np.testing.assert_array_equal(image, inside)


def test_positions_lie_on_their_triangles_and_normals_are_unit():
    mesh = sphere()
    texels = rasterise_texels(mesh, (SIZE,))
    corners = mesh.vertices[mesh.faces[texels.face]]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    good = np.linalg.norm(face, axis=1) > 1e-9
    off = np.sum((texels.position + texels.center - corners[:, 0]) * face, -1)[good]
    assert np.abs(off / np.linalg.norm(face[good], axis=1)).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(texels.normal, axis=1), 1, atol=1e-6)
    assert np.sum(texels.normal * unit(texels.position), -1).min() > 0.999


def test_a_full_chart_gives_every_pixel_once():
    texels = rasterise_texels(sphere(), (SIZE,))
    assert len(texels) == SIZE[0] * SIZE[1] == len(identity(texels))


def test_order_of_faces_does_not_change_the_texels():
    mesh = charts()
    order = np.random.default_rng(1).permutation(len(mesh.faces))
    a = rasterise_texels(mesh, (SIZE,))
    b = rasterise_texels(replace(mesh, faces=mesh.faces[order], uv=mesh.uv[order]), (SIZE,))
    for name in ("position", "normal"):
        np.testing.assert_array_equal(
            a.to_images(getattr(a, name))[0], b.to_images(getattr(b, name))[0]
        )
    face_a, face_b = a.to_images(a.face, -1)[0], b.to_images(b.face, -1)[0]
    np.testing.assert_array_equal(face_a, np.where(face_b < 0, -1, order[face_b]))


def test_several_textures_are_those_of_their_faces():
    mesh = charts()
    index = (np.arange(len(mesh.faces)) % 3).astype(np.int32)
    sizes = ((48, 96), (20, 30), (64, 64))
    texels = rasterise_texels(replace(mesh, texture_index=index), sizes)
    np.testing.assert_array_equal(index[texels.face], texels.texture)
    for k, size in enumerate(sizes):
        alone = rasterise_texels(
            replace(mesh, faces=mesh.faces[index == k], uv=mesh.uv[index == k]), (size,)
        )
        assert {i[1:] for i in identity(texels) if i[0] == k} == {i[1:] for i in identity(alone)}
    images = texels.to_images(texels.position)
    assert [i.shape for i in images] == [(*s, 3) for s in sizes]
    for k, image in enumerate(images):
        here = texels.texture == k
        np.testing.assert_array_equal(
            image[texels.row[here], texels.col[here]], texels.position[here]
        )
        assert np.isfinite(image).all(-1).sum() == here.sum()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_faces_without_usable_coordinates_have_no_texels(value):
    mesh = charts()
    uv = mesh.uv.copy()
    uv[3, 1, 0] = value
    texels = rasterise_texels(replace(mesh, uv=uv), (SIZE,))
    without = rasterise_texels(
        replace(mesh, faces=np.delete(mesh.faces, 3, 0), uv=np.delete(mesh.uv, 3, 0)), (SIZE,)
    )
    assert identity(texels) == identity(without)
    assert 3 not in texels.face


@pytest.mark.parametrize("value", [1e12, -1e12, 1e30, -1e300])
def test_charts_beyond_any_image_end_at_its_border(value):
    """Pixel coordinates that no integer holds: a sliver covers what it covers; nothing crashes."""
    mesh = charts(faces=1)
    uv = mesh.uv.copy()
    uv[0, 1, 0] = value
    texels = rasterise_texels(replace(mesh, uv=uv), (SIZE,))
    v = 1 - (texels.row + 0.5) / SIZE[0]
    assert len(identity(texels)) == len(texels)
    assert ((v >= uv[0, :, 1].min()) & (v <= uv[0, :, 1].max())).all()
    assert np.isfinite(texels.position).all()


def test_degenerate_charts_have_no_texels():
    mesh = charts()
    texels = rasterise_texels(replace(mesh, uv=np.repeat(mesh.uv[:, :1], 3, 1)), (SIZE,))
    assert len(texels) == 0
    assert texels.position.shape == texels.normal.shape == texels.barycentric.shape == (0, 3)
    assert np.isnan(texels.to_images(np.zeros(0, np.float32))[0]).all()


def test_coordinates_beyond_the_image_do_not_wrap():
    mesh = charts()
    assert len(rasterise_texels(replace(mesh, uv=mesh.uv + 1.0), (SIZE,))) == 0


def test_where_charts_overlap_the_first_face_wins():
    mesh = plane()
    twice = replace(
        mesh,
        faces=np.vstack([mesh.faces, mesh.faces[::-1]]),
        uv=np.vstack([mesh.uv, mesh.uv[::-1]]),
    )
    texels = rasterise_texels(twice, (SIZE,))
    assert texels.face.max() < 2
    assert len(identity(texels)) == len(texels) == SIZE[0] * SIZE[1]


def test_vertices_without_normal_take_the_faces():
    mesh = replace(plane(), normals=np.zeros((4, 3)))
    texels = rasterise_texels(mesh, (SIZE,))
    np.testing.assert_allclose(texels.normal, np.tile([0, 0, 1], (len(texels), 1)), atol=1e-6)


def test_the_faces_normal_of_a_mirrored_mesh_points_outwards():
    """Normals of a face's corners that cancel at its middle."""
    mesh = sphere()
    a, b, c = mesh.faces[len(mesh.faces) // 4]
    mesh = mesh.transformed(np.diag([1.0, 1, -1, 1]))
    normals = mesh.normals.copy()
    normals[a], normals[b], normals[c] = [1, 0, 0], [-0.5, 0.75**0.5, 0], [-0.5, -(0.75**0.5), 0]
    normal = np.zeros((1, 3), np.float32)
    face = np.array([len(mesh.faces) // 4])
    outward = unit(mesh.vertices[mesh.faces[face[0]]].mean(0))
    _unit_or_face(normal, replace(mesh, normals=normals), face)
    assert normal[0] @ outward > 0.99


def test_a_face_without_area_gives_a_zero_normal_not_a_direction():
    flat = Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float), np.array([[0, 1, 2]], np.int32),
                None, charts(faces=1).uv)  # fmt: skip
    texels = rasterise_texels(flat, (SIZE,))
    assert len(texels) > 0
    np.testing.assert_array_equal(texels.normal, 0)


def test_map_coordinates_cost_nothing():
    mesh = sphere()
    origin = np.array([4.5e5, 5.4e6, 120.0])
    a = rasterise_texels(mesh, (SIZE,))
    b = rasterise_texels(replace(mesh, vertices=mesh.vertices + origin), (SIZE,))
    np.testing.assert_allclose(b.center - a.center, origin, rtol=1e-12)
    np.testing.assert_allclose(b.to_images(b.position)[0], a.to_images(a.position)[0], atol=1e-6)
    assert b.radius == pytest.approx(a.radius)


def test_neighbours_in_memory_are_neighbours_on_the_surface():
    """A step in memory is on average a few texel spacings long, where a shuffle's is the object."""
    texels = rasterise_texels(plane(), ((64, 64),))
    step = np.linalg.norm(np.diff(texels.position, axis=0), axis=1)
    assert step.mean() < 2.5 * (2 / 64)


def test_mesh_without_coordinates_is_refused():
    with pytest.raises(ValueError, match="parametrise"):
        rasterise_texels(replace(plane(), uv=None), (SIZE,))
