"""New texture coordinates: every face its own texels, charts apart, the surface untouched."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.parametrise import parametrise
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.uv_checks import check_uv


def torus(n=24, m=16):
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    r = 1 + 0.4 * np.cos(b)
    v = np.stack([r * np.cos(a), r * np.sin(a), 0.4 * np.sin(b)], -1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    p, q = i * m + j, (i + 1) % n * m + j
    s, t = (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m
    faces = np.vstack([np.column_stack([p, q, s]), np.column_stack([p, s, t])]).astype(np.int32)
    return Mesh(v, faces)


def cube():
    v = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Mesh(v, np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)], np.int32))


def chart_of(mesh):
    """Which connected piece of the texture each face lies in."""
    _, wedge = np.unique(mesh.uv.reshape(-1, 2), axis=0, return_inverse=True)
    wedge = wedge.reshape(-1, 3)
    count = wedge.max() + 1
    pairs = np.vstack([wedge[:, :2], wedge[:, 1:]])
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)[1][wedge[:, 0]]


@pytest.mark.parametrize("mesh", [torus(), cube()])
@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_every_place_gets_its_own_texels(mesh, shift):
    mesh = replace(mesh, vertices=mesh.vertices + shift)
    result = parametrise(mesh, 256, 4)
    np.testing.assert_array_equal(result.vertices, mesh.vertices)
    np.testing.assert_array_equal(result.faces, mesh.faces)
    assert result.uv.shape == (len(mesh.faces), 3, 2)
    assert not result.texture_index.any()
    report = check_uv(result, ((256, 256),))
    assert report.ok
    assert report.overlap_share == 0
    assert report.zero_area_faces == 0
    assert report.covered_share > 0.4
    assert set(np.unique(rasterise_texels(result, ((256, 256),)).face)) == set(
        range(len(mesh.faces))
    )


def test_charts_keep_their_distance():
    result = parametrise(torus(), 256, 6)
    texels = rasterise_texels(result, ((256, 256),))
    chart = texels.to_images(chart_of(result)[texels.face].astype(np.int32), -1)[0]
    assert chart.max() > 0
    for index in range(chart.max() + 1):
        away = distance_transform_edt(chart != index)
        assert away[(chart >= 0) & (chart != index)].min() >= 6


def test_texels_have_about_the_same_size_everywhere():
    mesh = torus()
    result = parametrise(mesh, 512, 4)

    def area(p):
        e, f = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        return (
            np.linalg.norm(np.cross(e, f), axis=1)
            if p.shape[2] == 3
            else abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])
        )

    ratio = area(result.uv) / area(mesh.vertices[mesh.faces])
    assert np.percentile(ratio, 95) / np.percentile(ratio, 5) < 2


def test_the_same_mesh_gives_the_same_charts_and_normals_are_welcome():
    mesh = torus()
    np.testing.assert_array_equal(parametrise(mesh, 128).uv, parametrise(mesh, 128).uv)
    with_normals = parametrise(replace(mesh, normals=mesh.vertex_normals()), 128)
    assert check_uv(with_normals, ((128, 128),)).ok
    assert with_normals.normals is not None


def test_degenerate_faces_and_lone_vertices_do_no_harm():
    mesh = torus()
    mesh = replace(
        mesh,
        vertices=np.vstack([mesh.vertices, [[9, 9, 9.0]]]),
        faces=np.vstack([mesh.faces, [[5, 5, 5], [7, 8, 8]]]).astype(np.int32),
    )
    report = check_uv(parametrise(mesh, 256), ((256, 256),))
    assert report.ok
    assert report.zero_area_faces == 2


def test_what_cannot_be_done_is_said():
    with pytest.raises(SvbrdfError, match="without faces"):
        parametrise(Mesh(np.zeros((3, 3)), np.zeros((0, 3), np.int32)))
    with pytest.raises(SvbrdfError, match="not finite"):
        parametrise(Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]], np.int32)))
    with pytest.raises(SvbrdfError, match="without area"):
        parametrise(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)))
    with pytest.raises(SvbrdfError, match="larger texture or a smaller padding"):
        parametrise(cube(), 8, 16)
