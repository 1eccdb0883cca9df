"""The luminance that parts diffuse from specular samples."""

from __future__ import annotations

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.threshold import (
    FEWEST_SAMPLES,
    MINIMUM_SAMPLES,
    luminance_threshold,
)

from ._stages import counted, read_observations, share

FEW = 0.05
"""Share of the texels that are seen too seldom, from which on it is said."""

FILTER = Filter(
    name="compute_svbrdf_luminance_threshold",
    title="SVBRDF: luminance threshold",
    needs=("mesh", "rasters", "texels", "samples"),
    writes=("threshold",),
    parameters=(
        Parameter(
            "minimum_quality", "float", 0.1, minimum=0.0, maximum=1.0,
            help="Samples below do not count for the threshold.",
        ),
        Parameter(
            "minimum_samples", "int", MINIMUM_SAMPLES, minimum=3, maximum=1000,
            help="Texels with fewer are unobserved. Less than 8 is for a few photographs, where "
            "else little would be seen: a highlight in one of them then counts for more.",
        ),
    ),
    help="Per texel t = μ + mean |Y − μ| of the samples' luminance, an upper bound of their "
    "median. Texels with fewer than `minimum_samples` are unobserved. Attributes: "
    "svbrdf_threshold, svbrdf_mean, svbrdf_minimum (luminance, 0..100), svbrdf_mean_color, "
    "svbrdf_samples.",
    reference="Palma et al. 2012, §5",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    statistics = luminance_threshold(
        read_observations(document, visibility=False),
        parameters.minimum_quality,
        counted(progress, "texels"),
        parameters.minimum_samples,
    )
    document.set_attribute("threshold", statistics.threshold)
    document.set_attribute("mean", statistics.mean)
    document.set_attribute("minimum", statistics.minimum)
    document.set_attribute("mean_color", statistics.color)
    document.set_attribute("samples", statistics.samples)
    said = f"{share(statistics.observed)} of the texels observed"
    few = (statistics.samples > 0) & ~statistics.observed
    if few.mean() > FEW:
        said += (
            f"; {share(few)} were seen, but by fewer than {parameters.minimum_samples} frames well "
            "enough: take more from all around"
        )
        if parameters.minimum_samples > FEWEST_SAMPLES:
            said += f", or be content with fewer (minimum_samples={FEWEST_SAMPLES})"
    return said
