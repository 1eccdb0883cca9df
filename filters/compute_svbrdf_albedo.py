"""The diffuse colour without the acquisition's light: what is shaded anew under other light."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.visibility import Rays
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.albedo import divide_light, lamp_irradiance
from meshlab_svbrdf.reflectance.ambient import openness
from meshlab_svbrdf.samples.luminance import to_srgb8

from ._lights import read_lights
from ._maps import set_texture
from ._stages import UNOBSERVED_GREY
from ._views import LAMP_RADIUS

FILTER = Filter(
    name="compute_svbrdf_albedo",
    title="SVBRDF: albedo",
    needs=("mesh", "texels", "visibility", "material_specular"),
    writes=("albedo",),
    parameters=(
        LAMP_RADIUS,
        Parameter(
            "balance", "enum", "camera", choices=("camera", "highlights"),
            help='What is white: "camera" trusts its white balance; "highlights" divides by the '
            "colour of the highlights, which is the lamps' on all materials but metals.",
        ),
    ),
    help="Divides the diffuse colour by the light that each texel received: the lamps found, with "
    "their strengths, distances and shadows, and the ambient light that makes neighbouring texels "
    "most alike. Albedo and rho_s are in one unit, of a lamp of gain 1, and known up to that. "
    "Texels that hardly any light reached stay unobserved.",
    reference="Palma et al. 2012, §9 (its limitation); Ramamoorthi and Hanrahan 2001",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    lights, ambient = read_lights(document), document.json("lights")["ambient"]
    if not lights:
        raise SvbrdfError(
            "no light was found, so that there is none to divide by: the diffuse colour is all "
            "that can be told of this object"
        )
    texels, mesh = document.texels(), document.mesh()
    refined = "refined_normal" in document.attributes()
    normal = np.asarray(document.attribute("refined_normal") if refined else texels.normal, float)

    # Add up what every texel received
    progress(0.1, "the lamps' shadows")
    received = lamp_irradiance(texels, normal, Rays(mesh), lights, parameters.lamp_radius)
    progress(0.8, "dividing")
    coefficients = document.array("visibility")
    open_ = openness(texels, mesh.faces, coefficients, normal)
    around = np.zeros(3) if ambient is None else np.array(ambient, float)

    # Divide by it, and by the lamps' colour
    diffuse = document.attribute("final_diffuse").astype(float)
    color = np.ones(3) if parameters.balance == "camera" else _highlight_color(document)
    albedo = divide_light(diffuse, received, open_, around) / color
    document.set_attribute("albedo", albedo.astype(np.float32))
    document.set_attribute("irradiance", received.astype(np.float32))
    linear = (albedo / 100).astype(np.float32)
    document.set_map("albedo", texels.to_images(linear))
    known = np.isfinite(linear).all(axis=1)
    shown = np.where(known[:, None], to_srgb8(linear), np.uint8(UNOBSERVED_GREY))
    set_texture(document, "albedo", texels, shown)
    document.show_map("albedo", "albedo")
    told = f"{100 * known.mean():.1f} % of the texels"
    if ambient is None:
        told += "; no ambient light is known, shadows stay unobserved"
    if parameters.balance == "highlights":
        told += "; lamps' colour " + ", ".join(f"{c:.2f}" for c in color)
    return told


def _highlight_color(document: Document) -> np.ndarray:
    """The colour of most texels' highlights, luminance 1."""
    found = [m for m in document.json("materials")["materials"] if m["observed"]]
    if not found:
        raise SvbrdfError(
            "balance=highlights: no material's highlight was observed, use balance=camera"
        )
    colors = np.array([m["specular_color"] for m in found])
    share = np.array([m["texels"] for m in found], float)
    color = np.exp(share @ np.log(np.maximum(colors, 1e-3)) / share.sum())
    return color / (color @ [0.2126, 0.7152, 0.0722])
