"""Where a frame shows the geometry's own lines: silhouettes, and sharp edges that are seen.

outline       the lines that a camera sees, as the frame has them
fit_outline   the camera nearby whose lines are the frame's

What is printed on a surface does not tell where the surface ends; its lines do (Harris and
Stennett 1990, "RAPID"). From each point of a line the frame's step of brightness is looked for
across it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from .overlay import Edges
from .pose import motion_cost, moved, pixel_motion, point_motion, twist_between
from .surface import Surface, View

EVERY = 5.0  # pixels between points along the lines
MOST = 240  # points of a frame
REACH = 3, 8  # pixels, at least and at most, to each side in which a step is looked for
REACH_SHARE = 1 / 30  # of the object's radius in the frame: the same
ALONG = 2  # pixels to each side along the line over which its profile is averaged
FAINTEST = 3.0  # codes per pixel: a step that is one
RIVAL = 0.5  # of the strongest step: a nearer one that is as strong is taken first
BORDER = 4  # pixels of the frame's border that are not looked at
WIDTHS = (8.0, 8.0, 6.0, 4.0, 3.0, 2.0, 2.0)  # pixels, of each round
AGREE = 1.5  # pixels across a line within which a step is the line's
FEWEST = 20  # points, below which lines tell little
NEIGHBOURS = 10.0  # points that err alike
FOCAL = 0.05  # share by which a focal length that is free may be wrong
NEXT = 0.01  # of the depth by which a line may lie behind what is drawn there


@dataclass(frozen=True)
class Outline:
    """Points of the geometry's lines, and where a frame has its steps.

    points : (n, 3) in the scaled world; found : (n, 2) pixels of the whole frame
    whitener : (n, 2, 2), in pixels across the line: along it nothing is known
    looked : at how many points a step was looked for
    """

    points: np.ndarray
    found: np.ndarray
    whitener: np.ndarray
    looked: int

    def __len__(self) -> int:
        return len(self.points)

    def off(self, camera: Camera) -> np.ndarray:
        """Pixels (n,) across the lines by which a camera misses the steps."""
        miss = self.found - camera.project(self.points)[:, :2]
        return np.linalg.norm(np.einsum("nij,nj->ni", self.whitener, miss), axis=1)

    def linear(self, camera: Camera, free_focal: bool):
        """Residuals (n, 2) across the lines, and their slopes (n, 2, 6 or 7) by the camera's twist
        and, where it is free, by the logarithm of its focal length."""
        local = self.points @ camera.R.T + camera.t
        local = np.where(local[:, 2:] > 1e-9, local, [0, 0, 1e-9])
        at = local[:, :2] / local[:, 2:] * [camera.fx, camera.fy]
        W = self.whitener
        residual = np.einsum("nij,nj->ni", W, self.found - at - [camera.cx, camera.cy])
        J = W @ pixel_motion(local, camera) @ point_motion(local)
        if free_focal:
            J = np.concatenate([J, np.einsum("nij,nj->ni", W, at)[..., None]], 2)
        return residual, J


def outline(
    image: np.ndarray, view: View, camera: Camera, surface: Surface, edges: Edges
) -> Outline:
    """The lines that a camera sees, as the frame has them near where the camera expects them.

    image : (h, w) uint8, whole; view : the camera's
    """
    points, ends = _points(view, camera, surface, edges)
    at = camera.project(points)[:, :2]
    along = camera.project(ends)[:, :2] - at
    along /= np.linalg.norm(along, axis=1, keepdims=True).clip(1e-9)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    rim = camera.fx / max(camera.t[2], 1e-9)
    reach = int(np.clip(REACH_SHARE * rim, *REACH))
    offset, ok = _steps(image, at, along, across, reach)
    whitener = across[:, :, None] * across[:, None, :]
    found = at + offset[:, None] * across
    return Outline(points[ok], found[ok], whitener[ok], len(ok))


def fit_outline(
    image: np.ndarray, camera: Camera, surface: Surface, edges: Edges, hold: float,
    free_focal: bool = False,
) -> tuple[Camera, float]:  # fmt: skip
    """The camera nearby whose lines are the frame's, and the share of them that are.

    Gauss–Newton with Geman and McClure's weights, whose width shrinks from round to round.

    image : (h, w) uint8; hold : pixels, RMS, by which the camera may be wrong
    """
    given, share = camera, 0.0
    cost = np.zeros((6 + free_focal, 6 + free_focal))
    cost[:6, :6] = motion_cost(camera, surface.visible_points(camera), hold)
    if free_focal:
        cost[6, 6] = 1 / FOCAL**2
    for width in WIDTHS:
        view = surface.view(camera, jumps=False)
        if view is None:
            break
        lines = outline(image, view, camera, surface, edges)
        r, J = lines.linear(camera, free_focal)
        weight = 1 / (1 + (np.linalg.norm(r, axis=1) / width) ** 2) ** 2 / NEIGHBOURS
        gone = np.append(
            twist_between(given, camera), [np.log(camera.fx / given.fx)] * free_focal
        )  # fmt: skip
        A = np.einsum("n,nij,nik->jk", weight, J, J) + cost
        b = np.einsum("n,nij,ni->j", weight, J, r) - cost @ gone
        step = np.linalg.solve(A + 1e-12 * np.eye(len(A)) * A.max(), b)
        grown = float(np.exp(step[6])) if free_focal else 1.0
        camera = moved(camera, step[:6])
        camera = replace(camera, fx=camera.fx * grown, fy=camera.fy * grown)
        share = float((lines.off(camera) < AGREE).sum() / max(lines.looked, FEWEST))
    return camera, share


def _points(view: View, camera: Camera, surface: Surface, edges: Edges):
    """Points (n, 3) evenly along the lines that are seen, and the ends they run to."""
    front = np.einsum("ij,ij->i", edges.normals, camera.center - edges.centers) > 0
    one, other = front[edges.faces[:, 0]], front[edges.faces[:, 1]]
    drawn = (edges.faces[:, 1] < 0) | (one != other) | (edges.sharp & one)
    a, b = (surface.vertices[edges.ends[drawn, k]] for k in (0, 1))
    p, q = camera.project(a), camera.project(b)
    near = (p[:, 2] > 0) & (q[:, 2] > 0)
    length = np.where(near, np.linalg.norm(p[:, :2] - q[:, :2], axis=1), 0)
    length = np.minimum(length, 4 * (camera.width + camera.height))
    total = np.cumsum(length)
    whole = float(total[-1]) if len(total) else 0.0
    steps = np.arange(EVERY / 2, whole, EVERY)
    line = np.searchsorted(total, steps)
    share = ((total[line] - steps) / length[line])[:, None]
    points = share * a[line] + (1 - share) * b[line]
    # What is hidden, or at the frame's border, is left out
    u, v, z = camera.project(points).T
    h, w = view.inverse_depth.shape
    col, row = np.rint(u - view.left), np.rint(v - view.top)
    inside = (z > 0) & (u >= BORDER) & (u < camera.width - BORDER)
    inside &= (v >= BORDER) & (v < camera.height - BORDER)
    inside &= (col >= 0) & (col < w) & (row >= 0) & (row < h)
    behind = cv2.erode(view.inverse_depth, np.ones((3, 3)))
    at = row[inside].astype(int), col[inside].astype(int)
    inside[inside] = 1 / z[inside] >= (1 - NEXT) * behind[at]
    some = np.flatnonzero(inside)
    some = some[:: max(-(-len(some) // MOST), 1)]
    return points[some], b[line[some]]


def _steps(image: np.ndarray, at: np.ndarray, along: np.ndarray, across: np.ndarray, most: int):
    """How far (n,) across a line its step is, the nearest strong one, and whether there is one."""
    reach = np.arange(-most - 1.0, most + 2.0)
    beside = np.arange(-ALONG, ALONG + 1.0)
    places = (
        at[:, None, None]
        + reach[:, None, None] * across[:, None, None]
        + beside[:, None] * along[:, None, None]
    ).astype(np.float32)
    if len(at) == 0:
        return np.zeros(0), np.zeros(0, bool)
    rows = places.reshape(-1, len(beside), 2)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    seen = cv2.remap(smooth, rows[..., 0], rows[..., 1], cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    profile = seen.reshape(len(at), len(reach), len(beside)).mean(2)
    slope = np.abs(profile[:, 2:] - profile[:, :-2]) / 2
    strongest = slope.max(1)
    peak = np.zeros(slope.shape, bool)
    peak[:, 1:-1] = (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] > slope[:, 2:])
    peak &= slope >= np.maximum(FAINTEST, RIVAL * strongest)[:, None]
    distance = np.where(peak, np.abs(reach[1:-1]), np.inf)
    best = distance.argmin(1)
    ok = np.isfinite(distance.min(1))
    # The peak between pixels
    n = np.arange(len(at))
    middle = best.clip(1, slope.shape[1] - 2)
    a, b, c = (slope[n, middle + d] for d in (-1, 0, 1))
    bend = np.maximum(2 * b - a - c, 1e-9)
    return reach[1:-1][middle] + np.clip((c - a) / (2 * bend), -0.5, 0.5), ok
