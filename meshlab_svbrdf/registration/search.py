"""The camera whose view of the geometry tells most about a frame, searched from coarse to fine."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ..geometry.camera import Camera
from .mutual_information import Comparison, face_predictors
from .surface import Surface

SIZES = (60, 120, 240)  # pixels that the object's radius has at each step, from coarse to fine
REACH = 0.09  # radians, or share of the distance, by which a start may be off
TRIALS = 600  # cameras that are looked at before the search
KEPT = (20, 6, 2)  # of them, that each step improves
AGREE = 0.015  # of the object's radius in the frame, within which two searches end alike
NEAREST = 1.5  # pixels; the same, where the object is small
AHEAD = 0.02  # nats a pixel, by which another place must be worse, and no object at all


class Refined(NamedTuple):
    """camera, score (information, nats a pixel), converged: whether it can be relied on."""

    camera: Camera
    score: float
    converged: bool


class _Motions:
    """Cameras around one, by numbers that are independent: whichever changes by d moves what is
    seen of the object by d pixels, RMS.

    A turn about the object's centre looks much like a shift. In these numbers what tells them apart
    weighs as much as what they share.
    """

    def __init__(self, camera: Camera, points: np.ndarray, free_focal: bool) -> None:
        self.camera, self.points, self.free_focal = camera, points, free_focal
        self.directions = np.eye(6 + free_focal)
        unit = 1e-4
        here = camera.project(points)[:, :2]
        slopes = [
            (self(unit * axis).project(points)[:, :2] - here).ravel() / unit
            for axis in self.directions
        ]
        gram = np.array(slopes) @ np.array(slopes).T / len(points)
        values, vectors = np.linalg.eigh(gram)
        # What moves nothing is left alone
        values = np.maximum(values, 1e-6 * values[-1])
        self.directions = (vectors / np.sqrt(values)).T

    def __call__(self, numbers: np.ndarray) -> Camera:
        n, c = np.asarray(numbers) @ self.directions, self.camera
        turned = Rotation.from_rotvec(n[:3]).as_matrix() @ c.R
        t = c.t + c.t[2] * n[3:6]
        longer = np.exp(n[6]) if self.free_focal else 1.0
        return replace(c, R=turned, t=t, fx=c.fx * longer, fy=c.fy * longer)


class InformationSearch:
    """`refine_camera` for many frames of one surface; cameras in the world."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.predictors = face_predictors(surface)

    def refine(self, image: np.ndarray, camera: Camera, free_focal: bool = False) -> Refined:
        """See `refine_camera`."""
        if image.shape[:2] != (camera.height, camera.width):
            raise ValueError(
                f"image: expected {camera.width}×{camera.height} as the camera says, "
                f"not {image.shape[1]}×{image.shape[0]}"
            )
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
        start = self.surface.inner(camera)
        rim = start.fx / max(start.t[2], 1e-9)
        window = self._window(start)
        steps = [
            Comparison(
                self.surface, self.predictors, image, max(round(rim / size), 1), window,
                alike=size == SIZES[-1],
            )
            for size in SIZES
        ]  # fmt: skip
        # From coarse to fine, with fewer and fewer of those that may be it
        found, rivals = _spread(_shifted(steps[0], start), steps[0]), []
        for step, kept in zip(steps, KEPT, strict=True):
            radius = REACH * rim / 4 if step is steps[0] else 4.0 * step.times
            climbed = [self._climb(step, each, radius, free_focal) for each in found[:kept]]
            told = [(step.information(step.faces(camera)), camera) for camera in climbed]
            told.sort(key=lambda pair: -pair[0])
            found = [camera for _, camera in told]
            if step is not steps[-1]:
                rivals = told
        score = steps[-1].information(steps[-1].faces(found[0]))
        near = max(AGREE * rim, NEAREST)
        converged = score > AHEAD and _clear(
            found[0], rivals, self.surface.visible_points(found[0]), near
        )
        return Refined(self.surface.outer(found[0]), score, converged)

    def _climb(self, step: Comparison, camera: Camera, radius: float, free_focal: bool) -> Camera:
        """The camera of most information nearby (COBYQA: Ragonneau 2022, which needs no slopes)."""
        points = self.surface.visible_points(camera)
        if len(points) < 6:
            return camera
        motions = _Motions(camera, points, free_focal)
        result = minimize(
            lambda numbers: -step.information(step.faces(motions(numbers))),
            np.zeros(6 + free_focal),
            method="COBYQA",
            options={
                "initial_tr_radius": radius, "final_tr_radius": 0.1 * step.times, "maxfev": 200,
            },
        )  # fmt: skip
        return motions(result.x)

    def _window(self, camera: Camera) -> tuple[int, int, int, int]:
        """Where the object can be: around where it should be by as much as the start may be off."""
        left, top, right, bottom = self.surface.window(camera)
        more = int(REACH * camera.fx)
        return (
            max(left - more, 0), max(top - more, 0),
            min(right + more, camera.width), min(bottom + more, camera.height),
        )  # fmt: skip


def _clear(
    best: Camera, rivals: list[tuple[float, Camera]], points: np.ndarray, near: float
) -> bool:
    """Whether the last but one step has led to the same camera, from elsewhere too or far ahead.

    rivals : what that step has found, information and camera, best first
    points : (n, 3) of the object; near : pixels, RMS, that are the same place
    """
    here = best.project(points)[:, :2]
    miss = [np.sqrt(((c.project(points)[:, :2] - here) ** 2).sum(1).mean()) for _, c in rivals]
    same = np.array(miss) < near
    told = np.array([information for information, _ in rivals])
    if not same[0]:
        return False
    return bool(same.sum() >= 2 or told[0] - told[~same].max(initial=-np.inf) > AHEAD)


def _spread(camera: Camera, step: Comparison) -> list[Camera]:
    """Cameras within reach of one, turned about the object and nearer or farther; best first."""
    rng = np.random.default_rng(1)
    cameras = [camera]
    for _ in range(TRIALS):
        turn = rng.normal(size=3)
        turn *= REACH * rng.uniform() ** (1 / 3) / np.linalg.norm(turn)
        farther = 1 + REACH * rng.uniform(-0.7, 0.7)
        R = Rotation.from_rotvec(turn).as_matrix() @ camera.R
        cameras.append(replace(camera, R=R, t=camera.t * [1, 1, farther]))
    return sorted(cameras, key=lambda c: -step.information(step.faces(c)))


def _shifted(step: Comparison, camera: Camera) -> Camera:
    """The camera turned so that the object lies where, in the plane, it fits best."""
    face = step.faces(camera)
    reach = int(np.ceil(REACH * camera.fx / step.times))
    shifts = [(c, r) for c in range(-reach, reach + 1) for r in range(-reach, reach + 1)]
    best = max(shifts, key=lambda s: step.shifted(face, *s))
    move = np.array([best[0] / camera.fx, best[1] / camera.fy]) * step.times * camera.t[2]
    return replace(camera, t=camera.t + np.append(move, 0))
