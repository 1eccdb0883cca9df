"""OBJ and its material library MTL, as text.

MTL's highlight is Ks (n·h)^Ns with the half vector h (illum 2, Blinn), neither normalised nor with
a cosine, as Phong's lobe here: Ks = ρs, Ns = 4α. Roughness and normal map are Clara.io's extension
`Pr`, `Pm`, `norm`, which Blender and others read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..geometry.mesh import Mesh
from ..geometry.mikktspace import same_rows
from .corners import outward, textured_faces


@dataclass(frozen=True)
class ObjMaterial:
    """name; maps : file names by MTL's words; ks, ns : factors; kd : where there is no map"""

    name: str
    maps: dict[str, str] = field(default_factory=dict)
    ks: float = 1.0
    ns: float = 1.0
    kd: float = 1.0


def mtl_text(materials: Sequence[ObjMaterial], head: str) -> str:
    """A material library."""
    lines = [f"# {head}", "# map_Kd is sRGB, all other maps are linear; Ks (n.h)^Ns"]
    for material in materials:
        kd, ks = (" ".join([f"{value:.6g}"] * 3) for value in (material.kd, material.ks))
        lines += ["", f"newmtl {material.name}", "Ka 0 0 0", f"Kd {kd}", f"Ks {ks}"]
        lines += [f"Ns {material.ns:.6g}", "d 1", "illum 2"]
        if "map_Pr" in material.maps:
            lines += ["Pr 1", "Pm 0"]
        lines += [f"{word} {name}" for word, name in material.maps.items()]
    return "\n".join(lines) + "\n"


def obj_text(mesh: Mesh, materials: Sequence[str], bare: str, library: str, head: str) -> str:
    """A mesh in world coordinates.

    materials : one per texture; bare : of faces without a texture
    """
    assert mesh.uv is not None
    turn = outward(mesh)
    wedge = mesh.uv.reshape(-1, 2).astype(np.float32)
    number = same_rows([*wedge.T])
    table = np.empty((number.max(initial=-1) + 1, 2), np.float32)
    table[number] = wedge
    number = number.reshape(-1, 3)[:, turn] + 1
    corner = mesh.faces[:, turn] + 1
    parts = [
        f"# {head}\nmtllib {library}\no object",
        _lines("v %.12g %.12g %.12g", mesh.vertices),
        _lines("vt %.8g %.8g", table),
        _lines("vn %.6f %.6f %.6f", mesh.vertex_normals()),
    ]
    groups = zip([*materials, bare], textured_faces(mesh, len(materials)), strict=True)
    for name, faces in groups:
        if len(faces):
            rows = np.stack([corner[faces], number[faces], corner[faces]], -1).reshape(-1, 9)
            parts += [f"usemtl {name}", _lines("f %d/%d/%d %d/%d/%d %d/%d/%d", rows)]
    return "\n".join(parts) + "\n"


def _lines(form: str, rows: np.ndarray) -> str:
    return "\n".join([form] * len(rows)) % tuple(rows.ravel().tolist())
