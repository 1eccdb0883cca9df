"""One frame projected to texels: which see it, how well, in what colour ([CCCS08])."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..blocks import LARGE, room, rowwise, transposed
from ..geometry.camera import Camera
from ..geometry.groups import GROUP, faces_away, group
from ..geometry.mesh import Mesh
from ..geometry.raster import DepthMaps
from ..geometry.texels import Texels
from ..jit import inner, kernel
from .chunks import SampledFrame
from .luminance import decode, encode
from .radiance_code import code_of
from .radiance_code import table as radiance_table

CLIPPED = 254
"""A channel at or above this value may have been brighter."""
CLIPPED_MEAN = 250
"""The same of the mean of several pixels, of which one alone may have been clipped."""

_TO_LINEAR = decode(np.arange(256) / 255).astype(np.float32)
_STEPS = 1 << 14  # finer than half a code at sRGB's steepest, 12.92 · 255 = 3295 codes per unit
_TO_CODE = np.rint(255 * encode((np.arange(_STEPS + 1)) / _STEPS)).astype(np.uint8)
_WIDE_TO_LINEAR = radiance_table()


@dataclass(frozen=True)
class Quality:
    """How the quality of a sample falls; lengths in pixels scale with width / 640.

    border : pixels, at 640 wide, over which quality rises from a depth jump, the image's border or
        the mask's edge
    jump : depth step that counts as a jump, in radii
    occlusion : how much deeper than the depth map a texel may lie and still be seen, in radii
    cut : samples below this quality are dropped
    clipped : a channel at or above this value, 0..255, may have been brighter
    """

    border: float = 5.0
    jump: float = 0.05
    occlusion: float = 0.02
    cut: float = 0.1
    clipped: int = CLIPPED


@kernel
def _mark_jumps(inverse_depth, step, smooth):
    """Clear `smooth` without surface, and on both sides of a depth step or a silhouette.

    A silhouette's own pixels hold some background: leaving them in costs .1 ΔE of D. The outermost
    pixels are neighbours only.
    """
    height, width = inverse_depth.shape
    for row in range(height):
        for col in range(width):
            smooth[row, col] &= inverse_depth[row, col] > 0
    for row in range(1, height - 1):
        for col in range(1, width - 1):
            w = inverse_depth[row, col]
            n, s = inverse_depth[row - 1, col], inverse_depth[row + 1, col]
            e, o = inverse_depth[row, col + 1], inverse_depth[row, col - 1]
            # |1/w − 1/o| ≤ step, without dividing
            limit = step * w
            smooth[row, col] &= (
                (abs(n - w) <= limit * n)
                & (abs(s - w) <= limit * s)
                & (abs(e - w) <= limit * e)
                & (abs(o - w) <= limit * o)
            )


# Rows of a group's tables, numbers and indices: quality is what depth and angle leave, 0 where the
# camera cannot see the texel; nearest a depth jump or a border; right of and below the pixel
DEPTH, COSINE, QUALITY, NEAREST, RIGHT, BELOW, SURFACE = range(0, 7 * GROUP, GROUP)
PIXEL, PLACE, SEEN = range(0, 3 * GROUP, GROUP)


@inner
def _project(
    position, normal, first, count, R, t, intrinsics, eye, size, crop, cut, reference_depth,
    numbers, indices,
):  # fmt: skip
    """Project `count` texels from `first` on, to the tables of the rows named above.

    size : the image's last column and row, and how many values a row of it has
    crop : left, top, width, height of the depth map in the image
    """
    # The compiler makes this loop eight texels wide if all that it reads are slices and numbers
    fx, fy, cx, cy = intrinsics
    width, height, stride = size
    left, top, columns, rows = crop
    ex, ey, ez = eye[0], eye[1], eye[2]
    r00, r01, r02, tx = R[0, 0], R[0, 1], R[0, 2], t[0]
    r10, r11, r12, ty = R[1, 0], R[1, 1], R[1, 2], t[1]
    r20, r21, r22, tz = R[2, 0], R[2, 1], R[2, 2], t[2]
    stop = first + count
    px, py, pz = position[0, first:stop], position[1, first:stop], position[2, first:stop]
    nx, ny, nz = normal[0, first:stop], normal[1, first:stop], normal[2, first:stop]
    zero, half, one = np.float32(0), np.float32(0.5), np.float32(1)
    for k in range(count):
        vx, vy, vz = ex - px[k], ey - py[k], ez - pz[k]
        facing = vx * nx[k] + vy * ny[k] + vz * nz[k]
        cos = facing / np.sqrt(vx * vx + vy * vy + vz * vz)
        z = r20 * px[k] + r21 * py[k] + r22 * pz[k] + tz
        x = fx * (r00 * px[k] + r01 * py[k] + r02 * pz[k] + tx) / z + cx
        y = fy * (r10 * px[k] + r11 * py[k] + r12 * pz[k] + ty) / z + cy
        near = min(reference_depth / z, one)
        quality = near * near * cos
        before = (cos > 0) & (z > 0) & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        before &= quality >= cut
        x, y = x if before else zero, y if before else zero
        numbers[DEPTH + k], numbers[COSINE + k] = z, cos
        numbers[QUALITY + k] = quality if before else zero
        numbers[NEAREST + k] = min(min(x, width - x), min(y, height - y)) + half
        # The pixel left above, and the nearest one's place in the depth map
        col, row = np.int32(x), np.int32(y)
        numbers[RIGHT + k], numbers[BELOW + k] = x - np.float32(col), y - np.float32(row)
        indices[PIXEL + k] = row * stride + col * np.int32(3)
        col, row = np.int32(x + half) - left, np.int32(y + half) - top
        inside = (col >= 0) & (row >= 0) & (col < columns) & (row < rows)
        indices[PLACE + k] = row * columns + col if inside else np.int32(0)


@inner
def _judge(numbers, indices, border, occlusion, cut):
    """Whether something lies before the texels, and their quality by the distance to the border
    too: a loop that the compiler makes eight texels wide."""
    one, zero = np.float32(1), np.float32(0)
    for k in range(GROUP):
        w = numbers[SURFACE + k]
        behind = (numbers[DEPTH + k] * w - one) * numbers[COSINE + k]
        quality = min(numbers[NEAREST + k] / border, one) * numbers[QUALITY + k]
        seen = (w > zero) & (behind <= occlusion * w) & (quality >= cut) & (quality > zero)
        numbers[QUALITY + k] = quality
        indices[SEEN + k] = seen


@inner
def _code(linear, to_code):
    """What is stored: an sRGB code, looked up, or without a table (None) a radiance's."""
    if to_code is None:  # each is compiled without the other
        return code_of(linear)
    return to_code[np.uint64(linear * np.float32(len(to_code) - 1) + np.float32(0.5))]


