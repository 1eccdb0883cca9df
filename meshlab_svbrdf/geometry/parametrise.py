"""Texture coordinates for a mesh that has none: xatlas's charts, packed into one square texture."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import xatlas

from ..errors import SvbrdfError
from .mesh import Mesh

# The charts shrink by this step until they fit; below the least scale there is no room for texels.
SHRINK = 0.97
LEAST_SCALE = 0.1
REST = 0.01
"""Seconds until xatlas's threads sleep. One that is just falling asleep when its atlas is destroyed
misses the call to end, and is waited for for ever."""


def parametrise(mesh: Mesh, texture_size: int = 1024, padding: int = 4) -> Mesh:
    """The same mesh with texture coordinates per wedge; vertices and faces are as they were.

    Charts are cut where the surface bends (and along seams of `mesh.normals`, if given), then
    packed to fill one texture. The same mesh gives the same charts. It takes 10 to 20 s for 50k
    triangles, depending on their shape and the machine, nearly all of it for cutting.

    Parameters
    ----------
    texture_size : side of the texture, in texels
    padding : least distance between charts, in texels, so that filtering does not mix them

    Errors
    ------
    SvbrdfError where the mesh has no area or vertices that are not finite, or where its charts do
    not fit the texture with this padding
    """
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise SvbrdfError(
            "cannot parametrise a mesh without faces or with vertices that are not finite: "
            "repair it first"
        )
    scale = mesh.radius or 1.0
    positions = ((mesh.vertices - mesh.center) / scale).astype(np.float32)
    normals = None if mesh.normals is None else mesh.vertex_normals().astype(np.float32)

    # Cut the surface into flat charts
    atlas = xatlas.Atlas()
    atlas.add_mesh(positions, mesh.faces.astype(np.uint32), normals)
    atlas.generate()
    time.sleep(REST)
    _, wedges, uv = atlas.get_mesh(0)
    charts = (uv * [atlas.width, atlas.height]).astype(np.float32)
    e1, e2 = (
        charts[wedges[:, 1]] - charts[wedges[:, 0]],
        charts[wedges[:, 2]] - charts[wedges[:, 0]],
    )
    area = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]).sum() / 2
    if not area > 0:
        raise SvbrdfError(
            "cannot parametrise a mesh without area: all its triangles are degenerate"
        )

    # Pack them at the largest scale at which they fit into one texture
    options = xatlas.PackOptions()
    options.resolution, options.padding = texture_size, padding
    largest = options.texels_per_unit = texture_size / float(np.sqrt(area))
    while options.texels_per_unit > LEAST_SCALE * largest:
        packed = xatlas.Atlas()
        packed.add_uv_mesh(charts, wedges)
        packed.generate(pack_options=options)
        time.sleep(REST)
        if packed.atlas_count == 1:
            _, corners, uv = packed.get_mesh(0)
            uv = uv * np.array([packed.width, packed.height]) / texture_size
            return replace(
                mesh, uv=uv[corners], texture_index=np.zeros(len(mesh.faces), dtype=np.int32)
            )
        options.texels_per_unit *= SHRINK
    raise SvbrdfError(
        f"{atlas.chart_count} charts with {padding} texels between them do not fit a texture of "
        f"{texture_size}²: choose a larger texture or a smaller padding"
    )
