"""All cameras adjusted together against the mesh.

A feature is a pixel of its keyframe; the surface says where it lies; so a match of a frame with a
keyframe ties two cameras and nothing else. Points need no unknowns of their own: they slide on the
surface as their keyframe's camera moves. What fixes the whole is the surface's shape.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array, csc_array
from scipy.sparse.linalg import splu

from ..geometry.camera import Camera
from ..jit import kernel
from .keyframes import Keyframe
from .match import Matches
from .outlines import NEIGHBOURS, Outline
from .pose import OUTLIER, motion_cost, moved, twist_between
from .surface import Surface

ROUNDS = 15
WIDEST = 30.0  # standard deviations at which weights fall at first: loops may have come apart
DAMPING = 1e-9  # of the diagonal: holds cameras that nothing ties
TIES = 120  # matches of a frame with a keyframe that the cameras are adjusted to
LIFT = 4  # rounds after which features are lifted to the surface anew
DONE = 0.02  # standard deviations of motion below which nothing changes any more


@dataclass(frozen=True)
class Adjusted:
    """Cameras after the adjustment.

    inliers : per frame, how many matches agree
    residual, uncertainty : per frame, pixels: RMS of those, and RMS error to be expected
    """

    cameras: dict[int, Camera]
    keyframes: list[Keyframe]
    inliers: dict[int, int]
    residual: dict[int, float]
    uncertainty: dict[int, float]


@kernel
def _slopes(points, planes, found, whitener, R, t, lens, other_R, other_t, residual, J):
    """Fill residuals (n, 2) and their slopes (n, 2, 13); lens : fx, fy, cx, cy"""
    turn = R @ other_R.T
    x, local, slide = np.empty(3), np.empty(3), np.empty(3)
    g, h = np.empty(3), np.empty(3)
    for n in range(len(points)):
        for k in range(3):
            local[k], x[k] = t[k], other_t[k]
            for c in range(3):
                local[k] += R[k, c] * points[n, c]
                x[k] += other_R[k, c] * points[n, c]
        z = local[2]
        if z <= 1e-9:
            local[0], local[1], z = 0.0, 0.0, 1e-9
        u, v = lens[0] * local[0] / z, lens[1] * local[1] / z
        du, dv = found[n, 0] - u - lens[2], found[n, 1] - v - lens[3]
        for row in range(2):
            a, b = whitener[n, row, 0], whitener[n, row, 1]
            residual[n, row] = a * du + b * dv
            g[0], g[1] = a * lens[0] / z, b * lens[1] / z
            g[2] = -(a * u + b * v) / z
            # The keyframe's motion moves the point within its tangent plane: −(1 − x qᵀ)(ω × x + v)
            along = 0.0
            for k in range(3):
                h[k] = g[0] * turn[0, k] + g[1] * turn[1, k] + g[2] * turn[2, k]
                along += h[k] * x[k]
            for k in range(3):
                slide[k] = along * planes[n, k] - h[k]
            for at, p, m in ((0, local, g), (6, x, slide)):
                J[n, row, at] = m[2] * p[1] - m[1] * p[2]
                J[n, row, at + 1] = m[0] * p[2] - m[2] * p[0]
                J[n, row, at + 2] = m[1] * p[0] - m[0] * p[1]
                for k in range(3):
                    J[n, row, at + 3 + k] = m[k]
            # A longer focal length also makes the keyframe's rays narrower
            narrower = slide[0] * x[0] + slide[1] * x[1]
            J[n, row, 12] = a * u + b * v + narrower


def _linear(keyframe: Keyframe, matches: Matches, camera: Camera):
    """Whitened residuals (n, 2) and their slopes (n, 2, 13): by the frame's twist, the keyframe's,
    and the logarithm of the focal length."""
    residual, J = np.empty((len(matches), 2)), np.empty((len(matches), 2, 13))
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    _slopes(
        keyframe.points[matches.feature], keyframe.planes[matches.feature], matches.found,
        matches.whitener, camera.R, camera.t, lens, keyframe.camera.R, keyframe.camera.t,
        residual, J,
    )  # fmt: skip
    return residual, J


def adjust(
    cameras: Mapping[int, Camera],
    keyframes: Sequence[Keyframe],
    matches: Mapping[int, Sequence[Matches]],
    surface: Surface,
    held: Mapping[int, Camera],
    hold: float,
    free_focal: bool = False,
    outlines: Mapping[int, Outline] | None = None,
    settled: bool = False,
) -> Adjusted:
    """Cameras, and keyframes with them, that explain all matches best, outliers aside.

    Gauss–Newton on all cameras' twists with Geman and McClure's weights; normal equations in blocks
    of 6 × 6 per pair of cameras, solved sparsely.

    Parameters
    ----------
    cameras : by frame, in the scaled world, the keyframes' among them
    matches : by frame
    held : the known cameras, by frame: they move by pixels only if the matches insist. What is
        printed on a plane may slide along it, and all faces of a box's corner may grow from it;
        then these cameras alone fix the whole
    hold : pixels, RMS, by which those may be wrong
    outlines : of some frames, which tell where the surface ends, whatever is printed on it
    settled : the cameras were adjusted before: no loop has come apart
    """
    cameras, keyframes = dict(cameras), list(keyframes)
    order = {frame: at for at, frame in enumerate(cameras)}
    scale, width = 1.0, OUTLIER if settled else WIDEST
    holds = {
        frame: motion_cost(camera, surface.visible_points(camera), hold)
        for frame, camera in held.items()
    }
    ties = {frame: [_thinned(each) for each in found] for frame, found in matches.items()}
    for turn in range(ROUNDS):
        system = _System(len(order), free_focal)
        deviations = []
        for frame, found in ties.items():
            for each in found:
                keyframe = keyframes[each.keyframe]
                if frame == keyframe.index or len(each) == 0:
                    continue
                r, J = _linear(keyframe, each, cameras[frame])
                deviation = np.linalg.norm(r, axis=1)
                deviations.append(deviation)
                weight = 1 / (1 + (deviation / width) ** 2) ** 2
                pair = [order[frame], order[keyframe.index]]
                system.add(pair, r, J[:, :, : 12 + free_focal], weight)
        if not deviations:
            break
        for frame, lines in (outlines or {}).items():
            r, J = lines.linear(cameras[frame], free_focal)
            weight = 1 / (1 + (np.linalg.norm(r, axis=1) / OUTLIER) ** 2) ** 2 / NEIGHBOURS
            system.add([order[frame]], r, J, weight)
        for frame, camera in held.items():
            system.hold(order[frame], twist_between(camera, cameras[frame]), holds[frame])
        scale = max(float(np.median(np.concatenate(deviations))) / 1.18, 1.0)
        twists, log_focal = system.solve()
        for frame, at in order.items():
            camera = moved(cameras[frame], twists[at])
            grown = float(np.exp(log_focal))
            cameras[frame] = replace(camera, fx=camera.fx * grown, fy=camera.fy * grown)
        if turn % LIFT == 0:
            keyframes = [k.with_camera(cameras[k.index], surface) for k in keyframes]
        else:
            keyframes = [k.slid(cameras[k.index]) for k in keyframes]
        if width == OUTLIER * scale and system.motion(twists) < DONE:
            break
        width = max(width / 2, OUTLIER * scale)
    return _judged(cameras, keyframes, matches, order, scale)


def _thinned(matches: Matches) -> Matches:
    """Every so many, and no more than are needed."""
    return matches[np.arange(0, len(matches), max(-(-len(matches) // TIES), 1))]


def _judged(cameras, keyframes, matches, order, scale) -> Adjusted:
    """The inliers, and each frame's error with all other cameras held."""
    inliers, residual, uncertainty = {}, {}, {}
    for frame, found in matches.items():
        errors, A, spread = [], np.zeros((6, 6)), []
        for each in found:
            r, J = _linear(keyframes[each.keyframe], each, cameras[frame])
            own = J[:, :, :6]
            good = np.linalg.norm(r, axis=1) < OUTLIER * scale
            A += np.einsum("nij,nik->jk", own[good], own[good])
            inverse = np.linalg.inv(each.whitener[good])
            errors.append(np.einsum("nij,nj->ni", inverse, r[good]))
            spread.append(inverse @ own[good])
        inliers[frame] = sum(map(len, errors))
        if inliers[frame] < 6:
            residual[frame], uncertainty[frame] = float("nan"), float("inf")
            continue
        J, e = np.concatenate(spread), np.concatenate(errors)
        residual[frame] = float(np.sqrt((e**2).sum(1).mean()))
        covariance = np.linalg.pinv(A) * scale**2
        squared = np.einsum("nij,jk,nik->", J, covariance, J) / len(J)
        uncertainty[frame] = float(np.sqrt(squared))
    return Adjusted(cameras, keyframes, inliers, residual, uncertainty)


