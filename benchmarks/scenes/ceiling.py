"""The truth rendered as results are: what the figures of unseen views cannot exceed by much.

What is left are the lamps' size, noise, the scan's triangles, and shadows in the ambient light.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.images import read_exr, read_image, write_png
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer, Appearance
from sample_projects.procedural.paint import encode_srgb

from .score import seen_lobes


def render_truth(truth: Path, folder: Path) -> None:
    """Render the held-out views from the truth's maps, one PNG per view, into a new folder."""
    light = json.loads((truth / "lights.json").read_text())
    lobes, gain = seen_lobes(truth)
    ids = read_image(truth / "material_id.png")
    rho_s, alpha = (np.array([lobe[k] for lobe in lobes])[ids] for k in (0, 1))
    white = np.ones((*ids.shape, 3))
    # Light from everywhere reflects as if it were diffuse: ∫ρ cos^α/π over the lobe
    haze = rho_s / gain * light["ambient_radiance"][0] * 2 / (alpha + 1)
    diffuse = read_exr(truth / "diffuse_full.exr") + haze[..., None]
    look = Appearance(diffuse, rho_s, alpha, white)
    lights = [
        Light(
            np.array(e["direction"]),
            np.eye(2),
            float(np.mean(e["phong_intensity"])) / gain,
            1 / e["distance"],
        )
        for e in light["emitters"]
    ]
    project = read_project(truth / "views" / "project.mlp")
    mesh = read_mesh(project.meshes[0].path).mesh
    renderer = AcquisitionRenderer(mesh, [look], lights)
    folder.mkdir(parents=True)
    for raster in project.rasters:
        image, _ = renderer.render(raster.camera, 3)
        write_png(folder / raster.path.name, np.round(255 * encode_srgb(image)).astype(np.uint8))
