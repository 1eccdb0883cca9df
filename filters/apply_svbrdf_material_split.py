"""Splitting a cluster along a stroke, or by faces."""

from __future__ import annotations

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.material_edits import Carve, Edit, Split, read_faces

from ._materials import apply_edits, check_faces, cluster_at, read_labels

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
            "id", "int", -1, minimum=-1,
            help="The cluster; -1 takes the one under the stroke's middle point, or, with faces, "
            "makes one cluster of them whatever they belonged to.",
        ),
        Parameter(
            "faces", "string", "",
            help='In place of a stroke: the mesh\'s faces to split off, from 0, "0-120 455".',
        ),
    ),
    help="Cuts a cluster along a stroke over the surface, or splits faces off. A stroke that does "
    "not part it changes nothing and says so.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    texels, labels = document.texels(), read_labels(document)
    faces, stroke, cluster = read_faces(parameters.faces), parameters.stroke, parameters.id
    if len(faces) and len(stroke):
        raise SvbrdfError("give a stroke or faces, not both")
    if len(faces):
        check_faces(document, faces)
        edit: Edit = Carve(cluster, faces)
        what = f"{len(faces)} faces split off; "
    else:
        if len(stroke) < 2:
            raise SvbrdfError("a stroke needs two points or more")
        if cluster < 0:
            cluster = cluster_at(stroke, len(stroke) // 2, texels, labels)
        edit = Split(cluster, stroke)
        what = f"cluster {cluster} split; "
    return what + apply_edits(document, [edit], progress)
