"""The scene that Mitsuba's inverse rendering changes: textures, materials and environment unknown.

The object has the paper's lobe, with an albedo per texel and ρs and α per material, each material's
texels given; all light comes from a map of directions, directly.
"""

from __future__ import annotations

import cv2
import drjit as dr
import mitsuba as mi
import numpy as np

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels

from ..scenes.renderer import Phong, _surface, _texture  # sets the variant

ALBEDO, RHO_S, ALPHA = (f"object.bsdf.{name}.data" for name in ("albedo", "rho_s", "alpha"))
LIGHT = "light.data"


class UnknownPhong(Phong):
    """The lobe with its textures as parameters, and a derivative by α where it is 0."""

    def traverse(self, callback: mi.TraversalCallback) -> None:
        for name in ("albedo", "rho_s", "alpha"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def eval(self, ctx, si, wo, active=True):
        front = active & (si.wi.z > 0) & (wo.z > 0)
        alpha, rho_s = self.alpha.eval_1(si, front), self.rho_s.eval_1(si, front)
        towards = dr.maximum(dr.dot(wo, mi.reflect(si.wi)), 1e-6)
        lobe = rho_s * dr.power(towards, alpha)
        value = (self.albedo.eval(si, front) * wo.z + lobe) * dr.inv_pi
        return dr.select(front, value, 0)


mi.register_bsdf("svbrdf_phong_unknown", UnknownPhong)


def load_scene(mesh: Mesh, size: int, sky: tuple[int, int]) -> mi.Scene:
    """The object under an environment of `sky` (height, width) pixels; all values to be set."""
    flat = np.ones((size, size), np.float32)
    bsdf = {
        "type": "svbrdf_phong_unknown",
        "albedo": _texture(np.repeat(flat[..., None], 3, -1), "bilinear"),
        "rho_s": _texture(flat, "nearest"),
        "alpha": _texture(flat, "nearest"),
    }
    light = {"type": "envmap", "bitmap": mi.Bitmap(np.ones((*sky, 3), np.float32))}
    integrator = {"type": "prb", "max_depth": 2, "hide_emitters": True}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "object": _surface(mesh, bsdf),
            "light": light,
        }
    )


def padded(sky: mi.TensorXf) -> mi.TensorXf:
    """An environment (H, W, 3) with the column beyond each border that Mitsuba keeps."""
    height, width, _ = sky.shape
    column = (np.arange(width + 2) - 1) % width
    index = np.arange(height)[:, None] * width + column
    index = (3 * index[..., None] + np.arange(3)).ravel()
    return mi.TensorXf(dr.gather(mi.Float, sky.array, mi.UInt32(index)), (height, width + 2, 3))


def per_texel(values: mi.Float, ids: mi.UInt32, size: int) -> mi.TensorXf:
    """One value per material, as a texture."""
    return mi.TensorXf(dr.gather(mi.Float, values, ids), (size, size, 1))


def sensor(camera: Camera) -> mi.Sensor:
    """Mitsuba's camera: its axes are left, up, forward. One kernel serves all of one size."""
    middle = np.array([camera.width, camera.height]) / 2
    off = (middle - 0.5 - [camera.cx, camera.cy]) / (2 * middle)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([-camera.R[0], -camera.R[1], camera.R[2]], 1)
    pose[:3, 3] = camera.center
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(middle[0] / camera.fx))),
            "principal_point_offset_x": float(off[0]),
            "principal_point_offset_y": float(off[1]),
            "to_world": mi.ScalarTransform4f(pose),
            "film": {
                "type": "hdrfilm", "width": camera.width, "height": camera.height,
                "pixel_format": "rgba", "rfilter": {"type": "box"},
            },
            "sampler": {"type": "multijitter"},
        }
    )  # fmt: skip


def irradiance(scene: mi.Scene, texels: Texels, mesh: Mesh, samples: int) -> np.ndarray:
    """What each texel receives from the environment past the object, over π; (T, 3)."""
    a, b, c = (mesh.vertices[mesh.faces[texels.face, k]] for k in range(3))
    facet = mesh.winding() * np.cross(b - a, c - a)
    facet /= np.maximum(np.linalg.norm(facet, axis=1, keepdims=True), 1e-30)
    point = dr.zeros(mi.SurfaceInteraction3f, len(texels))
    point.p, point.n = mi.Point3f(texels.position.T), mi.Normal3f(facet.T)
    normal = mi.Normal3f(texels.normal.T)
    shift = mi.PCG32(len(texels), 1)
    first, second = shift.next_float32(), shift.next_float32()
    total = mi.Color3f(0)
    for k in range(samples):
        # Plastic's sequence, shifted at random for each texel
        u = first + mi.Float(k * 0.7548776662466927 % 1)
        v = second + mi.Float(k * 0.5698402909980532 % 1)
        place = mi.Point2f(u - dr.floor(u), v - dr.floor(v))
        sample, weight = scene.sample_emitter_direction(point, place, True)
        total += weight * dr.maximum(dr.dot(sample.d, normal), 0) * dr.inv_pi
        dr.eval(total)
    return np.array(total).reshape(3, -1).T / samples


def material_texels(ids: np.ndarray, size: int) -> np.ndarray:
    """True material ids at a texture's size, (size, size)."""
    return cv2.resize(ids, (size, size), interpolation=cv2.INTER_NEAREST)
