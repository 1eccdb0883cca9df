"""What every stage after the capture reads: the samples, and the geometry they were taken in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..geometry.camera import Camera
from ..geometry.harmonics import evaluate
from ..geometry.texels import Texels
from ..geometry.visibility import Rays
from ..jit import inner, kernel
from .luminance import decode
from .radiance_code import LARGEST, table
from .store import SampleStore

VISIBLE = np.float32(0.25)
"""Visibility, as the harmonics have it, up to which nothing is seen."""


class View(NamedTuple):
    """The arrays that kernels read, as one argument.

    position, normal : (T, 3) float32 about the centre
    face : (T,) int32; barycentric : (T, 3) float32
    eyes : (F, 3) float32, where each frame's camera stands, about the centre
    scale : (F, 3) float32, linear 0..1 of what the code can hold to 0..100 of the median exposure
    faces : (M, 3) int32; coefficients : (V, 36) float32 of the visibility, or (0, 36): all visible
    linear : (256,) float32, sRGB code to linear 0..1; or (65536,), a radiance's code to 0..1 of the
        largest
    even : whether the frames' scales are all the same
    """

    position: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    eyes: np.ndarray
    scale: np.ndarray
    faces: np.ndarray
    coefficients: np.ndarray
    linear: np.ndarray
    even: bool


@dataclass(frozen=True)
class Observations:
    """The sample store with all that is needed to interpret it.

    sequence : (F,) int32, which film a frame belongs to; order : (F,) int32, its place in the film:
    frames whose places differ by one are neighbours in time, a gap is a frame that was left out
    pixel : (F,) float32, radians that a frame's pixel subtends at its middle
    rays : of the mesh, to test lights for shadows; None: the harmonics tell
    shape : (T, 3, 3) float32, how the normals turn (`geometry.surface_shape`), which tells how far
        a pixel blurs highlights; None: it does not
    """

    texels: Texels
    store: SampleStore
    view: View
    sequence: np.ndarray
    order: np.ndarray
    pixel: np.ndarray
    rays: Rays | None = None
    shape: np.ndarray | None = None

    @property
    def footprint(self) -> float:
        """A pixel's size on the object, in radii: the median over the frames."""
        away = np.linalg.norm(self.view.eyes, axis=1) / self.texels.radius
        return float(np.median(away * self.pixel))


def observe(
    texels: Texels,
    store: SampleStore,
    cameras: list[Camera],
    faces: np.ndarray,
    *,
    gains: np.ndarray | None = None,
    coefficients: np.ndarray | None = None,
    sequence: np.ndarray | None = None,
    order: np.ndarray | None = None,
    rays: Rays | None = None,
) -> Observations:
    """Bundle a store with its geometry.

    Parameters
    ----------
    cameras : one per frame of the store, world coordinates
    faces : (M, 3) int32 of the mesh
    gains : (F,) or (F, 3) relative brightness of each frame (exposure, white balance); the samples
        are divided by it. Normalise to the median frame so that thresholds keep their meaning.
    coefficients : (V, 36) visibility in spherical harmonics, or None where nothing shadows anything
    """
    count = len(cameras)
    if count != store.frames:
        raise ValueError(f"cameras: expected one for each of the store's {store.frames} frames")
    if len(texels) != store.texels:
        raise ValueError(f"texels: expected the {store.texels} of the store, not {len(texels)}")
    gain = (
        np.ones((count, 3))
        if gains is None
        else np.broadcast_to(np.asarray(gains, float).reshape(count, -1), (count, 3))
    )
    if not (np.isfinite(gain).all() and (gain > 0).all()):
        raise ValueError("gains: expected positive numbers")
    wide = store.bits == 16
    if coefficients is None:
        coefficients = np.zeros((0, 36), np.float32)
    scale = np.ascontiguousarray((100.0 * LARGEST if wide else 100.0) / gain, np.float32)
    view = View(
        np.ascontiguousarray(texels.position, np.float32),
        np.ascontiguousarray(texels.normal, np.float32),
        np.ascontiguousarray(texels.face, np.int32),
        np.ascontiguousarray(texels.barycentric, np.float32),
        np.array([c.center - texels.center for c in cameras], np.float32).reshape(count, 3),
        scale,
        np.ascontiguousarray(faces, np.int32),
        np.ascontiguousarray(coefficients, np.float32),
        table() if wide else decode(np.arange(256) / 255).astype(np.float32),
        bool((scale == scale[:1]).all()),
    )  # fmt: skip
    return Observations(
        texels, store, view,
        np.zeros(count, np.int32) if sequence is None else np.asarray(sequence, np.int32),
        np.arange(count, dtype=np.int32) if order is None else np.asarray(order, np.int32),
        np.array([1 / np.sqrt(c.fx * c.fy) for c in cameras], np.float32),
        rays,
    )  # fmt: skip


