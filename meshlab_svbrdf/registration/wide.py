"""A frame found again without any guess: features of its own, compared with the keyframes' (Lowe
2004), each of which has its place on the surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from .keyframes import MARGIN, Keyframe, lift
from .pose import fit_camera

FEATURES = 4000  # of a whole frame
RATIO = 0.85  # of the distances to the nearest and the second nearest descriptor
REACH = 8.0  # pixels within which a match agrees with a camera
FEWEST = 10


@dataclass(frozen=True)
class Signature:
    """pixels (n, 2) float64 of the whole frame; descriptors (n, 128) float32, unit."""

    pixels: np.ndarray
    descriptors: np.ndarray


NOTHING = Signature(np.zeros((0, 2)), np.zeros((0, 128), np.float32))


def describe(image: np.ndarray) -> Signature:
    """A frame's own features; image (h, w) uint8."""
    found, values = cv2.SIFT_create(FEATURES, contrastThreshold=0.02).detectAndCompute(image, None)
    if values is None:
        return NOTHING
    # Hellinger's distance (Arandjelović and Zisserman 2012)
    values = np.sqrt(values / np.maximum(values.sum(1, keepdims=True), 1e-9))
    return Signature(np.array([f.pt for f in found], float), values.astype(np.float32))


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
    """Pixels (n, 2) of a frame and points (n, 3) whose descriptors are alike, and no other's are."""
    if len(descriptors) < 2 or len(signature.descriptors) < 2:
        return np.zeros((0, 2)), np.zeros((0, 3))
    likeness = descriptors @ signature.descriptors.T
    best = np.argpartition(likeness, -2, axis=1)[:, -2:]
    values = np.take_along_axis(likeness, best, 1)
    order = np.argsort(-values, axis=1)
    values, best = np.take_along_axis(values, order, 1), np.take_along_axis(best, order, 1)
    distance = np.sqrt(np.maximum(2 - 2 * values, 0))
    good = distance[:, 0] < RATIO * distance[:, 1]
    mutual = likeness.argmax(0)[best[:, 0]] == np.arange(len(best))
    good &= mutual
    return signature.pixels[best[good, 0]], points[good]


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