class _System:
    """Normal equations in blocks: one per camera on the diagonal, one per pair that is tied."""

    def __init__(self, count: int, free_focal: bool) -> None:
        self.count, self.focals = count, int(free_focal)
        self.blocks: dict[tuple[int, int], np.ndarray] = {}
        self.right = np.zeros((count, 6))
        self.border = np.zeros((count, 6, self.focals))
        self.corner = np.zeros((self.focals, self.focals))
        self.right_focal = np.zeros(self.focals)
        self.pixels = np.zeros((count, 6, 6))
        self.seen = np.zeros(count)

    def add(self, tied, r, J, weight) -> None:
        """Residuals (n, 2) of the first of one or two cameras, and their slopes (n, 2, m) by the
        twist of each, and by the logarithm of the focal length where that is free."""
        J = J.reshape(2 * len(r), -1)
        weighted = J * np.repeat(weight, 2)[:, None]
        A, b = weighted.T @ J, weighted.T @ r.ravel()
        end = 6 * len(tied)
        for a, at in zip(tied, range(0, end, 6), strict=True):
            self.right[a] += b[at : at + 6]
            self.border[a] += A[at : at + 6, end:]
            for c, to in zip(tied, range(0, end, 6), strict=True):
                block = self.blocks.setdefault((a, c), np.zeros((6, 6)))
                block += A[at : at + 6, to : to + 6]
        self.corner += A[end:, end:]
        self.right_focal += b[end:]
        self.pixels[tied[0]] += A[:6, :6]
        self.seen[tied[0]] += len(r)

    def hold(self, i: int, gone: np.ndarray, cost: np.ndarray) -> None:
        """Draw camera `i`, which has gone by a twist, back at a cost (6, 6)."""
        block = self.blocks.setdefault((i, i), np.zeros((6, 6)))
        block += cost
        self.right[i] -= cost @ gone

    def solve(self) -> tuple[np.ndarray, float]:
        n = 6 * self.count
        for at in range(self.count):
            self.blocks.setdefault((at, at), np.zeros((6, 6)))
        keys = sorted(self.blocks)
        rows = np.searchsorted([k[0] for k in keys], np.arange(self.count + 1))
        data = np.array([self.blocks[k] for k in keys])
        A = csc_array(bsr_array((data, np.array([k[1] for k in keys]), rows), shape=(n, n)))
        diagonal = A.diagonal()
        A = A + csc_array(
            (DAMPING * diagonal + 1e-9 * max(diagonal.max(), 1e-9), (range(n), range(n)))
        )
        factor = splu(csc_array(A))
        twists = factor.solve(self.right.ravel())
        if not self.focals:
            return twists.reshape(-1, 6), 0.0
        # The focal length borders the system: eliminate the cameras
        border = self.border.reshape(n, 1)
        carried = factor.solve(border)
        log_focal = float(
            (self.right_focal - border.T @ twists)[0] / (self.corner - border.T @ carried)[0, 0]
        )
        return (twists - carried[:, 0] * log_focal).reshape(-1, 6), log_focal

    def motion(self, twists: np.ndarray) -> float:
        """The largest RMS motion of any camera's features, in standard deviations."""
        squared = np.einsum("fi,fij,fj->f", twists, self.pixels, twists)
        return float(np.sqrt((squared / np.maximum(self.seen, 1)).max()))
