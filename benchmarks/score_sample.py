"""How near a result of the sample project `totem` comes to the truth beside it.

    meshlab-svbrdf run sample_projects/totem/totem.mlp -o out
    python benchmarks/score_sample.py out/totem.mlp

Prints errors of light directions and gains, of the diffuse colour (CIEDE2000), of ρs and α per true
material, and of renderings from the four held-out views. Lights of gain 1 are the geometric mean of
the true intensities, so the true ρs is multiplied by that mean before it is compared.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path

import cv2
import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it warns of its optional dependencies
    import colour

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.samples.luminance import encode

TRUTH = Path(__file__).parents[1] / "sample_projects" / "totem" / "ground_truth"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("project", help="a result of the totem, such as out/totem.mlp")
    parser.add_argument("--truth", type=Path, default=TRUTH, help="another ground_truth folder")
    arguments = parser.parse_args()
    document, truth = Document.open(arguments.project), arguments.truth
    print_lights(document, truth)
    print_diffuse(document, truth)
    print_materials(document, truth)
    print_views(document, truth)


def true_gain(truth: Path) -> float:
    """The true intensity of a light of gain 1: their geometric mean."""
    emitters = json.loads((truth / "lights.json").read_text())["emitters"]
    return float(np.exp(np.mean([np.log(np.mean(e["phong_intensity"])) for e in emitters])))


def print_lights(document: Document, truth: Path) -> None:
    """Angles as seen from the centre; every true light takes the nearest one found."""
    center = document.mesh().center
    found = document.json("lights")["lights"]
    rays = np.array([light["direction"] for light in found]).reshape(-1, 3)
    for emitter in json.loads((truth / "lights.json").read_text())["emitters"]:
        away = np.array(emitter["position"]) - center
        angle = np.degrees(np.arccos(np.clip(rays @ away / np.linalg.norm(away), -1, 1)))
        if not len(angle) or angle.min() > 10:
            print(f"light {emitter['name']:12} missed")
            continue
        light = found[int(angle.argmin())]
        gain = light["gain"] * true_gain(truth) / np.mean(emitter["phong_intensity"])
        words = f"{angle.min():6.3f}° off, gain {100 * (gain - 1):+.1f} %"
        if light["position"] is not None:
            distance = np.linalg.norm(np.array(light["position"]) - center)
            words += f", distance {100 * (distance / np.linalg.norm(away) - 1):+.1f} %"
        print(f"light {emitter['name']:12} {words}")
    print(f"lights found       {len(found)}")


def print_diffuse(document: Document, truth: Path) -> None:
    """CIEDE2000 at the truth's resolution, where the map is observed and the truth not clipped."""
    shaded = read_exr(truth / "diffuse_shaded.exr").astype(np.float64)
    size = shaded.shape[1::-1]
    inside = _shrink((read_image(truth / "texel_mask.png") > 127).astype(float), size) > 0.999
    inside &= np.isfinite(shaded).all(-1) & (shaded.max(-1) < 1)
    diffuse = document.map("diffuse")[0].astype(np.float64)
    observed = np.isfinite(diffuse).all(-1)
    weight = _shrink(observed.astype(float), size)
    mean = _shrink(np.nan_to_num(diffuse) * observed[..., None], size)
    seen = inside & (weight > 0.5)
    error = colour.delta_E(_lab(mean[seen] / weight[seen][:, None]), _lab(shaded[seen]))
    print(
        f"diffuse colour     ΔE2000 mean {error.mean():.2f}, median {np.median(error):.2f}, "
        f"95 % below {np.quantile(error, 0.95):.2f}; {seen.sum() / inside.sum():.1%} of the surface"
    )


def print_materials(document: Document, truth: Path) -> None:
    """ρs and α over the inside of every true material: medians of the texels observed."""
    ids = read_image(truth / "material_id.png")
    charts = read_image(truth / "texel_mask.png") > 127
    rho_s, alpha = (document.map(name)[0] for name in ("rho_s", "alpha"))
    for material in json.loads((truth / "materials.json").read_text())["materials"]:
        own = ((ids == material["id"]) & charts).astype(np.uint8)
        own = cv2.resize(own, rho_s.shape[::-1], interpolation=cv2.INTER_NEAREST)
        own = cv2.erode(own, np.ones((5, 5), np.uint8)) > 0
        seen = own & np.isfinite(rho_s)
        words = f"observed on {seen.sum() / own.sum():.1%}"
        if material["rho_s"] == 0:
            words += " (the truth has no gloss: 0 % is right)"
        elif seen.any():
            expected = material["rho_s"] * true_gain(truth)
            words += _against("rho_s", float(np.median(rho_s[seen])), expected)
            words += _against("alpha", float(np.median(alpha[seen])), material["alpha"])
        print(f"material {material['name']:9} {words}")


def print_views(document: Document, truth: Path) -> None:
    """PSNR in sRGB over the object's pixels, all of them and the brightest tenth."""
    project = read_project(truth / "views" / "project.mlp")
    renderer = AcquisitionRenderer(
        document.mesh(), read_appearance(document), read_lights(document)
    )
    everywhere, highlights = [], []
    for raster in project.rasters:
        expected = read_image(raster.path)[..., :3] / 255
        rendered, coverage = renderer.render(raster.camera, 3)
        on = cv2.erode((coverage > 0.999).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        error = ((encode(np.clip(rendered[on], 0, 1)) - expected[on]) ** 2).mean(-1)
        bright = expected[on].mean(-1)
        everywhere.append(-10 * np.log10(error.mean()))
        highlights.append(-10 * np.log10(error[bright >= np.quantile(bright, 0.9)].mean()))
    print(
        f"held-out views     {np.mean(everywhere):.1f} dB, "
        f"brightest tenth {np.mean(highlights):.1f} dB ({len(everywhere)} views)"
    )


def _against(name: str, found: float, expected: float) -> str:
    return f"; {name} {found:.3g}, true {expected:.3g} ({100 * (found / expected - 1):+.1f} %)"


def _lab(linear: np.ndarray) -> np.ndarray:
    return colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(linear, 0, 1), "sRGB"))


def _shrink(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    main()
