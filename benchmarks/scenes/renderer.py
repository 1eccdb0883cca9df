"""Mitsuba 3: the object under each light alone, its frames and what its surface receives.

One scene a light: no variance from choosing among lights, and images that can be added.
"""

from __future__ import annotations

from math import isqrt

import drjit as dr
import mitsuba as mi
import numpy as np

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh

from .paint import Maps
from .variant import Lamp, Variant

NEEDED = (3, 9)
if tuple(int(part) for part in mi.__version__.split(".")[:2]) < NEEDED:
    raise SvbrdfError(
        f"Mitsuba {mi.__version__} is installed: needs Mitsuba >= 3.9, for older ones "
        "render facets where normals are smooth (pip install 'mitsuba>=3.9')"
    )
mi.set_variant("llvm_ad_rgb")

from .phong import Phong  # noqa: E402, F401  (registers itself; needs the variant)


class Renderer:
    """All lights of a variant on its object; linear radiances before exposure."""

    def __init__(self, mesh: Mesh, maps: Maps, variant: Variant):
        self.variant = variant
        surface = _surface(mesh, _bsdf(maps, variant))
        lights = [_lamp(lamp) for lamp in variant.lamps]
        if variant.ambient:
            lights.append({"type": "constant", "radiance": _rgb(variant.ambient)})
        self.scenes = [
            mi.load_dict(
                {
                    "type": "scene",
                    "integrator": _integrator(variant, light["type"] == "constant"),
                    "object": surface,
                    "light": light,
                    "sensor": _sensor(variant),
                }
            )
            for light in lights
        ]
        self.parameters = [mi.traverse(scene) for scene in self.scenes]

    def render(self, camera: Camera, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Linear image (height, width, 3) on black, and coverage (height, width)."""
        pose = np.eye(4)
        pose[:3, :3] = np.stack([-camera.R[0], -camera.R[1], camera.R[2]], 1)
        pose[:3, 3] = camera.center
        total = np.zeros((camera.height, camera.width, 4))
        for k, (scene, parameters) in enumerate(zip(self.scenes, self.parameters, strict=True)):
            parameters["sensor.to_world"] = mi.Transform4f(pose)
            parameters["sensor.x_fov"] = float(
                np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))
            )
            parameters.update()
            # Light from everywhere is noisier
            spp = samples if scene.environment() is None else (isqrt(samples) + 1) ** 2
            total += np.array(mi.render(scene, spp=spp, seed=seed * 64 + k))
        return total[..., :3], total[..., 3] / len(self.scenes)

    def irradiance(
        self, position: np.ndarray, normal: np.ndarray, facet: np.ndarray, samples: int, seed: int
    ) -> np.ndarray:
        """What surface points receive from all lights directly, over π; (N,).

        position : (N, 3); normal : (N, 3) interpolated; facet : (N, 3) normals of their triangles
        """
        point = dr.zeros(mi.SurfaceInteraction3f, len(position))
        point.p, point.n = mi.Point3f(position.T), mi.Normal3f(facet.T)
        point.sh_frame = mi.Frame3f(mi.Normal3f(normal.T))
        total = np.zeros(len(position))
        for k, scene in enumerate(self.scenes):
            received = mi.Float(0)
            generator = mi.PCG32(len(position), seed * 64 + k)
            for _ in range(samples):
                u = mi.Point2f(generator.next_float32(), generator.next_float32())
                if scene.environment() is None:
                    sample, weight = scene.sample_emitter_direction(point, u, True)
                    cosine = dr.maximum(dr.dot(sample.d, point.sh_frame.n), 0)
                    received += weight.x * cosine * dr.inv_pi
                else:
                    way = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(u))
                    free = ~scene.ray_test(point.spawn_ray(way))
                    received += dr.select(free, self.variant.ambient, 0)
                dr.eval(received, generator)
            total += np.array(received) / samples
        return total


def _rgb(value: float) -> dict:
    return {"type": "rgb", "value": value}


def _integrator(variant: Variant, constant: bool) -> dict:
    if variant.depth > 2:
        return {"type": "path", "max_depth": variant.depth, "hide_emitters": True}
    # A lobe's samples find light from everywhere best
    return {"type": "direct", "emitter_samples": int(not constant), "bsdf_samples": 1,
            "hide_emitters": True}  # fmt: skip


def _sensor(variant: Variant) -> dict:
    return {
        "type": "perspective",
        "fov": 30,
        "film": {
            "type": "hdrfilm", "width": variant.width, "height": variant.height,
            "pixel_format": "rgba", "rfilter": {"type": "box"},
        },
        "sampler": {"type": "multijitter"},
    }  # fmt: skip


def _lamp(lamp: Lamp) -> dict:
    axes = lamp.half_axes
    pose = np.eye(4)
    pose[:3] = np.stack([*axes, -lamp.direction, lamp.position], 1)
    return {
        "type": lamp.kind,
        "to_world": mi.ScalarTransform4f(pose),
        "emitter": {"type": "area", "radiance": _rgb(lamp.radiance())},
    }


def _surface(mesh: Mesh, bsdf: dict) -> mi.Mesh:
    """One vertex per wedge, since texture coordinates differ across seams; v = 0 is the bottom."""
    assert mesh.uv is not None
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(bsdf)
    corners = mesh.faces.reshape(-1)
    made = mi.Mesh("object", len(corners), len(mesh.faces), properties, True, True)
    parameters = mi.traverse(made)
    uv = mesh.uv.reshape(-1, 2) * [1, -1] + [0, 1]
    parameters["vertex_positions"] = mesh.vertices[corners].astype(np.float32).ravel()
    parameters["vertex_normals"] = mesh.vertex_normals()[corners].astype(np.float32).ravel()
    parameters["vertex_texcoords"] = uv.astype(np.float32).ravel()
    parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
    parameters.update()
    return made


def _bsdf(maps: Maps, variant: Variant) -> dict:
    """All Phong materials as one BSDF with maps, each other one blended over it by a mask."""
    albedo = _texture(maps.albedo.astype(np.float32), "bilinear")

    def per_material(values: list[float]) -> dict:
        return _texture(np.array(values, np.float32)[maps.material], "nearest")

    bsdf: dict = {
        "type": "svbrdf_phong",
        "albedo": albedo,
        "rho_s": per_material([m.rho_s or 0.0 for m in variant.materials]),
        "alpha": per_material([m.alpha or 1.0 for m in variant.materials]),
    }
    for k, material in enumerate(variant.materials):
        if material.plastic is not None:
            other = {
                "type": "roughplastic",
                "distribution": material.distribution,
                "alpha": material.plastic,
                "diffuse_reflectance": albedo,
            }
        elif material.gold is not None:
            other = {
                "type": "roughconductor",
                "distribution": material.distribution,
                "alpha": material.gold,
                "material": "Au",
            }
        else:
            continue
        mask = per_material([float(k == i) for i in range(len(variant.materials))])
        bsdf = {"type": "blendbsdf", "weight": mask, "first": bsdf, "second": other}
    return bsdf


def _texture(image: np.ndarray, filter_type: str) -> dict:
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(image)),
        "raw": True,
        "filter_type": filter_type,
        "wrap_mode": "clamp",
    }
