"""Penumbrae of the renderers: lamps of a size, against the share of a disk that is seen."""

import numpy as np
import pytest
from analytic import lamp, look_at, plane
from looks import look

from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.visibility import Rays
from meshlab_svbrdf.reflectance.lamp_shadows import RAYS, disk, lamp_share
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.environment_lights import Illumination
from meshlab_svbrdf.rendering.relight import RelitRenderer

ABOVE = np.array([0, 0, 1.0])


@pytest.fixture(scope="module")
def table() -> Mesh:
    """A floor of half side 1, and half a unit above it a square of half side .4."""
    floor, screen = plane(1.0, cells=4), plane(0.4, 0.5)
    return Mesh(
        np.vstack([floor.vertices, screen.vertices]),
        np.vstack([floor.faces, screen.faces + len(floor.vertices)]).astype(np.int32),
        None,
        np.concatenate([floor.uv, screen.uv]),
    )


@pytest.mark.parametrize("curvature", [0.0, 0.2])
def test_the_share_is_that_of_a_disk_beyond_a_straight_edge(table, curvature):
    x = np.linspace(0.2, 0.7, 301)
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    size, normal = np.radians(6), np.tile(ABOVE, (len(x), 1))
    rays = Rays(table)
    found = lamp_share(rays, points, normal, ABOVE, curvature, size)
    every = disk(ABOVE, size) if curvature == 0 else disk(ABOVE, size) / curvature + rays.center
    toward = every[None] if curvature == 0 else every[None] - points[:, None]
    over = points[:, None, 0] + 0.5 * toward[..., 0] / toward[..., 2]
    np.testing.assert_allclose(found, (np.abs(over) > 0.4).mean(1), atol=1 / RAYS + 1e-9)
    edge = (x + (0.5 / np.tan(np.pi / 2)) - 0.4) / (0.5 * np.tan(size))
    if curvature == 0:  # the disk's segment beyond the screen's edge
        d = np.clip(-edge, -1, 1)
        segment = (np.arccos(d) - d * np.sqrt(1 - d * d)) / np.pi
        np.testing.assert_allclose(found, segment, atol=0.1)
        assert np.abs(found - segment).mean() < 0.03
    assert set(np.unique(lamp_share(rays, points, normal, ABOVE, curvature))) == {0.0, 1.0}


def test_both_renderers_have_the_same_penumbra(table):
    camera = look_at((2.2, 0, 1.6), up=(0, 0, 1))
    matt = [look(rho_s=np.nan)]
    light = Illumination(ABOVE[None], np.zeros(1), np.ones((1, 3)), np.zeros(1, bool))
    hard, soft = (
        RelitRenderer(table, matt, light, lamp_radius=r).render(camera, 1)[0] for r in (0.0, 6.0)
    )
    assert len(np.unique(hard[..., 0].round(9))) == 2  # dark or lit
    shares = np.unique((soft[..., 0] / hard[..., 0].max() * RAYS).round(6))
    np.testing.assert_array_equal(shares, shares.round())  # sixteenths
    assert len(shares) > 8
    assert 0.002 < np.abs(soft - hard).max(-1).astype(bool).mean() < 0.2
    shiny = [look(diffuse=(0, 0, 0), rho_s=0.5, alpha=1.0)]
    above = [lamp(ABOVE)]
    hard, soft = (
        AcquisitionRenderer(table, shiny, above, lamp_radius=r).render(camera, 1)[0]
        for r in (0.0, 6.0)
    )
    lit = hard.max(-1) > 0
    assert (soft[lit] <= hard[lit] + 1e-9).all()
    assert 0.002 < (np.abs(soft - hard).max(-1) > 1e-6).mean() < 0.2
