"""One frame projected to texels: which see it, how well, in what colour ([CCCS08])."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.raster import rasterise
from ..geometry.texels import Texels
from .luminance import decode, encode

CLIPPED = 254
"""A channel at or above this value may have been brighter."""

_TO_LINEAR = decode(np.arange(256) / 255).astype(np.float32)
_STEPS = 1 << 14  # finer than half a code at sRGB's steepest, 12.92 · 255 = 3295 codes per unit
_TO_CODE = np.rint(255 * encode((np.arange(_STEPS + 1)) / _STEPS)).astype(np.uint8)


@dataclass(frozen=True)
class Quality:
    """How the quality of a sample falls; lengths in pixels scale with width / 640.

    border : pixels, at 640 wide, over which quality rises from a depth jump, the image's border or
        the mask's edge
    jump : depth step that counts as a jump, in radii
    occlusion : how much deeper than the depth map a texel may lie and still be seen, in radii
    cut : samples below this quality are dropped
    """

    border: float = 5.0
    jump: float = 0.05
    occlusion: float = 0.02
    cut: float = 0.1


@njit(cache=True, nogil=True)
def _mark_jumps(inverse_depth, step, smooth):
    """Clear `smooth` without surface, and on both sides of a depth step or a silhouette.

    A silhouette's own pixels hold some background: leaving them in costs .1 ΔE of D.
    """
    height, width = inverse_depth.shape
    for row in range(height):
        for col in range(width):
            w = inverse_depth[row, col]
            if w <= 0.0:
                smooth[row, col] = 0
            for dr, dc in ((0, 1), (1, 0)):
                r, c = row + dr, col + dc
                if r < height and c < width:
                    o = inverse_depth[r, c]
                    if w <= 0.0 and o <= 0.0:
                        continue
                    if w <= 0.0 or o <= 0.0 or abs(1.0 / w - 1.0 / o) > step:
                        smooth[row, col] = 0
                        smooth[r, c] = 0


@njit(cache=True, nogil=True)
def _sample(
    position, normal, R, t, intrinsics, eye, image, inverse_depth, distance,
    to_linear, to_code, border, occlusion, reference_depth, cut,
    out_texel, out_rgb, out_quality,
):  # fmt: skip
    """Test, weigh and sample every texel, in their order; returns how many are seen."""
    height, width = inverse_depth.shape
    fx, fy, cx, cy = intrinsics
    steps = len(to_code) - 1
    n = 0
    for i in range(position.shape[0]):
        # Skip what faces away, then what falls outside the image
        vx, vy, vz = eye[0] - position[i, 0], eye[1] - position[i, 1], eye[2] - position[i, 2]
        facing = vx * normal[i, 0] + vy * normal[i, 1] + vz * normal[i, 2]
        if facing <= 0.0:
            continue
        cos = facing / np.sqrt(vx * vx + vy * vy + vz * vz)
        if cos < cut:
            continue
        z = R[2, 0] * position[i, 0] + R[2, 1] * position[i, 1] + R[2, 2] * position[i, 2] + t[2]
        if z <= 0.0:
            continue
        x = (
            fx
            * (
                R[0, 0] * position[i, 0]
                + R[0, 1] * position[i, 1]
                + R[0, 2] * position[i, 2]
                + t[0]
            )
            / z
            + cx
        )
        y = (
            fy
            * (
                R[1, 0] * position[i, 0]
                + R[1, 1] * position[i, 1]
                + R[1, 2] * position[i, 2]
                + t[1]
            )
            / z
            + cy
        )
        if not (x >= 0.0 and y >= 0.0 and x < width - 1 and y < height - 1):
            continue
        # Weigh by distance to the border, depth and angle
        col, row = int(x + 0.5), int(y + 0.5)
        d = min(distance[row, col], min(min(x, width - 1 - x), min(y, height - 1 - y)) + 0.5)
        near = min(reference_depth / z, 1.0)
        quality = min(d / border, 1.0) * near * near * cos
        if quality < cut or not quality > 0.0:
            continue
        # Test whether something lies before it
        w = inverse_depth[row, col]
        if w <= 0.0 or z - 1.0 / w > occlusion / cos:
            continue
        # Sample bilinearly in linear light
        c0, r0 = int(x), int(y)
        a, b = x - c0, y - r0
        clipped = False
        for channel in range(3):
            p00, p01 = image[r0, c0, channel], image[r0, c0 + 1, channel]
            p10, p11 = image[r0 + 1, c0, channel], image[r0 + 1, c0 + 1, channel]
            clipped |= p00 >= CLIPPED or p01 >= CLIPPED or p10 >= CLIPPED or p11 >= CLIPPED
            linear = (1.0 - b) * ((1.0 - a) * to_linear[p00] + a * to_linear[p01]) + b * (
                (1.0 - a) * to_linear[p10] + a * to_linear[p11]
            )
            out_rgb[n, channel] = to_code[int(linear * steps + 0.5)]
        out_texel[n] = i
        out_quality[n] = np.uint8(quality * 127.0 + 0.5) | (
            np.uint8(128) if clipped else np.uint8(0)
        )
        n += 1
    return n


def reference_depth(points: np.ndarray, cameras: list[Camera]) -> float:
    """The 10th percentile of depth over the project: nearer views lose no quality.

    points : (N, 3) float, some points of the surface, in the cameras' world
    """
    depths = []
    for camera in cameras:
        x, y, z = camera.project(points).T
        depths.append(z[(z > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)])
    depth = np.concatenate(depths) if depths else np.zeros(0)
    return float(np.quantile(depth, 0.1)) if len(depth) else 1.0


class FrameSampler:
    """Samples frames to texels; one object for many frames and threads.

    Parameters
    ----------
    mesh : the surface, world coordinates
    texels : its texels
    reference_depth : see the function of that name
    """

    def __init__(
        self, mesh: Mesh, texels: Texels, reference_depth: float, quality: Quality | None = None
    ):
        self.texels = texels
        self.vertices = mesh.vertices - texels.center
        self.faces = mesh.faces
        self.reference_depth = reference_depth
        self.quality = quality or Quality()

    def sample(
        self, camera: Camera, image: np.ndarray, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The texels that see this frame.

        Parameters
        ----------
        camera : in the world (not about the centre)
        image : (H, W, 3) uint8, sRGB
        mask : (H, W) bool, True where the object is; or None

        Returns
        -------
        texel : (n,) int32, ascending
        rgb : (n, 3) uint8, sRGB, interpolated in linear light
        quality : (n,) uint8: quality · 127 in the low seven bits; the top bit: any tap was clipped
        """
        q, texels = self.quality, self.texels
        size = (camera.height, camera.width)
        if image.shape != (*size, 3) or image.dtype != np.uint8:
            raise ValueError(
                f"image: expected {(*size, 3)} uint8 as the camera says, "
                f"not {image.shape} {image.dtype}"
            )
        if mask is not None and mask.shape != size:
            raise ValueError(f"mask: expected {size} as the camera says, not {mask.shape}")
        camera = camera.about(texels.center)
        inverse_depth, _ = rasterise(self.vertices, self.faces, camera)
        smooth = np.ones(inverse_depth.shape, np.uint8) if mask is None else mask.astype(np.uint8)
        _mark_jumps(inverse_depth, q.jump * texels.radius, smooth)
        distance = cv2.distanceTransform(smooth, cv2.DIST_L2, 3)
        count = len(texels)
        texel, rgb = np.empty(count, np.int32), np.empty((count, 3), np.uint8)
        weight = np.empty(count, np.uint8)
        n = _sample(
            texels.position, texels.normal,
            camera.R.astype(np.float32), camera.t.astype(np.float32),
            np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32),
            camera.center.astype(np.float32), np.ascontiguousarray(image), inverse_depth, distance,
            _TO_LINEAR, _TO_CODE, np.float32(q.border * camera.width / 640),
            np.float32(q.occlusion * texels.radius), np.float32(self.reference_depth),
            np.float32(q.cut), texel, rgb, weight,
        )  # fmt: skip
        return texel[:n].copy(), rgb[:n].copy(), weight[:n].copy()
