"""Mitsuba 3: the OBJ, with MTL's highlight as its format means it.

Its OBJ loader leaves the MTL to its user: images and factors are taken from it here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.rendering.environment_lights import Illumination

from ..peers.mitsuba_scene import sensor  # sets the variant

SAMPLES = 64


class Mtl(mi.BSDF):
    """Kd and Ks (n·h)^Ns, illum 2; a lamp of perpendicular irradiance π gives a white surface 1."""

    def __init__(self, props: mi.Properties):
        mi.BSDF.__init__(self, props)
        self.kd, self.ks, self.ns = props["kd"], props["ks"], props["ns"]
        self.ks_factor, self.ns_factor = props["ks_factor"], props["ns_factor"]
        both = (
            mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        )
        self.m_components, self.m_flags = [both], both

    def eval(self, ctx, si, wo, active=True):
        """Reflectance times the cosine towards the light."""
        front = active & (si.wi.z > 0) & (wo.z > 0)
        exponent = self.ns_factor * self.ns.eval_1(si, front)
        lobe = dr.power(dr.maximum(dr.normalize(si.wi + wo).z, 0), exponent)
        gloss = self.ks_factor * self.ks.eval(si, front) * lobe
        return dr.select(front, (self.kd.eval(si, front) * wo.z + gloss) * dr.inv_pi, 0)

    def pdf(self, ctx, si, wo, active=True):
        """Lamps are points: no direction is ever sampled."""
        return mi.Float(0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        return dr.zeros(mi.BSDFSample3f), mi.Color3f(0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)


mi.register_bsdf("mtl", Mtl)


def render(
    obj: Path, lamps: Illumination, center: np.ndarray, radius: float,
    cameras: Sequence[Camera],
) -> list[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Views (H, W, 3), linear on black, and coverage (H, W)."""
    told = _library(obj.with_suffix(".mtl"))
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {
            "type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True,
        },
        "object": {"type": "obj", "filename": str(obj), "bsdf": _bsdf(obj.parent, told)},
    }  # fmt: skip
    for k, (way, curvature, color) in enumerate(
        zip(lamps.direction, lamps.curvature, lamps.color, strict=True)
    ):
        power = {"type": "rgb", "value": (np.pi * color).tolist()}
        scene[f"lamp{k}"] = {"type": "directional", "direction": (-way).tolist(),
                             "irradiance": power}  # fmt: skip
        if curvature > 0:
            distance = radius / curvature
            power["value"] = (np.pi * color * distance**2).tolist()
            scene[f"lamp{k}"] = {
                "type": "point", "position": (center + distance * way).tolist(),
                "intensity": power,
            }  # fmt: skip
    loaded = mi.load_dict(scene)
    found = []
    for k, camera in enumerate(cameras):
        image = np.array(mi.render(loaded, sensor=sensor(camera), spp=SAMPLES, seed=k))
        found.append((image[..., :3].astype(float), image[..., 3].astype(float)))
    return found


def _bsdf(folder: Path, told: dict[str, str]) -> dict[str, Any]:
    def image(name: str, linear: bool) -> dict[str, Any]:
        return {"type": "bitmap", "filename": str(folder / name), "raw": linear,
                "wrap_mode": "clamp"}  # fmt: skip

    return {
        "type": "mtl",
        "kd": image(told["map_Kd"], False),
        "ks": image(told["map_Ks"], True),
        "ns": image(told["map_Ns"], True),
        "ks_factor": float(told["Ks"].split()[0]),
        "ns_factor": float(told["Ns"]),
    }


def _library(path: Path) -> dict[str, str]:
    """The first material of an MTL, by its words."""
    text = path.read_text().split("newmtl ")[1]
    return dict(line.split(" ", 1) for line in text.splitlines()[1:] if " " in line)