@kernel
def _sample(
    position, normal, groups, R, t, intrinsics, eye, image, inverse_depth, distance, origin,
    to_linear, to_code, border, occlusion, reference_depth, cut, limit,
    out_texel, out_value,
):  # fmt: skip
    """Test, weigh and sample the texels, in their order; returns how many are seen.

    inverse_depth and distance are crops of the image from column and row `origin` on.
    out_texel, out_value : with room for all texels and one more
    """
    one, half = np.float32(1), np.float32(0.5)
    stride = np.int32(3 * image.shape[1])
    size = (np.float32(image.shape[1] - 1), np.float32(image.shape[0] - 1), stride)
    rows, columns = inverse_depth.shape
    crop = (np.int32(origin[0]), np.int32(origin[1]), np.int32(columns), np.int32(rows))
    numbers, indices = np.zeros(7 * GROUP, np.float32), np.zeros(3 * GROUP, np.int32)
    # Unsigned offsets into flat arrays need no test for negative ones
    pixels, surface, smooth = image.ravel(), inverse_depth.ravel(), distance.ravel()
    right_of, below = np.uint64(3), np.uint64(stride)
    n = 0
    for g in range(len(groups.radius)):
        if faces_away(groups, g, eye):
            continue
        first = g * GROUP
        count = min(GROUP, position.shape[1] - first)
        _project(
            position, normal, first, count, R, t, intrinsics, eye, size, crop, cut,
            reference_depth, numbers, indices,
        )  # fmt: skip
        for k in range(count):
            place = np.uint64(indices[PLACE + k])
            numbers[SURFACE + k] = surface[place]
            numbers[NEAREST + k] = min(smooth[place], numbers[NEAREST + k])
        _judge(numbers, indices, border, occlusion, cut)
        # List what is seen, without branches: it cannot be foretold
        found = n
        for k in range(count):
            out_texel[found] = first + k
            found += indices[SEEN + k]
        for i in range(n, found):
            # Sample bilinearly in linear light
            own = np.uint64(out_texel[i] - first)
            a, b = numbers[RIGHT + own], numbers[BELOW + own]
            w00, w01 = (one - b) * (one - a), (one - b) * a
            w10, w11 = b * (one - a), b * a
            at = np.uint64(indices[PIXEL + own])
            brightest = pixels.dtype.type(0)
            for channel in (np.uint64(0), np.uint64(1), np.uint64(2)):
                p00, p01 = pixels[at + channel], pixels[at + right_of + channel]
                p10, p11 = pixels[at + below + channel], pixels[at + below + right_of + channel]
                brightest = max(brightest, max(max(p00, p01), max(p10, p11)))
                linear = (
                    w00 * to_linear[p00]
                    + w01 * to_linear[p01]
                    + w10 * to_linear[p10]
                    + w11 * to_linear[p11]
                )
                out_value[i, channel] = _code(linear, to_code)
            clipped = np.uint8(128) if brightest >= limit else np.uint8(0)
            out_value[i, 3] = np.uint8(numbers[QUALITY + own] * np.float32(127) + half) | clipped
        n = found
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
        self.position, self.normal = (
            transposed(values, np.float32) for values in (texels.position, texels.normal)
        )
        self.reference_depth = reference_depth
        self.quality = quality or Quality()
        self.groups = group(texels.position, texels.normal, self.quality.cut)
        vertices = rowwise(lambda some: some - texels.center, mesh.vertices)
        front = -mesh.winding() if mesh.is_closed() else 0
        self.depth_maps = DepthMaps(vertices, mesh.faces, front)
        low, high = vertices.min(0), vertices.max(0)
        self.box = np.stack(np.meshgrid(*np.stack([low, high], 1)), -1).reshape(-1, 3)

    def sample(
        self,
        camera: Camera,
        image: np.ndarray,
        mask: np.ndarray | None = None,
        clipped: int | None = None,
    ) -> SampledFrame:
        """The texels that see this frame.

        Parameters
        ----------
        camera : in the world (not about the centre)
        image : (H, W, 3) uint8, sRGB; or uint16, codes of radiance (samples/radiance_code.py)
        mask : (H, W) bool, True where the object is; or None
        clipped : a code of this frame's from which a pixel may have been brighter; None: as
            `Quality` says, and no radiance
        """
        q, texels = self.quality, self.texels
        size = (camera.height, camera.width)
        if image.shape != (*size, 3) or image.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"image: expected {(*size, 3)} uint8 or uint16 as the camera says, "
                f"not {image.shape} {image.dtype}"
            )
        kind = image.dtype.type
        tables = (_TO_LINEAR, _TO_CODE) if kind is np.uint8 else (_WIDE_TO_LINEAR, None)
        if clipped is None:
            clipped = q.clipped if kind is np.uint8 else 65535
        if mask is not None and mask.shape != size:
            raise ValueError(f"mask: expected {size} as the camera says, not {mask.shape}")
        camera = camera.about(texels.center)
        left, top, right, bottom = _window(camera, self.box)
        count = len(texels) if left < right and top < bottom else 0
        texel, value = room(count + 1, np.int32), room((count + 1, 4), kind)
        if count == 0:
            return SampledFrame(texel[:0], value[:0])
        # Look where the object is, and one pixel beyond
        inverse_depth = self.depth_maps.of(camera.cropped(left, top, right, bottom))
        smooth = np.ones(inverse_depth.shape, np.uint8)
        if mask is not None:
            inside = np.s_[max(top, 0) : bottom, max(left, 0) : right]
            smooth[max(-top, 0) :, max(-left, 0) :][
                : mask[inside].shape[0], : mask[inside].shape[1]
            ] = mask[inside]
        _mark_jumps(inverse_depth, np.float32(q.jump * texels.radius), smooth)
        distance = cv2.distanceTransform(smooth, cv2.DIST_L2, 3)
        n = _sample(
            self.position, self.normal, self.groups,
            camera.R.astype(np.float32), camera.t.astype(np.float32),
            np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32),
            camera.center.astype(np.float32), np.ascontiguousarray(image), inverse_depth, distance,
            (left, top), *tables, np.float32(q.border * camera.width / 640),
            np.float32(q.occlusion * texels.radius), np.float32(self.reference_depth),
            np.float32(q.cut), kind(clipped), texel, value,
        )  # fmt: skip
        if texel.nbytes >= LARGE:  # what was not written takes no memory
            return SampledFrame(texel[:n], value[:n])
        return SampledFrame(texel[:n].copy(), value[:n].copy())


def _window(camera: Camera, box: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels (half open) that a box's 8 corners (8, 3) enclose,
    one pixel around, from −1 to one beyond the image."""
    x, y, z = camera.project(box).T
    if z.min() <= 0:
        return -1, -1, camera.width + 1, camera.height + 1
    left, top = (max(int(np.floor(min(v.min(), 1e9))) - 1, -1) for v in (x, y))
    right, bottom = (
        min(int(np.ceil(max(v.max(), -1e9))) + 2, size + 1)
        for v, size in ((x, camera.width), (y, camera.height))
    )
    return left, top, right, bottom
