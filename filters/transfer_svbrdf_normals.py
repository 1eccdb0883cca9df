"""Normals of a detailed layer, baked onto the texels of the simplified object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter, Percentage
from meshlab_svbrdf.geometry.bake import bake_normals
from meshlab_svbrdf.geometry.normal_maps import encode_normal_map
from meshlab_svbrdf.progress import Progress

from ._stages import share

FILTER = Filter(
    name="transfer_svbrdf_normals",
    title="SVBRDF: bake normals",
    needs=("mesh", "texels"),
    writes=("texels",),
    parameters=(
        Parameter("source", "layer", "", help="Label of the layer with the detailed mesh."),
        Parameter(
            "max_distance", "length", Percentage(1.0), minimum=0.0,
            help="How far the two surfaces may lie apart: a few times the largest gap.",
        ),
    ),
    help="Shoots a ray along each texel's normal, both ways, onto the detailed layer and takes its "
    "normal. Texels that miss keep their own and are marked in the attribute svbrdf_baked. "
    "maps/normal.png is the baked map in tangent space. The detailed layer is hidden.",
    reference="Palma et al. 2012, §8 (the normal map of the high-resolution mesh)",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    own = document.object_layer().label
    layers = {layer.label: layer for layer in document.layers if not layer.ours}
    if parameters.source not in layers or parameters.source == own:
        others = ", ".join(repr(label) for label in layers if label != own) or "none"
        raise SvbrdfError(
            f"source is {parameters.source!r}, expected the label of another mesh layer "
            f"(there are: {others})"
        )
    texels = document.texels()
    progress(0.1, "shooting rays")
    mesh = document.mesh()
    normals, hit = bake_normals(
        texels.position + texels.center, texels.smooth_normals(mesh),
        document.mesh(layers[parameters.source]),
        float(parameters.max_distance),
    )  # fmt: skip
    if not hit.any():
        raise SvbrdfError(
            f"layer {parameters.source!r} is nowhere within {parameters.max_distance:g} of "
            f"{own!r}: check that the two are aligned, or raise max_distance"
        )
    document.set_map("normal", encode_normal_map(texels, mesh, normals), kind="png")
    document.show_map("normal")
    document.set_texels(replace(texels, normal=normals.astype(np.float32)))
    document.set_array("texels_detail", hit)
    document.set_attribute("baked", hit.astype(np.uint8))
    layers[parameters.source].visible = False  # it would cover the object in MeshLab
    return f"{share(hit)} of the texels got the normal of {parameters.source!r}"
