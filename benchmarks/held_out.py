"""How well photographs that no stage has seen are predicted: PSNR of the held-out frames.

    meshlab-svbrdf run PROJECT -o OUT --hold-out
    python benchmarks/held_out.py OUT/NAME.mlp

Every 8th photograph by name, starting with the 4th, is held out by `--hold-out`. For every method
alike, one linear gain per channel is fitted to each photograph; PSNR is taken in sRGB over the
pixels of the object (the mask's, where there is one) whose texel is valid in all methods.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame, read_mask
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer, Appearance
from meshlab_svbrdf.samples.luminance import decode, encode


def fitted(rendered: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """`rendered` (n, 3) times the linear gain per channel that brings it nearest to `truth`."""
    usable = truth.max(1) < 0.98
    product, power = (rendered * truth)[usable].sum(0), (rendered**2)[usable].sum(0)
    return rendered * np.divide(product, power, out=np.ones(3), where=power > 0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("project", help="a result whose run had --hold-out")
    document = Document.open(parser.parse_args().project)
    if not document.held_out:
        raise SystemExit("no frame was held out: run with --hold-out")
    texels, looks = document.texels(), read_appearance(document)

    def textured(attribute: str) -> list[Appearance]:
        images = texels.to_images((document.attribute(attribute) / 100).astype(np.float32))
        return [
            replace(look, diffuse=image, rho_s=np.full_like(look.rho_s, np.nan))
            for look, image in zip(looks, images, strict=True)
        ]

    mesh = document.mesh()
    methods = {
        "mean of the samples": AcquisitionRenderer(mesh, textured("mean_color"), []),
        "diffuse colour (statistical)": AcquisitionRenderer(mesh, textured("diffuse"), []),
        "diffuse colour (final)": AcquisitionRenderer(mesh, textured("final_diffuse"), []),
        "diffuse and specular": AcquisitionRenderer(mesh, looks, read_lights(document)),
    }
    valid = [
        replace(
            look,
            diffuse=np.repeat(np.isfinite(look.diffuse).all(-1)[..., None], 3, -1).astype(float),
            rho_s=np.full_like(look.rho_s, np.nan),
        )
        for look in looks
    ]
    observed = AcquisitionRenderer(mesh, valid, [])
    scores: dict[str, list[float]] = {name: [] for name in methods}
    shares = []
    for raster in document.held_out:
        camera = raster.camera
        truth = decode(read_frame(raster.path, label=raster.label) / 255)
        seen, coverage = observed.render(camera, 1)
        inside = coverage > 0 if raster.mask is None else read_mask(raster.mask, label=raster.label)
        on = inside & (coverage > 0) & (seen[..., 0] > 0.999)
        shares.append(on.sum() / max(inside.sum(), 1))
        for name, renderer in methods.items():
            image = fitted(renderer.render(camera, 2)[0][on], truth[on])
            error = encode(np.clip(image, 0, 1)) - encode(truth[on])
            scores[name].append(-10 * np.log10((error**2).mean()))
    print(f"{len(shares)} held-out frames; {np.mean(shares):.1%} of the object's pixels judged")
    for name, values in scores.items():
        print(f"{name:32} {np.mean(values):6.2f} dB   (worst {min(values):.2f})")


if __name__ == "__main__":
    main()
