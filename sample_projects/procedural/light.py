"""Light in the paper's model, by rays: what a surface point sends to the eye, and what it receives.

Everything happens in the object's own frame: centre 0, radius 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from meshlab_svbrdf.geometry.mesh import Mesh

OFFSET = 1e-4  # how far above the surface shadow rays start, in radii: beyond float32's error


@dataclass(frozen=True)
class Floodlight:
    """A point light. direction : (3,) unit; distance : radii, inf where far; intensity at 0."""

    name: str
    direction: np.ndarray
    distance: float
    intensity: float

    def toward(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit directions (N, 3) from the points to the light, and intensities (N,) there."""
        if np.isinf(self.distance):
            same = np.broadcast_to(self.direction, points.shape)
            return same, np.full(len(points), self.intensity)
        offset = self.direction * self.distance - points
        square = np.einsum("ij,ij->i", offset, offset)
        return offset / np.sqrt(square)[:, None], self.intensity * self.distance**2 / square


@dataclass(frozen=True)
class Material:
    """A Phong lobe: rho_s in 0..1 for a light of intensity 1, alpha its exponent."""

    name: str
    rho_s: float
    alpha: float


class Surface:
    """The mesh with what shading needs: rays, interpolated normals, the albedo image."""

    def __init__(self, mesh: Mesh, material: np.ndarray, albedo: np.ndarray):
        """albedo : (S, S, 3) linear, row 0 is v = 1; material : (F,) index per face."""
        self.mesh, self.material, self.albedo = mesh, material, albedo
        self.corners = mesh.vertices[mesh.faces]
        self.normals = mesh.vertex_normals()[mesh.faces]
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, self.corners.astype(np.float32))

    def hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First face along each ray, (N,), -1 where none; barycentrics (N, 3)."""
        found = self._scene.run(
            origins.astype(np.float32), directions.astype(np.float32), output=True
        )
        u, v = found["u"].astype(np.float64), found["v"].astype(np.float64)
        return found["primID"], np.stack([1 - u - v, u, v], -1)

    def free(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Whether nothing stands along each ray, (N,) bool."""
        blocked = self._scene.run(
            origins.astype(np.float32), directions.astype(np.float32), query="OCCLUDED"
        )
        return blocked < 0

    def at(self, face: np.ndarray, barycentric: np.ndarray) -> tuple[np.ndarray, ...]:
        """Positions, unit normals, where shadow rays start, and albedos; (N, 3) each."""
        assert self.mesh.uv is not None
        weights = barycentric[..., None]
        corners, normals = self.corners[face], self.normals[face]
        position = (weights * corners).sum(1)
        normal = (weights * normals).sum(1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        # Lift the start of shadow rays onto the smooth surface (Hanika 2021): no faceted shadows
        above = np.einsum("nkc,nkc->nk", position[:, None] - corners, normals)
        lift = (weights * (np.minimum(above, 0)[..., None] * normals)).sum(1)
        start = position - lift + OFFSET * normal
        uv = (weights * self.mesh.uv[face]).sum(1)
        return position, normal, start, bilinear(self.albedo, uv)

    def irradiance(
        self, face: np.ndarray, barycentric: np.ndarray, lights: list[Floodlight], ambient: float
    ) -> np.ndarray:
        """What D's texel receives: sum of intensity (l·n)+ visibility, plus ambient; (N,)."""
        position, normal, start, _ = self.at(face, barycentric)
        total = np.full(len(face), ambient)
        for light in lights:
            l, intensity = light.toward(position)
            cosine = np.einsum("ij,ij->i", l, normal)
            lit = cosine > 0
            lit[lit] = self.free(start[lit], l[lit])
            total += np.where(lit, intensity * cosine, 0)
        return total

    def radiance(
        self,
        face: np.ndarray,
        barycentric: np.ndarray,
        view: np.ndarray,
        lights: list[Floodlight],
        ambient: float,
        materials: tuple[Material, ...],
    ) -> np.ndarray:
        """Paper, eq. 1: light sent along `view` (N, 3, unit, to the eye); (N, 3) linear.

        The ambient light comes from everywhere alike: its share of a lobe is 2/(α + 1).
        """
        position, normal, start, albedo = self.at(face, barycentric)
        rho_s = np.array([m.rho_s for m in materials])[self.material[face]]
        alpha = np.array([m.alpha for m in materials])[self.material[face]]
        mirror = 2 * np.einsum("ij,ij->i", normal, view)[:, None] * normal - view
        color = ambient * (albedo + (rho_s * 2 / (alpha + 1))[:, None])
        for light in lights:
            l, intensity = light.toward(position)
            cosine = np.einsum("ij,ij->i", l, normal)
            lit = np.flatnonzero(cosine > 0)
            lit = lit[self.free(start[lit], l[lit])]
            lobe = np.maximum(np.einsum("ij,ij->i", l[lit], mirror[lit]), 0) ** alpha[lit]
            diffuse = albedo[lit] * cosine[lit, None]
            color[lit] += intensity[lit, None] * (diffuse + (rho_s[lit] * lobe)[:, None])
        return color


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The image (S, S, 3) at texture coordinates (N, 2); row 0 is v = 1, texels' centres at .5."""
    height, width = image.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    col, row = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    s, t = (x - col)[:, None], (y - row)[:, None]
    upper = (1 - s) * image[row, col] + s * image[row, col + 1]
    lower = (1 - s) * image[row + 1, col] + s * image[row + 1, col + 1]
    return (1 - t) * upper + t * lower
