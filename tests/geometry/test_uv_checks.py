"""Texture coordinates: exact counts on charts drawn by hand."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.uv_checks import check_uv

SIZE = ((64, 64),)
SQUARE = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)


def charts(uv, texture_index=None):
    """A mesh of which only the texture coordinates matter."""
    faces = np.arange(3 * len(uv), dtype=np.int32).reshape(-1, 3)
    return Mesh(
        np.zeros((3 * len(uv), 3)), faces, uv=np.asarray(uv, float), texture_index=texture_index
    )


def fan(points):
    """Triangles around an inner point: they tile their polygon."""
    return np.array(
        [[points[0], a, b] for a, b in zip(points[1:], np.roll(points[1:], -1, 0), strict=True)]
    )


def test_a_full_square_is_covered_once():
    for uv in (SQUARE, SQUARE[:, ::-1], SQUARE * [1, -1] + [0, 1]):
        report = check_uv(charts(uv), SIZE)
        assert report.ok
        assert report.message == ""
        assert report.covered_share == 1
        assert report.overlap_share == 0


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(3, 12))
def test_faces_around_a_vertex_neither_overlap_nor_leave_gaps(seed, corners):
    """On pixel centres or anywhere: the fan covers what two halves of its square cover."""
    rng = np.random.default_rng(seed)
    inner = (rng.integers(1, 63, 2) + 0.5) / 64 if seed % 2 else rng.uniform(0.1, 0.9, 2)
    cuts = np.unique(np.r_[0, 1, 2, 3, rng.integers(0, 4 * 64, corners) / 64])
    side, t = cuts.astype(int), cuts % 1
    border = np.array([[t, 0 * t], [1 + 0 * t, t], [1 - t, 1 + 0 * t], [0 * t, 1 - t]])
    border = border[side, :, np.arange(len(t))]
    report = check_uv(charts(fan(np.vstack([inner, border]))), SIZE)
    assert report.overlap_share == 0
    assert report.covered_share == 1


def test_charts_on_each_other_overlap():
    half = SQUARE * [0.5, 1]
    report = check_uv(charts(np.vstack([SQUARE, half])), SIZE)
    assert report.overlap_share == 0.5
    assert not report.ok
    assert "50 % of the texels" in report.message
    assert "Parametrise" in report.message
    # A mirrored half on its other half, as symmetric models have it
    mirrored = check_uv(charts(np.vstack([half, half * [-1, 1] + [0.5, 0]])), SIZE)
    assert mirrored.overlap_share == 1
    assert mirrored.flipped_faces == 2


def test_a_fold_overlaps_across_its_edge():
    kite = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [1, 0.5]]], float)
    report = check_uv(charts(kite), SIZE)
    assert report.flipped_faces == 1
    assert 0.45 < report.overlap_share < 0.55


def test_faces_out_of_range_are_told():
    shifted = check_uv(
        charts(np.vstack([SQUARE / 2, SQUARE / 2 + [1.5, 0], SQUARE / 2 + [0.75, 0]])), SIZE
    )
    assert shifted.out_of_range_faces == 4
    assert shifted.tiled_faces == 2
    assert not shifted.ok
    assert "4 of 6 faces reach outside" in shifted.message
    # A rounding error beyond the border is none
    assert check_uv(charts(SQUARE * (1 + 1e-6)), SIZE).ok


@pytest.mark.parametrize("far", [1e3, 1e6, 1e30])
def test_far_coordinates_do_not_break_the_count(far):
    report = check_uv(charts(np.vstack([SQUARE, SQUARE * far, SQUARE + far])), SIZE)
    assert report.out_of_range_faces == 4
    assert report.covered_share == 1


def test_faces_without_area_are_told():
    uv = np.vstack([SQUARE, np.zeros((1, 3, 2)), np.full((1, 3, 2), np.nan)])
    report = check_uv(charts(uv), SIZE)
    assert report.zero_area_faces == 2
    assert report.ok
    assert "2 of 4 faces have no area" in report.message
    assert not check_uv(charts(uv[2:]), SIZE).ok


def test_each_texture_is_counted_on_its_own():
    index = np.array([0, 0, 1, 1], np.int32)
    both = charts(np.vstack([SQUARE, SQUARE]), index)
    report = check_uv(both, ((64, 64), (16, 32)))
    assert report.ok
    assert report.covered_share == 1
    missing = check_uv(both, SIZE)
    assert missing.missing_texture_faces == 2
    assert not missing.ok


def grid(cells):
    """A flat square of 2 · cells² triangles whose texture coordinates are its x and y."""
    x, y = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1))
    vertices = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) / cells
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    right, above = corner + 1, corner + cells + 1
    faces = np.vstack([np.column_stack([corner, right, above + 1]),
                       np.column_stack([corner, above + 1, above])]).astype(np.int32)  # fmt: skip
    return Mesh(vertices, faces, uv=vertices[faces][..., :2])


def test_whole_charts_have_no_seams_and_two_halves_have_one():
    mesh = grid(8)
    report = check_uv(mesh, SIZE)
    assert (report.seam_share, report.skewed_share, report.starved_share) == (0, 0, 0)
    right = mesh.vertices[mesh.faces].mean(1)[:, 0] > 0.5
    halves = mesh.uv * [0.4, 1] + right[:, None, None] * [0.2, 0]
    report = check_uv(replace(mesh, uv=halves), SIZE)
    inner = 2 * 7 + 8 * np.sqrt(2)  # the lengths of edges between two faces, the seam is 1
    assert report.seam_share == pytest.approx(1 / inner)
    assert report.skewed_share == 1  # 2.5 times as high as wide
    assert not report.torn
    turned = (mesh.uv - 0.5) @ np.array([[0.6, 0.8], [-0.8, 0.6]]) * [0.6, 0.4] + 0.5
    assert check_uv(replace(mesh, uv=turned), SIZE).skewed_share == 0


def test_faces_with_next_to_no_texels_are_told_by_their_area():
    mesh = grid(8)
    small = np.where(mesh.vertices[mesh.faces].mean(1)[:, 0] > 0.75, 0.2, 1.0)[:, None, None]
    report = check_uv(replace(mesh, uv=mesh.uv * small), SIZE)
    assert report.starved_share == pytest.approx(0.25)
    assert not report.ok
    assert "25 % of the surface has next to no texels" in report.message
    assert check_uv(replace(mesh, uv=mesh.uv * np.maximum(small, 0.3)), SIZE).starved_share == 0
    lost = np.where(small < 1, 0.0, mesh.uv)
    assert check_uv(replace(mesh, uv=lost), SIZE).starved_share == pytest.approx(0.25)


def test_charts_in_pieces_that_no_longer_fit_are_torn():
    mesh = grid(8)
    rng = np.random.default_rng(5)
    pieces = mesh.uv[:, :1] + 0.02 * rng.standard_normal(mesh.uv.shape)
    report = check_uv(replace(mesh, uv=np.clip(pieces, 0, 1)), SIZE)
    assert report.seam_share > 0.9
    assert report.torn
    assert not report.ok
    assert "The charts are torn" in report.message
    whole = check_uv(replace(mesh, uv=mesh.uv + 0 * pieces), SIZE)
    assert not whole.torn


def test_a_mesh_without_coordinates_is_refused():
    with pytest.raises(SvbrdfError, match="parametrise"):
        check_uv(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])), SIZE)


@pytest.mark.parametrize("name", ["bust_floods", "goldcape"])
def test_real_charts_are_sound(name):
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of real scenes")
    faces = PlyData.read(Path(scenes) / name / "mesh.ply")["face"]
    report = check_uv(charts(np.vstack(faces["texcoord"]).reshape(-1, 3, 2)), ((1024, 1024),))
    assert report.ok
    assert report.overlap_share < 1e-3
    assert 0.3 < report.covered_share < 0.6
