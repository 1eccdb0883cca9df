"""The basis materials: clusters of texels of like diffuse colour."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, texture_files
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.labels import from_image

from ._clusters import find_clusters
from ._materials import set_labels

FILTER = Filter(
    name="compute_svbrdf_materials",
    title="SVBRDF: materials",
    version=2,
    needs=("mesh", "texels", "diffuse"),
    needs_if={"lights": ("gloss", True)},  # the samples are what the diffuse colour is from
    writes=("materials",),
    parameters=(
        Parameter(
            "image", "path", "",
            help="An image in UV space, for the first texture; NAME.1.png … for others, or one of "
            "NAME.1001.png, NAME.1002.png … where they are UDIM tiles. Its grey "
            "values are the materials' ids (255, or 65535 in 16 bits, is none), or its colours "
            "are told apart (ids from 0). Empty: automatic.",
        ),
        Parameter(
            "threshold", "float", 10.0, minimum=0.5, maximum=100.0, unit="CIE Lab",
            help="How far a colour may lie from its region's mean. Lower it to tell more "
            "materials apart.",
        ),
        Parameter(
            "lightness_weight", "float", 0.2, minimum=0.0, maximum=1.0,
            help="How much lightness counts. D holds the light's shading, so that one material "
            "varies in lightness; 1 is plain CIE Lab (the paper), which grey objects may need.",
        ),
        Parameter(
            "minimum_share", "float", 0.005, minimum=0.0, maximum=0.5,
            help="Regions with less than this share of the texels are absorbed by their "
            "neighbours.",
        ),
        Parameter(
            "join", "bool", True,
            help="Join regions of like colour that do not touch.",
        ),
        Parameter(
            "gloss", "bool", False,
            help="Ask the highlights, too: clusters of one gloss become one, whatever their "
            "colours, and a cluster whose parts clearly differ in gloss becomes two. What the "
            "samples do not tell stays as the colour has it.",
        ),
    ),
    help="Seeds where the colour is most uniform, regions that grow over the surface, across UV "
    "seams, while colours stay near their mean. maps/material.png holds the ids; the layer "
    "`materials` shows them. Merge and split them with apply_svbrdf_material_merge and "
    "apply_svbrdf_material_split.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    texels = document.texels()
    if parameters.image is not None:
        path = parameters.image
        files = texture_files(path, len(texels.sizes), document.tiles())
        images = [read_image(name) for name in files]
        labels, table = from_image(images, texels.texture, texels.row, texels.col, texels.sizes)
        if table.ndim == 1:  # grey values are ids, and stay
            labels = np.where(labels >= 0, np.append(table.astype(np.int32), -1)[labels], -1)
        labels = np.where(np.isfinite(document.attribute("diffuse")).all(1), labels, -1)
        return set_labels(document, texels, labels) + f", given by {path.name}"
    labels, words = find_clusters(
        document, progress, threshold=parameters.threshold,
        lightness_weight=parameters.lightness_weight, minimum_share=parameters.minimum_share,
        join=parameters.join, gloss=parameters.gloss,
    )  # fmt: skip
    return ", ".join(filter(None, [set_labels(document, texels, labels), words]))
