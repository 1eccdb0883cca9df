"""Several edits of the clusters at once: what `meshlab-svbrdf view` saves."""

from __future__ import annotations

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.material_edits import from_text

from ._materials import apply_edits

FILTER = Filter(
    name="apply_svbrdf_material_edits",
    title="SVBRDF: edit materials",
    needs=("mesh", "texels", "materials"),
    writes=("materials",),
    parameters=(
        Parameter(
            "edits", "string", "",
            help='Merges and splits, parted by "|" or on lines of their own: "merge 0 3 | split 4 '
            'stroke x y z; x y z | split -1 faces 0-120 455".',
        ),
        Parameter(
            "anew", "bool", False,
            help="Begin with the clusters as they were before any edit, so that no edits undo all.",
        ),
    ),
    help="Merges and splits clusters, all of it or, where one is refused, nothing. "
    "material_edits.mlx in the result folder holds them as a script.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    edits = from_text(parameters.edits)
    said = apply_edits(document, edits, progress, anew=parameters.anew)
    return f"{len(edits)} edits{', from the start' if parameters.anew else ''}; {said}"
