"""Scenes whose answers are known: cameras on an orbit, spheres and planes, Phong light in numpy.

Nothing here uses the package's kernels: what it computes is a second opinion on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.luminance import to_srgb8
from meshlab_svbrdf.samples.observations import Observations, observe
from meshlab_svbrdf.samples.store import SampleStore, write_store

ORIGIN = np.zeros(3)
REC709 = np.array([0.2126, 0.7152, 0.0722])


def unit(vectors) -> np.ndarray:
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def angle(a, b) -> np.ndarray:
    """Degrees between unit vectors, exact near 0."""
    return np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(np.subtract(a, b), axis=-1) / 2, 1)))


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, [1, 0, 2]]


# Cameras


def look_at(
    eye, target=ORIGIN, up=(0.0, 1.0, 0.0), *, width=160, height=120, fx=150.0, fy=None,
    cx=None, cy=None,
) -> Camera:  # fmt: skip
    """A camera at `eye` that looks at `target`."""
    eye = np.asarray(eye, float)
    forward = unit(np.subtract(target, eye))
    right = unit(np.cross(forward, up))
    R = np.array([right, np.cross(forward, right), forward])
    return Camera(
        width, height, fx, fx if fy is None else fy, (width - 1) / 2 if cx is None else cx,
        (height - 1) / 2 if cy is None else cy, R, -R @ eye,
    )  # fmt: skip


def orbit(count: int, distance: float = 4.0, turns: float = 1.0, climb: float = 60.0, **kw):
    """`count` cameras around the origin, climbing from −climb/2 to climb/2 degrees."""
    phi = 2 * np.pi * turns * np.arange(count) / count
    theta = np.radians(climb) * (np.arange(count) / max(count - 1, 1) - 0.5)
    eyes = distance * np.column_stack(
        [np.cos(theta) * np.sin(phi), np.sin(theta), np.cos(theta) * np.cos(phi)]
    )
    return [look_at(eye, **kw) for eye in eyes]


# Surfaces


def _grid(rows: int, cols: int) -> np.ndarray:
    i = np.arange(rows * cols).reshape(rows, cols)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)


def plane(size: float = 1.0, z: float = 0.0, cells: int = 1) -> Mesh:
    """A square of half side `size` that faces +z, with texture coordinates 0..1."""
    a = np.linspace(-1, 1, cells + 1)
    x, y = np.meshgrid(a, a, indexing="xy")
    vertices = np.column_stack([x.ravel() * size, y.ravel() * size, np.full(x.size, z)])
    faces = _grid(cells + 1, cells + 1)[:, [0, 2, 1]]
    uv = ((np.column_stack([x.ravel(), y.ravel()]) + 1) / 2)[faces]
    return Mesh(vertices, faces, None, uv)


def sphere(rows: int = 24, normals: bool = True) -> Mesh:
    """A unit sphere with a latitude-longitude chart; its seam and poles are doubled vertices."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1), indexing="ij"
    )
    st = np.sin(theta)
    xyz = np.stack([st * np.sin(phi), np.cos(theta), st * np.cos(phi)], -1).reshape(-1, 3)
    uv = np.stack([phi / (2 * np.pi), 1 - theta / np.pi], -1).reshape(-1, 2)
    faces = _grid(rows + 1, 2 * rows + 1)
    return Mesh(xyz, faces, xyz.copy() if normals else None, uv[faces])


def free_texels(position, normal, radius: float = 1.0, center=ORIGIN) -> Texels:
    """Texels at given places without any mesh, one column of a texture."""
    count = len(position)
    return Texels(
        np.asarray(position, np.float32), np.asarray(normal, np.float32), np.zeros(count, np.int32),
        np.tile(np.float32([1, 0, 0]), (count, 1)), np.zeros(count, np.uint8),
        np.arange(count, dtype=np.int32), np.zeros(count, np.int32), np.asarray(center, float),
        radius, ((count, 1),),
    )  # fmt: skip


def ball(count: int) -> Texels:
    """Texels spread evenly over the unit sphere (Fibonacci)."""
    k = np.arange(count) + 0.5
    y = 1 - 2 * k / count
    phi = np.pi * (1 + 5**0.5) * k
    s = np.sqrt(1 - y * y)
    d = np.column_stack([s * np.sin(phi), y, s * np.cos(phi)])
    return free_texels(d, d)


def bumpy_ball(count: int, depth: float = 0.06) -> Texels:
    """A convex ball with dents: r = 1 + depth · sin 2x · sin 2y · sin 2z, normals exact."""
    d = ball(count).position.astype(float)

    def swell(p):
        return depth * np.prod(np.sin(2 * p), axis=-1)

    step = 1e-6 * np.eye(3)
    slope = np.stack([(swell(d + e) - swell(d - e)) / 2e-6 for e in step], -1)
    r = 1 + swell(d)[:, None]
    tangent = slope - d * np.sum(slope * d, -1, keepdims=True)
    return free_texels(r * d, unit(r * d - tangent))


# Light


