"""What the part on microfacets calls true, and how it tells what was found."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import microfacets
from benchmarks.scenes.catalogue import SCENES

SIZE = np.radians(4.0)  # half extent of every lamp: a disk's variance is a quarter of its square


def test_what_is_found_exactly_is_told_without_an_error(tmp_path):
    gain = 0.4
    emitters = [
        {"kind": "disk", "half_extent_deg": [4.0, 4.0], "phong_intensity": [gain * k] * 3}
        for k in (0.5, 1.0, 2.0)
    ]
    (tmp_path / "lights.json").write_text(json.dumps({"emitters": emitters}))
    empty = [{"rho_s": None, "alpha": None}]
    (tmp_path / "materials.json").write_text(json.dumps({"materials": empty}))
    case = SimpleNamespace(name="gold", truth=tmp_path)
    gold, glaze, plaster = SCENES["gold"].materials
    reflected = np.array(microfacets.GOLD_F0)
    f0 = reflected @ [0.2126, 0.7152, 0.0722]
    better = {
        "model": "beckmann", "strength": np.pi * gain, "f0": f0, "gain_db": 3.0,
        "roughness": np.sqrt(gold.gold**2 + SIZE**2 / 8), "color": list(reflected / f0),
    }  # fmt: skip
    result = tmp_path / "result"
    result.mkdir()
    told = [{"id": 0, "reflectance": better}, {"id": 1}, {"id": 2}]
    (result / "materials.json").write_text(json.dumps({"materials": told}))
    first, second = microfacets._found(result, case)
    assert first["ln_facing"] == pytest.approx(0, abs=1e-6)
    assert first["color_off"] == pytest.approx(0, abs=1e-4)
    assert first["roughness"] == pytest.approx(first["true_roughness"])
    assert first["f0"] == pytest.approx(first["true_f0"])
    assert (second["name"], second["true_model"], second["model"]) == (glaze.name, "phong", "phong")
    assert plaster.rho_s == 0
    rows = [
        {"part": "microfacets", "scene": "gold", "name": "microfacets", "found": [first, second]}
    ]
    cells = microfacets.tables(rows)[0].cells
    assert [line[2:4] for line in cells] == [["beckmann", "beckmann"], ["phong", "phong"]]


def test_the_constants_are_mitsubas():
    mitsuba = pytest.importorskip(
        "mitsuba", "3.9", reason="the benchmark's renderer is not installed ([benchmark])"
    )
    mitsuba.set_variant("scalar_rgb")
    point = mitsuba.SurfaceInteraction3f()
    point.wi = mitsuba.Vector3f(0, 0, 1)
    gold = mitsuba.load_dict({"type": "conductor", "material": "Au"})
    _, weight = gold.sample(mitsuba.BSDFContext(), point, 0.5, mitsuba.Point2f(0.5))
    np.testing.assert_allclose(np.array(weight), microfacets.GOLD_F0, atol=5e-4)
    # Rough plastic's own defaults, an index of 1.49 in air
    layer = mitsuba.load_dict({"type": "dielectric", "int_ior": 1.49, "ext_ior": "air"})
    sample, _ = layer.sample(mitsuba.BSDFContext(), point, 0.0, mitsuba.Point2f(0.5))
    np.testing.assert_allclose(sample.pdf, microfacets.PLASTIC_F0[0], atol=5e-5)
