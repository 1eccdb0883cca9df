"""A look at some frames before all are projected: do cameras, mesh and pictures belong together?"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_mask, reduced
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.raster import rasterise_depth
from meshlab_svbrdf.samples.choose_frames import choose_frames
from meshlab_svbrdf.samples.outline import Offset, outline_offset
from meshlab_svbrdf.threads import thread_count

LOOKED_AT = 12  # frames
WIDE = 480  # pixels that frames are reduced to at least
OFF = 0.01
"""Of the image's diagonal: .2 % at most on real scenes; 20 pixels of 640×480 are 2.5 %."""
FOUND = 0.3
"""Agreement of outlines and edges: .41 to .59 on real scenes, .1 to .25 with another mesh."""


def look_at_outlines(mesh: Mesh, rasters: list[RasterEntry]) -> tuple[dict[str, Any] | None, str]:
    """Medians over some frames, and what there is to be said about them, or "".

    Masks are looked at where there are any. None where the outline lies outside of all frames.
    """
    some = choose_frames([r.camera for r in rasters], mesh.center, mesh.radius, LOOKED_AT)
    with Frames(rasters) as frames, ThreadPoolExecutor(thread_count()) as pool:
        found = list(pool.map(lambda k: _look(mesh, rasters[k], frames), some))
    seen = [(offset, diagonal) for offset, diagonal in found if offset is not None]
    if not seen:
        return None, ""
    share = float(np.median([offset.pixels / diagonal for offset, diagonal in seen]))
    agreement = float(np.median([offset.best for offset, _ in seen]))
    pixels = share * float(np.median([np.hypot(r.camera.width, r.camera.height) for r in rasters]))
    told = {"pixels": pixels, "agreement": agreement, "frames": len(seen)}
    if agreement < FOUND:
        return told, (
            f"the object's outline is not found in the frames (agreement {agreement:.2f}, usual "
            f"{FOUND} to 1): cameras or mesh are not this object's, or nothing sets it off"
        )
    if share > OFF:
        return told, (
            f"the object's outline lies {pixels:.0f} pixels off in the frames: the cameras are "
            "wrong (meshlab-svbrdf register refines them), or the mesh is of another shape"
        )
    return told, ""


def _look(mesh: Mesh, raster: RasterEntry, frames: Frames) -> tuple[Offset | None, float]:
    """A frame's offset in reduced pixels, and the diagonal of the reduced frame."""
    times = next((n for n in (4, 2) if raster.camera.width >= n * WIDE), 1)
    camera = raster.camera.reduced(times)
    depth = rasterise_depth(mesh.vertices, mesh.faces, camera)
    size = (raster.camera.width, raster.camera.height)
    if raster.mask is None:
        image = frames.read(raster, times)
    else:
        mask = read_mask(raster.mask, label=raster.label, size=size)
        image = reduced(255 * mask.astype(np.uint8), times) > 127
    return outline_offset(depth, image), float(np.hypot(camera.width, camera.height))
