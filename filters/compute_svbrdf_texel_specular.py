"""ρs and α of single texels, from their luminance peaks."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.specular import texel_specular
from meshlab_svbrdf.samples.luminance import luminance

from ._stages import counted, read_lights_found, read_observations, share

FILTER = Filter(
    name="compute_svbrdf_texel_specular",
    title="SVBRDF: specular per texel",
    needs=("mesh", "rasters", "texels", "samples", "diffuse", "lights"),
    writes=("texel_specular",),
    parameters=(
        Parameter(
            "peaks", "enum", "auto", choices=("auto", "time", "direction", "none"),
            help='A peak is a run of consecutive frames ("time"), or the samples about one light '
            '("direction"), which photographs need; "auto" chooses by how far apart the frames '
            "are.",
        ),
        Parameter(
            "c_min", "enum", "half", choices=("half", "least"),
            help="The peak's second sample: nearest to half its height, or the least (the paper).",
        ),
        Parameter(
            "p", "enum", "nearest", choices=("nearest", "farthest"),
            help="Which point of the ellipse of equal distance stands for a direction.",
        ),
    ),
    help="Finds the luminance peaks of every texel, assigns each to its nearest light and solves "
    "for ρs and α. Attributes: svbrdf_rho_s (1 = 255), svbrdf_alpha, svbrdf_light_distance, "
    "svbrdf_light.",
    reference="Palma et al. 2012, §7, eq. 7-9",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    lights = read_lights_found(document) if parameters.peaks != "none" else []
    stills = document.json("frames")["stills"]
    peaks = (
        parameters.peaks
        if parameters.peaks in ("time", "direction")
        else "direction"
        if stills
        else "time"
    )
    found = texel_specular(
        read_observations(document, visibility=False), luminance(document.attribute("diffuse")),
        lights,
        peaks=peaks, c_min=parameters.c_min, p=parameters.p, progress=counted(progress, "texels"),
    )  # fmt: skip
    document.set_attribute("rho_s", found.rho_s / 100)
    document.set_attribute("alpha", found.alpha)
    document.set_attribute("light_distance", found.distance)
    document.set_attribute("light", found.light)
    if parameters.peaks == "none":
        return "skipped, as asked: no highlights are looked for"
    if not lights:
        return "skipped: there is no light"
    how = "runs of frames" if peaks == "time" else "stills: samples ordered by viewing direction"
    return f"{share(np.isfinite(found.alpha))} of the texels show a peak that tells ({how})"
