"""A frame found again without any guess: features of its own, compared with the keyframes' (Lowe
2004), each of which has its place on the surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from .keyframes import MARGIN, Keyframe, lift
from .pose import fit_camera

FEATURES = 2500  # of a whole frame
LARGE = 400  # features, the largest, that tell which frames have something in common
RATIO = 0.85  # of the distances to the nearest and the second nearest descriptor
REACH = 8.0  # pixels within which a match agrees with a camera
FEWEST = 10


@dataclass(frozen=True)
class Signature:
    """The largest features first.

    pixels : (n, 2) float64, of the whole frame; descriptors : (n, 128) float32, unit
    """

    pixels: np.ndarray
    descriptors: np.ndarray


NOTHING = Signature(np.zeros((0, 2)), np.zeros((0, 128), np.float32))


def describe(image: np.ndarray) -> Signature:
    """A frame's own features; image (h, w) uint8."""
    found, values = cv2.SIFT.create(FEATURES, contrastThreshold=0.02).detectAndCompute(image, None)
    if values is None:
        return NOTHING
    order = np.argsort([-f.size for f in found], kind="stable")
    # Hellinger's distance (Arandjelović and Zisserman 2012)
    values = np.sqrt(values / np.maximum(values.sum(1, keepdims=True), 1e-9))
    pixels = np.array([f.pt for f in found], float)
    return Signature(pixels[order], values[order].astype(np.float32))


def on_surface(signature: Signature, keyframe: Keyframe) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, 3) and descriptors of a keyframe's features that lie on the object."""
    view, pixels = keyframe.view, signature.pixels
    h, w = view.inside.shape
    at = np.rint(pixels - [view.left, view.top]).astype(int)
    near = ((at >= 0) & (at < [w, h])).all(1)
    near[near] = view.inside[at[near, 1], at[near, 0]] >= MARGIN
    _, points, _, ok = lift(view, pixels[near])
    return points[ok], signature.descriptors[near][ok]


def pair(signature: Signature, points: np.ndarray, descriptors: np.ndarray):
    """Pixels (n, 2) of a frame and points (n, 3) whose descriptors alone are alike."""
    here, there = _alike(descriptors, signature.descriptors)
    return signature.pixels[there], points[here]


def likeness(a: np.ndarray, b: np.ndarray) -> int:
    """How many of the largest features (n, 128) and (m, 128) of two frames are alike."""
    return len(_alike(a[:LARGE], b[:LARGE])[0])


def _alike(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of unit vectors (n, d) and (m, d) that are each other's nearest, and clearly so."""
    if len(a) < 2 or len(b) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    product = a @ b.T
    rows, best = np.arange(len(a)), product.argmax(1)
    mutual = product.argmax(0)[best] == rows
    first = product[rows, best].copy()
    product[rows, best] = -1
    second = product.max(1)
    good = mutual & (1 - first < RATIO**2 * (1 - second))
    return rows[good], best[good]


def camera_from_pairs(
    pixels: np.ndarray, points: np.ndarray, like: Camera
) -> tuple[Camera, int] | None:
    """The camera with the focal length of `like` that most pairs agree with, and their number."""
    if len(pixels) < FEWEST:
        return None
    cv2.setRNGSeed(1)
    ok, turn, t, inliers = cv2.solvePnPRansac(
        points, pixels, like.K, None, iterationsCount=2000, reprojectionError=REACH,
        confidence=0.9999, flags=cv2.SOLVEPNP_EPNP,
    )  # fmt: skip
    if not ok or inliers is None or len(inliers) < FEWEST:
        return None
    chosen = inliers.ravel()
    camera = replace(like, R=cv2.Rodrigues(turn)[0], t=t.ravel())
    whitener = np.tile(np.eye(2) / 2.0, (len(chosen), 1, 1))
    fit = fit_camera(points[chosen], pixels[chosen], whitener, camera)
    if fit is None:
        return None
    return fit.camera, len(chosen)
