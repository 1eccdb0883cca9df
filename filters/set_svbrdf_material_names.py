"""Names for the clusters."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress

from ._materials import read_labels

FILTER = Filter(
    name="set_svbrdf_material_names",
    title="SVBRDF: name materials",
    needs=("materials",),
    writes=("material_names",),
    parameters=(
        Parameter(
            "names", "string", "", help='An id and its name each, "0 gold; 3 weathered oak".'
        ),
    ),
    help="Writes material_names.json; `meshlab-svbrdf info` and `view` show the names. They belong "
    "to the clusters as they are now.",
)


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    there = set(np.unique(read_labels(document)).tolist()) - {-1}
    names: dict[str, str] = {}
    for entry in filter(None, map(str.strip, parameters.names.split(";"))):
        identity, _, name = entry.partition(" ")
        if not identity.isdecimal() or not name.strip():
            raise SvbrdfError(f"names has {entry!r}, expected an id and a name, such as 0 gold")
        if int(identity) not in there:
            raise SvbrdfError(f"there is no material {identity} to name")
        names[str(int(identity))] = " ".join(name.split())
    document.set_json("material_names", names)
    return f"{len(names)} materials named"
