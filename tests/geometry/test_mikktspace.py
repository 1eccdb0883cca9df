"""MikkTSpace's tangents: exact on flat charts, the mean on curved ones, inverses, invariances."""

from dataclasses import replace

import numpy as np
from analytic import rotation, unit

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.mikktspace import (
    corner_tangents,
    in_tangent_space,
    same_rows,
    tangent_frames,
)
from meshlab_svbrdf.geometry.normal_maps import face_tangents
from meshlab_svbrdf.geometry.texels import rasterise_texels

SIZE = 32


def bulge(n=9, height=0.4) -> Mesh:
    """A bulged square; u along x, v along y."""
    a = np.linspace(0, 1, n)
    x, y = np.meshgrid(a, a, indexing="ij")
    v = np.column_stack([x.ravel(), y.ravel(), height * (x * (1 - x) + y * (1 - y)).ravel()])
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    return Mesh(v, faces, uv=0.05 + 0.9 * v[faces][..., :2])


def test_rows_are_numbered_by_what_they_hold():
    found = same_rows([np.array([1, 2, 1, 1]), np.array([0.5, 0.5, 0.5, 0.25])])
    assert found[0] == found[2]
    assert len(set(found.tolist())) == 3


def test_flat_charts_have_the_faces_own():
    mesh = bulge(height=0)
    found = corner_tangents(mesh)
    np.testing.assert_allclose(
        found[..., :3], np.broadcast_to([1, 0, 0], (*found.shape[:2], 3)), atol=1e-12
    )
    assert (found[..., 3] == 1).all()
    mirrored = corner_tangents(replace(mesh, uv=mesh.uv * [-1, 1] + [1, 0]))
    np.testing.assert_allclose(mirrored[..., 0], -1, atol=1e-12)
    assert (mirrored[..., 3] == -1).all()


def test_curved_charts_have_the_surfaces():
    """On z = h(x, y), dP/du across the normal is (1, 0, h_x) across it."""
    mesh = bulge(65)
    x = mesh.vertices[:, 0]
    normal = mesh.vertex_normals()
    along = np.column_stack([np.ones_like(x), np.zeros_like(x), 0.4 * (1 - 2 * x)])
    along = unit(along - normal * np.einsum("ij,ij->i", along, normal)[:, None])
    found = corner_tangents(mesh)
    assert np.abs(found[..., :3] - along[mesh.faces]).max() < 0.01
    assert np.abs(np.einsum("fci,fci->fc", found[..., :3], normal[mesh.faces])).max() < 1e-9


def test_corners_are_joined_within_a_chart_and_parted_at_its_borders():
    mesh = bulge(5)
    found = corner_tangents(mesh)
    at = np.concatenate([found[..., :3], mesh.uv], axis=2).reshape(-1, 5)
    corners = mesh.faces.ravel()
    for vertex in range(len(mesh.vertices)):
        assert np.ptp(at[corners == vertex], axis=0).max() < 1e-12
    turned = replace(mesh, uv=mesh.uv.copy())
    turned.uv[: len(mesh.faces) // 2] = turned.uv[: len(mesh.faces) // 2, :, ::-1]  # u and v change
    apart = corner_tangents(turned)
    assert (apart[: len(mesh.faces) // 2, :, 3] == -1).all()
    np.testing.assert_array_equal(apart[len(mesh.faces) // 2 :, :, 3], 1)


def test_turning_the_object_turns_its_tangents():
    mesh, turn = bulge(7), rotation(np.random.default_rng(3))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, [5, -2, 1]
    a, b = corner_tangents(mesh), corner_tangents(mesh.transformed(matrix))
    np.testing.assert_allclose(a[..., :3] @ turn.T, b[..., :3], atol=1e-9)
    np.testing.assert_array_equal(a[..., 3], b[..., 3])


def test_doubled_vertices_change_nothing():
    mesh = bulge(6)
    normals = mesh.vertex_normals()
    corners = mesh.faces.ravel()
    doubled = Mesh(mesh.vertices[corners], np.arange(len(corners)).reshape(-1, 3).astype(np.int32),
                   normals[corners], mesh.uv)  # fmt: skip
    plain = corner_tangents(replace(mesh, normals=normals))
    np.testing.assert_allclose(corner_tangents(doubled), plain, atol=1e-12)


def test_normals_come_back_from_their_frames():
    mesh = bulge()
    texels = rasterise_texels(mesh, ((SIZE, SIZE),))
    frames = tangent_frames(texels, mesh, corner_tangents(mesh))
    rng = np.random.default_rng(1)
    normals = unit(texels.normal + rng.normal(scale=0.3, size=(len(texels), 3)))
    told = in_tangent_space(frames, normals)
    np.testing.assert_allclose(np.linalg.norm(told, axis=1), 1)
    np.testing.assert_allclose(unit(np.einsum("tij,tj->ti", frames, told)), normals, atol=1e-9)
    own = in_tangent_space(frames, texels.smooth_normals(mesh))
    np.testing.assert_allclose(own, np.broadcast_to([0, 0, 1], own.shape), atol=1e-6)


def test_frames_follow_the_texture():
    """Red is along u, green along v, also on charts that are mirrored."""
    mesh = bulge()
    for uv in (mesh.uv, mesh.uv * [-1, 1] + [1, 0]):
        own = replace(mesh, uv=uv)
        texels = rasterise_texels(own, ((SIZE, SIZE),))
        frames = tangent_frames(texels, own, corner_tangents(own))
        along_u, along_v = face_tangents(own)
        assert (np.einsum("ti,ti->t", frames[..., 0], along_u[texels.face]) > 0.9).all()
        assert (np.einsum("ti,ti->t", frames[..., 1], along_v[texels.face]) > 0.9).all()


def test_no_texture_coordinates_to_speak_of_still_give_unit_tangents():
    mesh = bulge(4)
    found = corner_tangents(replace(mesh, uv=np.zeros_like(mesh.uv)))
    np.testing.assert_allclose(np.linalg.norm(found[..., :3], axis=-1), 1)
    texels = rasterise_texels(mesh, ((8, 8),))
    flat = np.zeros((len(texels), 3, 3))
    assert (in_tangent_space(flat, texels.normal) == [0, 0, 1]).all()
