"""What a perfect acquisition would find: maps in texture space, lights, materials."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.geometry.mesh import Mesh

from .capture import Scene
from .light import Surface
from .paint import Atlas, encode_srgb


def open_texels(surface: Surface, atlas: Atlas, directions: int = 48) -> np.ndarray:
    """Texels that see some of the world (a handle's end inside the neck does not), (S, S) bool."""
    inside = atlas.face >= 0
    _, normal, start, _ = surface.at(atlas.face[inside], atlas.barycentric[inside])
    seen, faced = np.zeros(len(start)), np.zeros(len(start))
    for omega in _spread(directions):
        above = np.flatnonzero(normal @ omega > 0)
        seen[above] += surface.free(start[above], np.broadcast_to(omega, (len(above), 3)))
        faced[above] += 1
    mask = np.zeros(inside.shape, bool)
    mask[inside] = seen > 0.05 * faced
    return mask


def _spread(count: int) -> np.ndarray:
    """Directions spread evenly over the sphere (Fibonacci's spiral), (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), z, r * np.sin(turn)], -1)


def shaded(scene: Scene, size: int, samples: int = 4) -> np.ndarray:
    """Albedo times irradiance, what D estimates: each texel's mean, NaN off the charts.

    Returns (size, size, 3) float64 linear.
    """
    total, hits = np.zeros((size, size, 3)), np.zeros((size, size, 1))
    for i, j in np.ndindex(samples, samples):
        atlas = Atlas.of(scene.surface.mesh, size, ((j + 0.5) / samples, (i + 0.5) / samples))
        on = atlas.face >= 0
        face, weights = atlas.face[on], atlas.barycentric[on]
        albedo = scene.surface.at(face, weights)[3]
        light = scene.surface.irradiance(face, weights, scene.lights, scene.ambient)
        total[on] += albedo * light[:, None]
        hits[on] += 1
    return np.divide(total, hits, out=np.full_like(total, np.nan), where=hits > 0)


def lights_record(scene: Scene, mesh: Mesh, to_world: Callable[[np.ndarray], np.ndarray]) -> dict:
    """Lights and ambient as the world sees them: from the centre of the mesh's bounding box.

    mesh : the object in the world; to_world : object's points (N, 3) to the world's
    """
    emitters = []
    for light in scene.lights:
        record = {"name": light.name, "kind": "disk", "half_extent_deg": [0.0, 0.0]}
        if np.isinf(light.distance):
            foot, tip = to_world(np.stack([np.zeros(3), light.direction]))
            direction = tip - foot
            position, distance, gain = None, None, light.intensity
        else:
            foot, place = to_world(np.stack([np.zeros(3), light.direction * light.distance]))
            direction = place - mesh.center
            # The intensity is that at the world's centre, whose distance to the lamp may differ
            gain = light.intensity * (np.linalg.norm(place - foot) / np.linalg.norm(direction)) ** 2
            position = place.tolist()
            distance = float(np.linalg.norm(direction) / mesh.radius)
        record |= {
            "position": position,
            "direction": (direction / np.linalg.norm(direction)).tolist(),
            "distance": distance,
            "phong_intensity": [float(gain)] * 3,
        }
        emitters.append(record)
    return {
        "units": "positions in world units, distances in object radii, linear light (1 = 255)",
        "model": "pixel_linear = sum_k visible_k * [l.n > 0] * phong_intensity_k * "
        "(distance_k / d_k)^2 * (albedo * (l.n) + rho_s * max(l.r, 0)^alpha) "
        "+ ambient_radiance * (albedo + rho_s * 2 / (alpha + 1))",
        "emitters": emitters,
        "ambient_radiance": [scene.ambient] * 3,
    }


def write_truth(folder: Path, scene: Scene, atlas: Atlas, lights: dict) -> None:
    """Write maps, lights.json and materials.json into an existing folder."""
    surface = scene.surface
    mask = open_texels(surface, atlas)
    around = distance_transform_edt(atlas.face < 0, return_distances=False, return_indices=True)
    identity = surface.material[atlas.face[tuple(around)]].astype(np.uint8)
    write_png(folder / "albedo.png", np.round(255 * encode_srgb(surface.albedo)).astype(np.uint8))
    write_png(folder / "material_id.png", identity)
    write_png(folder / "texel_mask.png", np.where(mask, 255, 0).astype(np.uint8))
    # Half precision is 40 times finer than a code value, and packs well
    half = shaded(scene, len(surface.albedo) // 2).astype(np.float16)
    write_exr(folder / "diffuse_shaded.exr", half.astype(np.float32))

    materials = []
    for index, material in enumerate(scene.materials):
        here = mask & (identity == index)
        materials.append(
            {
                "id": index,
                "name": material.name,
                "rho_s": material.rho_s,
                "alpha": material.alpha,
                "mean_albedo": surface.albedo[here].mean(0).round(4).tolist(),
                "texel_fraction": float(here.sum() / mask.sum()),
            }
        )
    write_json(folder / "lights.json", lights)
    write_json(folder / "materials.json", {"bsdf": "phong", "materials": materials})


def write_json(path: Path, value: dict) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
