"""A few samples of a few texels: highlights above noise, noise alone, and what one cannot tell."""

import numpy as np
import pytest

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.planning.trial import seek_highlights, surface_texels
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.luminance import encode

TEXELS, FRAMES = 3000, 12


def frames(luminance: np.ndarray, *, seed=0, noise=1.0, clipped=None):
    """Samples of every texel in every frame, grey, with a sensor's noise in code values.

    luminance (F, T), 0..100
    """
    rng = np.random.default_rng(seed)
    found = []
    for k, values in enumerate(luminance):
        code = 255 * encode(values / 100) + rng.normal(0, noise, len(values))
        value = np.repeat(np.clip(np.rint(code), 0, 255).astype(np.uint8)[:, None], 4, axis=1)
        value[:, 3] = 100
        if clipped is not None:
            value[clipped[k], 3] |= 128
        found.append(SampledFrame(np.arange(len(values), dtype=np.int32), value))
    return found


def matt(seed=0) -> np.ndarray:
    colour = np.random.default_rng(seed).uniform(5, 40, TEXELS)
    return np.tile(colour, (FRAMES, 1))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
def test_noise_is_no_highlight(seed, noise):
    found = seek_highlights(frames(matt(seed), seed=seed, noise=noise), TEXELS)
    assert found.judged == TEXELS
    assert found.none


@pytest.mark.parametrize("share", [0.01, 0.05, 1.0])
@pytest.mark.parametrize("height", [20.0, 40.0])
def test_highlights_are_seen_where_only_some_texels_have_them(share, height):
    luminance = matt()
    luminance[3, : int(share * TEXELS)] += height
    found = seek_highlights(frames(luminance), TEXELS)
    assert found.rising >= 0.9 * share * TEXELS
    assert not found.none


def test_a_faint_gloss_shows_by_its_side():
    """No sample rises far, but all that depart from their texel's median rise."""
    luminance = matt()
    luminance[::4] += 2.5
    found = seek_highlights(frames(luminance), TEXELS)
    assert found.lopsided > 0.2 * TEXELS
    assert not found.none


def test_shadows_are_no_highlights():
    luminance = matt()
    luminance[5, : TEXELS // 2] *= 0.3
    found = seek_highlights(frames(luminance), TEXELS)
    assert found.rising == 0
    assert found.lopsided < 0


def test_a_clipped_sample_may_be_a_highlight():
    clipped = np.zeros((FRAMES, TEXELS), bool)
    clipped[:, :30] = True
    assert not seek_highlights(frames(matt(), clipped=clipped), TEXELS).none


def test_what_varies_throughout_may_be_a_broad_highlight():
    """A lobe so broad that every sample of some texels holds some of it: one cannot tell."""
    luminance = matt()
    lobe = 15 * np.cos(np.linspace(0, np.pi, FRAMES)) ** 2
    luminance[:, : TEXELS // 10] += lobe[:, None]
    assert not seek_highlights(frames(luminance), TEXELS).none


def test_neither_can_one_where_the_exposure_varies():
    gain = np.exp(np.random.default_rng(1).normal(0, 0.3, FRAMES))
    assert not seek_highlights(frames(matt() * gain[:, None]), TEXELS).none


def test_nor_where_there_are_few_samples():
    assert not seek_highlights(frames(matt()[:7]), TEXELS).none
    few = seek_highlights(frames(matt()[:, :500]), TEXELS)
    assert few.judged == 500
    assert not few.none


def test_the_order_of_the_frames_does_not_matter():
    luminance = matt()
    luminance[2, ::7] += 20
    samples = frames(luminance)
    assert seek_highlights(samples, TEXELS) == seek_highlights(samples[::-1], TEXELS)


# Points of the surface


def two_triangles(uv=None) -> Mesh:
    """One of area ½, one of 3/2."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-3, 0, 0]], np.float64)
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), uv=uv)


def test_points_lie_on_the_surface_as_dense_as_its_area():
    mesh = two_triangles()
    found = surface_texels(mesh, 4000)
    assert np.bincount(found.face).tolist() == [1000, 3000]
    world = found.position + mesh.center
    assert (world[:, 1] > -1e-6).all()
    assert (found.barycentric >= -1e-6).all()
    corners = mesh.vertices[mesh.faces[found.face]]
    np.testing.assert_allclose(
        world, np.einsum("tc,tcd->td", found.barycentric, corners), atol=1e-6
    )
    np.testing.assert_allclose(found.normal, np.tile([0, 0, 1], (4000, 1)), atol=1e-6)


def test_they_fill_their_faces_evenly():
    found = surface_texels(two_triangles(), 4000)
    mean = found.barycentric[found.face == 1].mean(axis=0)
    np.testing.assert_allclose(mean, 1 / 3, atol=0.01)


def test_with_charts_they_are_as_dense_as_texels():
    corners = np.array([[0, 0], [0.5, 0], [0, 0.5]])
    uv = np.array([corners, corners * np.sqrt(0.25) + 0.5])
    found = surface_texels(two_triangles(uv), 1000)
    np.testing.assert_allclose(np.bincount(found.face) / 1000, [0.8, 0.2], atol=0.01)