def lamp(direction, gain: float = 1.0, curvature: float = 0.0, spread: float = 0.02) -> Light:
    """A light whose blob is round, `spread` radians wide."""
    return Light(unit(direction), np.eye(2) * spread**2, gain, curvature, 1.0)


def view_vectors(texels: Texels, cameras: list[Camera]) -> np.ndarray:
    """v of every texel and frame, (T, F, 3) float64."""
    eyes = np.array([c.center for c in cameras]) - texels.center
    return unit(eyes[None] - texels.position[:, None].astype(float))


def mirror(texels: Texels, cameras: list[Camera]) -> np.ndarray:
    """r = 2 (n·v) n − v, (T, F, 3) float64."""
    v, n = view_vectors(texels, cameras), texels.normal[:, None].astype(float)
    return 2 * np.sum(n * v, -1, keepdims=True) * n - v


def lobes(texels: Texels, cameras: list[Camera], lights: list[Light], alpha) -> np.ndarray:
    """φ = Σ_k g_k (l_k·r)₊^α /|L_k|² where n·l_k > 0, (T, F) float64; `alpha` may be per texel."""
    r = mirror(texels, cameras)
    alpha = np.broadcast_to(np.asarray(alpha, float), len(texels))[:, None]
    total = np.zeros(r.shape[:2])
    for light in lights:
        L = light.direction - light.curvature / texels.radius * texels.position.astype(float)
        length = np.linalg.norm(L, axis=-1, keepdims=True)
        cos = np.maximum(np.einsum("tfd,td->tf", r, L / length), 0)
        above = np.sum(texels.normal * L, -1, keepdims=True) > 0
        total += np.where(above, light.gain * cos**alpha / length**2, 0)
    return total


# Samples


def grey(luminance) -> np.ndarray:
    """Linear luminance 0..100 as sRGB codes, (..., 3) uint8."""
    return np.repeat(to_srgb8(np.asarray(luminance) / 100)[..., None], 3, -1)


def store_of(folder: Path, codes, quality, **kw) -> SampleStore:
    """A store of codes (T, F, 3) uint8 with qualities (T, F) uint8; quality 0 is not seen."""
    folder.mkdir(parents=True, exist_ok=True)

    def sample(f):
        texel = np.flatnonzero(quality[:, f]).astype(np.int32)
        return SampledFrame(texel, np.column_stack([codes[texel, f], quality[texel, f]]))

    return write_store(folder, *quality.shape, sample, **kw)


def observations_of(
    folder: Path, codes, quality, texels: Texels, cameras: list[Camera], **kw
) -> Observations:
    """`store_of`, with its geometry."""
    store = store_of(folder, np.asarray(codes, np.uint8), np.asarray(quality, np.uint8))
    return observe(texels, store, cameras, np.zeros((1, 3), np.int32), **kw)


@dataclass(frozen=True)
class Scene:
    """An object under known lights and what its cameras see of it.

    material : (T,); rho_s (0..100), alpha : (M,); diffuse : (T, 3) linear 0..100
    """

    observations: Observations
    cameras: list[Camera]
    lights: list[Light]
    material: np.ndarray
    rho_s: np.ndarray
    alpha: np.ndarray
    diffuse: np.ndarray


def film(
    folder: Path, texels: Texels, cameras: list[Camera], lights: list[Light], material, rho_s,
    alpha, diffuse, *, tint=None, highlights=None, noise: float = 0.0, seed: int = 0,
) -> Scene:  # fmt: skip
    """Film texels that nothing occludes: sRGB codes with `noise` codes RMS, clipped at 255.

    A sample is seen where n·v > .1, with quality n·v, and marked where a channel is ≥ 254.
    highlights : (T, F), 0..100, instead of the lobes'
    """
    material, rho_s, alpha = (
        np.asarray(material),
        np.asarray(rho_s, float),
        np.asarray(alpha, float),
    )
    tint = np.ones((len(rho_s), 3)) if tint is None else np.asarray(tint, float)
    if highlights is None:
        highlights = rho_s[material, None] * lobes(texels, cameras, lights, alpha[material])
    linear = diffuse[:, None] + tint[material][:, None] * highlights[..., None]
    error = noise * np.random.default_rng(seed).normal(size=linear.shape)
    exact = linear / 100
    curve = np.where(
        exact <= 0.0031308,
        12.92 * exact,
        1.055 * np.maximum(exact, 0.0031308) ** (1 / 2.4) - 0.055,
    )
    codes = np.clip(np.rint(255 * curve + error), 0, 255).astype(np.uint8)
    facing = np.sum(view_vectors(texels, cameras) * texels.normal[:, None], -1)
    quality = np.where(facing > 0.1, np.rint(127 * facing.clip(0, 1)), 0).astype(np.uint8)
    quality |= np.where((codes.max(-1) >= 254) & (quality > 0), 128, 0).astype(np.uint8)
    observations = observations_of(folder, codes, quality, texels, cameras)
    return Scene(observations, cameras, lights, material, rho_s, alpha, diffuse)
