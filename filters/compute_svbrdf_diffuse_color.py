"""The diffuse colour of every texel, without the highlights."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.diffuse import METHODS, diffuse_color

from ._maps import set_diffuse_maps
from ._stages import counted, read_observations, read_statistics, share

FILTER = Filter(
    name="compute_svbrdf_diffuse_color",
    title="SVBRDF: diffuse colour",
    needs=("mesh", "rasters", "texels", "visibility", "samples", "threshold", "environment"),
    writes=("diffuse",),
    parameters=(
        Parameter(
            "method", "enum", "statistical", choices=METHODS,
            help='"statistical" is the paper\'s; "trimmed" averages the samples below '
            'median + 1.5 MAD, "quantile" those below the first quartile, both without any model.',
        ),
        Parameter(
            "cone", "float", 5.0, minimum=0.5, maximum=45.0, unit="degrees",
            help="Half angle of the cone about the mirror direction in which the map is looked up.",
        ),
        Parameter(
            "cone_kernel", "enum", "angle", choices=("angle", "literal"),
            help="Gaussian on the angle, or on the dot product as the paper prints it.",
        ),
        Parameter(
            "cone_visibility", "bool", False,
            help="Visibility in each of the cone's directions (the paper) instead of once; slow.",
        ),
        Parameter(
            "weights", "enum", "1-s", choices=("1-s", "s"),
            help="Mean and deviation weighted with 1 − s, or with s as the paper says "
            "(biased upward).",
        ),
    ),
    help="Weighs every sample by the chance that it is specular, bounds the diffuse ones and "
    "averages them by quality: maps/diffuse.exr (linear, 1 = 255), maps/diffuse.png (the object's "
    "texture), maps/valid.png, attribute svbrdf_diffuse (0..100). The light's shading is in it.",
    reference="Palma et al. 2012, §6, eq. 3-6",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    diffuse = diffuse_color(
        read_observations(document), read_statistics(document),
        document.image("environment").astype(np.float64),
        method=parameters.method, cone=parameters.cone, cone_kernel=parameters.cone_kernel,
        cone_visibility=parameters.cone_visibility, weights=parameters.weights,
        progress=counted(progress, "texels"),
    )  # fmt: skip
    document.set_attribute("diffuse", diffuse)
    notes = set_diffuse_maps(document, document.texels(), diffuse)
    return "; ".join([f"{share(np.isfinite(diffuse[:, 0]))} of the texels", *notes])
