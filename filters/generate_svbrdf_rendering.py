"""The object under the light it was filmed in, from the cameras of another project."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.microfacet import NAMES, PHONG
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance

from ._lights import read_lights
from ._sheen import with_sheen
from ._views import BACKGROUND, LAMP_RADIUS, REFLECTANCE, VIEWS, render_views, views

FILTER = Filter(
    name="generate_svbrdf_rendering",
    title="SVBRDF: render the acquisition's light",
    needs=("mesh", "texels", "material_specular"),
    parameters=(
        *VIEWS,
        Parameter("shadows", "bool", True, help="Whether the object shades its own highlights."),
        LAMP_RADIUS,
        replace(REFLECTANCE, help=f"{REFLECTANCE.help} D stays the best one's."),
        BACKGROUND,
    ),
    help="Renders D + Σ ρ g V (l·r)^α, or microfacets' highlights, with near lights and shadows, "
    "on grey. D holds the lights' shading: it is not shaded again.",
    reference="Palma et al. 2012, eq. 1",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    wanted = views(document, parameters)
    renderer = AcquisitionRenderer(
        document.mesh(), read_appearance(document, parameters.reflectance == "best"),
        read_lights(document), parameters.shadows, parameters.lamp_radius,
    )  # fmt: skip
    return render_views(renderer, wanted, parameters, progress)


def read_appearance(document: Document, microfacets: bool = True) -> list[Appearance]:
    """The last estimator's maps, one entry per texture; D with the ambient light's highlight.

    microfacets : whether they stand for Phong's lobe where they describe a material better
    """
    materials = document.json("materials")["materials"]
    labels = document.attribute("material")
    table = np.full((max((m["id"] for m in materials), default=0) + 2, 7), np.nan)
    table[:, 2:] = [PHONG, 0, 1, 1, 1]
    for m in materials:
        found = m.get("reflectance") if microfacets else None
        table[m["id"]] = [
            m["rho_s_lobe"] or np.nan, m["alpha_lobe"] or np.nan, PHONG, 0, *m["specular_color"],
        ] if found is None else [
            found["strength"] * found["f0"], found["roughness"], NAMES.index(found["model"]),
            found["strength"] * (1 - found["f0"]), *found["color"],
        ]  # fmt: skip
    texels = document.texels()
    rho_s, alpha = (texels.to_images(column) for column in table[labels, :2].T)
    kind = texels.to_images(table[labels, 2].astype(np.int64), PHONG)
    grazing = texels.to_images(table[labels, 3], 0.0)
    tints = texels.to_images(table[labels, 4:], 1.0)
    turns: list[np.ndarray | None] = [None] * len(tints)
    refined = "refined_normal" in document.attributes()
    if refined or document.has_array("texels_detail"):
        normal = document.attribute("refined_normal") if refined else texels.normal
        turns = [*texels.to_images(normal - texels.smooth_normals(document.mesh()))]
    inside = texels.to_images(np.ones(len(texels), bool), False)
    diffuse = document.map("diffuse")
    if "ambient_highlight" in document.attributes():
        ambient = texels.to_images(document.attribute("ambient_highlight") / np.float32(100), 0)
        diffuse = [d + a for d, a in zip(diffuse, ambient, strict=True)]
    maps = (diffuse, rho_s, alpha, tints, turns, inside, kind, grazing)
    return with_sheen(document, [Appearance(*each) for each in zip(*maps, strict=True)])
