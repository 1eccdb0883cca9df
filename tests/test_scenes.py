"""Long sequences, where they are: MESHLAB_SVBRDF_SCENES names the folder of the scenes.

Every 4th frame and small textures; the full figures are the benchmarks'.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import scores
from totems import ENVIRONMENT, SAMPLES, TEXELS, run

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame, read_mask
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.samples.luminance import decode, encode

FOLDER = os.environ.get("MESHLAB_SVBRDF_SCENES")
pytestmark = pytest.mark.skipif(not FOLDER, reason="MESHLAB_SVBRDF_SCENES names no folder")


def scene(name: str) -> Path:
    project = Path(FOLDER) / name / f"{name}.mlp"
    if not project.is_file():
        pytest.skip(f"{project} is not there")
    return project


def test_bust_under_floodlights(tmp_path):
    """Measured: lights .02°, ln gain .001; ΔE 1.30, median .50; |ln rho_s|, |ln alpha| .02."""
    project = scene("bust_floods")
    document = Document.open(project, tmp_path)
    run(document, **{TEXELS: {"texture_size": 256}, SAMPLES: {"step": 4}})
    truth = project.parent / "ground_truth"
    lights = scores.lights(document, truth)
    assert (lights.missed, lights.false) == (0, 0)
    assert lights.angle < 0.1
    assert lights.ln_gain < 0.01
    assert lights.ln_distance < 0.04
    error = scores.diffuse(document, truth)
    assert error.mean() < 1.5
    assert np.median(error) < 0.6
    for gloss in scores.gloss(document, truth).values():
        assert gloss.observed > 0.9
        assert abs(gloss.ln_rho_s) < 0.06
        assert abs(gloss.ln_alpha) < 0.06


def test_photographs_of_the_gold_cape(tmp_path):
    """What a mesh without the embossing shows is no gloss; ceiling light comes from above."""
    document = Document.open(scene("goldcape"), tmp_path)
    document.hold_out()
    said = run(document, **{TEXELS: {"texture_size": 256}})
    assert "exposure: exif" in said[SAMPLES].message
    assert "stills, 14° apart" in said[SAMPLES].message
    frames = document.json("frames")
    assert frames["gains_fitted"]
    assert sum(frame.get("left_out") == "held out" for frame in frames["frames"]) == 15
    assert not any(m["observed"] for m in document.json("materials")["materials"])
    assert np.isnan(document.map("rho_s")[0]).all()

    # Compare the light from above with that from below, as the photographers stood
    environment, rays = document.image("environment"), directions(64)
    assert "128×64" in said[ENVIRONMENT].message
    up = -np.mean([raster.camera.R[1] for raster in document.rasters], axis=0)
    up /= np.linalg.norm(up)
    above, below = (environment[s * (rays @ up) > 0.7].mean() for s in (1, -1))
    assert above > 2 * below  # measured .148, .033

    # Predict the photographs that were held out
    renderer = AcquisitionRenderer(
        document.mesh(), read_appearance(document), read_lights(document)
    )
    found = [predicted(renderer, raster) for raster in document.held_out[::3]]
    assert np.mean(found) > 16.5  # measured 17.0


def predicted(renderer: AcquisitionRenderer, raster) -> float:
    """PSNR in sRGB over the mask, after one linear gain per channel."""
    true = decode(read_frame(raster.path) / 255)
    image, coverage = renderer.render(raster.camera, 1)
    on = (coverage > 0) & (true.max(-1) < 0.98)
    if raster.mask is not None:
        on &= read_mask(raster.mask)
    image, true = image[on], true[on]
    image = image * (image * true).sum(0) / (image**2).sum(0)
    return -10 * np.log10(((encode(np.clip(image, 0, 1)) - encode(true)) ** 2).mean())
