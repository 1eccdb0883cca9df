"""Where the light comes from: the object is the probe."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.environment import environment_map

from ._sphere import set_environment_layer
from ._stages import counted, read_observations, read_statistics, share

ENOUGH = 2_000_000  # samples from which 128 rows are not noisy: 60 a pixel

FILTER = Filter(
    name="generate_svbrdf_environment_map",
    title="SVBRDF: environment map",
    needs=("mesh", "rasters", "texels", "visibility", "samples", "threshold"),
    writes=("environment",),
    parameters=(
        Parameter(
            "height", "int", 0, minimum=0, maximum=1024, unit="pixels",
            help="Rows of the latitude-longitude map. 0: 128, or 64 for photographs and where "
            "there are fewer than 2 million samples.",
        ),
        Parameter(
            "samples", "int", 2_000_000, minimum=1000,
            help="About how many samples to use, of evenly spaced texels; more only cost time.",
        ),
        Parameter(
            "normalisation", "enum", "weight", choices=("weight", "count"),
            help="Divide a pixel by Σ q·V of all samples that fall there, or by their count "
            "(the paper).",
        ),
        Parameter(
            "scale", "enum", "quantile", choices=("quantile", "max"),
            help="What becomes 1: the 99.9th percentile, or the largest pixel (the paper).",
        ),
    ),
    help="Accumulates (Y − t)·V(r)·q of the samples above the threshold along their mirror "
    "directions, normalised by what falls there. environment.exr is in [0, 1]; its pole is the "
    "world's +Y. The layer `environment` is a sphere around the object that shows it.",
    reference="Palma et al. 2012, §5, eq. 2",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    observations, statistics = read_observations(document), read_statistics(document)
    few = document.json("frames")["stills"] or len(observations.store) < ENOUGH
    height = parameters.height or (64 if few else 128)
    found = environment_map(
        observations, statistics, height=height, samples=parameters.samples,
        normalisation=parameters.normalisation, scale=parameters.scale,
        progress=counted(progress, "samples"),
    )  # fmt: skip
    document.set_array("environment_radiance", found.radiance)
    document.set_array("environment_weight", found.weight)
    document.set_image("environment", found.probability.astype(np.float32))
    set_environment_layer(document, found.probability, [])
    return (
        f"{2 * height}×{height}, {share(found.seen.ravel())} of the directions mirrored somewhere"
    )
