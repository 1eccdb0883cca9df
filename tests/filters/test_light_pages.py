"""The pages from the environment map to the gloss: what they write, in which units."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import angle, lamp, plane
from totems import (
    DIFFUSE,
    ENVIRONMENT,
    GLOSS,
    LIGHTS,
    PEAKS,
    SAMPLES,
    TEXELS,
    THRESHOLD,
    VIDEO,
    WALK,
    by_texel,
    copied,
    film,
    run,
    sized,
    with_mesh,
)

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filters import compute_svbrdf_light_sources
from meshlab_svbrdf.filters._report_run import remarks
from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.reflectance.lights import TRUSTED_SAMPLES
from meshlab_svbrdf.samples.luminance import to_srgb8

GREY = 118


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, VIDEO, tmp_path / "result")


@pytest.fixture
def walk(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, WALK, tmp_path / "walk")


# Environment


def test_the_environment_is_a_map_of_probabilities_that_peaks_at_the_lights(result):
    image = result.image("environment")
    assert image.shape == (64, 128)
    assert image.dtype == np.float32
    assert image.min() == 0
    assert image.max() == 1
    radiance, weight = result.array("environment_radiance"), result.array("environment_weight")
    assert radiance.shape == weight.shape == image.shape
    assert (radiance[weight == 0] == 0).all()
    rays = directions(64)
    for light in result.json("lights")["lights"]:
        near = angle(rays, np.array(light["direction"])) < 4
        assert image[near].max() > 0.5
    shown = result.image("environment", "png")
    assert shown.shape == (512, 1024, 3)
    layer = result.results.record["products"]["lights"]["layers"]["environment"]
    assert layer["file"] == "layers/environment.ply"


def test_height_and_normalisation_of_the_environment(walk):
    walk.apply(ENVIRONMENT, height=32)
    assert walk.image("environment").shape == (32, 64)
    assert "64×32" in walk.results.record["runs"][ENVIRONMENT]["message"]
    walk.apply(ENVIRONMENT, height=32, normalisation="count", scale="max")
    image = walk.image("environment")
    assert image.max() == 1
    assert (image == 1).sum() == 1


# Diffuse colour


def test_maps_of_the_diffuse_colour_are_linear_and_unobserved_is_nan_and_grey(result):
    observed = np.isfinite(result.attribute("final_diffuse")).all(1)
    linear = by_texel(result, result.map("diffuse"))
    assert linear.dtype == np.float32
    np.testing.assert_allclose(linear, result.attribute("final_diffuse") / 100, rtol=1e-6)
    assert 0 < np.nanmin(linear) < np.nanmax(linear) < 1.2  # sharpened
    codes = by_texel(result, result.map("diffuse", "png"))
    np.testing.assert_array_equal(codes[observed], to_srgb8(linear[observed]))
    assert (codes[~observed] == GREY).all()
    (valid,) = result.map("valid", "png")
    texels = result.texels()
    (expected,) = texels.to_images(np.where(observed, 255, 0).astype(np.uint8), 0)
    np.testing.assert_array_equal(valid, expected)
    (inside,) = texels.to_images(np.ones(len(texels), bool), False)
    assert np.isnan(result.map("diffuse")[0][~inside]).all()
    assert (result.map("diffuse", "png")[0][~inside] > 0).any()  # gutters are filled


@pytest.mark.parametrize("method", ["trimmed", "quantile"])
def test_methods_without_a_model_come_near_the_statistical_one(walk, method):
    statistical = walk.attribute("diffuse")
    assert not walk.apply(DIFFUSE, method=method).skipped
    other = walk.attribute("diffuse")
    np.testing.assert_array_equal(np.isnan(other), np.isnan(statistical))
    assert np.nanmedian(np.abs(other / statistical - 1)) < 0.1
    assert walk.stale("lights") == ""
    assert walk.stale("materials") == "diffuse"


# Lights


def test_lights_json(result):
    center, radius = result.array("texels_center"), float(result.array("texels_radius"))
    lights = result.json("lights")["lights"]
    assert len(lights) == 3
    for light in lights:
        assert light.keys() >= {"direction", "position", "gain", "covariance"}
        assert np.linalg.norm(light["direction"]) == pytest.approx(1)
        offset = np.array(light["position"]) - center
        assert angle(offset / np.linalg.norm(offset), np.array(light["direction"])) < 1e-6
        assert 7 < np.linalg.norm(offset) / radius < 13
        covariance = np.array(light["covariance"])
        assert (np.linalg.eigvalsh(covariance) > 0).all()
        np.testing.assert_allclose(covariance, covariance.T)
    gains = [light["gain"] for light in lights]
    assert np.mean(np.log(gains)) == pytest.approx(0, abs=1e-9)
    result.apply(GLOSS, near=False)
    assert [light["position"] for light in result.json("lights")["lights"]] == [None] * 3


def test_other_ways_to_find_lights_and_back(result):
    def directions_found():
        return np.array([light["direction"] for light in result.json("lights_found")["lights"]])

    found = directions_found()
    result.apply(LIGHTS, method="median_cut")
    few = len(directions_found())
    result.apply(LIGHTS, method="median_cut", minimum_energy=0)
    assert 1 <= few <= len(directions_found())
    result.apply(LIGHTS)
    np.testing.assert_array_equal(directions_found(), found)


# Gloss


def test_gloss_per_texel_comes_from_peaks_of_lights_found(result):
    alpha, rho_s = result.attribute("alpha"), result.attribute("rho_s")
    known = np.isfinite(alpha)
    np.testing.assert_array_equal(known, np.isfinite(rho_s))
    assert 0.1 < known.mean() < 0.3
    assert ((alpha[known] > 1) & (alpha[known] < 2000)).all()
    assert ((rho_s[known] > 0) & (rho_s[known] < 10)).all()
    assert (result.attribute("light_distance")[known] < 2.5).all()
    assert set(result.attribute("light")[known]) == {0, 1, 2}
    said = result.results.record["runs"][PEAKS]["message"]
    assert (
        said == f"{100 * known.mean():.1f} % of the texels show a peak that tells (runs of frames)"
    )


def test_gloss_maps_and_materials_json(result):
    record = result.json("materials")
    assert record.keys() == {"estimator", "materials", "notes", "sheen"}
    assert record["estimator"] == "joint"
    rho_s, alpha = by_texel(result, result.map("rho_s")), by_texel(result, result.map("alpha"))
    np.testing.assert_allclose(rho_s, result.attribute("material_rho_s"), rtol=1e-6)
    np.testing.assert_allclose(alpha, result.attribute("material_alpha"), rtol=1e-6)
    labels = result.attribute("material")
    assert np.isnan(rho_s[labels < 0]).all()
    for material in record["materials"]:
        assert material.keys() >= {"id", "rho_s", "alpha", "texels", "observed", "reason",
                                   "specular_color", "z", "explained_variance"}  # fmt: skip
        own = labels == material["id"]
        assert material["texels"] == own.sum()
        assert material["observed"] == (material["reason"] == "")
        expected = material["rho_s"] if material["observed"] else np.nan
        np.testing.assert_allclose(rho_s[own], expected, rtol=1e-6)
    assert {m["id"] for m in record["materials"]} == set(labels[labels >= 0])
    pictures = {name: by_texel(result, result.map(name, "png")) for name in ("rho_s", "alpha")}
    for picture in pictures.values():
        assert (picture[np.isnan(rho_s)] == GREY).all()
        assert (picture[np.isfinite(rho_s)] != GREY).any(1).all()


# What has no gloss, and next to nothing


def test_a_scene_without_gloss_says_so_and_keeps_its_diffuse_colour(tmp_path_factory, tmp_path):
    matte = tuple(replace(material, rho_s=0.0) for material in WALK.materials)
    options = replace(WALK, frames=40, texture=64, materials=matte, views=0)
    document = Document.open(film(tmp_path_factory, options), tmp_path)
    said = run(document, **sized(options))[GLOSS].message
    assert "no gloss is observed, so nothing shows where the lights are" in said
    assert all(m["reason"] and not m["observed"] for m in document.json("materials")["materials"])
    assert np.isnan(document.map("rho_s")[0]).all()
    assert np.isnan(document.map("alpha")[0]).all()
    document.apply(GLOSS, sharp=False)
    np.testing.assert_array_equal(
        document.attribute("final_diffuse"), document.attribute("diffuse")
    )


def test_of_hundreds_of_lights_the_strongest_are_kept_and_it_is_said(
    tmp_path_factory, tmp_path, monkeypatch
):
    rng = np.random.default_rng(0)
    many = [lamp(direction) for direction in rng.normal(size=(300, 3))]
    monkeypatch.setattr(compute_svbrdf_light_sources, "lights_by_peaks", lambda *_: many)
    document = copied(tmp_path_factory, WALK, tmp_path)
    said = document.apply(LIGHTS, force=True).message
    assert said.startswith("300 found, the strongest 32 kept: the map is noise rather than lamps")
    kept = document.json("lights_found")["lights"]
    np.testing.assert_array_equal([k["direction"] for k in kept], [m.direction for m in many[:32]])


@pytest.mark.parametrize(("frames", "trusted"), [(14, False), (0, True)])
def test_lights_of_too_few_frames_are_not_to_be_trusted(
    tmp_path_factory, tmp_path, frames, trusted
):
    """It is said with the number of frames that see a texel, and the report says it too."""
    document = copied(tmp_path_factory, WALK, tmp_path)
    document.apply(SAMPLES, frames=frames)
    document.apply(THRESHOLD, minimum_samples=3)
    document.apply(ENVIRONMENT)
    said = document.apply(LIGHTS).message
    assert document.json("lights")["lights"]
    samples = document.attribute("samples")
    median = int(np.median(samples[samples > 0]))
    assert (median >= TRUSTED_SAMPLES) == trusted
    assert (f"do not trust them: a texel is seen by {median} frames" in said) == (not trusted)
    assert any(text.startswith("Do not trust") for text in remarks(document)) == (not trusted)


@pytest.mark.parametrize("side", [4, 1])
def test_objects_of_next_to_no_texels_go_through_the_chain(tmp_path_factory, tmp_path, side):
    """A square before the totem, whose texture is mostly empty."""
    square = plane(0.3, 0.4)
    mesh = replace(square, uv=square.uv * side / 16)
    project = with_mesh(film(tmp_path_factory, WALK), tmp_path / "in", mesh)
    document = Document.open(project, tmp_path / "out")
    run(document, **{TEXELS: {"texture_size": 16}})
    assert len(document.texels()) == side**2
    assert np.isfinite(document.attribute("final_diffuse")).all()
    (material,) = document.json("materials")["materials"]
    assert not material["observed"]
    document.save()
    assert Document.open(document.path).apply(GLOSS).skipped
