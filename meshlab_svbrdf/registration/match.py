"""A frame compared with keyframes as they would look from a camera that is nearly right.

The surface has carried the keyframe over, so what is left are a few pixels of motion without turn
or scale: Lucas and Kanade's tracker finds them however far apart the two cameras are.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .contrast import normalise, structure_at
from .keyframes import CLIPPED, STEEP, Keyframe
from .surface import View
from .warp import warp

WINDOW = 21  # pixels
SIZE = (WINDOW, WINDOW)
LEVELS = 2
RETURN = 0.7  # pixels by which the way there and back may miss
OCCLUSION = 0.02  # radii
CODE_NOISE = 25.0  # codes of normalised contrast by which two views differ anyway
PIXEL_NOISE = 0.15  # pixels that no contrast takes away


@dataclass(frozen=True)
class Matches:
    """Features of one keyframe found in one frame.

    keyframe : position in the list of keyframes
    feature : (n,) of the keyframe; found : (n, 2) pixels of the whole frame
    whitener : (n, 2, 2), makes a residual's covariance 1
    """

    keyframe: int
    feature: np.ndarray
    found: np.ndarray
    whitener: np.ndarray

    def __len__(self) -> int:
        return len(self.feature)

    def __getitem__(self, chosen: np.ndarray) -> Matches:
        return Matches(
            self.keyframe, self.feature[chosen], self.found[chosen], self.whitener[chosen]
        )


@dataclass(frozen=True)
class Target:
    """The part of a frame in which the object is expected.

    crop : (h, w) uint8; seen : the same with its contrast normalised
    """

    view: View
    crop: np.ndarray
    seen: np.ndarray


def target(image: np.ndarray, view: View) -> Target:
    """A frame, (h, w) uint8, whole, prepared for matching where `view` expects the object."""
    crop = np.ascontiguousarray(view.crop(image))
    return Target(view, crop, normalise(crop, (view.inverse_depth > 0).view(np.uint8)))


def match(keyframe: Keyframe, position: int, frame: Target) -> Matches:
    """The keyframe's features in a frame whose view is nearly known.

    position : of the keyframe in its list
    """
    view, crop = frame.view, frame.crop
    picture = np.ascontiguousarray(keyframe.view.crop(keyframe.image))
    carried, valid = warp(picture, keyframe.view, view, OCCLUSION)
    feature, expected = _expected(keyframe, view, valid)
    if len(feature) == 0:
        return Matches(position, feature, expected, np.zeros((0, 2, 2)))
    predicted = normalise(carried, valid)

    # There and back
    start = expected.astype(np.float32)
    there, ok = _flow(predicted, frame.seen, start)
    back, ok_back = _flow(frame.seen, predicted, there)
    good = ok & ok_back & (np.abs(back - start).max(1) < RETURN)
    good &= (there >= 1).all(1) & (there < np.array(crop.shape)[::-1] - 2).all(1)
    # A highlight has no position of its own
    at = np.where(good[:, None], np.rint(there), 0).astype(int)
    good &= crop[at[:, 1], at[:, 0]] < CLIPPED
    feature, there, start = feature[good], there[good].astype(float), start[good]
    return Matches(
        position, feature, there + np.array([view.left, view.top]), _whitener(predicted, start)
    )  # fmt: skip


def _flow(here: np.ndarray, there: np.ndarray, places: np.ndarray):
    """Where places (n, 2) float32 of one picture are in another, and whether they were found."""
    found, ok, _ = cv2.calcOpticalFlowPyrLK(
        here, there, places, np.empty_like(places), winSize=SIZE, maxLevel=LEVELS,
        minEigThreshold=1e-5,
    )  # fmt: skip
    return np.asarray(found), np.asarray(ok)[:, 0] > 0


def _expected(keyframe: Keyframe, view: View, valid: np.ndarray):
    """Features that the view sees well, (n,), and where in its crop, (n, 2)."""
    u, v, z = view.camera.project(keyframe.points).T
    towards = view.camera.center - keyframe.points
    facing = np.einsum("ni,ni->n", keyframe.normals, towards) > STEEP * np.linalg.norm(
        towards, axis=1
    )
    h, w = valid.shape
    ok = facing & (z > 0) & (u >= 1) & (v >= 1) & (u < w - 2) & (v < h - 2)
    index = np.flatnonzero(ok)
    row, col = np.rint(v[ok]).astype(int), np.rint(u[ok]).astype(int)
    inside = cv2.distanceTransform(valid, cv2.DIST_L2, 3)
    depth = view.inverse_depth[row, col]
    ok = (inside[row, col] >= WINDOW / 3) & (view.inside[row, col] >= WINDOW / 4) & (depth > 0)
    ok[ok] = np.abs(z[index[ok]] - 1 / depth[ok]) < OCCLUSION
    index = index[ok]
    return index, np.column_stack([u[index], v[index]])


def _whitener(predicted: np.ndarray, at: np.ndarray) -> np.ndarray:
    """From the structure of the picture around each place (n, 2): along an edge little is known."""
    products = np.empty((len(at), 3))
    structure_at(predicted, at, WINDOW // 2, products)
    values, vectors = np.linalg.eigh(products[:, [[0, 1], [1, 2]]])
    sigma = np.sqrt(CODE_NOISE**2 / np.maximum(values, 1e-3) + PIXEL_NOISE**2)
    return np.einsum("nij,nj,nkj->nik", vectors, 1 / sigma, vectors)
