"""A keyframe as it would look from another camera: its pixels carried over by the surface."""

from __future__ import annotations

import numpy as np

from ..jit import kernel
from .surface import View


@kernel
def _warp(inverse_depth, rays, R, t, intrinsics, image, depth, tolerance, out, valid):
    """Fill `out` and `valid` (h, w) uint8 for the pixels that the other view sees too.

    rays : (fx, fy, cx, cy) of the view to fill; R, t : from its coordinates to the other's
    """
    fx, fy, cx, cy = intrinsics
    rx, ry, rcx, rcy = rays
    height, width = inverse_depth.shape
    bottom, right = image.shape[0] - 1, image.shape[1] - 1
    for row in range(height):
        y = (row - rcy) / ry
        for col in range(width):
            w = inverse_depth[row, col]
            if w <= 0:
                continue
            x = (col - rcx) / rx
            # The point, and where the other view sees it; scaled by 1/z, which leaves pixels alone
            px = R[0, 0] * x + R[0, 1] * y + R[0, 2] + t[0] * w
            py = R[1, 0] * x + R[1, 1] * y + R[1, 2] + t[1] * w
            pz = R[2, 0] * x + R[2, 1] * y + R[2, 2] + t[2] * w
            if pz <= 0:
                continue
            u, v = fx * px / pz + cx, fy * py / pz + cy
            if not (u >= 0 and v >= 0 and u < right and v < bottom):
                continue
            c, r = int(u), int(v)
            seen = depth[int(v + 0.5), int(u + 0.5)]
            if seen <= 0 or pz / w - 1 / seen > tolerance:
                continue
            a, b = u - c, v - r
            upper = (1 - a) * image[r, c] + a * image[r, c + 1]
            lower = (1 - a) * image[r + 1, c] + a * image[r + 1, c + 1]
            out[row, col] = (1 - b) * upper + b * lower
            valid[row, col] = 1


def warp(image: np.ndarray, source: View, target: View, tolerance: float):
    """An image's pixels as another view sees them.

    Parameters
    ----------
    image : (h, w) uint8, the crop that `source` shows
    tolerance : how much deeper than its depth the source may see a point, world units

    Returns
    -------
    out : (h', w') float32 in `target`'s crop; valid : (h', w') uint8, 1 where seen in both
    """
    a, b = source.camera, target.camera
    R = a.R @ b.R.T
    out = np.zeros(target.inverse_depth.shape, np.float32)
    valid = np.zeros(out.shape, np.uint8)
    _warp(
        target.inverse_depth, (b.fx, b.fy, b.cx, b.cy), R, a.t - R @ b.t,
        (a.fx, a.fy, a.cx, a.cy), image, source.inverse_depth, tolerance, out, valid,
    )  # fmt: skip
    return out, valid
