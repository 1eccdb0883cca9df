"""What a perfect acquisition would find: maps in texture space, lights, materials."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.geometry.mesh import Mesh
from sample_projects.procedural.light import Surface
from sample_projects.procedural.paint import Atlas
from sample_projects.procedural.truth import open_texels

from .paint import Maps
from .variant import Variant

if TYPE_CHECKING:
    from .renderer import Renderer

SUBTEXELS, SHADOW_RAYS = 2, 8


def write_truth(
    folder: Path, renderer: Renderer, mesh: Mesh, maps: Maps, exposure: float, world: np.ndarray
) -> None:
    """Write maps, lights.json, materials.json and env.exr; exposure multiplies all light."""
    variant = renderer.variant
    atlas = Atlas.of(mesh, variant.texture)
    face_material = np.zeros(len(mesh.faces), np.uint8)
    surface = Surface(mesh, face_material, maps.albedo)
    mask = open_texels(surface, atlas)
    write_png(folder / "albedo.png", maps.albedo_code)
    write_png(folder / "material_id.png", maps.material)
    write_png(folder / "texel_mask.png", np.where(mask, 255, 0).astype(np.uint8))
    diffuse = exposure * shaded(renderer, surface, maps)
    write_exr(folder / "diffuse_full.exr", diffuse)
    half = variant.texture // 2
    write_exr(folder / "diffuse_shaded.exr", diffuse.reshape(half, 2, half, 2, 3).mean((1, 3)))
    write_exr(folder / "env.exr", exposure * environment(variant, world))
    write_json(folder / "lights.json", _lights(variant, exposure, world))
    materials = [
        {
            "id": index,
            "name": m.name,
            "rho_s": m.rho_s,
            "alpha": m.alpha,
            "mean_albedo": maps.albedo[mask & (maps.material == index)].mean(0).round(4).tolist(),
            "texel_fraction": float((maps.material[mask] == index).mean()),
        }
        for index, m in enumerate(variant.materials)
    ]
    phong = all(m.rho_s is not None for m in variant.materials)
    write_json(
        folder / "materials.json",
        {"bsdf": "phong" if phong else "mixed", "materials": materials},
    )


def shaded(renderer: Renderer, surface: Surface, maps: Maps) -> np.ndarray:
    """Albedo times irradiance over π, shadows included: each texel's mean.

    NaN off the charts, and where the material is not Phong's: its diffuse part depends on the view.

    Returns (S, S, 3) linear, before exposure.
    """
    size = renderer.variant.texture
    total, hits = np.zeros((size, size, 3)), np.zeros((size, size, 1))
    for k, (i, j) in enumerate(np.ndindex(SUBTEXELS, SUBTEXELS)):
        shift = (j + 0.5) / SUBTEXELS, (i + 0.5) / SUBTEXELS
        atlas = Atlas.of(surface.mesh, size, shift)
        on = atlas.face >= 0
        position, normal, _, albedo = surface.at(atlas.face[on], atlas.barycentric[on])
        a, b, c = surface.corners[atlas.face[on]].transpose(1, 0, 2)
        facet = np.cross(b - a, c - a)
        facet /= np.linalg.norm(facet, axis=1, keepdims=True)
        light = renderer.irradiance(position, normal, facet, SHADOW_RAYS, 1000 + k)
        total[on] += albedo * light[:, None]
        hits[on] += 1
    image = np.divide(total, hits, out=np.full_like(total, np.nan), where=hits > 0)
    known = np.array([m.rho_s is not None for m in renderer.variant.materials])[maps.material]
    image[~known] = np.nan
    return image


def environment(variant: Variant, world: np.ndarray, height: int = 128) -> np.ndarray:
    """Radiance from every direction as seen from the centre, (H, 2H, 3); the pole is +Y."""
    fine = 4 * height
    theta = np.pi * (np.arange(fine)[:, None] + 0.5) / fine
    phi = np.pi * (np.arange(2 * fine)[None] + 0.5) / fine
    way = np.stack(
        np.broadcast_arrays(
            np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)
        ),
        -1,
    )
    way = way @ world[:3, :3]
    radiance = np.full(way.shape[:2], variant.ambient)
    for lamp in variant.lamps:
        cosine = way @ lamp.direction
        with np.errstate(divide="ignore", invalid="ignore"):
            place = way * (lamp.distance / cosine)[..., None] - lamp.position
        u, v = (place @ axis / (axis @ axis) for axis in lamp.half_axes)
        inside = u**2 + v**2 < 1 if lamp.kind == "disk" else np.maximum(abs(u), abs(v)) < 1
        radiance[(cosine > 0) & inside] = lamp.radiance()
    mean = radiance.reshape(height, 4, 2 * height, 4).mean((1, 3))
    return np.repeat(mean[..., None], 3, -1)


def _lights(variant: Variant, exposure: float, world: np.ndarray) -> dict[str, Any]:
    emitters = []
    for lamp in variant.lamps:
        intensity = exposure * lamp.intensity
        emitters.append(
            {
                "name": lamp.name,
                "kind": lamp.kind,
                "position": (world[:3, :3] @ lamp.position + world[:3, 3]).tolist(),
                "direction": (world[:3, :3] @ lamp.direction).tolist(),
                "distance": lamp.distance,
                "half_extent_deg": list(lamp.half_extent),
                "half_axes": (lamp.half_axes @ world[:3, :3].T).tolist(),
                "radiance": [exposure * lamp.radiance()] * 3,
                "irradiance_perp": [np.pi * intensity] * 3,
                "phong_intensity": [intensity] * 3,
            }
        )
    return {
        "units": "object radii (positions: the world's); linear light after exposure, 1 = 255",
        "model": "pixel_linear = sum_k phong_intensity_k * (albedo * max(l.n, 0) + rho_s * "
        "max(l.r, 0)^alpha) + ambient",
        "emitters": emitters,
        "ambient_radiance": [exposure * variant.ambient] * 3,
    }


def write_json(path: Path, value: dict) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
