"""Lamps for other programs: read back they are ours; the map of directions gives the same light."""

import json

import numpy as np
import pytest
from analytic import unit

from meshlab_svbrdf.document.light_files import read_light_file
from meshlab_svbrdf.document.products import plain
from meshlab_svbrdf.exporting.lights import found_lights, light_file, light_map
from meshlab_svbrdf.reflectance.directions import directions, solid_angles
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.rendering.environment_lights import Illumination

COMPACT = np.eye(2) * 1e-3


def two() -> Illumination:
    return Illumination(
        unit([[0.2, 0.7, 0.6], [-0.5, 0.1, -0.4]]), np.array([0.1, 0.0]),
        np.array([[1.2, 1.0, 0.9], [0.4, 0.5, 0.7]]), np.zeros(2, bool),
    )  # fmt: skip


@pytest.mark.parametrize("k", [0, 1])
def test_the_maps_light_is_the_lamps(k):
    """(1/π) ∫ Env (n·ω) dω of a surface that faces the lamp, with its ambient light."""
    ambient = np.array([0.1, 0.2, 0.3])
    light = two().only(np.arange(2) == k)
    radiance = light_map(light, ambient, 128)
    cosine = np.maximum(directions(128) @ light.direction[0], 0)
    shown = (radiance * (cosine * solid_angles(128))[..., None]).sum((0, 1)) / np.pi
    np.testing.assert_allclose(shown, light.color[0] + ambient, rtol=2e-3)
    only = light_map(light, np.zeros(3), 128)
    shown = (only * (cosine * solid_angles(128))[..., None]).sum((0, 1)) / np.pi
    np.testing.assert_allclose(shown, light.color[0], rtol=1e-5)
    lit = only.any(-1)
    assert (directions(128)[lit] @ light.direction[0] > np.cos(np.radians(2.5))).all()


def test_the_file_is_read_as_it_was(tmp_path):
    light, center, radius = two(), np.array([1e3, 2.0, 3.0]), 5.0
    told = light_file(light, np.array([0.1, 0.2, 0.3]), center, radius)
    (tmp_path / "lights.json").write_text(json.dumps(plain(told)))
    found = read_light_file(tmp_path / "lights.json")
    np.testing.assert_allclose([lamp.color for lamp in found.lamps], light.color)
    np.testing.assert_allclose(found.lamps[0].position, center + 50 * light.direction[0])
    assert found.lamps[1].position is None
    np.testing.assert_allclose(found.lamps[1].direction, light.direction[1])
    np.testing.assert_allclose(found.ambient, [0.1, 0.2, 0.3])


def test_long_lamps_give_what_one_point_would():
    """As many points, whose light on a surface that faces the middle is the lamp's."""
    direction = unit([0.3, 0.8, 0.5])
    side = unit(np.cross(direction, [0, 1, 0]))
    tube = Light(direction, COMPACT, 1.3, 0.1, bar=0.4 * side)
    light = found_lights([tube, Light(-direction, COMPACT, 0.8)], 2.0)
    assert len(light) > 5
    long = light.curvature > 0
    shown = (light.color[long, 0] * (light.direction[long] @ direction)).sum()
    assert shown == pytest.approx(1.3)
    assert light.color[~long] == pytest.approx(np.full((1, 3), 0.8))
    np.testing.assert_allclose(np.linalg.norm(light.direction, axis=1), 1)
    # The points lie on the tube: along its side, on a plane that faces the object
    place = light.direction[long] / light.curvature[long, None]
    np.testing.assert_allclose(place @ direction, 10)
    np.testing.assert_allclose(place @ np.cross(direction, side), 0, atol=1e-12)
