"""Sheen in the document: written, rendered, and gone when it is not wanted."""

import numpy as np
import pytest
from totems import GLOSS, WALK, copied

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filters import _sheen, compute_svbrdf_material_specular
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.reflectance.sheen import Sheen


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, WALK, tmp_path / "result")


def test_sheen_is_kept_beside_the_diffuse_colour(result, monkeypatch):
    texels, labels = result.texels(), result.attribute("material")
    mine = labels == 0
    sheen = Sheen(
        np.arange(36) / 100, np.where(mine, 0.5, np.nan).astype(np.float32), texels.normal,
        np.where(mine[:, None], 40.0, np.full(3, np.nan)).astype(np.float32),
        np.array([0.3] + [0.01] * int(labels.max())), np.radians(12),
    )  # fmt: skip
    monkeypatch.setattr(compute_svbrdf_material_specular, "seek_sheen", lambda *arguments: sheen)
    said = result.apply(GLOSS, rounds=3, samples=50_000)
    assert "sheen of the surroundings on materials [0]: takes 30%" in str(said)
    assert "within 24°" in str(said)
    kept = result.json("materials")["sheen"]
    np.testing.assert_allclose(kept["harmonics"], np.arange(36) / 100)
    assert kept["materials"][0] == {"id": 0, "gain": 0.3}
    # The diffuse colour stays; renderings take the level and the strength
    diffuse = texels.to_images(result.attribute("final_diffuse") / np.float32(100))[0]
    np.testing.assert_allclose(result.map("diffuse")[0], diffuse, rtol=1e-6)
    (look,) = read_appearance(result)
    on = texels.to_images(mine, False)[0]
    np.testing.assert_allclose(look.diffuse[on], 0.4, rtol=1e-6)
    assert (look.sheen[on] == 0.5).all()
    assert np.isnan(look.sheen[~on]).all()
    assert np.nanmax(np.abs(look.diffuse[~on] - diffuse[~on])) < 0.1

    # Without it nothing of it is left
    monkeypatch.undo()
    result.apply(GLOSS, rounds=3, samples=50_000, sheen="none")
    assert "sheen" not in result.attributes()
    assert result.json("materials")["sheen"] is None
    (look,) = read_appearance(result)
    assert look.sheen is None


def test_it_is_not_sought_where_a_lamp_shows(result):
    labels = result.attribute("material")
    observed = np.array([False, True])
    assert _sheen.seek_sheen(result, labels, observed, None, lambda *a: None) is None
