"""A material that microfacets describe better: all that shows a result shows them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from totems import GLOSS, VIDEO, by_texel, copied
from typer.testing import CliRunner

from meshlab_svbrdf import cli
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.filters import compute_svbrdf_material_specular as page
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.reflectance.estimate import Estimate
from meshlab_svbrdf.reflectance.joint import Material
from meshlab_svbrdf.reflectance.microfacet import GGX, Microfacets
from meshlab_svbrdf.viewing import maps
from meshlab_svbrdf.viewing.scene import Scene
from meshlab_svbrdf.viewing.session import Session

FOUND = Microfacets(GGX, 4.0, 46.0, 0.2, (1.1, 1.0, 0.7), 2.5, 0.5)
MAPS = {"roughness": 0.2, "f0": 0.08, "strength": 0.5}


@pytest.fixture
def result(tmp_path_factory, tmp_path, monkeypatch) -> Document:
    """As if the first material, whose lobe is unobserved, and no other were one of microfacets."""
    document = copied(tmp_path_factory, VIDEO, tmp_path / "result")

    def found(document, labels, ids, lights, diffuse, parameters, progress) -> Estimate:
        none = Material(np.nan, np.nan, False, "no highlight stands out of the noise")
        counts = [int((labels == k).sum()) for k in range(len(ids))]
        facets = [FOUND if parameters.reflectance == "auto" else None]
        return Estimate(
            [replace(none, texels=count) for count in counts], read_lights(document), diffuse,
            np.zeros(3), np.zeros_like(diffuse), None, facets + [None] * (len(ids) - 1), [],
        )  # fmt: skip

    monkeypatch.setattr(page, "_joint", found)
    document.apply(GLOSS, sheen="none")
    document.save()
    return document


def test_maps_tell_what_microfacets_are_and_go_with_them(result):
    own = result.attribute("material") == 0
    for name, value in MAPS.items():
        expected = np.where(own, np.float32(value), np.nan)
        np.testing.assert_allclose(result.attribute(f"material_{name}"), expected, rtol=1e-6)
        np.testing.assert_allclose(by_texel(result, result.map(name)), expected, rtol=1e-6)
    assert "map: roughness" in [mesh.label for mesh in result.project.meshes]

    result.apply(GLOSS, sheen="none", reflectance="phong")
    assert not {f"material_{name}" for name in MAPS} & set(result.attributes())
    assert not any(result.map_paths(name) for name in MAPS)


def test_the_page_the_report_and_info_tell_them(result, tmp_path):
    session = Session(Scene(result.path))
    first, second = session.clusters()[:2]
    assert first["gloss"]["reflectance"]["roughness"] == FOUND.roughness
    assert "reflectance" not in second["gloss"]
    assert "roughness" in {entry["name"] for entry in maps.available(session.scene)}
    shown = (maps.paint(session.scene, "roughness").colors != maps.UNOBSERVED).any(1)
    np.testing.assert_array_equal(shown, session.labels == 0)

    result.apply("generate_svbrdf_report", file=tmp_path / "totem.html")
    text = (tmp_path / "totem.html").read_text(encoding="utf-8")
    assert "ggx describes it 2.5 dB better: roughness 0.200, F₀ 0.080, strength 0.5" in text
    said = CliRunner().invoke(cli.app, ["info", str(result.path)]).output
    assert "ggx of roughness 0.2, F0 0.08, strength 0.5" in " ".join(said.split())


def test_an_export_says_what_its_textures_hold(result, tmp_path):
    out = tmp_path / "out"
    result.apply("generate_svbrdf_export", folder=out, formats="textures", color="diffuse")
    told = json.loads((out / "totem.json").read_text())["materials"]
    ggx = told[0]["ggx"]
    assert ggx["mirrored"] == pytest.approx(0.04 / np.pi)
    assert ggx["mirrored_at_grazing"] == pytest.approx(0.5 / np.pi)
    assert "ggx" not in told[1]
    texels, own = result.texels(), result.attribute("material") == 0
    rough = read_image(out / "totem_Roughness.png")[texels.row, texels.col] / 255
    np.testing.assert_allclose(rough[own], ggx["roughness"], atol=0.51 / 255)
    assert ggx["roughness"] == pytest.approx(np.sqrt(FOUND.roughness))
