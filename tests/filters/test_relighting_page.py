"""Albedo and relighting on a small film: against its truth, and against the acquisition's light."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scores import psnr
from totems import VIDEO, contents, copied, film

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image, write_exr
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.samples.luminance import decode

ALBEDO, RELIGHT = "compute_svbrdf_albedo", "generate_svbrdf_relighting"
RENDER = "generate_svbrdf_rendering"


@pytest.fixture
def truth(tmp_path_factory) -> Path:
    return film(tmp_path_factory, VIDEO).parent / "ground_truth"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, VIDEO, tmp_path / "result")


def scaled_error(found: np.ndarray, true: np.ndarray) -> float:
    """Median ratio taken off, the median of |ln| that is left."""
    ratio = np.log(np.maximum(found, 1e-4)) - np.log(np.maximum(true, 1e-4))
    return float(np.median(np.abs(ratio - np.median(ratio))))


def test_albedo_is_the_truths_up_to_one_scale(result, truth):
    said = result.apply(ALBEDO).message
    assert "% of the texels" in said
    albedo, diffuse = result.map("albedo")[0], result.map("diffuse")[0]
    true = decode(read_image(truth / "albedo.png")[..., :3] / 255)
    true = cv2.resize(true, albedo.shape[1::-1], interpolation=cv2.INTER_AREA)
    known = np.isfinite(albedo).all(-1)
    assert known.sum() > 0.8 * np.isfinite(diffuse).all(-1).sum()
    error = scaled_error(albedo[known], true[known])
    assert error < 0.4 * scaled_error(diffuse[known], true[known])
    assert error < 0.08  # measured 0.065; D itself 0.49


def test_the_acquisitions_own_light_gives_back_its_picture(result, truth, tmp_path):
    """D divided by the light and lit by it again."""
    views = truth / "views" / "project.mlp"
    result.apply(ALBEDO)
    result.apply(RENDER, cameras=views, folder=tmp_path / "lit", reflectance="phong")
    lights = result.folder / "lights.json"
    before = contents(result.folder)
    said = result.apply(
        RELIGHT, lights=lights, cameras=views, folder=tmp_path / "relit", reflectance="phong"
    )
    assert contents(result.folder) == before
    assert "1 views" in said.message
    a, b = (read_image(tmp_path / name / "view_00.png") for name in ("lit", "relit"))
    assert psnr(b, a)[0] > 32  # measured 33.3


def test_more_exposure_is_brighter_and_a_turned_sky_is_another(result, truth, tmp_path):
    result.apply(ALBEDO)
    sky = np.zeros((16, 32, 3), np.float32)
    sky[:8, :16] = 0.8
    write_exr(tmp_path / "sky.exr", sky)

    def show(name, **given):
        result.apply(
            RELIGHT, environment=tmp_path / "sky.exr", cameras=truth / "views" / "project.mlp",
            folder=tmp_path / name, supersampling=1, directions=64, background=0, **given,
        )  # fmt: skip
        return decode(read_image(tmp_path / name / "view_00.png") / 255)

    plain, brighter = show("plain"), show("brighter", exposure=1.0)
    bright = (plain > 0.02) & (brighter < 0.9)
    np.testing.assert_allclose(brighter[bright] / plain[bright], 2, rtol=0.05)
    assert np.abs(show("turned", turn=90.0) - plain).max() > 0.05


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "neither lights nor an environment"),
        ({"lights": {"lights": [{"position": [0, 0, 0]}]}}, "light 0 stands"),
        ({"environment": np.zeros((8, 8, 3), np.float32)}, "twice as wide as high"),
        ({"environment": np.full((8, 16, 3), np.inf, np.float32)}, "finite radiances"),
    ],
)
def test_what_cannot_shine_is_said(result, truth, tmp_path, given, said):
    result.apply(ALBEDO)
    if "lights" in given:
        center = result.array("texels_center").tolist()
        told = {"lights": [{"position": center}]}
        (tmp_path / "lights.json").write_text(json.dumps(told))
        given = {"lights": tmp_path / "lights.json"}
    if "environment" in given:
        write_exr(tmp_path / "sky.exr", given["environment"])
        given = {"environment": tmp_path / "sky.exr"}
    with pytest.raises(SvbrdfError, match=said):
        result.apply(
            RELIGHT, cameras=truth / "views" / "project.mlp", folder=tmp_path / "x", **given
        )


def test_without_lights_there_is_nothing_to_divide_by(result):
    path = result.folder / "lights.json"
    told = json.loads(path.read_text()) | {"lights": []}
    path.unlink()  # it is shared with the original
    path.write_text(json.dumps(told))
    before = contents(result.folder)
    with pytest.raises(SvbrdfError, match="no light was found"):
        result.apply(ALBEDO)
    assert contents(result.folder) == before


def test_the_highlights_colour_can_be_what_is_white(result):
    result.apply(ALBEDO)
    plain = read_exr(result.folder / "maps" / "albedo.exr")
    said = result.apply(ALBEDO, balance="highlights").message
    assert "lamps' colour" in said
    balanced = read_exr(result.folder / "maps" / "albedo.exr")
    ratio = (plain / balanced)[np.isfinite(plain).all(-1)]
    np.testing.assert_allclose(ratio, np.broadcast_to(np.median(ratio, 0), ratio.shape), rtol=1e-3)
