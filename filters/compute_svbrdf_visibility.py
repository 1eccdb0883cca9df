"""What every vertex sees of the directions around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.harmonics import BANDS
from meshlab_svbrdf.geometry.visibility import Rays, needs_visibility, vertex_visibility
from meshlab_svbrdf.progress import Progress

FILTER = Filter(
    name="compute_svbrdf_visibility",
    title="SVBRDF: visibility",
    needs=("mesh", "texels"),
    writes=("visibility",),
    parameters=(
        Parameter(
            "mode", "enum", "auto", choices=("auto", "always", "never"),
            help='"auto" skips an object that hardly shadows itself (less than 1 % of a sample of '
            "rays is blocked): all that is above the horizon is visible then.",
        ),
        Parameter(
            "directions", "int", 512, minimum=32, maximum=8192,
            help="Rays per vertex over the whole sphere; 512 leave an error of .02, less than six "
            "bands leave out.",
        ),
        Parameter("bands", "int", BANDS, minimum=1, maximum=BANDS, help="Of spherical harmonics."),
    ),
    help="Shoots rays from every vertex and keeps, per vertex, the visibility of the upper "
    "hemisphere as 36 coefficients of real spherical harmonics. The layer `map: visibility` shows "
    "the share of its hemisphere that a vertex sees as Quality and grey, and holds the "
    "coefficients as attributes.",
    reference="Palma et al. 2012, §3.1",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    mesh = document.mesh()
    rays = Rays(mesh)
    needed, blocked = needs_visibility(mesh, rays=rays)
    if parameters.mode == "never" or (parameters.mode == "auto" and not needed):
        document.set_array("visibility", np.zeros((0, BANDS**2), np.float32))
        why = (
            "as asked"
            if parameters.mode == "never"
            else f"only {blocked:.1%} of the rays are blocked"
        )
        return f"skipped: {why}"
    coefficients = vertex_visibility(
        mesh, parameters.directions, parameters.bands,
        lambda done: progress(done, "shooting rays"), rays,
    )  # fmt: skip
    del rays  # Embree's tree is no longer wanted
    if parameters.bands < BANDS:
        coefficients = np.pad(coefficients, ((0, 0), (0, BANDS**2 - coefficients.shape[1])))
    document.set_array("visibility", coefficients)

    # Show the share of the upper hemisphere that is open, ∫V/2π, on the mesh's own vertices
    layer = document.object_layer()
    content = layer.read()
    openness = coefficients[:, 0] * np.sqrt(4 * np.pi) / (2 * np.pi)
    grey = np.rint(255 * openness.clip(0, 1)).astype(np.uint8)
    shown = MeshFile(
        mesh=replace(content.mesh, uv=None, texture_index=None),
        textures=(),
        vertex_attributes={f"svbrdf_visibility_{k}": c for k, c in enumerate(coefficients.T)},
        vertex_color=np.stack([grey, grey, grey, np.full_like(grey, 255)], axis=1),
        quality=openness.astype(np.float32),
    )
    document.set_layer(Layer("map: visibility", None, layer.matrix, False, shown))
    return f"{len(coefficients):,} vertices, {blocked:.1%} of the rays are blocked"
