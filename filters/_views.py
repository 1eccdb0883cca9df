"""Images from the cameras of a project, one PNG per raster."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.project import RasterEntry, read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.rendering.surface import SurfaceRenderer
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ._stages import UNOBSERVED_GREY

CAMERAS = Parameter(
    "cameras", "path", "", help="A project whose rasters are the views; empty: this one's own."
)
FOLDER = Parameter(
    "folder", "path", "",
    help="Where the images go, one PNG per raster under its file's name.",
)  # fmt: skip
SUPERSAMPLING = Parameter(
    "supersampling", "int", 3, minimum=1, maximum=8, help="Rays per pixel and direction."
)
REFLECTANCE = Parameter(
    "reflectance", "enum", "best", choices=("best", "phong"),
    help="Microfacets where they describe a material better, or Phong's lobe everywhere.",
)  # fmt: skip
BACKGROUND = Parameter(
    "background", "int", UNOBSERVED_GREY, minimum=0, maximum=255,
    help="The grey around the object, an sRGB code.",
)  # fmt: skip


def views(document: Document, parameters: Namespace) -> list[tuple[str, RasterEntry]]:
    """The rasters to render, and their images' names; SvbrdfError where there are none."""
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
    return list(zip(names, project.rasters, strict=True))


def render_views(
    renderer: SurfaceRenderer, wanted: list[tuple[str, RasterEntry]], parameters: Namespace,
    progress: Progress,
) -> str:  # fmt: skip
    """Write the images; how many there are, in words."""
    folder = Path(parameters.folder)
    folder.mkdir(parents=True, exist_ok=True)
    grey = float(decode(np.array(parameters.background / 255)))
    for name, raster in progress.over(wanted, "views"):
        image, coverage = renderer.render(raster.camera, parameters.supersampling)
        write_png(folder / name, to_srgb8(image + grey * (1 - coverage[..., None])))
    return f"{len(wanted)} views in {folder}"
