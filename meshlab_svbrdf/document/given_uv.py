"""The texture coordinates that a user's file had, where `save` wrote others in their place.

They lie beside that file, layers/object.ply, as layers/object_given_uv.npz.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..blocks import blocks
from ..geometry.mesh import Mesh
from .atomic import named


@dataclass(frozen=True)
class GivenUv:
    """path : the npz file; written : digests of all texture coordinates put in place of the given

    uv, texture_index : the given ones, None where there were none
    """

    path: Path
    written: tuple[str, ...] = ()
    uv: np.ndarray | None = None
    texture_index: np.ndarray | None = None

    @classmethod
    def beside(cls, mesh_file: Path) -> GivenUv:
        """What is known of that file; nothing where `save` left its coordinates alone."""
        path = given_path(mesh_file)
        if not path.is_file():
            return cls(path)
        with np.load(path, allow_pickle=False) as stored:
            uv, texture_index = (
                stored[name] if len(stored[name]) else None for name in ("uv", "texture_index")
            )
            return cls(path, tuple(stored["written"].tolist()), uv, texture_index)

    def undo(self, mesh: Mesh) -> Mesh:
        """The mesh with its given coordinates, if it has others that `save` wrote."""
        if mesh.uv is None or not self.written or _digest(mesh.uv) not in self.written:
            return mesh
        return replace(mesh, uv=self.uv, texture_index=self.texture_index)

    def keep(self, given: Mesh, shown: Mesh) -> None:
        """Remember the given coordinates before a file with those of `shown` is written."""
        if shown.uv is None or shown.uv is given.uv:
            return
        part = self.path.with_suffix(".part.npz")
        with named(part):
            np.savez(
                part,
                written=np.array(sorted({*self.written, _digest(shown.uv)})),
                uv=np.zeros(0) if given.uv is None else given.uv,
                texture_index=np.zeros(0) if given.texture_index is None else given.texture_index,
            )
        os.replace(part, self.path)


def given_path(mesh_file: Path) -> Path:
    return mesh_file.with_name(f"{mesh_file.stem}_given_uv.npz")


def _digest(uv: np.ndarray) -> str:
    sha = hashlib.sha256()
    for own in blocks(len(uv)):
        sha.update(np.ascontiguousarray(uv[own], np.float32).data)
    return sha.hexdigest()
