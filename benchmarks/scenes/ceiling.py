"""The truth rendered as results are: what the figures of unseen views cannot exceed by much.

What is left are the lamps' size, noise, the scan's triangles, and shadows in the ambient light.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from meshlab_svbrdf.document.images import read_exr, read_image, write_png
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.geometry.gutters import fill_gutters
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode
from sample_projects.procedural.paint import encode_srgb

from .score import seen_lobes


def render_truth(truth: Path, folder: Path, texture: int = 512) -> None:
    """Render the held-out views from the truth's maps, one PNG per view, into a new folder.

    texture : texels along a side, where the truth's maps are finer
    """
    light = json.loads((truth / "lights.json").read_text())
    lobes, gain = seen_lobes(truth)
    diffuse = _diffuse(truth, texture)
    ids = read_image(truth / "material_id.png")
    ids = cv2.resize(ids, diffuse.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    rho_s, alpha = (np.array([lobe[k] for lobe in lobes])[ids] for k in (0, 1))
    # Light from everywhere reflects as if it were diffuse: ∫ρ cos^α/π over the lobe
    haze = rho_s / gain * light["ambient_radiance"][0] * 2 / (alpha + 1)
    look = Appearance(diffuse + haze[..., None], rho_s, alpha, np.ones_like(diffuse))
    project = read_project(truth / "views" / "project.mlp")
    mesh = read_mesh(project.meshes[0].path).mesh
    lights = []
    for emitter in light["emitters"]:
        way = np.array(emitter["position"]) - mesh.center
        distance = float(np.linalg.norm(way))
        strength = float(np.mean(emitter["phong_intensity"])) / gain
        lights.append(Light(way / distance, np.eye(2), strength, mesh.radius / distance))
    renderer = AcquisitionRenderer(mesh, [look], lights)
    folder.mkdir(parents=True)
    for raster in project.rasters:
        image, _ = renderer.render(raster.camera, 3)
        write_png(folder / raster.path.name, np.round(255 * encode_srgb(image)).astype(np.uint8))


def _diffuse(truth: Path, texture: int) -> np.ndarray:
    """Albedo times irradiance, (S, S, 3) linear, gutters filled.

    Where a scene holds it at half its size only, irradiance is interpolated between the texels.
    """
    if (truth / "diffuse_full.exr").is_file():
        full = read_exr(truth / "diffuse_full.exr").astype(np.float64)
        return _shrunk(fill_gutters(full, np.isfinite(full).all(-1)), texture)
    shaded = read_exr(truth / "diffuse_shaded.exr").astype(np.float64)
    albedo = decode(read_image(truth / "albedo.png")[..., :3] / 255)
    mask = (read_image(truth / "texel_mask.png") > 127).astype(np.float64)
    half = shaded.shape[1::-1]
    part = cv2.resize(mask, half, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(albedo * mask[..., None], half, interpolation=cv2.INTER_AREA)
    inside = (part > 0.999) & np.isfinite(shaded).all(-1)
    light = np.full_like(shaded, np.nan)
    light[inside] = (shaded * part[..., None] / np.maximum(mean, 1e-6))[inside]
    light = fill_gutters(light, inside)
    made = albedo * cv2.resize(light, albedo.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return _shrunk(fill_gutters(made, mask > 0), texture)


def _shrunk(image: np.ndarray, texture: int) -> np.ndarray:
    if texture >= len(image):
        return image
    return cv2.resize(image, (texture, texture), interpolation=cv2.INTER_AREA)
