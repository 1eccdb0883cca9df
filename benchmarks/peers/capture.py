"""What all peers are given: the mesh with its charts, the frames of a result, their cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels


@dataclass(frozen=True)
class Capture:
    """One object's frames as a result of ours used them.

    document : the scene's project, its results those of the run
    size : texels along each side of the texture
    mesh, rasters : about `center`, so that single precision does
    """

    document: Document
    size: int
    mesh: Mesh
    rasters: list[RasterEntry]
    frames: Frames
    center: np.ndarray

    @property
    def texels(self) -> Texels:
        """The texels of the result: where a peer's texture counts."""
        return self.document.texels()

    @property
    def inside(self) -> np.ndarray:
        """The charts, (size, size) bool."""
        texels = self.texels
        return texels.to_images(np.ones(len(texels), bool), False)[0]

    def frame(self, raster: RasterEntry) -> np.ndarray:
        """A frame's pixels, (H, W, 3) uint8 sRGB."""
        return self.frames.read(raster)


def read_capture(project: Path, result: Path, size: int) -> Capture:
    """The frames that the run behind `result` used, held-out ones left out.

    project : the scene's; result : NAME.svbrdf with its sample store

    Raises
    ------
    SvbrdfError : the result has no samples, several textures, or another texture size.
    """
    document = Document.open(project, result.with_suffix(".mlp"))
    for product in ("texels", "samples"):
        if not document.has(product):
            raise SvbrdfError(f"{result}: has no {product}: run the chain on {project} first")
    sizes = document.texels().sizes
    if sizes != ((size, size),):
        raise SvbrdfError(
            f"{result}: has textures of {sizes}, expected one of {size}×{size}: run the chain with "
            f"--texture-size {size}"
        )
    mesh = document.mesh()
    center = mesh.center
    used = {f["label"] for f in document.json("frames")["frames"] if "samples" in f}
    rasters = [
        replace(raster, camera=raster.camera.about(center))
        for raster in document.rasters
        if raster.label in used
    ]
    near = replace(mesh, vertices=mesh.vertices - center, normals=mesh.vertex_normals())
    return Capture(document, size, near, rasters, Frames(rasters), center)


def write_maps(folder: Path, diffuse: np.ndarray) -> None:
    """Write `maps/` of a peer. diffuse : (size, size, 3) linear, 1 = 255, NaN where unseen."""
    maps = folder / "maps"
    maps.mkdir(parents=True, exist_ok=True)
    valid = np.isfinite(diffuse).all(-1)
    write_exr(maps / "diffuse.exr", diffuse)
    write_png(maps / "valid.png", np.where(valid, 255, 0).astype(np.uint8))
