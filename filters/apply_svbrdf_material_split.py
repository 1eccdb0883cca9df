"""Splitting a cluster along a stroke."""

from __future__ import annotations

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.edit import split

from ._materials import cluster_at, read_labels, set_labels

FILTER = Filter(
    name="apply_svbrdf_material_split",
    title="SVBRDF: split a material",
    needs=("mesh", "texels", "materials"),
    writes=("materials",),
    parameters=(
        Parameter(
            "stroke", "points", (),
            help="Points along the stroke, on the object, in the world's coordinates: "
            '"x y z; x y z".',
        ),
        Parameter(
            "id", "int", -1,
            help="The cluster; -1 takes the one under the stroke's middle point.",
        ),
    ),
    help="Cuts a cluster along a stroke over the surface. A stroke that does not part it changes "
    "nothing and says so.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    texels, labels = document.texels(), read_labels(document)
    if len(parameters.stroke) < 2:
        raise SvbrdfError("a stroke needs two points or more")
    stroke = parameters.stroke - texels.center
    cluster = parameters.id
    if cluster < 0:
        cluster = cluster_at(parameters.stroke[len(stroke) // 2], texels, labels)
    progress(0.1, "walking over the surface")
    adjacency = neighbours(texels.position, texels.normal)
    parts = split(labels, cluster, stroke, texels.position, texels.normal, adjacency)
    return f"cluster {cluster} split; " + set_labels(document, texels, parts)
