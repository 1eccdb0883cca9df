"""The object under the light it was filmed in, from the cameras of another project."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.microfacet import NAMES, PHONG
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer, Appearance
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ._lights import read_lights
from ._sheen import with_sheen
from ._stages import UNOBSERVED_GREY

FILTER = Filter(
    name="generate_svbrdf_rendering",
    title="SVBRDF: render the acquisition's light",
    needs=("mesh", "texels", "material_specular"),
    parameters=(
        Parameter(
            "cameras", "path", "",
            help="A project whose rasters are the views; empty: this one's own.",
        ),
        Parameter(
            "folder", "path", "",
            help="Where the images go, one PNG per raster under its file's name.",
        ),
        Parameter(
            "supersampling", "int", 3, minimum=1, maximum=8, help="Rays per pixel and direction."
        ),
        Parameter("shadows", "bool", True, help="Whether the object shades its own highlights."),
        Parameter(
            "reflectance", "enum", "best", choices=("best", "phong"),
            help="Microfacets where they describe a material better, or Phong's lobe everywhere. D "
            "stays the best one's.",
        ),
        Parameter(
            "background", "int", UNOBSERVED_GREY, minimum=0, maximum=255,
            help="The grey around the object, an sRGB code.",
        ),
    ),
    help="Renders D + Σ ρ g V (l·r)^α, or microfacets' highlights, with near lights and shadows, "
    "on grey. D holds the lights' shading: it is not shaded again.",
    reference="Palma et al. 2012, eq. 1",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    if parameters.folder is None:
        raise SvbrdfError("folder is empty: say where the images go")
    project = document.project if parameters.cameras is None else read_project(parameters.cameras)
    if not project.rasters:
        raise SvbrdfError(f"{project.path}: has no rasters to take cameras from")
    names = [Path(raster.path.name).with_suffix(".png").name for raster in project.rasters]
    if len(set(names)) < len(names):
        raise SvbrdfError(
            f"{project.path}: two rasters have the same file name, and would overwrite each other"
        )
    renderer = AcquisitionRenderer(
        document.mesh(), read_appearance(document, parameters.reflectance == "best"),
        read_lights(document), parameters.shadows,
    )  # fmt: skip
    folder = Path(parameters.folder)
    folder.mkdir(parents=True, exist_ok=True)
    grey = float(decode(np.array(parameters.background / 255)))
    for name, raster in zip(names, progress.over(project.rasters, "views"), strict=True):
        image, coverage = renderer.render(raster.camera, parameters.supersampling)
        write_png(folder / name, to_srgb8(image + grey * (1 - coverage[..., None])))
    return f"{len(names)} views in {folder}"


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
