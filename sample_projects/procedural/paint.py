"""The object's colours: procedural, continuous over all seams, baked into one albedo image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.ndimage import distance_transform_edt, map_coordinates

from meshlab_svbrdf.geometry.mesh import Mesh

from .shape import BRONZE, GLAZE, TERRACOTTA


@dataclass(frozen=True)
class Atlas:
    """Which surface point each texel centre shows; row 0 is v = 1.

    face : (S, S) int32, -1 outside all charts; barycentric : (S, S, 3)
    """

    face: np.ndarray
    barycentric: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, size: int, shift: tuple[float, float] = (0.5, 0.5)) -> Atlas:
        """Shoot a ray through the UV plane at every texel (`shift`: where inside the texel)."""
        assert mesh.uv is not None
        scene = EmbreeScene()
        flat = np.concatenate([mesh.uv, np.zeros((*mesh.uv.shape[:2], 1))], axis=-1)
        TriangleMesh(scene, flat.astype(np.float32))
        row, col = np.mgrid[0:size, 0:size].reshape(2, -1)
        origin = np.stack([(col + shift[0]) / size, 1 - (row + shift[1]) / size, 1 + 0 * col], -1)
        down = np.broadcast_to(np.array([0, 0, -1], np.float32), origin.shape)
        found = scene.run(origin.astype(np.float32), np.ascontiguousarray(down), output=True)
        u, v = found["u"].astype(np.float64), found["v"].astype(np.float64)
        barycentric = np.stack([1 - u - v, u, v], -1)
        return cls(found["primID"].reshape(size, size), barycentric.reshape(size, size, 3))


def albedo_image(mesh: Mesh, material: np.ndarray, atlas: Atlas, seed: int) -> np.ndarray:
    """Diffuse albedo (S, S, 3) float64 linear, its gutter filled from the nearest texel.

    The values are those that an 8-bit sRGB image holds: the image is the truth, without rest.
    """
    inside = atlas.face >= 0
    face, weights = atlas.face[inside], atlas.barycentric[inside]
    point = (weights[..., None] * mesh.vertices[mesh.faces[face]]).sum(1)
    rng = np.random.default_rng([seed, 1])
    noise = _Noise(rng)
    color = np.zeros((len(face), 3))
    for kind, paint in ((TERRACOTTA, _terracotta), (GLAZE, _glaze), (BRONZE, _bronze)):
        here = material[face] == kind
        color[here] = paint(point[here], noise)
    image = np.zeros((*inside.shape, 3))
    image[inside] = np.round(encode_srgb(color) * 255) / 255
    nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return decode_srgb(image[tuple(nearest)])


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light to sRGB code values, both 0..1 (IEC 61966-2-1)."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def decode_srgb(code: np.ndarray) -> np.ndarray:
    """The inverse of `encode_srgb`."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


class _Noise:
    """Smooth noise in space, about -1..1, by octaves of an interpolated random lattice."""

    def __init__(self, rng: np.random.Generator):
        self.lattice = rng.uniform(-1, 1, (32, 32, 32))

    def __call__(self, points: np.ndarray, frequency: float, octaves: int = 4) -> np.ndarray:
        total = np.zeros(len(points))
        for k in range(octaves):
            place = (points * frequency * 2**k + 7.3 * k).T
            total += map_coordinates(self.lattice, place, order=1, mode="grid-wrap") / 2**k
        return total


def _mix(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    share = np.clip(share, 0, 1)[:, None]
    return (1 - share) * a + share * b


def _edge(x: np.ndarray, width: float) -> np.ndarray:
    """0 below -width, 1 above +width, smooth between."""
    t = np.clip(x / (2 * width) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


def _terracotta(p: np.ndarray, noise: _Noise) -> np.ndarray:
    """Fired clay: cloudy, speckled with grog, a painted zigzag around the neck."""
    clay = _mix(np.array([0.36, 0.130, 0.062]), np.array([0.26, 0.085, 0.040]), 0.5 + noise(p, 4))
    color = _mix(clay, np.array([0.42, 0.22, 0.13]), _edge(noise(p, 45, 2) - 0.75, 0.25))
    angle, axis = np.arctan2(p[:, 2], p[:, 0]), np.hypot(p[:, 0], p[:, 2])
    wave = np.abs((angle * 16 / np.pi) % 2 - 1)
    zigzag = np.abs(p[:, 1] - 0.275 - 0.045 * (wave - 0.5)) - 0.010
    neck = (axis < 0.27) & (p[:, 1] < 0.36) & (p[:, 1] > 0.19)
    return _mix(color, np.array([0.13, 0.040, 0.024]), 0.85 * neck * _edge(-zigzag, 0.004))


def _glaze(p: np.ndarray, noise: _Noise) -> np.ndarray:
    """A deep turquoise glaze, pooled darker below, a lotus frieze painted above the gadroons."""
    pool = 0.5 + 1.6 * (p[:, 1] + 0.12) + 0.55 * noise(p, 5)
    color = _mix(np.array([0.014, 0.075, 0.125]), np.array([0.036, 0.175, 0.195]), pool)
    angle = np.arctan2(p[:, 2], p[:, 0])
    petal = (angle * 12 / (2 * np.pi)) % 1 * 2 - 1
    height = (p[:, 1] - 0.005) / 0.105
    arch = 0.86 * np.sqrt(np.clip(1 - np.clip(height, 0, 1) ** 1.6, 0, 1)) - np.abs(petal)
    band = _edge(height, 0.04) * _edge(1 - height, 0.04)
    cream, cobalt = np.array([0.19, 0.30, 0.27]), np.array([0.010, 0.026, 0.095])
    color = _mix(color, cream, 0.80 * band * _edge(arch, 0.05))
    color = _mix(color, cobalt, 0.90 * band * _edge(0.10 - np.abs(arch - 0.22), 0.03))
    for line in (-0.012, 0.126):
        color = _mix(color, cobalt, 0.9 * _edge(0.008 - np.abs(p[:, 1] - line), 0.003))
    return color * (1 + 0.10 * noise(p, 28, 3))[:, None]


def _bronze(p: np.ndarray, noise: _Noise) -> np.ndarray:
    """Brown bronze, worn golden in places, verdigris where hands do not reach."""
    brown, golden = np.array([0.085, 0.048, 0.022]), np.array([0.190, 0.110, 0.042])
    metal = _mix(brown, golden, noise(p, 7) + 0.3)
    verdigris = np.array([0.075, 0.130, 0.095])
    color = _mix(metal, verdigris, 0.75 * _edge(noise(p + 3.1, 9, 5) - 0.45, 0.35))
    return color * (1 + 0.12 * noise(p, 40, 2))[:, None]