def with_normals(observations: Observations, normal: np.ndarray) -> Observations:
    """The same samples seen with other normals (T, 3), unit."""
    return replace(
        observations,
        texels=replace(observations.texels, normal=normal),
        view=observations.view._replace(normal=np.ascontiguousarray(normal, np.float32)),
    )


@kernel
def color(block, view, j):
    """Sample j's linear RGB, 0..100 of the median exposure."""
    f = block.frame[j]
    return (
        view.linear[block.value[j, 0]] * view.scale[f, 0],
        view.linear[block.value[j, 1]] * view.scale[f, 1],
        view.linear[block.value[j, 2]] * view.scale[f, 2],
    )


@inner
def relative_luminance(r, g, b):
    """Linear Y (Rec. 709) of a linear colour."""
    return np.float32(0.2126) * r + np.float32(0.7152) * g + np.float32(0.0722) * b


@kernel
def sample_luminance(block, view, j):
    """Sample j's linear Y (Rec. 709), 0..100 of the median exposure."""
    r, g, b = color(block, view, j)
    return relative_luminance(r, g, b)


@inner
def longest(offsets, first, stop):
    """The most samples of a texel among first..stop."""
    most = 0
    for i in range(first, stop):
        most = max(most, offsets[i + 1] - offsets[i])
    return most


@kernel
def sample_quality(block, j):
    """Sample j's quality in 0..1, without the clipping bit."""
    return np.float32(block.value[j, 3] & 127) / np.float32(127)


@kernel
def mirror_direction(view, i, f):
    """r = 2 (n·v) n − v of texel i seen from frame f; unit."""
    vx, vy, vz = (
        view.eyes[f, 0] - view.position[i, 0],
        view.eyes[f, 1] - view.position[i, 1],
        view.eyes[f, 2] - view.position[i, 2],
    )
    scale = np.float32(1) / np.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * scale, vy * scale, vz * scale
    nx, ny, nz = view.normal[i, 0], view.normal[i, 1], view.normal[i, 2]
    twice = np.float32(2) * (nx * vx + ny * vy + nz * vz)
    return twice * nx - vx, twice * ny - vy, twice * nz - vz


@inner
def mirrors(view, i, frame, x, y, z):
    """`mirror_direction` of texel i seen from some frames (n,), to x, y, z (n,) float32."""
    n = len(frame)
    nx, ny, nz = view.normal[i, 0], view.normal[i, 1], view.normal[i, 2]
    px, py, pz = view.position[i, 0], view.position[i, 1], view.position[i, 2]
    for j in range(n):
        f = np.uint32(frame[j])
        x[j], y[j], z[j] = view.eyes[f, 0], view.eyes[f, 1], view.eyes[f, 2]
    for j in range(n):
        x[j], y[j], z[j] = x[j] - px, y[j] - py, z[j] - pz
        scale = np.float32(1) / np.sqrt(x[j] * x[j] + y[j] * y[j] + z[j] * z[j])
        twice = np.float32(2) * (nx * x[j] + ny * y[j] + nz * z[j]) * scale
        x[j], y[j], z[j] = (
            twice * nx - x[j] * scale, twice * ny - y[j] * scale, twice * nz - z[j] * scale,
        )  # fmt: skip


@kernel
def fill_visibility(view, i, out):
    """Texel i's 36 visibility coefficients to `out`; False where all is visible."""
    if view.coefficients.shape[0] == 0:
        return False
    a, b, c = view.faces[view.face[i], 0], view.faces[view.face[i], 1], view.faces[view.face[i], 2]
    u, v, w = view.barycentric[i, 0], view.barycentric[i, 1], view.barycentric[i, 2]
    for k in range(36):
        out[k] = (
            u * view.coefficients[a, k] + v * view.coefficients[b, k] + w * view.coefficients[c, k]
        )
    return True


@kernel
def visibility(has, coefficients, x, y, z):
    """Remapped visibility clip((V − .25) / .5, 0, 1) along a direction above the horizon."""
    if not has:
        return np.float32(1)
    return np.float32(min(max((evaluate(coefficients, x, y, z) - VISIBLE) * 2.0, 0.0), 1.0))
