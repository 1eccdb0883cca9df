"""Merging clusters that are one material."""

from __future__ import annotations

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.material_edits import Merge

from ._materials import apply_edits, cluster_at, read_labels

FILTER = Filter(
    name="apply_svbrdf_material_merge",
    title="SVBRDF: merge materials",
    needs=("mesh", "texels", "materials"),
    writes=("materials",),
    parameters=(
        Parameter(
            "ids", "string", "",
            help='The clusters to merge, "0 3 5"; the smallest id is kept.',
        ),
        Parameter("points", "points", (), help="Or points on them, in the world's coordinates."),
    ),
    help="Makes one cluster of several, named by their ids or picked by points on the object.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    texels, labels = document.texels(), read_labels(document)
    try:
        ids = [int(word) for word in parameters.ids.replace(",", " ").split()]
    except ValueError:
        raise SvbrdfError(
            f"ids is {parameters.ids!r}, expected whole numbers, such as 0 3 5"
        ) from None
    points = parameters.points
    ids += [cluster_at(points, k, texels, labels) for k in range(len(points))]
    ids = list(dict.fromkeys(ids))
    if len(ids) < 2:
        raise SvbrdfError(f"merging needs two clusters or more, and {ids or 'none'} was named")
    said = apply_edits(document, [Merge(tuple(sorted(ids)))], progress)
    return f"merged {', '.join(map(str, ids))}; {said}"
