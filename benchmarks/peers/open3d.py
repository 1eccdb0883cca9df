"""Open3D's projection of the frames onto a texture: `TriangleMesh.project_images_to_albedo`.

It averages sRGB values, by a soft maximum over how large a pixel's footprint on the surface is; all
its settings are its own. Its texture is 8-bit sRGB; outside the charts it pads, and what it has not
seen is black. Frames are handed over as they are: it knows nothing of exposures or masks.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.samples.luminance import decode

from ..scenes.score import Scores
from .capture import Capture, write_maps


def run(capture: Capture, truth: Path, folder: Path) -> Scores:
    """Seconds: reading the frames and projecting them."""
    _open3d()
    started = time.perf_counter()
    pixels = project_frames(
        capture.mesh, capture.rasters, map(capture.frame, capture.rasters), capture.size
    )
    seconds = time.perf_counter() - started
    seen = capture.inside & pixels.any(-1)
    diffuse = np.where(seen[..., None], decode(pixels / 255), np.nan)
    write_maps(folder, diffuse.astype(np.float32))
    return {"seconds": seconds}


def project_frames(
    mesh: Mesh, rasters: Sequence[RasterEntry], frames: Iterable[np.ndarray], size: int
) -> np.ndarray:
    """The texture (size, size, 3), uint8 sRGB; mesh and cameras about the object's centre."""
    open3d = _open3d()
    Tensor, Image = open3d.core.Tensor, open3d.t.geometry.Image
    assert mesh.uv is not None
    made = open3d.t.geometry.TriangleMesh(
        Tensor(mesh.vertices.astype(np.float32)), Tensor(mesh.faces.astype(np.int64))
    )
    made.triangle.texture_uvs = Tensor(mesh.uv.astype(np.float32))
    poses = []
    for raster in rasters:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = raster.camera.R, raster.camera.t
        poses.append(Tensor(pose))
    albedo = made.project_images_to_albedo(
        [Image(Tensor(frame)) for frame in frames],
        [Tensor(raster.camera.K) for raster in rasters],
        poses,
        size,
        update_material=False,
    )
    return albedo.as_tensor().numpy()


def why_not() -> str:
    """What this peer lacks on this machine, or \"\"."""
    try:
        _open3d()
    except SvbrdfError as error:
        return str(error)
    return ""


def _open3d():
    try:
        import open3d
    except ImportError as error:
        raise SvbrdfError(
            f"Open3D cannot be imported ({error}): pip install 'meshlab-svbrdf[benchmark]', and on "
            "Linux the system's libusb-1.0 and libGL"
        ) from error
    return open3d
